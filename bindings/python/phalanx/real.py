"""The elementary functions of the built-in laws, the same on every machine.

Those of ``math`` are the C library's, and numpy's its own: they may differ in the last bit, and with them the
trajectory and its hash. Numbers in, numbers out, angles in rad.
"""

from ._phalanx import real as _real

asin = _real.asin
atan = _real.atan
atan2 = _real.atan2
cos = _real.cos
exp = _real.exp
hypot = _real.hypot
ln = _real.ln
pow = _real.pow
sin = _real.sin
tanh = _real.tanh
