"""Equations frozen at instants of a run: natural frequencies over the drive's coordinate, and buckling.

Buckling: Przemieniecki 1968, chapter 15.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.model.bound_model import Model, keep_terms
from kaneflex.solve.linear_warnings import load_factors

INSTANTS, FEW_INSTANTS = 144, 36
"""Instants of a cycle at which the equations are frozen: at the scene's own speed, and at each speed of a sweep."""


@dataclass(frozen=True, eq=False)
class Frozen:
    """Equations at some instants of a cycle, each with constant coefficients.

    Attributes
    ----------
    times : ndarray (n_times,)
        Instants [s].
    coordinates : ndarray (n_times,)
        Coordinate of the first drive [rad or m].
    frequencies : ndarray (n_times, count)
        Lowest natural frequencies [Hz] without material damping, ascending; zero for divergent modes.
    growth : ndarray (n_times,)
        Largest real part of the poles [1/s] with damping: if positive, the frozen equations diverge or flutter. The
        stability of the periodic equations follows from their multipliers instead.
    condition_M, condition_K : ndarray (n_times,)
        Condition numbers of M and K (2-norm) with their diagonals scaled to one, independent of units.
    """

    times: np.ndarray
    coordinates: np.ndarray
    frequencies: np.ndarray
    growth: np.ndarray
    condition_M: np.ndarray
    condition_K: np.ndarray


def freeze(model: Model, count: int, instants: int) -> Frozen:
    """Poles of M z'' + C z' + K z = 0 with the coefficients of each of ``instants`` instants of a cycle."""
    from kaneflex.multibody.time.linearisation import state_matrix

    count = min(count, model.reduced.size)
    period = model.scene.period
    assert period is not None  # else there are no cycles to ask about
    times = np.arange(instants) * period / instants
    rigid = model.motion.at(times)
    M, C, K = (rigid.matrices(model.kept[name]) for name in "MCK")
    undamped = keep_terms(model.reduced, model.options._replace(damping=False))
    C_0, K_0 = (rigid.matrices(undamped[name]) for name in "CK")
    lowest, growth = np.empty((instants, count)), np.empty(instants)
    for k in range(instants):
        free = np.linalg.eigvals(state_matrix(M[k], C_0[k], K_0[k]))
        # one of each pair of poles
        lowest[k] = np.sort(abs(free.imag))[::2][:count] / (2.0 * np.pi)
        growth[k] = np.linalg.eigvals(state_matrix(M[k], C[k], K[k])).real.max()
    coordinates = rigid[f"{next(iter(model.scene.drives))}.angle"]
    return Frozen(times, coordinates, lowest, growth, _condition(M), _condition(K))


def _condition(stack: np.ndarray) -> np.ndarray:
    scale = np.sqrt(abs(np.einsum("kii->ki", stack)))
    scale[scale == 0.0] = 1.0
    return np.linalg.cond(stack / (scale[:, :, None] * scale[:, None, :]))


@dataclass(frozen=True, eq=False)
class Buckling:
    """Load factors over a cycle.

    Attributes
    ----------
    times : ndarray (n_times,)
        Instants [s].
    factors : ndarray (n_times,)
        Smallest lambda > 0 at which K_s + lambda K_g is singular: factor on all axial forces of that instant that
        causes buckling. Infinite without compression.
    """

    times: np.ndarray
    factors: np.ndarray

    @property
    def margin(self) -> float:
        """Least factor of the cycle; below one, a link would buckle under constant forces."""
        return float(self.factors.min())


def buckling(model: Model, times: np.ndarray) -> Buckling | None:
    """Load factors at ``times`` [s] from the elastic coordinates of the whole mechanism, in link axes.

    None if K_s is not positive definite, as an unrestrained mechanism has no buckling load, or if axial forces are
    statically indeterminate.
    """
    rigid = model.motion.at(times)
    geometric = rigid.matrices(model.equations.K_g)
    factors = None if np.isnan(geometric).any() else load_factors(rigid.matrices(model.equations.K_s), geometric)
    return None if factors is None else Buckling(rigid.times, factors)
