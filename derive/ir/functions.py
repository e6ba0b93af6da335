"""Time, cubic tables that kernels look up, and functions of laws with sides, as symbols."""

from __future__ import annotations

import sympy as sm
from sympy.core.function import AppliedUndef, ArgumentIndexError, UndefinedFunction

T = sm.Symbol("t")


def _function(name: str, *derivatives) -> UndefinedFunction:
    """A function of ``generated/laws.py``; ``derivatives`` make those to its arguments of these, None where none is."""

    def fdiff(self, argindex: int = 1):
        if argindex > len(derivatives) or derivatives[argindex - 1] is None:
            raise ArgumentIndexError(self, argindex)
        return derivatives[argindex - 1](*self.args)

    return UndefinedFunction(name, (AppliedUndef,), {"fdiff": fdiff})


_TINY = sm.Float("1e-300")
"""Square of a distance that keeps the rate of an angle finite where it has none."""
sign, smaller, larger = (_function(name) for name in ("sign", "smaller", "larger"))
within = _function("within", lambda s: sm.S.Zero)
clamped = _function("clamped", within)
chosen = _function(
    "chosen", None, lambda side, a, b: chosen(side, sm.S.One, sm.S.Zero),
    lambda side, a, b: chosen(side, sm.S.Zero, sm.S.One),
)
around = _function(
    "around", None, lambda side, y, x: x / (x**2 + y**2 + _TINY), lambda side, y, x: -y / (x**2 + y**2 + _TINY)
)
table, table_rate, table_curvature = (_function(name) for name in ("table", "table_rate", "table_curvature"))
"""Lookups in a cubic table, NAME(x, start of its block in the parameters), and its derivatives."""
