"""Independent coordinates of a planar mechanism at the start of its cycles, and their change over a cycle."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.system import CoupledSystem
from kaneflex.multibody.time.linear_equations import state_matrix
from kaneflex.multibody.time.linearisation import Instant, slopes
from kaneflex.multibody.time.shooting import PIECES, propagated
from kaneflex.multibody.time.trajectory import CoupledTrajectory


@dataclass(frozen=True, eq=False)
class Returning:
    """Independent coordinates of the initial states of a mechanism's cycles.

    ``which`` are their numbers among the tree's coordinates, chosen once by :func:`returning` and valid for every
    system with the same joints; ``t`` [s] is the start of a cycle.
    """

    t: float
    which: np.ndarray
    turns: np.ndarray

    def coordinates(self, system: CoupledSystem, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """x (2 k,) of a state of the bodies."""
        system.fold(q, v)
        y, rate, *_ = system.engine.motion
        return np.concatenate([y[self.which], rate[self.which]])

    def moved(
        self, system: CoupledSystem, q: np.ndarray, v: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """State q and v (size,) with x changed by ``x`` (2 k,).

        Raises ArithmeticError if the loops don't close there.
        """
        engine = system.engine
        system.fold(q, v)
        engine.choose(self.t)
        y, rate, *_ = engine.motion
        move, faster = np.split(x, 2)
        y[self.which] += move
        rate[self.which] += faster
        found = system.unfold(engine.row(self.t)[None]) if engine.project(self.t) else None
        if found is None:
            raise ArithmeticError("the loops don't close at the start of the next cycle")
        return found.q[0], found.v[0]

    def missed(self, system: CoupledSystem, cycle: CoupledTrajectory) -> np.ndarray:
        """Change P(x) - x over a cycle, (2 k,), without whole turns of joints."""
        ends = (self.coordinates(system, cycle.q[k], cycle.v[k]) for k in (-1, 0))
        gap = next(ends) - next(ends)
        turns = np.flatnonzero(self.turns)
        gap[turns] -= whole_turns(gap[turns])
        return gap

    def monodromy(self, system: CoupledSystem, cycle: CoupledTrajectory, pieces: int = PIECES) -> np.ndarray:
        """Monodromy matrix dP/dx (2 k, 2 k) of the equations linearised along a cycle, at the middle of each piece.

        Raises ArithmeticError or LinAlgError at a singular state.
        """
        return propagated(self._pieces(system, cycle, pieces))

    def _pieces(
        self, system: CoupledSystem, cycle: CoupledTrajectory, pieces: int
    ) -> Iterator[tuple[float, np.ndarray]]:
        engine, k, times = system.engine, len(self.which), cycle.times
        system.fold(cycle.q[0], cycle.v[0])
        engine.choose(self.t)
        ends = [*range(0, len(times) - 1, _stride(len(times) - 1, pieces)), len(times) - 1]
        for begin, end in pairwise(ends):
            row = (begin + end) // 2
            system.fold(cycle.q[row], cycle.v[row])
            engine.project(float(times[row]))
            base = Instant(float(times[row]), *(part[self.which].copy() for part in engine.motion[:3]))
            K, C, M = np.split(slopes(engine, base, range(3 * k))[1], 3, axis=1)
            yield times[end] - times[begin], state_matrix(M, C, K)


def _stride(count: int, pieces: int) -> int:
    """Stored steps of a piece, an even number: it has a middle."""
    return max(2, 2 * (count // (2 * pieces)))


def returning(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> Returning:
    """Independent coordinates at a state of the bodies."""
    system.compile()
    system.fold(q, v)
    system.engine.choose(t)
    which = system.engine.independent
    return Returning(t, which, system.engine.turns[which])
