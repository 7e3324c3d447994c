"""Distributed observer: each robot estimates the velocity of the leader, which only its first follower receives."""

import phalanx
from phalanx.real import tanh


class Observer(phalanx.Law):
    def __init__(self, **gains):
        super().__init__(**gains)
        self.v = [0.0, 0.0]

    def gamma(self, situation):
        heard = [n.message["v_hat_m_s"] if n.message else n.velocity for n in situation.neighbors]
        for axis in range(2):
            rate = sum(v[axis] - self.v[axis] for v in heard)
            self.v[axis] += situation.period_s * self.k_o_per_s * rate
        self.publish(v_hat_m_s=self.v)
        return [v - self.k_f_m_s * tanh(e) for v, e in zip(self.v, situation.error)]


phalanx.serve(Observer)
