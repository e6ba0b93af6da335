"""Natural frequencies of the equations frozen at instants of the cycle, over the drive's coordinate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kaneflex.multibody.model import Model, keep_terms

INSTANTS, FEW_INSTANTS = 144, 36
"""Instants of a cycle at which the equations are frozen: of a scene's own speed, and of each speed of a sweep."""


@dataclass(frozen=True, eq=False)
class Frozen:
    """The equations at some instants of a cycle, each as if its coefficients stayed.

    Attributes
    ----------
    times : ndarray (n_times,)
        In s.
    coordinates : ndarray (n_times,)
        Of the first drive [rad or m].
    frequencies : ndarray (n_times, count)
        Lowest natural frequencies [Hz] without the material damping, rising; one that diverges counts as zero.
    growth : ndarray (n_times,)
        Largest real part of the poles [1/s], damping included: above zero, the frozen equations diverge or flutter.
        It says nothing final of the periodic ones: their multipliers do.
    condition_M, condition_K : ndarray (n_times,)
        Condition numbers of M and K (2-norm) with their diagonals scaled to one, so that no unit matters.
    """

    times: np.ndarray
    coordinates: np.ndarray
    frequencies: np.ndarray
    growth: np.ndarray
    condition_M: np.ndarray
    condition_K: np.ndarray


def freeze(model: Model, count: int, instants: int) -> Frozen:
    """Poles of M z'' + C z' + K z = 0 with the coefficients of each of so many instants of a cycle."""
    count = min(count, model.reduced.size)
    times = np.arange(instants) * model.scene.period / instants
    rigid = model.motion.at(times)
    M, C, K = (rigid.matrices(model.kept[name]) for name in "MCK")
    undamped = keep_terms(model.reduced, replace(model.options, damping=False))
    C_0, K_0 = (rigid.matrices(undamped[name]) for name in "CK")
    lowest, growth = np.empty((instants, count)), np.empty(instants)
    for k in range(instants):
        free = np.linalg.eigvals(state_matrix(M[k], C_0[k], K_0[k]))
        # Two poles of a frequency: of each pair one is left.
        lowest[k] = np.sort(abs(free.imag))[::2][:count] / (2.0 * np.pi)
        growth[k] = np.linalg.eigvals(state_matrix(M[k], C[k], K[k])).real.max()
    coordinates = rigid[f"{next(iter(model.scene.drives))}.angle"]
    return Frozen(times, coordinates, lowest, growth, _condition(M), _condition(K))


def state_matrix(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """A of x' = A x with x = (z, z')."""
    n = len(M)
    return np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), -np.linalg.solve(M, np.hstack([K, C]))])


def _condition(stack: np.ndarray) -> np.ndarray:
    scale = np.sqrt(abs(np.einsum("kii->ki", stack)))
    scale[scale == 0.0] = 1.0
    return np.linalg.cond(stack / (scale[:, :, None] * scale[:, None, :]))
