"""Piecewise cubic interpolation of a table by four methods.

All pass through the rows and have one cubic per interval, so that kernels need one look-up.

- "linear": straight from row to row.
- "pchip": monotone between two rows, without overshoot (Fritsch & Butland 1984, SIAM J. Sci. Stat. Comput. 5);
  continuous slope.
- "akima": slopes from the nearest five rows (Akima 1970, J. ACM 17); may overshoot the rows slightly.
- "spline": continuous curvature (de Boor 1978, ch. IV), fourth order for smooth functions; it overshoots where a table
  changes from flat to steep.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

Interpolation = Literal["linear", "pchip", "akima", "spline"]
INTERPOLATIONS: tuple[Interpolation, ...] = get_args(Interpolation)
_BEYOND = 60
"""Rows added at each end of a periodic table: the curvature of a spline depends on a row by at most half as much as on
the next nearer one, slopes of the other methods on two rows on each side."""


def cubics_through(x: np.ndarray, y: np.ndarray, interpolation: Interpolation, periodic: bool) -> np.ndarray:
    """Coefficients c0 .. c3, (n, 4), of the cubics c0 + d (c1 + d (c2 + d c3)), d = x - x_i, through n + 1 rows.

    A periodic table has y[0] = y[-1]. Otherwise a spline has natural ends (no curvature), and the other methods use
    one-sided slopes at the ends.
    """
    if periodic and interpolation != "linear":
        count, period = len(x) - 1, x[-1] - x[0]
        k = np.arange(-_BEYOND, len(x) + _BEYOND)
        beyond = cubics_through(x[k % count] + k // count * period, y[k % count], interpolation, False)
        return beyond[_BEYOND:-_BEYOND]
    if interpolation == "linear":
        slopes = np.diff(y) / np.diff(x)
        return np.column_stack([y[:-1], slopes, 0.0 * slopes, 0.0 * slopes])
    if interpolation == "spline":
        return _natural_spline(x, y)
    from scipy.interpolate import Akima1DInterpolator, PchipInterpolator

    kind = PchipInterpolator if interpolation == "pchip" else Akima1DInterpolator
    return kind(x, y).c[::-1].T


def _natural_spline(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Coefficients of a spline's cubics by its curvatures m at the rows (de Boor 1978, ch. IV), zero at the ends:
    h_i-1 m_i-1 + 2 (h_i-1 + h_i) m_i + h_i m_i+1 = 6 (jump of slope)."""
    h = np.diff(x)
    jumps = 6 * np.diff(np.diff(y) / h)
    m = np.concatenate([[0.0], _solve_tridiagonal(h[1:-1], 2 * (h[:-1] + h[1:]), jumps), [0.0]])
    slopes = np.diff(y) / h - h * (2 * m[:-1] + m[1:]) / 6
    return np.column_stack([y[:-1], slopes, m[:-1] / 2, np.diff(m) / (6 * h)])


def _solve_tridiagonal(beside: np.ndarray, diagonal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution (n,) for a symmetric, diagonally dominant tridiagonal matrix, as of a spline.

    Cyclic reduction (Hockney 1965, J. ACM 12): every other unknown is eliminated at once, until one is left. scipy's
    solver would take 0.2 s to import.
    """
    before, after, pivots = beside[::2], beside[1::2], diagonal[1::2]
    if not len(pivots):
        return right / diagonal
    inner, share = diagonal[::2].copy(), right[::2].copy()
    lower, upper = before / pivots, after / pivots[: len(after)]  # coupling of odd rows to their even neighbours
    inner[: len(before)] -= lower * before
    inner[1:][: len(after)] -= upper * after
    share[: len(before)] -= lower * right[1::2]
    share[1:][: len(after)] -= upper * right[1::2][: len(after)]
    found = np.empty_like(right)
    found[::2] = even = _solve_tridiagonal(-lower[: len(after)] * after, inner, share)
    found[1::2] = (right[1::2] - before * even[: len(before)]) / pivots
    found[1::2][: len(after)] -= upper * even[1:]
    return found
