"""The law of tanh.py until 1 s; then it fails in the way that the file's name states."""

import ctypes
import math
import os
import signal
import time
from pathlib import Path

import phalanx
from phalanx.real import tanh


def siblings():
    """Returns the children of the supervisor except for this robot's keeper, which is the parent of this process."""
    keeper = os.getppid()
    supervisor = int(Path(f"/proc/{keeper}/stat").read_text().rpartition(")")[2].split()[1])
    children = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    return [int(pid) for pid in children if int(pid) != keeper]


class Hostile(phalanx.Law):
    def gamma(self, situation):
        (ex, ey), (vx, vy) = situation.error, situation.desired_velocity
        k = self.k_f_m_s
        if situation.t_s >= 1.0:
            return getattr(self, Path(__file__).stem)()
        return -k * tanh(ex) + vx, -k * tanh(ey) + vy

    def raises(self):
        raise ValueError("my law is at its end")

    def returns_nan(self):
        return math.nan, 0.0

    def returns_a_string(self):
        return "north"

    def returns_bytes(self):
        return b"ab"

    def returns_a_dict(self):
        return {0: 0.1, 1: 0.2}

    def returns_three(self):
        return 0.1, 0.2, 0.3

    def sleeps(self):
        time.sleep(1.0)
        return 0.0, 0.0

    def eats(self):
        held = []
        while True:
            held.append(bytearray(1_000_000))

    def leaves(self):
        os._exit(0)

    def loops(self):
        while True:
            pass

    def kills(self):
        for pid in siblings():
            os.kill(pid, signal.SIGKILL)
        return 0.0, 0.0

    def crashes(self):
        ctypes.string_at(0)


phalanx.serve(Hostile)
