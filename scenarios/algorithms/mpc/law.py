"""Distributed predictive control: each robot plans 20 positions, and keeps away from the plans that it receives."""

import math

import phalanx


class Mpc(phalanx.Law):
    plan = None

    def gamma(self, situation):
        (x, y), (gx, gy) = situation.front_point, self.robot.params["goal_m"]
        self.plan = self.plan[1:] + self.plan[-1:] if self.plan else [(x, y)] * 20
        heard = [(n.message["plan_m"], n.contact) for n in situation.neighbors if n.message]
        others = [p[1:] + p[-1:] if c == "fresh" else p[:1] * 20 for p, c in heard]  # silent: it stopped
        if round(situation.t_s / self.robot.period_s) % self.robot.params["robots"] == self.robot.index - 1:
            plans = [self.plan, *self.plans((x, y), others, math.atan2(gy - y, gx - x))]
            self.plan = min(plans, key=lambda plan: cost(plan, (gx, gy)))
            if math.dist(self.plan[-1], (gx, gy)) > math.dist((x, y), (gx, gy)) - 0.01:
                right = x + gy - y, y - gx + x  # it finds no way ahead
                self.plan = min(plans, key=lambda plan: cost(plan, right))
        self.publish(plan_m=self.plan)
        self.target((gx, gy))
        return [(p - q) / situation.period_s for p, q in zip(self.plan[0], (x, y))]

    def plans(self, own, others, ahead):
        step_m, d_m = self.speed_m_s * self.robot.period_s, self.robot.params["d_m"]
        for turn in [ahead, *(math.pi * k / 8 for k in range(16))]:
            for moves in (1, 2, 5, 10):
                ways = (step_m * min(i, moves) for i in range(1, 21))
                plan = [(own[0] + s * math.cos(turn), own[1] + s * math.sin(turn)) for s in ways]
                if all(math.dist(a, b) >= d_m for o in others for a, b in zip(plan, o)):
                    yield plan


def cost(plan, goal):
    return sum(math.dist(x, goal) for x in plan)


phalanx.serve(Mpc)
