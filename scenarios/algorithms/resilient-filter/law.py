"""Resilient consensus filter: as the consensus filter, but robots that send false estimates mislead no other robot."""

import random

import phalanx
from phalanx.resilient import w_msr

OBJECT = (1.0, 0.5)


class ResilientFilter(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.noise = random.Random(self.robot.seed + self.robot.incarnation)
        self.estimate = None

    def gamma(self, situation):
        radius = self.robot.params["noise_m"]
        measured = [p + self.noise.uniform(-radius, radius) for p in OBJECT]
        x = self.estimate or measured
        heard = [n.message["estimate_m"] for n in situation.neighbors if n.message]
        agreed = w_msr(x, heard, self.robot.params["liars_max"])
        k = [self.k_c_per_s * situation.period_s, self.k_m_per_s * situation.period_s]
        x = [x[a] + k[0] * (agreed[a] - x[a]) + k[1] * (measured[a] - x[a]) for a in (0, 1)]
        self.estimate = x
        self.publish(estimate_m=x)
        goal = [x[a] + self.robot.place[a] for a in (0, 1)]
        self.target(goal)
        return [self.k_per_s * (goal[a] - situation.front_point[a]) for a in (0, 1)]


phalanx.serve(ResilientFilter)
