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
    basis, H = np.empty((most + 1, len(load))), np.zeros((most + 1, most))
    basis[0], moves = load / size, list[np.ndarray]()
    # orthogonal to the columns of H; the least residual is the reciprocal of its length (Ayachour 2003)
    across = np.ones(most + 1)
    for k in range(most):
        moves.append(near(basis[k]))
        rest, known = apply(moves[k]), basis[: k + 1]
        for _ in range(2):  # once more, for what rounding left of them
            shares = known @ rest
            H[: k + 1, k] += shares
            rest = rest - shares @ known
        H[k + 1, k] = np.linalg.norm(rest)
        if H[k + 1, k] == 0.0:
            break
        across[k + 1] = -(H[: k + 1, k] @ across[: k + 1]) / H[k + 1, k]
        if not 1.0 > tolerance * np.linalg.norm(across[: k + 2]):
            break
        basis[k + 1] = rest / H[k + 1, k]
    columns, wanted = H[: k + 2, : k + 1], size * np.eye(1, k + 2)[0]
    y = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    return np.array(moves).T @ y, float(np.linalg.norm(wanted - columns @ y)) / size
