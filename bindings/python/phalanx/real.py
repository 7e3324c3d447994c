"""Elementary functions of the built-in laws, with the same results on every machine.

The functions of ``math`` and numpy may differ in the last bit, which changes the trajectory and its hash. Arguments
and results are numbers, angles in rad.
"""

from collections.abc import Callable

from ._phalanx import real as _real

asin: Callable[[float], float] = _real.asin
atan: Callable[[float], float] = _real.atan
atan2: Callable[[float, float], float] = _real.atan2
cos: Callable[[float], float] = _real.cos
exp: Callable[[float], float] = _real.exp
hypot: Callable[[float, float], float] = _real.hypot
ln: Callable[[float], float] = _real.ln
pow: Callable[[float, float], float] = _real.pow
sin: Callable[[float], float] = _real.sin
tanh: Callable[[float], float] = _real.tanh
