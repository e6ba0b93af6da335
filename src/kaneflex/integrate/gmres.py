"""Generalised minimal residuals (Saad & Schultz 1986, algorithm 4), here because importing scipy's takes 0.3 s."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Product = Callable[[np.ndarray], np.ndarray]


def gmres(
    apply: Product, load: np.ndarray, tolerance: float, most: int, near: Product = np.asarray
) -> tuple[np.ndarray, float]:
    """Solution x (n,) of A x = load, and the residual as a share of the load.

    Parameters
    ----------
    apply, near : callable
        Products of A, and of an approximate inverse of A, with a vector (n,).
    tolerance : float
        Residual at which the iteration ends.
    most : int
        Largest number of iterations, each of which stores two vectors.
    """
    size = float(np.linalg.norm(load))
    if size == 0.0:
        return np.zeros_like(load), 0.0
    basis, moves, H = [load / size], list[np.ndarray](), np.zeros((most + 1, most))
    wanted, left = size * np.eye(1, most + 1)[0], 1.0
    y: np.ndarray
    for k in range(most):
        moves.append(near(basis[k]))
        rest = apply(moves[k])
        for i, v in enumerate(basis):
            H[i, k] = rest @ v
            rest = rest - H[i, k] * v
        H[k + 1, k] = np.linalg.norm(rest)
        columns = H[: k + 2, : k + 1]
        y = np.linalg.lstsq(columns, wanted[: k + 2], rcond=None)[0]
        left = float(np.linalg.norm(wanted[: k + 2] - columns @ y)) / size
        if not left > tolerance:
            break
        basis.append(rest / H[k + 1, k])
    return np.array(moves).T @ y, left
