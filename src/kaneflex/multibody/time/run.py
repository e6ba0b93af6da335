"""Run of a mechanism in the plane or in space: initial state, integration with progress, energy balance.

If dependent speeds become large relative to independent ones, as near a dead centre, the next step begins with another
choice.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import ModuleType

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import codes
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.coefficients import GAUSS, RADAU
from kaneflex.multibody.time.error_bounds import ErrorBounds, Method
from kaneflex.multibody.time.spring_displacements import overturned
from kaneflex.multibody.time.trajectory import CoupledTrajectory, RunCurve
from kaneflex.multibody.unilateral import results

_PATIENCE = 5_000_000
"""Largest number of steps between two stored instants, a million periods: more indicate a wrong unit."""
_PIECE, _GROWTH, _WORK = 256, 8, 40_000
"""Pieces of a run between reports of progress, after which it can be interrupted: most stored instants, and first
number of steps; largest growth of that number, and its limit times the number of coordinates, about 0.2 s. Steps
are counted and not timed, as error bounds by largest values so far depend on the ends of pieces."""

_MOST, _WINDOW, _STALLED = 5_000_000, 50_000, 1e-4
"""Largest number of evaluations of the accelerations in a whole run, some minutes, and number of them after which the
progress is checked: _MOST of them must reach a hundredth of the duration."""
_TINY = 1e-4
"""Share of the longest step below which friction may be inconsistent with its reactions."""
_AGREE = 1e-7
"""Largest misfit of redundant constraints, as a share of the mechanism's size."""
PATIENT = 16
"""Steps per call of compiled code with dependent coordinates that should be replaced, but have no better ones."""


Stop = Callable[[CoupledTrajectory], bool]
"""Condition to stop a run, evaluated on every piece, whose first instant is the last one of the piece before."""


def first_step(accelerations: np.ndarray, scale: np.ndarray, longest: float) -> float:
    """First step [s], which moves the mechanism by ten errors; the error estimate controls the next ones."""
    largest = (abs(accelerations) / scale).max(initial=0.0)
    return min(math.sqrt(20.0 / largest) if largest > 0 else math.inf, longest)


def held(engine: Engine, module: ModuleType) -> str:
    """Load whose law would have to hold its switch at zero; empty if there is none."""
    number = int(engine.numbers(at.TOUCH, at.SHARED)[at.HELD])
    return module.SWITCHES[number - 1] if number else ""


class Run(RunCurve):
    """Rows of one integration in the plane or in space, filled piece by piece, up to its ``state``.

    ``limited``: the work of the run is limited, and a branch that it leaves is not looked for.
    """

    def __init__(
        self, system: System, start: State, times: np.ndarray, method: Method, given: np.ndarray | None = None,
        limited: bool = False,
    ) -> None:  # fmt: skip
        self.system, self.engine, self.start, self.times, self.method = system, system.engine, start, times, method
        self.given, self.limited = np.zeros(0) if given is None else given, limited or self.engine.in_space
        self.engine.compile()
        self.pieces, self.counts, self.filled, self.length, self.patient = [], np.zeros(5), 0, 0.0, 0.0
        overdamped = self.engine.in_space and method.integrator == "radau" and system.has_slopes
        self.sloped = codes.DAMPED if overdamped else 0.0
        self.longest, self.seen = float(times[1] - times[0]), (0, float(times[0]))
        self.bounds = ErrorBounds(self.engine, method, self.longest)
        self.bounds.begin()
        self.twice, self.stored = tuple[str, ...](), np.zeros(len(self.engine.rows))
        self.impacts: tuple[results.Impact, ...] = ()
        self.projected, self.step = self._begun(start)
        self.state = self.engine.row(float(times[0]))
        self.table = np.zeros((len(times), len(self.state)))
        self.table[0], self.ended = self.state, self.table[:0]

    def _begun(self, start: State) -> tuple[bool, float]:
        """Set the tables to the start; returns whether it is regular, and the first step [s]."""
        engine, t = self.engine, float(self.times[0])
        # Else records of an earlier run decide which contacts are closed, and what counts as zero.
        engine.rows[:], engine.numbers(at.TOUCH, at.SHARED)[at.FLIGHT :] = 0.0, 0.0
        engine.frictions[:, at.JAMS] = math.nan
        engine.take_impacts()
        engine.set(start)
        if engine.in_space:
            engine.choose_speeds(start.choice)
        else:
            self.twice = tuple(dict.fromkeys(engine.cut_of(row) for row in engine.choose(t).tolist()))
        regular, own = engine.project(t), slice(len(engine.frictions), len(engine.frictions) + len(self.touching))
        self.stored[own] = engine.work.touching[own, at.STORED_AT]
        return regular, first_step(engine.motion[2], self.bounds.scale, self.longest)

    def go(
        self, progress: Callable[[float], None] | None = None, stop: Stop | None = None
    ) -> tuple[Outcome, str]:
        """Integrate to the end, or to the last possible state. Raises SceneError if a limited run takes too many steps.
        """
        try:
            if not self.projected:
                rubs = len(self.engine.frictions) > 0
                rubbing = ", or no combination of sticking and slipping is consistent" if rubs else ""
                return Outcome.SINGULAR, f"singular at the start: {_SINGULAR}{rubbing}"
            return self._integrated(progress, stop)
        finally:  # for readers there are no change points
            self.engine.numbers(at.CROSSING, at.CHANGE_POINT)[at.WHEN], self.ended = -math.inf, self.table[:0]
            if not self.pieces:
                self.pieces.append((np.vstack([self.state, self.state]), self.engine.choice))

    def _integrated(self, progress: Callable[[float], None] | None, stop: Stop | None) -> tuple[Outcome, str]:
        # Bounds by the largest values so far are updated after every piece.
        most, growth = (1, 2) if self.method.bounded else (_PIECE, _GROWTH)
        since = 0
        while self.filled + 1 < len(self.times):
            before = self.filled
            rows = slice(before, before + 1 + min(most, _PIECE))
            ended = self._collocation(rows, most)
            if ended == codes.TOO_SMALL and self.engine.numbers(at.TOUCH, at.SHARED)[at.IN_A_ROW] > 0.0:
                ended = codes.CASCADE
            most = max(1, min(growth * most, _WORK // max(1, self.engine.size)))
            if ended not in (codes.DONE, codes.PAUSED) and not self._turned():
                outcome, words = self._held() or self._reason(ended) or _ENDED[ended]
                more = f"; constraints of {', '.join(self.twice)} and others are redundant there" if self.twice else ""
                return outcome, words.format(at=f"t = {self.times[self.filled]:.6g} s") + more
            if self._is_in_doubt() and not self._agrees():
                outcome, words = _ENDED[codes.PARADOX]
                return outcome, words.format(at=f"t = {self.state[0]:.6g} s")
            misfit = self._misfit()
            if misfit:
                return Outcome.SINGULAR, misfit
            tried = int(self.counts[0] + self.counts[1])
            since = tried if self.filled > before else since
            if tried - since > _PATIENCE:
                message = f"{_PATIENCE:,} steps after t = {self.times[self.filled]:.6g} s do not reach the next stored"
                return Outcome.STUCK, f"{message} instant: the motion is too fast"
            if progress is not None:
                came = max(self.times[self.filled], self.state[0])
                progress(float((came - self.times[0]) / (self.times[-1] - self.times[0])))
            if self.limited:
                self._keep_pace()
            if stop and self.filled > before and stop(self.trajectory(self.table[before : self.filled + 1])):
                break
        return Outcome.COMPLETED, Outcome.COMPLETED.value

    def _keep_pace(self) -> None:
        """Raise SceneError if the work so far shows that the run takes too long."""
        t, done, duration, stalled = float(self.state[0]), self.evaluations, float(np.ptp(self.times)), False
        if done - self.seen[0] > _WINDOW:
            stalled, self.seen = t - self.seen[1] < _STALLED * duration, (done, t)
        if stalled or done > _MOST:
            reached = f"{done} evaluations reach only t = {t:.6g} s of {duration:.6g} s"
            cure = f"Shorten the duration, or raise {self.method.entry}"
            raise self.stopped(f"the motion is too fast for the duration: {reached}", cure)

    def _held(self) -> tuple[Outcome, str] | None:
        """Outcome if a law would have to hold its switch at zero; None otherwise."""
        name = held(self.engine, self.system.module)
        cure = "Use friction of a joint in place of the law"
        return (Outcome.CASCADE, f"after {{at}} the law of loads.{name} {_BACK_AND_FORTH}. {cure}") if name else None

    def _reason(self, ended: int) -> tuple[Outcome, str] | None:
        """Outcome if bushings turn too far, the damping of bristles exceeds the force that their contact can give, or,
        in space, the last state is singular or steps become too short; None otherwise."""
        engine, stuck = self.engine, f"the motion can't continue after t = {self.state[0]:.6g} s"
        if engine.in_space and (far := overturned(self.system.mechanism, engine.work.springs)):  # in the last attempt
            return Outcome.STUCK, f"{stuck}: {far[1]}. Limit the rotation, or use loads with laws"
        if ended == codes.TOO_SMALL and (bristles := self._bristles()):
            return Outcome.STUCK, bristles
        if not engine.in_space or ended in (codes.CASCADE, codes.PARADOX):
            return None
        advice = f". {BENT_FAR}" if engine.shapes.any() else ""
        try:
            self.system.project(float(self.state[0]), *engine.state_of(self.state), engine.choice)
        except ArithmeticError as reason:
            return Outcome.SINGULAR, f"{stuck}: {reason}{advice}"
        return (Outcome.STUCK, f"{stuck}: the step size tends to zero{advice}") if ended == codes.TOO_SMALL else None

    def _bristles(self) -> str:
        """Message about damping of bristles that exceeds the sliding friction; empty otherwise."""
        frictions = list(self.system.mechanism.frictions.items())
        states = self.engine.instants(self.system.unfold(self.state[None])).touching[0]
        states = states[len(self.engine.frictions) - len(frictions) :]
        for (name, own), (_, speed, _, pressed, *_) in zip(frictions, states, strict=False):
            damped, dry = own.damping * abs(speed), own.mu * pressed + own.preload
            if damped > dry:
                return (
                    f"the step size tends to zero after {{at}}: at {name} bristle_damping times the speed, "
                    f"{damped:.3g}, exceeds the sliding friction, {dry:.3g}, and the bristle force has no solution. "
                    "Give a smaller bristle_damping"
                )  # fmt: skip
        return ""

    def _misfit(self) -> str:
        """Message about redundant constraints that no longer agree; empty otherwise."""
        engine = self.engine
        rows, first = engine.count(at.JOINT_ROWS), engine.count(at.ROW_OF)
        if np.count_nonzero(engine.tables.plan[first : first + engine.count(at.KEPT)] < rows) == rows:
            return ""
        t = float(self.state[0])
        engine.set_row(self.state)
        apart = abs(engine.openings(t)[:rows]) / engine.work.row_measure
        row = int(apart.argmax())
        if apart[row] <= _AGREE:
            return ""
        return (f"over-constrained after t = {t:.6g} s: a constraint of {engine.cut_of(row)} is redundant, "
                f"and violated by {apart[row]:.2g} of the mechanism's size, or of 1 rad")  # fmt: skip

    def _is_in_doubt(self) -> bool:
        """True if steps are so short that friction may be inconsistent with its reactions.

        Not with resting rigid sides: just before they separate, rounding makes their force negative, with which no
        friction is consistent, and the decision at the next change determines the mode.
        """
        if not len(self.engine.frictions) or self.step >= _TINY * self.longest:
            return False
        contacts = self.system.mechanism.contacts.values()
        closed = self.engine.contacts[: len(contacts), at.MODE] != at.OPEN
        return not any(shut and each.law == "newton" for shut, each in zip(closed, contacts, strict=True))

    def _agrees(self) -> bool:
        """True if friction is consistent with its reactions at the current state."""
        self.engine.set_row(self.state)
        agrees = self.engine.project(float(self.state[0]))
        self.engine.set_row(self.state)
        return agrees

    def _turned(self) -> bool:
        """True if the integration can continue with other dependent coordinates."""
        if not self._chosen_anew() or not self.engine.project(float(self.state[0])):
            return False
        self.step, self.length = first_step(self.engine.motion[2], self.bounds.scale, self.longest), 0.0
        return True

    def _chosen_anew(self) -> bool:
        """Choose kept rows and dependent coordinates at the current state; True if they change.

        As many rows are kept: near a singular position fewer would leave a freedom open.
        """
        engine, before = self.engine, self.engine.choice
        engine.set_row(self.state)
        engine.choose(float(self.state[0]))
        choice, other = engine.choice, engine.choice.rows.tolist() != before.rows.tolist()
        if choice.differs(before) and len(choice.rows) == len(before.rows) and (not other or self._projected()):
            return True
        engine.choose_speeds(before)
        engine.set_row(self.state)
        return False

    def _collocation(self, rows: slice, most: int) -> int:
        self.bounds.update(np.vstack([self.table[max(0, self.filled - _PIECE) : self.filled + 1], self.state]))
        before, choice, most = self.state.copy(), self.engine.choice, min(most, PATIENT) if self.patient else most
        control = np.array([self.step, self.longest, most, 0.0, 0.0, self.length, self.patient, self.sloped])
        given = self.given
        if len(given):
            given = given[slice(*np.searchsorted(given, (self.state[0], self.times[rows][-1]), side="right"))]
        if len(self.ended) < 2 * (int(most) + 1):
            self.ended = np.zeros((2 * (int(most) + 1), len(before)))
        method = TABLES["radau" if self.sloped == codes.DAMPED else self.method.integrator]
        ended = self.engine.integrate(
            method, control, self.state, given, self.times[rows], self.table[rows], self.counts, self.ended
        )
        if control[4]:
            self.pieces.append((np.vstack([before, self.ended[: int(control[4])]]), choice))
        self.step, self.length, self.filled = float(control[0]), float(control[5]), self.filled + int(control[3])
        self.sloped = float(control[7])
        if self.touching:
            self.impacts += results.over(self.touching, self.engine.take_impacts())
        self.patient = 0.0
        if ended == codes.TURNED:
            self.patient = float(not self._chosen_anew())
            return codes.PAUSED
        if ended == codes.RESTED:
            if self._rest():
                return codes.PAUSED
            return codes.PARADOX if len(self.engine.frictions) else codes.SINGULAR
        return ended

    def cut(self, k: int, message: str, found: CoupledTrajectory) -> CoupledTrajectory:
        """Part of the run up to stored instant k, where it left its branch."""
        self.filled, self.state = k, self.table[k].copy()
        self.impacts = tuple(impact for impact in self.impacts if impact.begin <= self.times[k])
        return self.trajectory(self.table[: k + 1], Outcome.SINGULAR, message, found.ns_per_step)

    def _rest(self) -> bool:
        """Continue after a change of resting contacts, with other dependent coordinates; False: singular."""
        self.engine.set_row(self.state)
        self.engine.choose(float(self.state[0]))
        return self._projected()

    def _projected(self) -> bool:
        """Continue from the current state, with the reactions of the kept rows; False: singular."""
        t, works = float(self.state[0]), self.engine.count(at.WORKS)
        if not self.engine.project(t):
            return False
        self.state[:-works], self.length = self.engine.row(t)[:-works], 0.0
        if self.table[self.filled, 0] == t:
            self.table[self.filled] = self.state
        return True

    def trajectory(
        self, rows: np.ndarray, outcome: Outcome = Outcome.COMPLETED, message: str = "", ns: float = 0.0
    ) -> CoupledTrajectory:
        """The rows as motion of the bodies."""
        engine, record = self.engine, self.system.unfold(rows)
        if self.touching:
            self.system.unfold(self.state[None])
        held = len(engine.frictions)
        jams = engine.frictions[held - len(self.system.mechanism.frictions) : held, at.JAMS].copy()
        happened = self.impacts + results.lasting(self.touching, engine, self.state)
        energy, contacts, frictions = self.moved(rows, record, happened, jams)
        return CoupledTrajectory(
            rows, record, self.system.record, energy, int(self.counts[0]), int(self.counts[1]), outcome, message, ns,
            contacts, frictions, curve=self,
        )  # fmt: skip


def integrate(
    system: System, start: State, times: np.ndarray, method: Method, progress: Callable[[float], None] | None = None,
    stop: Stop | None = None, ends: np.ndarray | None = None, limited: bool = False,
) -> CoupledTrajectory:  # fmt: skip
    """Motion of a system from a start at times[0], at ``times`` [s] up to its end.

    ``ends`` [s], including all ``times``, prescribe the ends of steps in place of error control; ``limited``: see
    :class:`Run`.
    """
    run = Run(system, start, times, method, ends, limited)
    started = time.perf_counter()
    ended = run.go(progress, stop)
    return finished(run, ended, 1e9 * (time.perf_counter() - started) / max(1.0, run.counts[0] + run.counts[1]))


def finished(run: Run, ended: tuple[Outcome, str], ns: float) -> CoupledTrajectory:
    """Motion of a run up to its end, or to the position at which it left its branch; ``ns``: nanoseconds a step."""
    found = run.trajectory(run.table[: run.filled + 1], *ended, ns)
    if run.limited or not len(found.energy.jumps()):
        return found
    from kaneflex.multibody.time.lost_branch import departure  # which few runs need

    left = departure(run.system, found, run.method.integrator)
    return found if left is None else run.cut(*left, found)


TABLES = {"radau": at.Handle(*RADAU), "gauss": at.Handle(*GAUSS)}
"""Coefficients of the integrators that control their error."""

BENT_FAR = "Give fewer solve.modes, or divide bodies with such large bending into several welded ones"
"""Advice if a coupled motion cannot continue: equations of the second order in the shapes fail for large bending."""
_BACK_AND_FORTH = "switches back and forth: on both sides of its jump the motion returns to it, as with a brake at rest"
"""Problem of a law that would have to hold its switch at zero."""
_SINGULAR = "the constraints there determine neither motion nor reactions, as in a fully stretched linkage"
_ENDED = {
    codes.TOO_SMALL: (
        Outcome.STUCK, "the motion can't continue after {at}: the step size tends to zero, as in a locked linkage",
    ),
    codes.SINGULAR: (Outcome.SINGULAR, f"singular after {{at}}: {_SINGULAR}"),
    codes.CASCADE: (
        Outcome.CASCADE,
        "contacts close and open, or stick and slip, repeatedly after {at}, at intervals too short for a step",
    ),
    codes.PARADOX: (
        Outcome.PARADOX,
        "at {at} no combination of sticking and slipping is consistent with friction (Painleve's paradox): the motion "
        "of rigid bodies with Coulomb's law is undefined",
    ),
    codes.NO_CONVERGENCE: (
        Outcome.STUCK,
        "the step of the given length from {at} does not converge: give shorter ones, or use error control",
    ),
}  # fmt: skip
