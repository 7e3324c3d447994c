"""Formation by bearings: each robot moves until it sees its neighbors in the given directions. Two anchors stand still."""

import math

import phalanx


class Bearings(phalanx.Law):
    def gamma(self, situation):
        x, y = situation.front_point
        gx = gy = 0.0
        for other in situation.neighbors:
            turn = self.robot.params["bearings_rad"][other.name]
            # The part of the displacement that is across the wanted direction.
            across = math.cos(turn) * (other.position[1] - y) - math.sin(turn) * (other.position[0] - x)
            gx, gy = gx - across * math.sin(turn), gy + across * math.cos(turn)
        return self.k_per_s * gx, self.k_per_s * gy


phalanx.serve(Bearings)
