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
_BEYOND = 4
"""Rows added at each end of a periodic table: Akima's slope at a row depends on two rows on each side."""


def cubics_through(x: np.ndarray, y: np.ndarray, interpolation: Interpolation, periodic: bool) -> np.ndarray:
    """Coefficients c0 .. c3, (n, 4), of the cubics c0 + d (c1 + d (c2 + d c3)), d = x - x_i, through n + 1 rows.

    A periodic table has y[0] = y[-1]. Otherwise a spline has natural ends (no curvature), and the other methods use
    one-sided slopes at the ends.
    """
    match interpolation:
        case "linear":
            slopes = np.diff(y) / np.diff(x)
            return np.column_stack([y[:-1], slopes, 0.0 * slopes, 0.0 * slopes])
        case "spline":
            return _cubics(x, y, _curvatures_periodic(x, y) if periodic else _curvatures_natural(x, y))
    if not periodic:
        return _scipy_cubics(x, y, interpolation)
    count, period = min(_BEYOND, len(x) - 1), x[-1] - x[0]
    x = np.concatenate([x[-1 - count : -1] - period, x, x[1 : count + 1] + period])
    y = np.concatenate([y[-1 - count : -1], y, y[1 : count + 1]])
    return _scipy_cubics(x, y, interpolation)[count:-count]


def _scipy_cubics(x: np.ndarray, y: np.ndarray, interpolation: Interpolation) -> np.ndarray:
    from scipy.interpolate import Akima1DInterpolator, PchipInterpolator

    kind = PchipInterpolator if interpolation == "pchip" else Akima1DInterpolator
    return kind(x, y).c[::-1].T


def _cubics(x: np.ndarray, y: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Coefficients c0 .. c3 of every interval, (n, 4), from the curvatures m at the knots (de Boor 1978, ch. IV)."""
    h = np.diff(x)
    slopes = np.diff(y) / h - h * (2 * m[:-1] + m[1:]) / 6
    return np.column_stack([y[:-1], slopes, m[:-1] / 2, np.diff(m) / (6 * h)])


def _curvatures_natural(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Curvatures of a natural spline: h_i-1 m_i-1 + 2 (h_i-1 + h_i) m_i + h_i m_i+1 = 6 (jump of slope)."""
    h = np.diff(x)
    jumps = 6 * np.diff(np.diff(y) / h)
    inner = _solve_tridiagonal(h[1:-1], 2 * (h[:-1] + h[1:]), jumps)
    return np.concatenate([[0.0], inner, [0.0]])


def _curvatures_periodic(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Curvatures of a periodic spline: the two corner entries h_n-1 are a rank-one change.

    A = T + g w w^T with w = (1, 0 .. 0, 1), g = h_n-1; Sherman and Morrison 1950.
    """
    h = np.diff(x)
    slopes = np.diff(y) / h
    jumps = 6 * (slopes - np.roll(slopes, 1))
    diagonal = 2 * (h + np.roll(h, 1))
    diagonal[[0, -1]] -= h[-1]
    w = np.zeros(len(h))
    w[[0, -1]] = 1.0
    m, v = _solve_tridiagonal(h[:-1], diagonal, np.column_stack([jumps, w])).T
    m = m - v * h[-1] * (m[0] + m[-1]) / (1 + h[-1] * (v[0] + v[-1]))
    return np.append(m, m[0])


def _solve_tridiagonal(beside: np.ndarray, diagonal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solution (n,) or (n, k) for a symmetric, diagonally dominant tridiagonal matrix, as of a spline.

    Cyclic reduction (Hockney 1965, J. ACM 12): every other unknown is eliminated at once, until one is left. scipy's
    solver would take 0.2 s to import.
    """
    if right.ndim == 1:
        return _solve_tridiagonal(beside, diagonal, right[:, None])[:, 0]
    before, after, pivots = beside[::2], beside[1::2], diagonal[1::2]
    if not len(pivots):
        return right / diagonal[:, None]
    inner, share = diagonal[::2].copy(), right[::2].copy()
    lower, upper = before / pivots, after / pivots[: len(after)]  # coupling of odd rows to their even neighbours
    inner[: len(before)] -= lower * before
    inner[1:][: len(after)] -= upper * after
    share[: len(before)] -= lower[:, None] * right[1::2]
    share[1:][: len(after)] -= upper[:, None] * right[1::2][: len(after)]
    found = np.empty_like(right)
    found[::2] = even = _solve_tridiagonal(-lower[: len(after)] * after, inner, share)
    found[1::2] = (right[1::2] - before[:, None] * even[: len(before)]) / pivots[:, None]
    found[1::2][: len(after)] -= upper[:, None] * even[1:]
    return found
