"""Search for periodic motions by shooting: from the change over a cycle to a start without change.

x are the independent coordinates and their rates at the start of a cycle, P(x) those at its end. Newton's method solves
P(x) = x with the monodromy matrix dP/dx of the equations linearised along a cycle,

    x <- x + (1 - dP/dx)^-1 (P(x) - x),

so that slowly decaying modes need not be waited for. The eigenvalues of dP/dx are the Floquet multipliers of a periodic
motion (Nayfeh and Mook 1979, section 5.2): a disturbance grows if the modulus of one exceeds one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.linearisation import Equations, state_matrix
from kaneflex.multibody.time.run import integrate
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.support.errors import counted

_CYCLES = 100
"""Largest number of cycles of the search."""
REPEATS = 1e-5
"""Change over a cycle that counts as periodic: of the deformation, relative to its largest value, and of free joints,
relative to their range and that of their speeds."""
LOOKS = 33
"""Instants of a cycle at which the range of its motion is measured."""
_STILL = 1e-3
"""Share of the mechanism's size, or rad, below which a motion counts as rest."""
PIECES, _FEWEST, _MOST = 48, 24, 200
"""Pieces of a cycle with constant linear equations, and their first and largest number for multipliers."""
_DIES, _EXACT = 0.5, 1e-4
"""Modulus that needs no refinement, and accuracy of one close to 1."""
_ROUNDED = 1e-8
"""Least error of a modulus by rounding and differences."""
_APART, _BY_CYCLES = 1e-3, 1e-2
"""For differences of cycles: distance of their starts, as a share of the motion's range, and resulting error of a
modulus."""
_UNKNOWN = "the stability is not known"


class Verdict(NamedTuple):
    """Result of a search for a periodic motion; floquet: its multipliers (2 k,), by decreasing modulus."""

    outcome: Outcome
    message: str
    floquet: np.ndarray | None


COMPLETED = Verdict(Outcome.COMPLETED, Outcome.COMPLETED.value, None)
"""Verdict of a run without search."""


class Cycles:
    """Cycles of a mechanism by their starts, in the plane or in space.

    Parameters
    ----------
    equations : Equations
        Of the coordinates of x; they hold between changes of contacts and friction.
    times : ndarray (n_times,)
        Stored instants of a cycle [s].
    method : Method
        Of the integration.
    closer : float
        Factor on REPEATS; other than 1 for neighbours of a known cycle, whose stability is not determined.
    ends : ndarray, optional
        Given ends of the steps [s].
    """

    def __init__(
        self, equations: Equations, times: np.ndarray, method: Method, closer: float = 1.0,
        ends: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.equations, self.times, self.method, self.ends, self.judges = equations, times, method, ends, closer == 1.0
        self.begin, self.period = float(times[0]), float(times[-1] - times[0])
        self.measure, self.shapes = equations.measure, equations.shapes
        self.left, self.error = closer * REPEATS, method.tolerance * self.measure

    @property
    def touches(self) -> bool:
        """True with contacts, friction or loads that jump: the linearised equations do not include their changes."""
        return bool(len(self.equations.engine.contacts) or len(self.equations.engine.frictions))

    def run(self, start: State) -> CoupledTrajectory:
        """Cycle from a start, which may stop early."""
        return integrate(self.equations.system, start, self.times, self.method, ends=self.ends)

    def completed(self, cycle: CoupledTrajectory) -> bool:
        """True if the cycle is complete."""
        return cycle.outcome is Outcome.COMPLETED

    def states(self, cycle: CoupledTrajectory, count: int) -> Iterable[State]:
        """States at equal distances, from the initial to the final one."""
        return self.along(cycle, np.linspace(0.0, 1.0, count))

    def along(self, cycle: CoupledTrajectory, shares: np.ndarray) -> Iterable[State]:
        """States at instants given as shares of a cycle."""
        found: Iterable[State] = cycle.curve.states(self.begin + shares * self.period)
        return found

    def deformation(self, cycle: CoupledTrajectory) -> float:
        """Largest coordinate of a shape in a cycle."""
        engine = self.equations.engine
        of_shapes = engine.own[engine.shapes[engine.own[:, 1]], 0]
        return max(abs(state.q[of_shapes]).max(initial=0.0) for state in self.states(cycle, LOOKS))

    def turns(self, cycle: CoupledTrajectory) -> np.ndarray:
        """Full turns of the coordinates in a cycle [rad]."""
        engine, (start, end) = self.equations.engine, self.states(cycle, 2)
        own = engine.own[(engine.turns & ~engine.shapes)[engine.own[:, 1]], 0]
        found = 0.0 * start.q
        found[own] = whole_turns(end.q[own] - start.q[own])
        return found

    def end(self, cycle: CoupledTrajectory) -> State:
        """End of a cycle as a start, without whole turns of joints since its start."""
        *_, end = self.states(cycle, 2)
        return self.equations.system.project(self.begin, end.q - self.turns(cycle), end.u, self.equations.choice)

    def apart(self, start: State, *others: State) -> np.ndarray:
        """x of other states less that of a start, without whole turns, (n, 2 k)."""
        return self.equations.apart(start, *others)

    def moved(self, start: State, x: np.ndarray) -> State:
        """Start with x changed by ``x`` (2 k,). Raises ArithmeticError or LinAlgError if equations are singular."""
        return self.equations.beside(start, x)

    def missed(self, cycle: CoupledTrajectory) -> np.ndarray:
        """Change P(x) - x, (2 k,)."""
        return self.apart(*self.states(cycle, 2))[0]

    def repeats(self, cycle: CoupledTrajectory, left: float) -> bool:
        """True if a cycle repeats to ``left``: deformations relative to their largest, free joints to their range and
        that of their speeds, within the error of the steps."""
        change, faster = abs(self.missed(cycle)).reshape(2, -1)
        joints, deforms = ~self.shapes, (change[self.shapes] <= left * self.deformation(cycle)).all()
        if not (deforms and joints.any()):
            return bool(deforms)
        way, fastest = self._ranges(cycle).reshape(2, -1)[:, joints]
        allowed = np.maximum(left * way, self.error[joints])
        return bool((change[joints] <= allowed).all() and (faster[joints] * way <= allowed * fastest).all())

    def _way(self, missed: np.ndarray) -> float:
        """Largest change of a coordinate, in its unit."""
        return float((abs(missed[: len(self.measure)]) / self.measure).max(initial=0.0))

    def _ranges(self, cycle: CoupledTrajectory) -> np.ndarray:
        """Range of every component of x in a cycle, (2 k,)."""
        start, *others = self.states(cycle, LOOKS)
        return np.ptp(self.apart(start, start, *others), axis=0)

    def sizes(self, cycle: CoupledTrajectory) -> np.ndarray:
        """Scales of x, (2 k,): at least 1e-3 of the mechanism's size or of 1 rad, per cycle for rates."""
        least = _STILL * self.measure
        return np.maximum(self._ranges(cycle), np.concatenate([least, least / self.period]))

    def monodromy(self, cycle: CoupledTrajectory, pieces: int = PIECES) -> np.ndarray:
        """Monodromy matrix dP/dx (2 k, 2 k) by the equations linearised at the middle of each piece. Raises as
        :meth:`moved`."""
        middles = self.along(cycle, (np.arange(pieces) + 0.5) / pieces)
        return propagated(self.period / pieces, (state_matrix(*self.equations.matrices(each)) for each in middles))

    def by_cycles(self, cycle: CoupledTrajectory) -> np.ndarray:
        """Monodromy matrix dP/dx (2 k, 2 k) by central differences of neighbouring cycles.

        Raises ArithmeticError if one of them is not complete.
        """
        (start, _), steps = self.states(cycle, 2), np.diag(_APART * self.sizes(cycle))
        ends = np.zeros((2, *steps.shape))
        for ahead, sign in zip(ends, (1.0, -1.0), strict=True):
            for k, step in enumerate(steps):
                found = self.run(self.moved(start, sign * step))
                if not self.completed(found):
                    raise ArithmeticError("a neighbouring cycle is not complete")
                ahead[:, k] = self.missed(found)
        return np.eye(len(steps)) + (ends[0] - ends[1]) / (2.0 * np.diag(steps))

    def repeated(
        self, start: State, progress: Callable[[float], None] | None = None
    ) -> tuple[CoupledTrajectory, Verdict | None]:
        """Run cycles until one repeats, each from the start that Newton's method predicts.

        The tangent is that of the first cycle, updated by every further one (Broyden 1965); if it fails or diverges,
        cycles continue from the end of the last one, and the verdict reports it. The verdict also includes stability;
        None if the motion can't continue.
        """
        found: CoupledTrajectory | None = None
        slope: np.ndarray | None = None
        move, missed, tell = np.zeros(0), np.zeros(0), progress or (lambda share: None)
        failure, waited = "", 0
        for count in range(_CYCLES):
            before, found = found, self.run(start)
            if not self.completed(found):
                if before is None or failure:
                    return found, None
                found, failure = before, "; Newton's method leads to a state without motion"
            last, missed = missed, self.missed(found)
            # below this, errors of the steps are larger than the change over a cycle
            stalled = not self.judges and count and self._way(missed) > 0.5 * self._way(last)
            if self.repeats(found, REPEATS if stalled else self.left):
                tell(1.0)
                verdict = self.judged(found) if self.judges else COMPLETED
                how = f"; found by continuing for {counted(waited, 'cycle')}{failure}" if failure else ""
                return found, verdict._replace(message=verdict.message + how)
            tell(count / _CYCLES)
            if not failure:
                try:
                    if slope is None:
                        tangent = self.by_cycles(found) if self.touches else self.monodromy(found, PIECES)
                        slope = np.eye(len(missed)) - tangent
                    else:
                        slope -= np.outer(missed - last + slope @ move, move) / (move @ move)
                    move = np.linalg.solve(slope, missed)
                    start = self.moved(next(iter(self.states(found, 2))), move)
                except (ArithmeticError, np.linalg.LinAlgError) as error:
                    failure = f"; Newton's method fails: {error}"
            if failure:
                start, waited = self.end(found), waited + 1
        assert found is not None
        reason = f"the motion still changes after {_CYCLES} cycles{failure}; add damping, or start from zero"
        return found, Verdict(Outcome.NO_PERIODIC_STATE, f"no periodic state: {reason}", None)

    def multipliers(self, cycle: CoupledTrajectory) -> tuple[np.ndarray, float]:
        """Floquet multipliers (2 k,) of a periodic cycle, by decreasing modulus, and the error of the largest.

        The number of pieces is increased until its modulus differs clearly from one, in doubt repeatedly, since long
        pieces hide fast vibrations. Raises as :meth:`monodromy`.
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
            is_clear = abs(moduli[-1] - 1.0) > 4.0 * off or off < _EXACT
            if is_clear or 2 * pieces > _MOST:
                return found, off
            pieces *= 2

    def judged(self, cycle: CoupledTrajectory) -> Verdict:
        """Stability verdict from a cycle's Floquet multipliers."""
        from kaneflex.integrate.periodic import exceeds_one
        from kaneflex.integrate.system import LEFT

        def unknown(why: str, floquet: np.ndarray | None = None) -> Verdict:
            return Verdict(Outcome.COMPLETED, f"{Outcome.COMPLETED.value}; {_UNKNOWN}: {why}", floquet)

        if not len(self.missed(cycle)):  # everything is prescribed
            return COMPLETED
        try:
            floquet, off = self.multipliers(cycle)
        except (ArithmeticError, np.linalg.LinAlgError):
            return unknown("the linearised equations have no solution")
        largest = float(abs(floquet[0]))
        if largest > 1.0 + 4.0 * off:
            return Verdict(Outcome.UNSTABLE, exceeds_one(floquet[0]) + LEFT, floquet)
        if largest < 1.0 - 4.0 * off:
            return Verdict(Outcome.COMPLETED, Outcome.COMPLETED.value, floquet)
        return unknown(f"the largest Floquet multiplier is 1 within {max(off, abs(largest - 1.0)):.1g}", floquet)


def propagated(length: float, pieces: Iterable[np.ndarray]) -> np.ndarray:
    """State transition matrix of x' = A x over pieces of equal length [s], given A at the middle of each.

    The error is of second order in the length (Magnus 1954).
    """
    from scipy.linalg import expm

    return reduce(lambda found, piece: piece @ found, (expm(length * A) for A in pieces))
