"""Runs PettingZoo's own tests of a parallel environment, with warnings as errors."""

import sys
import warnings

import phalanx
from pettingzoo.test import parallel_api_test, parallel_seed_test

warnings.simplefilter("error")


def moved(env, seed):
    """Returns the observation of r1 after three steps of an episode with this seed."""
    env.reset(seed=seed)
    for _ in range(3):
        observations = env.step({name: (0.1, 0.0) for name in env.agents})[0]
    assert observations["r1"][0] == 1.0, "r1 has a valid observation"
    return observations["r1"]


scenario = sys.argv[1]
for action in ("velocity", "twist"):
    for more in ({}, {"faults": ["noise r1 odometry by 0.01 @0", "kill r2 @0.5", "freeze r3 @0.2 for 0.1"]}):

        def make():
            return phalanx.parallel_env(scenario, action=action, duration_s=1.0, **more)

        parallel_api_test(make(), num_cycles=1000)
        parallel_seed_test(make, num_cycles=500)
        assert (moved(make(), 7) == moved(make(), 7)).all()
        differ = (moved(make(), 7) != moved(make(), 8)).any()
        assert differ == bool(more), "the seed affects only the noise"
