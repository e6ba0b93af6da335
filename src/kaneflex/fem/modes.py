"""Undamped natural modes of mass and stiffness matrices, and damping ratios from a scene."""

from __future__ import annotations

import math

import numpy as np

from kaneflex.mechanism.affine import Matrix, as_array
from kaneflex.support.errors import SceneError

_DENSE_UP_TO = 150
_ADAMS = (100.0, 1000.0), np.array([0.01, 0.1, 1.0])
"""Frequencies [Hz] between which Adams changes the damping ratio of a flexible body's modes, and the ratios."""


def lowest_modes(stiffness: Matrix, mass: Matrix, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest modes of K phi = omega^2 M phi, paper (140).

    Parameters
    ----------
    stiffness, mass : ndarray or sparse (n, n)
        Symmetric; mass positive definite.
    count : int
        Number of modes, at most n.

    Returns
    -------
    ndarray (count,), ndarray (n, count)
        Angular frequencies [rad/s], ascending; mass-normalised shapes, Phi^T M Phi = 1, paper (135), with the sign
        fixed so that each shape's largest entry is positive (the first of them, where several are as large).

    Raises
    ------
    ValueError
        If more modes are requested than there are degrees of freedom.
    """
    size = stiffness.shape[0]
    if count > size:
        raise ValueError(f"{count} modes of {size} degrees of freedom")
    if count == 0:
        return np.zeros(0), np.zeros((size, 0))
    if size <= _DENSE_UP_TO or count > size // 3:
        squares, shapes = symmetric_modes(as_array(stiffness), as_array(mass), count)
    else:
        from scipy.sparse import csc_array
        from scipy.sparse.linalg import eigsh

        start = np.ones(size)  # a fixed start vector makes the iteration reproducible
        squares, shapes = eigsh(csc_array(stiffness), k=count, M=csc_array(mass), sigma=0.0, v0=start)
        order = np.argsort(squares)
        squares, shapes = squares[order], shapes[:, order]
    return np.sqrt(np.maximum(squares, 0.0)), shapes * _signs(shapes)


def symmetric_modes(stiffness: np.ndarray, mass: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Lowest omega^2 and mass-normalised shapes by M = L L^T, as LAPACK's dsygvd has them, without importing scipy.

    Raises SceneError if M is not positive definite.
    """
    try:
        lower = np.linalg.cholesky(mass)
    except np.linalg.LinAlgError:
        reason = "the mass matrix is numerically singular: masses or lengths differ too much"
        raise SceneError("bodies", None, reason, "Check their units") from None
    squares, turned = np.linalg.eigh(np.linalg.solve(lower, np.linalg.solve(lower, stiffness).T))
    return squares[:count], np.linalg.solve(lower.T, turned[:, :count])


def damping_ratios(given: tuple[float, ...] | str, omega: np.ndarray) -> np.ndarray:
    """Damping ratio of each mode from `damping.modal.ratio`.

    One for each mode from the lowest frequency up, the last one for the rest; or "adams": by frequency, as the
    default of MSC Adams for a flexible body (Adams/Flex, damping ratio of the flexible body).

    Parameters
    ----------
    given : tuple of float, or "adams"
    omega : ndarray (n,)
        Angular frequencies [rad/s], in any order.
    """
    if given == "adams":
        limits, ratios = _ADAMS
        return ratios[np.searchsorted(limits, omega / (2 * np.pi), side="right")]
    rank = np.argsort(np.argsort(omega, kind="stable"))
    return np.array([given[min(k, len(given) - 1)] for k in rank])


def _signs(shapes: np.ndarray) -> np.ndarray:
    largest = abs(shapes).max(axis=0)
    decisive = np.argmax(abs(shapes) > (1 - 1e-6) * largest, axis=0)
    return np.sign(shapes[decisive, np.arange(shapes.shape[1])])


def rayleigh_coefficients(ratio: float, f_1: float, f_2: float) -> tuple[float, float]:
    """Coefficients alpha [1/s] and beta [s] of C = alpha M + beta K with one damping ratio at two frequencies [Hz]."""
    w_1, w_2 = 2 * math.pi * f_1, 2 * math.pi * f_2
    return 2 * ratio * w_1 * w_2 / (w_1 + w_2), 2 * ratio / (w_1 + w_2)
