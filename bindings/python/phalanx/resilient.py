"""Resilient consensus on values in messages: the W-MSR filter, which up to F liars among the in-neighbors cannot mislead.

LeBlanc, Zhang, Koutsoukos and Sundaram, IEEE JSAC 31(4), 2013. The laws ``formation-robust`` use the same function.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ._phalanx import resilient_mean as _resilient_mean


def w_msr(own: Any, values: Sequence[Any], liars_max: int) -> Any:
    """Returns the mean of the values without the ``liars_max`` largest above ``own`` and the ``liars_max`` smallest below it.

    ``own`` and each value are numbers, or sequences of numbers with one shape; each number is filtered on its own, and the
    result is a number or nested lists. It is ``own`` where no value is left. If at most ``liars_max`` of the values are
    false, the result lies between the smallest and the largest of ``own`` and the true ones.

    Raises ``ValueError`` if a value has another length than ``own``, or ``liars_max`` is negative.
    """
    if liars_max < 0:
        raise ValueError(f"liars_max is {liars_max}, expected 0 or more")
    if not hasattr(own, "__len__"):
        return _resilient_mean(own, list(values), liars_max)
    for value in values:
        if len(value) != len(own):
            raise ValueError(f"a value has {len(value)} elements, expected {len(own)} as in `own`")
    return [
        w_msr(part, [value[i] for value in values], liars_max) for i, part in enumerate(own)
    ]
