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
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from kaneflex.integrate.outcome import Outcome

_CYCLES = 100
"""Cycles after which a motion that doesn't repeat counts as one without a periodic state."""
REPEATS = 1e-5
"""Change of the deformation over a cycle, against its largest value, and of free joints, against how far they go, below
which a motion repeats."""
PIECES, _FEWEST, _MOST = 48, 24, 200
"""Pieces of a cycle in each of which the linear equations are those of its middle; at first and at most for its
multipliers."""
_DIES, _EXACT = 0.5, 1e-4
"""A modulus that needs no better look, and what another may be off by where it is one as far as one can tell."""
_ROUNDED = 1e-8
"""What rounding and differences leave of a modulus at least."""
_APART, _BY_CYCLES = 1e-3, 1e-2
"""Of cycles from which differences are taken: how far their starts lie apart, as a share of how far the motion goes,
and what a modulus is off by then."""
_UNKNOWN = "whether disturbances grow is not known"

Start = TypeVar("Start")
Cycle = TypeVar("Cycle")


class Verdict(NamedTuple):
    """What came of a search for a motion that repeats; floquet: its multipliers (2 k,), by decreasing modulus."""

    outcome: Outcome
    message: str
    floquet: np.ndarray | None


COMPLETED = Verdict(Outcome.COMPLETED, Outcome.COMPLETED.value, None)
"""Of a run that is no search."""


class Cycles(ABC, Generic[Start, Cycle]):
    """The cycles of a mechanism by their starts."""

    touches = False
    """Whether something hits, or sticks and slips: that turns a disturbance into another one at once, of which the
    equations in between know nothing."""

    judges = True
    """Whether it is asked of a cycle that repeats whether its disturbances grow."""

    @abstractmethod
    def run(self, start: Start) -> Cycle:
        """The cycle from a start, which may not come to its end."""

    @abstractmethod
    def completed(self, cycle: Cycle) -> bool:
        """Whether it did."""

    @abstractmethod
    def repeats(self, cycle: Cycle) -> bool:
        """Whether it ends where it began."""

    @abstractmethod
    def missed(self, cycle: Cycle) -> np.ndarray:
        """P(x) - x, (2 k,)."""

    @abstractmethod
    def monodromy(self, cycle: Cycle, pieces: int) -> np.ndarray:
        """dP/dx (2 k, 2 k) by that many pieces. Raises ArithmeticError or LinAlgError where equations are singular."""

    @abstractmethod
    def moved(self, cycle: Cycle, x: np.ndarray) -> Start:
        """The start whose x is another one by ``x`` (2 k,). Raises what :meth:`monodromy` does."""

    @abstractmethod
    def end(self, cycle: Cycle) -> Start:
        """Its end as a start."""

    def sizes(self, cycle: Cycle) -> np.ndarray:
        """How far every one of x goes in a cycle, (2 k,); of what touches alone."""
        raise NotImplementedError

    def most_pieces(self, cycle: Cycle) -> int:
        """Into which it can be cut."""
        return _MOST

    def by_cycles(self, cycle: Cycle) -> np.ndarray:
        """dP/dx (2 k, 2 k) by central differences of cycles that start beside one.

        Raises ArithmeticError where one of them doesn't come to its end.
        """
        steps = np.diag(_APART * self.sizes(cycle))
        ends = np.zeros((2, *steps.shape))
        for ahead, sign in zip(ends, (1.0, -1.0), strict=True):
            for k, step in enumerate(steps):
                found = self.run(self.moved(cycle, sign * step))
                if not self.completed(found):
                    raise ArithmeticError("a cycle beside it doesn't come to its end")
                ahead[:, k] = self.missed(found)
        return np.eye(len(steps)) + (ends[0] - ends[1]) / (2.0 * np.diag(steps))

    def repeated(self, start: Start, progress: Callable[[float], None] | None = None) -> tuple[Cycle, Verdict | None]:
        """Cycle after cycle until one repeats, each from where Newton's method has the last one's end lead to.

        The tangent is that of the first cycle, mended by every further one (Broyden 1965); where it is none, or leads
        away, a cycle goes on from the end of the last one, and the verdict says why. What is found says whether
        disturbances of it grow; nothing where the motion can't go on.
        """
        found: Cycle | None = None
        slope: np.ndarray | None = None
        move, missed, tell = np.zeros(0), np.zeros(0), progress or (lambda share: None)
        failure, waited = "", 0
        for count in range(_CYCLES):
            before, found = found, self.run(start)
            if not self.completed(found):
                if before is None or failure:
                    return found, None
                found, failure = before, "; Newton's method leads where no motion goes on"
            if self.repeats(found):
                tell(1.0)
                verdict = self.judged(found) if self.judges else COMPLETED
                how = f"; found by waiting for {waited} cycles{failure}" if failure else ""
                return found, verdict._replace(message=verdict.message + how)
            tell(count / _CYCLES)
            if not failure:
                last, missed = missed, self.missed(found)
                try:
                    if slope is None:
                        tangent = self.by_cycles(found) if self.touches else self.monodromy(found, PIECES)
                        slope = np.eye(len(missed)) - tangent
                    else:
                        slope -= np.outer(missed - last + slope @ move, move) / (move @ move)
                    move = np.linalg.solve(slope, missed)
                    start = self.moved(found, move)
                except (ArithmeticError, np.linalg.LinAlgError) as error:
                    failure = f"; Newton's method fails: {error}"
            if failure:
                start, waited = self.end(found), waited + 1
        assert found is not None
        reason = f"the motion still changes after {_CYCLES} cycles{failure}; damp it, or start from zero"
        return found, Verdict(Outcome.NO_PERIODIC_STATE, f"no periodic state: {reason}", None)

    def multipliers(self, cycle: Cycle) -> tuple[np.ndarray, float]:
        """Floquet multipliers (2 k,) of a cycle that repeats, by decreasing modulus, and what the largest is off by.

        They are taken in as many pieces as it takes to tell its modulus from one, in doubt more than once: fast
        vibrations hide from long pieces. Raises what :meth:`monodromy` does.
        """
        if self.touches:
            found = np.linalg.eigvals(self.by_cycles(cycle))
            return found[np.argsort(-abs(found), kind="stable")], _BY_CYCLES
        moduli, pieces = list[float](), _FEWEST
        while True:
            found = np.linalg.eigvals(self.monodromy(cycle, pieces))
            found = found[np.argsort(-abs(found), kind="stable")]
            moduli.append(float(abs(found[0])))
            off = abs(np.diff(moduli[-3:])).max(initial=_ROUNDED) if len(moduli) > 2 else math.inf
            if moduli[-1] < _DIES:
                return found, 0.0
            told = abs(moduli[-1] - 1.0) > 4.0 * off or off < _EXACT
            if told or 2 * pieces > _MOST or pieces > self.most_pieces(cycle):
                return found, off
            pieces *= 2

    def judged(self, cycle: Cycle) -> Verdict:
        """What a cycle's Floquet multipliers say of its disturbances."""
        from kaneflex.integrate.periodic import exceeds_one
        from kaneflex.integrate.run import LEFT

        def unknown(why: str, floquet: np.ndarray | None = None) -> Verdict:
            return Verdict(Outcome.COMPLETED, f"{Outcome.COMPLETED.value}; {_UNKNOWN}: {why}", floquet)

        if not len(self.missed(cycle)):  # everything is prescribed
            return COMPLETED
        try:
            floquet, off = self.multipliers(cycle)
        except (ArithmeticError, np.linalg.LinAlgError):
            return unknown("the equations beside it have no solution")
        largest = float(abs(floquet[0]))
        if largest > 1.0 + 4.0 * off:
            return Verdict(Outcome.UNSTABLE, exceeds_one(floquet[0]) + LEFT, floquet)
        if largest < 1.0 - 4.0 * off:
            return Verdict(Outcome.COMPLETED, Outcome.COMPLETED.value, floquet)
        return unknown(f"the largest Floquet multiplier is 1 within {max(off, abs(largest - 1.0)):.1g}", floquet)


def propagated(pieces: Iterable[tuple[float, np.ndarray]]) -> np.ndarray:
    """Of x' = A x over pieces of a cycle, each with its length [s] and A at its middle: what the end has of the start.

    It is off by the second order of a piece's length (Magnus 1954).
    """
    from scipy.linalg import expm

    found: np.ndarray | None = None
    for length, A in pieces:
        found = expm(length * A) if found is None else expm(length * A) @ found
    assert found is not None
    return found
