"""The law `formation-tanh`, in Python: the same operations in the same order. (28)"""

import phalanx
from phalanx.real import tanh


class Tanh(phalanx.Law):
    def gamma(self, situation):
        (ex, ey), (vx, vy) = situation.error, situation.desired_velocity
        k = self.k_f_m_s
        return -k * tanh(ex) + vx, -k * tanh(ey) + vy


phalanx.serve(Tanh)
