"""Rigid formation by distances: gradient descent on the squared errors of the distances to the neighbors."""

import math

import phalanx


class Distances(phalanx.Law):
    def gamma(self, situation):
        x, y = situation.front_point
        gx = gy = worst = 0.0
        for other in situation.neighbors:
            dx, dy = x - other.position[0], y - other.position[1]
            wanted = self.robot.params["distances_m"][other.name]
            worst = max(worst, abs(math.hypot(dx, dy) - wanted))
            error = dx * dx + dy * dy - wanted * wanted
            gx, gy = gx - error * dx, gy - error * dy
        self.record(distance_error_m=worst)
        return self.k_per_m2_s * gx, self.k_per_m2_s * gy


phalanx.serve(Distances)
