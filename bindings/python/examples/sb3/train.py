"""Trains one policy for all robots of a shipped scenario with PPO, and writes its weights to policy.npz."""

from pathlib import Path

import numpy as np
import phalanx
import supersuit
from stable_baselines3 import PPO
from stable_baselines3.common.utils import set_random_seed
from stable_baselines3.common.vec_env import VecNormalize

set_random_seed(1)
env = phalanx.parallel_env("scenarios/triangle.toml", duration_s=8.0, period_s=0.1)
env = supersuit.pettingzoo_env_to_vec_env_v1(env)
env = supersuit.concat_vec_envs_v1(env, 8, num_cpus=1, base_class="stable_baselines3")
env = VecNormalize(env, norm_obs=False, gamma=0.8)
net = {"net_arch": [32, 32], "log_std_init": -1.5}
model = PPO("MlpPolicy", env, n_steps=25, batch_size=150, learning_rate=0.01, gamma=0.8, device="cpu", policy_kwargs=net)
model.learn(10_000)
layers = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
weights = [values.detach().numpy() for layer in layers for values in layer.parameters()]
np.savez(Path(__file__).parent / "policy.npz", *weights)
print(f"trained {model.num_timesteps} steps")
