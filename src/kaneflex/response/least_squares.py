"""Least squares over time of sparse equations: joints' reactions, body by body."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

Row = dict[int, float | np.ndarray]
"""Unknown -> its coefficient in an equation, constant or (n_times,)."""
Solver = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Function of A (n_times, n_rows, n) and b (n_times, n_rows) that returns x (n_times, n) with least |A x - b|."""


def normal_equations(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve A^T A x = A^T b at every instant: a :data:`Solver`."""
    turned = matrix.transpose(0, 2, 1)
    return np.linalg.solve(turned @ matrix, turned @ right[..., None])[..., 0]


def by_reflections(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve by A = Q R, which does not square the condition number: a :data:`Solver`."""
    Q, R = np.linalg.qr(matrix)
    return np.linalg.solve(R, Q.transpose(0, 2, 1) @ right[..., None])[..., 0]


def least_squares(
    rows: Sequence[Row], right: np.ndarray, solver: Solver = normal_equations
) -> dict[int, np.ndarray]:
    """Unknowns x, (n_times,) each, with the least sum of squares of ``rows`` x - ``right``, (n_rows, n_times).

    An unknown that occurs in one equation only satisfies it exactly: both are eliminated first. For a chain of bodies
    this leaves little or nothing.
    """
    left, found = dict(enumerate(rows)), []
    while (pivot := _alone(left)) is not None:
        found.append((*pivot, left.pop(pivot[0])))
    solved = _together(left, right, solver)
    for row, unknown, coefficients in reversed(found):
        rest = right[row] - sum(a * solved[k] for k, a in coefficients.items() if k != unknown)
        solved[unknown] = rest / coefficients[unknown]
    return solved


def _alone(left: dict[int, Row]) -> tuple[int, int] | None:
    """An equation and an unknown that occurs in no other one, with a constant nonzero coefficient."""
    places: dict[int, list[int]] = {}
    for row, coefficients in left.items():
        for unknown in coefficients:
            places.setdefault(unknown, []).append(row)
    for unknown, where in places.items():
        value = left[where[0]][unknown]
        if len(where) == 1 and np.ndim(value) == 0 and value:
            return where[0], unknown
    return None


def _together(left: Mapping[int, Row], right: np.ndarray, solver: Solver) -> dict[int, np.ndarray]:
    """Least-squares solution of the remaining equations."""
    unknowns = sorted({unknown for coefficients in left.values() for unknown in coefficients})
    if not unknowns:
        return {}
    matrix = np.zeros((right.shape[1], len(left), len(unknowns)), right.dtype)
    for row, coefficients in enumerate(left.values()):
        for unknown, value in coefficients.items():
            matrix[:, row, unknowns.index(unknown)] = value
    return dict(zip(unknowns, solver(matrix, right[list(left)].T).T, strict=True))
