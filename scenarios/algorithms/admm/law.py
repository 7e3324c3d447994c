"""ADMM: robots agree on the point that minimizes the sum of their costs w |x - a|^2, each of which only one knows."""

import phalanx


class Admm(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.a, self.w = self.robot.params["a_m"], self.robot.params["w"]
        self.x = list(self.a)
        self.duals, self.starts = {}, {}

    def gamma(self, situation):
        c, heard = self.robot.params["c"], {}
        for other in situation.neighbors:
            if self.starts.get(other.name) != other.incarnation:
                # The neighbor has restarted with dual variable 0, so that of this end starts again, too.
                self.starts[other.name], self.duals[other.name] = other.incarnation, [0.0, 0.0]
            if other.message and other.contact == "fresh":
                heard[other.name] = other.message["x_m"]
        for name, x in heard.items():
            for axis in (0, 1):
                self.duals[name][axis] += c * (self.x[axis] - x[axis])
        old = self.x
        self.x = [
            (
                2 * self.w * self.a[axis]
                - sum(self.duals[name][axis] for name in heard)
                + c * sum(old[axis] + x[axis] for x in heard.values())
            )
            / (2 * self.w + 2 * c * len(heard))
            for axis in (0, 1)
        ]
        self.publish(x_m=self.x)
        goal = [x + place for x, place in zip(self.x, self.robot.place)]
        self.target(goal)
        return [self.k_per_s * (g - p) for g, p in zip(goal, situation.front_point)]


phalanx.serve(Admm)
