"""Vector environments of SuperSuit on the scenario named on the command line, in this process and in two worker processes."""

import sys

import numpy as np
import phalanx
import supersuit

scenario = sys.argv[1]


def make():
    return phalanx.parallel_env(scenario, duration_s=0.5, faults=["noise r1 odometry by 0.01 @0"])


agents = len(make().possible_agents)
for processes in (0, 2):
    vectors = supersuit.concat_vec_envs_v1(
        supersuit.pettingzoo_env_to_vec_env_v1(make()), 4, num_cpus=processes, base_class="gymnasium"
    )
    vectors.reset(seed=3)
    action = np.full((4 * agents, 2), 0.1)
    for _ in range(300):
        observations, rewards, _, truncations, _ = vectors.step(action)
        assert observations.shape == (4 * agents, *vectors.observation_space.shape)
        assert np.isfinite(observations).all() and (rewards <= 0.0).all()
    vectors.close()
    print(f"stepped 4 environments, {processes} processes")

killed = supersuit.black_death_v3(phalanx.parallel_env(scenario, duration_s=0.5, faults=["kill r2 @0.2"]))
killed = supersuit.pettingzoo_env_to_vec_env_v1(killed)
killed.reset(seed=1)
for _ in range(200):
    killed.step(np.zeros((agents, 2)))
print("stepped with a robot that dies")
