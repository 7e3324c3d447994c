"""A robot whose law is the policy of policy.npz: two hidden layers with tanh."""

import numpy as np
import phalanx

OBSERVATION = phalanx.Observation(neighbors=1, near=4)  # the same as in the environment
SPEED_MAX_M_S = 0.3  # the scenario's speed_max_m_s, to which the trainer clips actions


class Policy(phalanx.Law):
    def __init__(self):
        with np.load("policy.npz") as file:
            weights = list(file.values())
        *self.hidden, self.last = zip(weights[::2], weights[1::2])

    def gamma(self, situation):
        numbers = np.array(OBSERVATION(situation))
        for weight, bias in self.hidden:
            numbers = np.tanh(weight @ numbers + bias)
        weight, bias = self.last
        return np.clip(weight @ numbers + bias, -SPEED_MAX_M_S, SPEED_MAX_M_S)


phalanx.serve(Policy)
