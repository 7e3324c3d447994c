"""For the tests: sends drawn messages, and checks that each message of a neighbor is the one that it has sent, or at least of
the declared format if the run falsifies messages."""

import math
import random

import phalanx


def draw(robot, tick):
    dice = random.Random(1_000_003 * robot + tick)
    return dice.randbytes(dice.randint(1, 64))


class Exchange(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.kind = self.robot.params["kind"]
        self.seen = 0

    def gamma(self, situation):
        tick = round(situation.t_s / situation.period_s)
        for other in situation.neighbors:
            if other.message is not None:
                self.check(other, tick)
            self.seen += len(other.messages)
        if self.kind == "numbers":
            self.publish(x_m=[float(tick), -1.0], n=self.robot.index)
        else:
            self.publish(draw(self.robot.index, tick))
        self.record(seen=self.seen)
        return 0.0, 0.0

    def check(self, other, tick):
        if self.kind == "numbers":
            x, n = other.message["x_m"], other.message["n"]
            assert len(x) == 2 and all(math.isfinite(number) for number in (*x, n)), other.message
        elif self.kind == "falsified":
            assert 1 <= len(other.message) <= 64, len(other.message)
        else:
            sent = round(tick - other.message_age_s / 0.001)
            assert other.message == draw(other.index, sent), (tick, sent, other.message)


phalanx.serve(Exchange)
