"""The law `leader-tanh`, in Python. (28)"""

import math

import phalanx


class LeaderTanh(phalanx.Law):
    def gamma(self, situation):
        (ex, ey), (vx, vy) = situation.error, situation.desired_velocity
        k = self.k_m_m_s
        return -k * math.tanh(ex) + vx, -k * math.tanh(ey) + vy


phalanx.serve(LeaderTanh)
