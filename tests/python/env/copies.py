"""Copies, pickles and draws an environment of the scenario named on the command line."""

import copy
import pickle
import sys
import warnings

import cloudpickle
import gymnasium
import numpy as np
import phalanx

scenario = sys.argv[1]


def make(**more):
    return phalanx.parallel_env(scenario, duration_s=1.0, faults=["noise r1 odometry by 0.01 @0"], **more)


def end(env):
    """Returns the hash at the end of an episode whose actions depend on the observations."""
    while env.agents:
        observations = {name: env.observation(env.situation(name)) for name in env.agents}
        env.step({name: (-seen[1], -seen[2]) for name, seen in observations.items()})
    return env.trajectory_hash


env = make()
try:
    env.step({})
    raise SystemExit("step before reset was accepted")
except gymnasium.error.ResetNeeded as error:
    assert "call reset first" in str(error), error

env.reset(seed=7, options={"overrides": {"robot": {"r1": {"pose": {"heading_rad": 1.0}}}}})
for _ in range(20):
    env.step({name: (0.1, 0.05) for name in env.agents})
for copied in (copy.deepcopy(env), copy.copy(env), *(p.loads(p.dumps(env)) for p in (pickle, cloudpickle))):
    assert copied.trajectory_hash == env.trajectory_hash
    assert copied.agents == env.agents and (copied.state() == env.state()).all()
    assert (copied.period_s, copied.render_mode) == (env.period_s, env.render_mode)
    last = end(copied)
    assert last != env.trajectory_hash, "a copy must have a separate episode"
assert end(env) == last
first, second = env.reset()[0], copied.reset()[0]
assert all((first[name] == second[name]).all() for name in first), "the next seeds are the same"
assert not pickle.loads(pickle.dumps(make())).agents

with warnings.catch_warnings(record=True) as told:
    warnings.simplefilter("always")
    assert make().render() is None
    assert "render_mode" in str(told[0].message), told
env = make(render_mode="rgb_array")
assert env.metadata["render_fps"] == round(1.0 / env.period_s) and env.render_mode in env.metadata["render_modes"]
env.reset()
before = env.render()
assert before.shape == (480, 480, 3) and before.dtype == np.uint8
assert (before != 255).any() and (before == 255).all(axis=2).mean() > 0.5, "robots on white"
assert (env.render() == before).all(), "drawing must not change the state"
for _ in range(20):
    env.step({name: (0.2, 0.0) for name in env.agents})
assert (env.render() != before).any(), "the robots must have moved"
assert (pickle.loads(pickle.dumps(env)).render() == env.render()).all()
assert env.state().shape == env.state_space.shape and env.state_space.contains(env.state())
print("copied, pickled and drawn")
