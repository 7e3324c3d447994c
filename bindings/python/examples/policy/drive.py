"""A robot that is driven by the policy."""

import numpy as np
import phalanx
from policy import OBSERVATION, twist


class Policy(phalanx.Controller):
    def __init__(self):
        self.weights = np.load("policy.npy")

    def twist(self, odometry, neighbors, t_s):
        return twist(self.weights, OBSERVATION(odometry, neighbors))


phalanx.serve(Policy)
