"""Decoupled modes with constant coefficients, advanced exactly."""

from __future__ import annotations

import numpy as np

from kaneflex.integrate.system import AffineSystem
from kaneflex.support.errors import UserError


def transition(system: AffineSystem, row: np.ndarray, step: float) -> np.ndarray:
    """Coefficients of one exact step of m z'' + c z' + k z = F, F linear within the step; shape (11, n).

    Rows: z_1 = (0) z_0 + (1) v_0 + (2) F_0 + (3) F_1, v_1 the same with rows 4 to 7, and
    z'' = (8) F - (9) v - (10) z.

    With F = F_0 + (F_1 - F_0) tau, tau = t / step, the vector (z, v / sigma, F, dF/dtau) obeys a linear
    equation with constant matrix, whose exponential gives all coefficients. It covers oscillating, overdamped
    and free modes without cases, so no digits are lost between them. sigma = max(frequency, 1 / step) balances
    the matrix; the relative error is about its norm, step * frequency, times the unit roundoff, as for any phase.
    """
    from scipy.linalg import expm

    mass, damping, stiffness = (_diagonal(system, name, row) for name in ("M", "C", "K"))
    if not np.all(mass > 0.0):
        raise _not_decoupled("the mass of a mode is not positive")
    rate, square = damping / mass, stiffness / mass
    sigma = np.maximum(np.sqrt(np.abs(square)), 1.0 / step)
    matrix = np.zeros((system.n, 4, 4))
    matrix[:, 0, 1] = sigma * step
    matrix[:, 1, 0] = -square * step / sigma
    matrix[:, 1, 1] = -rate * step
    matrix[:, 1, 2] = 1.0
    matrix[:, 2, 3] = 1.0
    flow = expm(matrix)
    force = step / (sigma * mass)  # left out of the matrix, so that its size does not spoil the balance
    coefficients = np.empty((11, system.n))
    for first, scale, line in ((0, np.ones(system.n), 0), (4, sigma, 1)):
        coefficients[first] = scale * flow[:, line, 0]
        coefficients[first + 1] = scale * flow[:, line, 1] / sigma
        coefficients[first + 2] = scale * force * (flow[:, line, 2] - flow[:, line, 3])
        coefficients[first + 3] = scale * force * flow[:, line, 3]
    coefficients[8:] = 1.0 / mass, rate, square
    return coefficients


def forces(system: AffineSystem, rows: np.ndarray) -> np.ndarray:
    """F at rows of the table, shape (rows, n): all that the loop `exact_modal` reads."""
    return np.ascontiguousarray((system.F @ rows.T).T)


def constants(system: AffineSystem) -> np.ndarray:
    """Indices of the scalars that must not change in time: those of M, C and K."""
    matrices = (system.M, system.C, system.K)
    return np.unique(np.concatenate([each.indices[each.data != 0.0] for each in matrices]))


def _diagonal(system: AffineSystem, name: str, row: np.ndarray) -> np.ndarray:
    matrix = system.dense(name, row)
    if np.any(matrix != np.diag(np.diag(matrix))):
        raise _not_decoupled(f"{name} couples its coordinates")
    return np.diag(matrix).copy()


def _not_decoupled(reason: str) -> UserError:
    return UserError("integrator", "exact-modal", reason, "Use radau, generalised-alpha or newmark")
