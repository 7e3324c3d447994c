"""Episodes and training with PPO through RLlib's wrapper of PettingZoo, on the scenario named on the command line."""

import os
import sys

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # Ray sends usage statistics by default.

import numpy as np
import phalanx
import ray
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

scenario = os.path.abspath(sys.argv[1])
KILL = ["kill r2 @0.2"]
ITERATIONS = 3


def make(settings):
    return ParallelPettingZooEnv(phalanx.parallel_env(scenario, duration_s=0.5, **settings))


def step_episode(faults):
    """Returns the number of steps of an episode and the agents at its end."""
    env = make({"faults": faults})
    observations, _ = env.reset(seed=1)
    for steps in range(1, 1000):
        active = list(env.par_env.agents)
        observations, rewards, terminated, truncated, _ = env.step({name: np.full(2, 0.1) for name in active})
        assert set(active) == set(observations) == set(rewards)
        for name in active:
            assert env.observation_space[name].contains(observations[name])
        if terminated["__all__"] or truncated["__all__"]:
            return steps, active
    raise AssertionError("the episode does not end")


def flat(weights):
    return np.concatenate([values.ravel() for values in weights["shared"].values()])


def train(workers, faults):
    """Trains one policy for all agents, with environments in this process (0 workers) or in worker processes."""
    config = (
        PPOConfig()
        .environment("scenario", env_config={"faults": faults})
        .env_runners(num_env_runners=workers, num_envs_per_env_runner=2)
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda *_, **__: "shared")
        .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[16]))
        .training(train_batch_size_per_learner=200, minibatch_size=100, num_epochs=1)
        .debugging(seed=1)
    )
    algorithm = config.build_algo()
    before = flat(algorithm.get_weights())
    for _ in range(ITERATIONS):
        sampled = algorithm.train()["env_runners"]
    after = flat(algorithm.get_weights())
    algorithm.stop()
    assert sampled["num_env_steps_sampled_lifetime"] >= ITERATIONS * 200, sampled
    assert -100.0 < sampled["episode_return_mean"] < 0.0, sampled
    assert np.isfinite(after).all() and (before != after).any()


for faults in ([], KILL):
    steps, active = step_episode(faults)
    print(f"stepped {steps} steps, {len(active)} robots at the end")

ray.init(address="local", num_cpus=1, include_dashboard=False, log_to_driver=False)
register_env("scenario", make)
for workers, faults in ((0, []), (0, KILL), (1, [])):
    train(workers, faults)
    print(f"trained {ITERATIONS} iterations, {workers} worker processes, faults {faults}")
ray.shutdown()
