"""The law `formation-tanh`, in Python: the same operations in the same order. (28)"""

import math

import phalanx


class Tanh(phalanx.Law):
    def gamma(self, situation):
        (ex, ey), (vx, vy) = situation.error, situation.desired_velocity
        k = self.k_f_m_s
        return -k * math.tanh(ex) + vx, -k * math.tanh(ey) + vy


phalanx.serve(Tanh)
