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
