"""Event-triggered consensus: a robot sends its position only when it has moved too far from the one that it sent last."""

import math

import phalanx


class EventTriggered(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.sent, self.starts = None, {}

    def gamma(self, situation):
        own = situation.front_point
        starts = {n.name: n.incarnation for n in situation.neighbors}
        bound = self.c_0_m + self.c_1_m * math.exp(-self.a_per_s * situation.t_s)
        # A neighbor that has restarted knows no position yet.
        if self.sent is None or starts != self.starts or math.dist(own, self.sent) > bound:
            self.sent, self.starts = own, starts
            self.publish(x_m=own)
        else:
            self.withhold()
        heard = [n.message["x_m"] for n in situation.neighbors if n.message]
        return [self.k_per_s * sum(x[axis] - self.sent[axis] for x in heard) for axis in (0, 1)]


phalanx.serve(EventTriggered)
