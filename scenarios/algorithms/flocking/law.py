"""Flocking: robots keep a distance to the neighbors in range, agree on a velocity, and are drawn to a moving point."""

import math

import phalanx


class Flocking(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.v = [0.0, 0.0]

    def gamma(self, situation):
        q, goal_v = situation.front_point, self.robot.params["velocity_m_s"]
        goal = [v * situation.t_s for v in goal_v]
        for axis in (0, 1):
            u = -self.c_1 * (q[axis] - goal[axis]) - self.c_2 * (self.v[axis] - goal_v[axis])
            for other in situation.neighbors:
                gap_m = math.dist(q, other.position)
                if gap_m < self.range_m:
                    weight = (1.0 - (gap_m / self.range_m) ** 2) ** 2
                    pull = self.a * weight * (gap_m - self.spacing_m) / gap_m
                    u += pull * (other.position[axis] - q[axis])
                    u += weight * (other.velocity[axis] - self.v[axis])
            self.v[axis] += u * situation.period_s
        self.record(velocity_error_m_s=math.dist(self.v, goal_v))
        return self.v


phalanx.serve(Flocking)
