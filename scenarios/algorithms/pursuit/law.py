"""Cyclic pursuit: each robot moves at a constant angle to the next one, and all circle around the mean of their starts."""

import math

import phalanx


class Pursuit(phalanx.Law):
    def gamma(self, situation):
        cos, sin = math.cos(math.pi / self.robots), math.sin(math.pi / self.robots)
        for other in situation.neighbors:
            x, y = (p - q for p, q in zip(other.position, situation.front_point))
            return self.k_per_s * (cos * x + sin * y), self.k_per_s * (cos * y - sin * x)
        return 0.0, 0.0


phalanx.serve(Pursuit)
