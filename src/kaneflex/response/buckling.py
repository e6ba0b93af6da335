"""How far the axial forces of the motion are from buckling something (Przemieniecki 1968, chapter 15)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.model import Model

_ROUNDING = 1e-9
"""Share of the stiffness that K_g must take away to be a push and no rounding."""

_FREE = 1e-12
"""Share of a diagonal stiffness under which what is left of it, others held, is rounding: nothing holds it."""


@dataclass(frozen=True, eq=False)
class Buckling:
    """Load factors over a cycle.

    Attributes
    ----------
    times : ndarray (n_times,)
        In s.
    factors : ndarray (n_times,)
        Smallest lambda > 0 at which K_s + lambda K_g is singular: by so much all axial forces of that instant may
        grow. Infinite where nothing is pushed.
    """

    times: np.ndarray
    factors: np.ndarray

    @property
    def margin(self) -> float:
        """The least factor of the cycle; below one, something would buckle if the forces stayed."""
        return float(self.factors.min())


def buckling(model: Model, times: np.ndarray) -> Buckling | None:
    """Factors at ``times`` [s] by the elastic coordinates of the whole mechanism, in link axes.

    None where K_s is not positive: what nothing holds has no buckling load.
    """
    rigid = model.motion.at(times)
    factors = load_factors(rigid.matrices(model.equations.K_s), rigid.matrices(model.equations.K_g))
    return None if factors is None else Buckling(rigid.times, factors)


def load_factors(stiffness: np.ndarray, more: np.ndarray) -> np.ndarray | None:
    """Smallest lambda > 0 at which stiffness + lambda more is singular, of stacks (n_times, n, n): (n_times,).

    Of ``more`` the symmetric part counts. None where a stiffness is not positive.
    """
    try:
        lower = np.linalg.cholesky(stiffness)
    except np.linalg.LinAlgError:
        return None
    if (np.einsum("kii->ki", lower) ** 2 < _FREE * np.einsum("kii->ki", stiffness)).any():
        return None
    half = np.linalg.solve(lower, 0.5 * (more + more.swapaxes(1, 2)))
    unit = np.linalg.solve(lower, half.swapaxes(1, 2))
    # stiffness + lambda more = L (1 + lambda U) L^T: singular where 1 / lambda is minus an eigenvalue of U.
    inverse = -np.linalg.eigvalsh(unit)[:, 0]
    factors = np.full(len(stiffness), np.inf)
    pushed = inverse > _ROUNDING
    factors[pushed] = 1.0 / inverse[pushed]
    return factors


_INSTANTS = 36
"""Instants of a run that are looked at."""
_NO_FREQUENCY = 1e-13
"""Share of the highest squared frequency that rounding may leave of one that is zero."""
_MOST = 200
"""Coordinates up to which looking costs next to nothing beside a run; for more `kaneflex stability` is asked."""


def lost_stiffness(model: Model, times: np.ndarray) -> list[str]:
    """Warnings where K_s + K_g, or K_s + K_d where the run leaves K_g out, is not positive at some of ``times`` [s]."""
    options, size = model.options, model.equations.size
    if options.dynamics == "frozen":
        squares = model.kept["K"].at({}).diagonal()
        if not squares.min(initial=0.0) < -_NO_FREQUENCY * abs(squares).max(initial=0.0):
            return []
        rate = float(np.sqrt(-squares.min()))
        return [
            f"the spin takes away all stiffness where the matrices are frozen: a mode grows by exp({rate:.4g} t); K_g, "
            "by which the axial forces would restore it, is kept by preset stiffened"
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
            f"the axial forces exceed a buckling load at {at}: {factors.min():.3g} of them would do, if they stayed; "
            f"ask kaneflex stability whether the motion is stable"
        ]
    return [
        f"the spin takes away all stiffness at {at}, and K_g, by which the axial forces would restore it, is left out; "
        "keep it, as preset stiffened does"
    ]
