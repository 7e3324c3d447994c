"""The law `leader-tanh`, in Python. (28)"""

import phalanx
from phalanx.real import tanh


class LeaderTanh(phalanx.Law):
    def gamma(self, situation):
        (ex, ey), (vx, vy) = situation.error, situation.desired_velocity
        k = self.k_m_m_s
        return -k * tanh(ex) + vx, -k * tanh(ey) + vy


phalanx.serve(LeaderTanh)
