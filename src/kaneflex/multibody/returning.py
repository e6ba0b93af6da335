"""Motions that repeat: from where a cycle's end misses its start to a start that it doesn't miss.

x are the independent coordinates and their rates at the start of a cycle, P(x) what they are at its end. Newton's
method solves P(x) = x with the monodromy matrix dP/dx of the equations linearised along a cycle,

    x <- x + (1 - dP/dx)^-1 (P(x) - x),

whose modes forget their start by themselves where they are damped, and need not be waited for. Its eigenvalues are the
Floquet multipliers of a motion that repeats (Nayfeh and Mook 1979, section 5.2): a disturbance grows where the modulus
of one is beyond one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.linalg import expm

from kaneflex.multibody.linearisation import Instant, slopes
from kaneflex.multibody.run import CoupledTrajectory
from kaneflex.multibody.system import CoupledSystem

_PIECES, _FEWEST, _MOST = 48, 24, 200
"""Pieces of a cycle in each of which the linear equations are those of its middle; at first and at most for its
multipliers."""
_DIES, _EXACT = 0.5, 1e-4
"""A modulus that needs no better look, and what another may be off by where it is one as far as one can tell."""


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

    def monodromy(self, system: CoupledSystem, cycle: CoupledTrajectory, pieces: int = _PIECES) -> np.ndarray:
        """dP/dx (2 k, 2 k) of the equations linearised along a cycle, in each piece of it about its middle.

        It is off by the second order of a piece's length (Magnus 1954). Raises ArithmeticError or LinAlgError where
        they don't determine the motion.
        """
        engine, k, times = system.engine, len(self.which), cycle.times
        system.fold(cycle.q[0], cycle.v[0])
        engine.choose(self.t)
        ends = [*range(0, len(times) - 1, _stride(len(times) - 1, pieces)), len(times) - 1]
        found = np.eye(2 * k)
        for begin, end in pairwise(ends):
            row = (begin + end) // 2
            system.fold(cycle.q[row], cycle.v[row])
            engine.settle(float(times[row]))
            state = (part[self.which].copy() for part in engine.motion[:3])
            slope = slopes(engine, Instant(float(times[row]), *state), range(3 * k))[1]
            K, C, M = np.split(slope, 3, axis=1)
            A = np.zeros((2 * k, 2 * k))
            A[:k, k:] = np.eye(k)
            A[k:] = -np.linalg.solve(M, np.hstack([K, C]))
            found = expm((times[end] - times[begin]) * A) @ found
        return found

    def multipliers(self, system: CoupledSystem, cycle: CoupledTrajectory) -> tuple[np.ndarray, float]:
        """Floquet multipliers (2 k,) of a cycle that repeats, by decreasing modulus, and what the largest is off by.

        They are taken in as many pieces as it takes to tell its modulus from one, in doubt more than once: fast
        vibrations hide from long pieces. Raises what :meth:`monodromy` does.
        """
        found, moduli, pieces = np.zeros(0), [], _FEWEST
        while True:
            found = np.linalg.eigvals(self.monodromy(system, cycle, pieces))
            found = found[np.argsort(-abs(found), kind="stable")]
            moduli.append(float(abs(found[0])))
            off = abs(np.diff(moduli[-3:])).max(initial=0.0) if len(moduli) > 2 else math.inf
            if moduli[-1] < _DIES:
                return found, 0.0
            told = abs(moduli[-1] - 1.0) > 4.0 * off or off < _EXACT
            if told or 2 * pieces > _MOST or _stride(len(cycle.times) - 1, pieces) == 2:
                return found, off
            pieces *= 2


def _stride(count: int, pieces: int) -> int:
    """Stored steps of a piece, an even number: it has a middle."""
    return max(2, 2 * (count // (2 * pieces)))


def returning(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> Returning:
    """The independent coordinates at a state of the bodies."""
    system.compile()
    system.fold(q, v)
    system.engine.choose(t)
    which = system.engine.independent
    turns = np.array([system.engine.layout.coordinates[k][1] == "rad" for k in which], bool)
    return Returning(t, which, turns)
