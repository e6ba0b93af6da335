"""Generated kernels over arrays: NumPy evaluates the text that numba compiles for loops, so that a run compiles none.

Kernels of a rigid motion and of elements are sums and products without a branch, so their numbers may be arrays of as
many instants or elements. What they call that branches by its argument is here for arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, reduce
from types import FunctionType
from typing import Any

import numpy as np

Numbers = float | np.ndarray


@cache
def on_arrays(kernel: Any) -> Callable[..., Any]:
    """Function of a compiled kernel's text, with the functions that it calls, whose numbers may be arrays."""
    function = getattr(kernel, "py_func", kernel)
    if function.__name__ in _FOR_ARRAYS:
        return _FOR_ARRAYS[function.__name__]
    known, names = function.__globals__, function.__code__.co_names
    called = {name: on_arrays(known[name]) for name in names if hasattr(known.get(name), "py_func")}
    text = FunctionType(function.__code__, known | _FOR_ARRAYS | called, function.__name__, None, function.__closure__)

    def evaluated(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):  # as compiled: what is no number comes through
            return text(*arguments)

    return evaluated


def place_in_table(x: Numbers, p: np.ndarray, start: int) -> tuple[Numbers, np.ndarray]:
    """Distance from the breakpoint before x, and where the cubic there begins."""
    n, period = int(p[start]), p[start + 1]
    knots = p[start + 2 : start + 3 + n]
    if period > 0.0:
        x = knots[0] + (x - knots[0]) % period
    low = np.clip(np.searchsorted(knots, x, side="right") - 1, 0, n - 1)
    return x - knots[low], start + 3 + n + 4 * low


def _around(side: Numbers, y: Numbers, x: Numbers) -> Numbers:
    """Angle of (x, y), on this side of y across its cut."""
    angle = np.arctan2(y, x)
    return angle + np.where((x < 0.0) & (side * angle < 0.0), side * (2.0 * np.pi), 0.0)


_FOR_ARRAYS: dict[str, Any] = {
    "math": np, "min": lambda *given: reduce(np.minimum, given), "max": lambda *given: reduce(np.maximum, given),
    "place_in_table": place_in_table, "around": _around, "sign": np.sign, "smaller": np.minimum, "larger": np.maximum,
    "chosen": lambda side, a, b: np.where(side < 0.0, b, a),
    "within": lambda s: np.where((s > 0.0) & (s < 1.0), 1.0, 0.0),
}  # fmt: skip
"""Functions over arrays by the names that kernels call: Python's own, and those of laws and tables that branch."""
