"""Motions that repeat: from where a cycle's end misses its start to a start that it doesn't miss.

x are the independent coordinates and their rates at the start of a cycle, P(x) what they are at its end. Newton's
method solves P(x) = x with the monodromy matrix dP/dx of the equations linearised along a cycle,

    x <- x + (1 - dP/dx)^-1 (P(x) - x),

whose modes forget their start by themselves where they are damped, and need not be waited for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from kaneflex.multibody.linearisation import Instant, slopes
from kaneflex.multibody.run import CoupledTrajectory
from kaneflex.multibody.system import CoupledSystem

_SEGMENTS = 48
"""Pieces of a cycle in each of which the linear equations are those of its middle."""


@dataclass(frozen=True, eq=False)
class Returning:
    """The independent coordinates that the starts of a mechanism's cycles differ by.

    ``which`` of the tree's coordinates they are is chosen once, by :func:`returning`, and serves every system with the
    same joints; ``t`` [s] is when a cycle begins.
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
        """q and v (size,) of a state whose x is another one by ``x`` (2 k,).

        Raises ArithmeticError where the loops don't close there.
        """
        engine = system.engine
        system.fold(q, v)
        engine.choose(self.t)
        y, rate, *_ = engine.motion
        move, faster = np.split(x, 2)
        y[self.which] += move
        rate[self.which] += faster
        found = system.unfold(engine.row(self.t)[None]) if engine.settle(self.t) else None
        if found is None:
            raise ArithmeticError("the loops don't close at the start of the next cycle")
        return found.q[0], found.v[0]

    def missed(self, system: CoupledSystem, cycle: CoupledTrajectory) -> np.ndarray:
        """P(x) - x, (2 k,): a joint that has turned on by whole turns stands where it stood."""
        ends = (self.coordinates(system, cycle.q[k], cycle.v[k]) for k in (-1, 0))
        gap = next(ends) - next(ends)
        turns = np.flatnonzero(self.turns)
        gap[turns] -= 2.0 * np.pi * np.round(gap[turns] / (2.0 * np.pi))
        return gap

    def monodromy(self, system: CoupledSystem, cycle: CoupledTrajectory) -> np.ndarray:
        """dP/dx (2 k, 2 k) of the equations linearised along a cycle, in each piece of it about its middle.

        Raises ArithmeticError or LinAlgError where they don't determine the motion.
        """
        engine, k = system.engine, len(self.which)
        system.fold(cycle.q[0], cycle.v[0])
        engine.choose(self.t)
        count = len(cycle.times) - 1
        pieces = min(_SEGMENTS, count)
        length = (cycle.times[-1] - cycle.times[0]) / pieces
        found = np.eye(2 * k)
        for piece in range(pieces):
            row = int((piece + 0.5) * count / pieces)
            system.fold(cycle.q[row], cycle.v[row])
            engine.settle(float(cycle.times[row]))
            state = (part[self.which].copy() for part in engine.motion[:3])
            slope = slopes(engine, Instant(float(cycle.times[row]), *state), range(3 * k))[1]
            K, C, M = np.split(slope, 3, axis=1)
            A = np.zeros((2 * k, 2 * k))
            A[:k, k:] = np.eye(k)
            A[k:] = -np.linalg.solve(M, np.hstack([K, C]))
            found = expm(length * A) @ found
        return found


def returning(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> Returning:
    """The independent coordinates at a state of the bodies."""
    system.compile()
    system.fold(q, v)
    system.engine.choose(t)
    which = system.engine.independent
    turns = np.array([system.engine.layout.coordinates[k][1] == "rad" for k in which], bool)
    return Returning(t, which, turns)
