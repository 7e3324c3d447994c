"""A rollout by TorchRL's wrapper of PettingZoo on the scenario named on the command line."""

import sys

import phalanx
from torchrl.envs import PettingZooWrapper

env = PettingZooWrapper(phalanx.parallel_env(sys.argv[1], duration_s=0.5), use_mask=False)
rollout = env.rollout(20)
print("rollout", tuple(rollout.batch_size), sorted(map(str, rollout.keys())))
assert rollout.batch_size[0] == 20
