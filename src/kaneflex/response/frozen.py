"""Equations frozen at instants of a run: natural frequencies over the drive's coordinate, and buckling.

Buckling: Przemieniecki 1968, chapter 15.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kaneflex.multibody.model.bound_model import Model, keep_terms

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
    times = np.arange(instants) * model.scene.period / instants
    rigid = model.motion.at(times)
    M, C, K = (rigid.matrices(model.kept[name]) for name in "MCK")
    undamped = keep_terms(model.reduced, replace(model.options, damping=False))
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


_ROUNDING = 1e-9
"""Reduction of the stiffness by K_g, as a share, below which it counts as rounding."""

_FREE = 1e-12
"""Remaining share of a diagonal stiffness, others eliminated, below which the mechanism counts as unrestrained."""


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

    None if K_s is not positive definite: an unrestrained mechanism has no buckling load.
    """
    rigid = model.motion.at(times)
    factors = load_factors(rigid.matrices(model.equations.K_s), rigid.matrices(model.equations.K_g))
    return None if factors is None else Buckling(rigid.times, factors)


def load_factors(stiffness: np.ndarray, more: np.ndarray) -> np.ndarray | None:
    """Smallest lambda > 0 at which stiffness + lambda more is singular, for stacks (n_times, n, n): (n_times,).

    Only the symmetric part of ``more`` counts. None if a stiffness is not positive definite.
    """
    try:
        lower = np.linalg.cholesky(stiffness)
    except np.linalg.LinAlgError:
        return None
    if (np.einsum("kii->ki", lower) ** 2 < _FREE * np.einsum("kii->ki", stiffness)).any():
        return None
    half = np.linalg.solve(lower, 0.5 * (more + more.swapaxes(1, 2)))
    unit = np.linalg.solve(lower, half.swapaxes(1, 2))
    # stiffness + lambda more = L (1 + lambda U) L^T is singular if 1 / lambda is minus an eigenvalue of U
    inverse = -np.linalg.eigvalsh(unit)[:, 0]
    factors = np.full(len(stiffness), np.inf)
    pushed = inverse > _ROUNDING
    factors[pushed] = 1.0 / inverse[pushed]
    return factors


_INSTANTS = 36
"""Instants of a run that are checked."""
_NO_FREQUENCY = 1e-13
"""Share of the highest squared frequency below which one counts as zero."""
_MOST = 200
"""Coordinates up to which the check costs little compared with a run; for more use `kaneflex stability`."""


def lost_stiffness(model: Model, times: np.ndarray) -> list[str]:
    """Warnings if K_s + K_g, or K_s + K_d without K_g, is not positive definite at some of ``times`` [s]."""
    options, size = model.options, model.equations.size
    if options.dynamics == "frozen":
        squares = model.kept["K"].value({}).diagonal()
        if not squares.min(initial=0.0) < -_NO_FREQUENCY * abs(squares).max(initial=0.0):
            return []
        rate = float(np.sqrt(-squares.min()))
        return [
            f"the frozen stiffness is not positive definite because of the spin: a mode grows as exp({rate:.4g} t); "
            "preset stiffened keeps K_g, the stiffening by axial forces"
        ]
    if options.dynamics not in ("dynamic", "quasistatic") or not 0 < size <= _MOST:
        return []
    if not options.geometric and not options.spin:
        return []
    rigid = model.motion.at(times[:: max(1, len(times) // _INSTANTS)])
    equations = model.equations
    more = equations.K_g if options.geometric else equations.K_d
    factors = load_factors(rigid.matrices(equations.K_s), rigid.matrices(more))
    if factors is None or not factors.min() < 1.0:
        return []
    at = f"t = {rigid.times[int(factors.argmin())]:.4g} s"
    if options.geometric:
        return [
            f"the axial forces exceed a buckling load at {at}, with a load factor of {factors.min():.3g}; check with "
            f"kaneflex stability whether the motion is stable"
        ]
    return [
        f"the stiffness is not positive definite at {at} because of the spin, and K_g, the stiffening by axial forces, "
        "is left out; use preset stiffened"
    ]
