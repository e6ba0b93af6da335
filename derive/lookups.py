"""Time, and cubic tables that kernels look up, as symbols."""

from __future__ import annotations

import sympy as sm
from sympy.core.function import AppliedUndef, ArgumentIndexError, UndefinedFunction

T = sm.Symbol("t")


def _lookup(name: str, derivative: str | None) -> UndefinedFunction:
    """A cubic table, NAME(x, start of its block in the parameters), whose derivative to x has a name of its own."""

    def fdiff(self, argindex: int = 1):
        if argindex != 1 or derivative is None:
            raise ArgumentIndexError(self, argindex)
        return _LOOKUPS[derivative](*self.args)

    return UndefinedFunction(name, (AppliedUndef,), {"fdiff": fdiff})


_LOOKUPS = {
    name: _lookup(name, derivative)
    for name, derivative in (
        ("table", "table_rate"), ("table_rate", "table_curvature"), ("table_curvature", "table_jerk"),
        ("table_jerk", None),
    )
}  # fmt: skip
table, table_rate, table_curvature, _ = _LOOKUPS.values()
