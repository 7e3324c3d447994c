"""Coverage: each robot moves to the centroid of its Voronoi cell in the unit square (Lloyd)."""

import phalanx

CELLS = 24
GRID = [((i + 0.5) / CELLS, (j + 0.5) / CELLS) for i in range(CELLS) for j in range(CELLS)]


class Coverage(phalanx.Law):
    def gamma(self, situation):
        x, y = situation.front_point
        others = [n.position for n in situation.neighbors]
        cell = [
            (u, v)
            for u, v in GRID
            if all((u - x) ** 2 + (v - y) ** 2 <= (u - a) ** 2 + (v - b) ** 2 for a, b in others)
        ]
        if not cell:
            return 0.0, 0.0
        goal = [sum(point[axis] for point in cell) / len(cell) for axis in (0, 1)]
        self.target(goal)
        self.record(cost_m2=sum((u - x) ** 2 + (v - y) ** 2 for u, v in cell) / len(GRID))
        return self.k_per_s * (goal[0] - x), self.k_per_s * (goal[1] - y)


phalanx.serve(Coverage)
