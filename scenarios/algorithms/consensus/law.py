"""Consensus on a directed graph with weights: robots meet in a weighted mean of their starts."""

import phalanx


class Consensus(phalanx.Law):
    def gamma(self, situation):
        pull = [0.0, 0.0]
        for other in situation.neighbors:
            weight = other.params.get("weight", 1.0)
            for axis in (0, 1):
                pull[axis] += weight * (other.position[axis] - situation.front_point[axis])
        return [self.k_per_s * p for p in pull]


phalanx.serve(Consensus)
