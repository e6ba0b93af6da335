"""Curves of a mechanism in the plane or in space: its states by time, or neighbours of one of them."""

from __future__ import annotations

import bisect
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from kaneflex.mechanism.rigid_motion import not_integrated
from kaneflex.multibody.model.codes import AHEAD, BESIDE, FAR, GROWN, NEAR_STATES, check
from kaneflex.multibody.model.initial_state import choose_anew
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.support.errors import SceneError

_MOST_PLACES = 20_000_000
"""Largest number of positions at which loops are closed between instants: some minutes."""
_AT_ONCE = 1000
"""Positions whose records are in memory at a time."""
_ROUNDED = 1e-6
"""Share of a step that counts as rounding."""


class Curve(ABC):
    """States of a mechanism by the time [s], from its start on; ``work`` of the system then has the last one."""

    system: System
    start: State
    turned: Mapping[str, float] | None = None
    """Angles [rad] with whole turns at the start, for joints that close loops, from the run that this one continues;
    None if it continues none."""
    whole = False
    """True for the curve of a run."""

    def __call__(self, t: float) -> State:
        """The state at t [s]."""
        self.rows(np.array([float(t)]))
        return self.system.engine.state(t, self.system.engine.choice)

    @abstractmethod
    def rows(self, times: np.ndarray) -> np.ndarray:
        """Rows of :class:`kaneflex.multibody.dynamics.arrays.Instants` at ``times`` [s], which are in their
        order.
        """

    def record(self, times: np.ndarray) -> np.ndarray:
        """The same at ``times`` [s] in any order."""
        order, found = np.argsort(times, kind="stable"), np.zeros((len(times), len(self.system.work.kept)))
        if len(times):
            found[order] = self.rows(times[order])
        return found


class AtStart(Curve):
    """Start of a mechanism, before free joints or shapes are integrated."""

    def __init__(self, system: System, start: State) -> None:
        self.system, self.start = system, start

    def rows(self, times: np.ndarray) -> np.ndarray:
        start = self.start
        for t in times[times != start.t].tolist():
            raise not_integrated(t)
        self.system.project(start.t, start.q, start.u, start.choice)
        return np.tile(self.system.work.kept, (len(times), 1))


class DrivenCurve(Curve):
    """Curve of a mechanism whose drives determine its position: loops are followed step by step.

    Raises SceneError if they do not close; it names the time.
    """

    def __init__(self, system: System, start: State) -> None:
        self.system, self.start, self.track, self.last = system, start, [start], start

    def rows(self, times: np.ndarray) -> np.ndarray:
        out, done = np.zeros((len(times), len(self.system.work.kept))), 0
        self._check_courses(times)
        state = self._before(times[0])
        t, choice = state.t, state.choice
        try:
            self.system.project(t, state.q, state.u, choice)
            while done < len(times):
                count, t, outcome = self.system.follow(t, choice, times[done:], out[done:])
                done += count
                if outcome == GROWN:
                    here = self.system.engine.state(t, choice)
                    choice = choose_anew(self.system, here.q, choice)
                    self.system.project(t, here.q, here.u, choice)
                else:
                    check(outcome)
                self._check_pace(t, times[min(done, len(times) - 1)])
                self.last = self.system.engine.state(t, choice)
                if done < len(times):
                    bisect.insort(self.track, self.last, key=lambda known: known.t)
        except ArithmeticError as reason:
            self._check_pace(t, times[done])
            raise self._open(t, str(reason)) from None
        return out

    def _check_courses(self, times: np.ndarray) -> None:
        """Raise SceneError if the course of a drive at these times [s] is not finite, or too long to be followed."""
        driven = self.system.driven
        courses = self.system.engine.courses(times).reshape(len(times), len(driven), 3)
        for k, drive in np.argwhere(~np.isfinite(courses).all(axis=2))[:1].tolist():
            raise SceneError(
                f"drives.{driven[drive]}", self.system.mechanism.drives[driven[drive]].law,
                f"the motion or a derivative of it has no finite value at t = {times[k]:.6g} s",
                "Give a law that is finite over the run, or another duration",
            )  # fmt: skip
        if self.system.layout.cuts:
            steps_between(courses[:, :, 0] / self.system.engine.measure[self.system.engine.prescribed], driven)

    def _open(self, t: float, reason: str) -> SceneError:
        """Error for loops that don't close at t [s]. Raises another one where they can't close in the plane at all."""
        mechanism, driven = self.system.mechanism, self.system.driven
        places = dict(zip(driven, self.system.courses(t)[:, 0].tolist(), strict=True))
        if not self.system.in_space:
            from kaneflex.mechanism.position_analysis import place

            place(mechanism, places)
        at = " and ".join(f"{name} = {mechanism.written_coordinate(name, where)}" for name, where in places.items())
        return SceneError(
            "joints", ", ".join(self.system.layout.cuts or driven) or None,
            f"{reason}, at t = {t:.6g} s" + (f", where {at}" if at else ""),
            "Change the lengths, or limit the drives' range",
        )  # fmt: skip

    def _check_pace(self, t: float, asked: float) -> None:
        """Raise SceneError if a drive diverges at t [s], as at a law's pole: at its speed, the way to the next instant
        would be too long to be followed."""
        engine, speeds = self.system.engine, abs(self.system.courses(t)[:, 1])
        far = speeds / engine.measure[engine.prescribed] * (asked - t) / FAR
        for drive in np.flatnonzero(far > _MOST_PLACES)[:1].tolist():
            name = self.system.driven[drive]
            raise SceneError(
                f"drives.{name}", self.system.mechanism.drives[name].law, f"its motion is unbounded at t = {t:.6g} s",
                "Give a law that is bounded and smooth over the run, or another duration",
            )  # fmt: skip

    def _before(self, t: float) -> State:
        """The last known state before t, or the start."""
        found = self.track[max(0, bisect.bisect_right(self.track, t, key=lambda known: known.t) - 1)]
        return self.last if found.t < self.last.t <= t else found


def steps_between(places: np.ndarray, names: Sequence[str]) -> np.ndarray:
    """Numbers of steps between instants over which loops can be followed, (n_times - 1,).

    ``places``: coordinates of the joints with these names in their measures, (n_times, n). Raises SceneError for more
    positions than some minutes allow.
    """
    moved = abs(np.diff(places, axis=0)) / FAR
    steps = np.maximum(1.0, np.ceil(moved.max(axis=1, initial=0.0) - _ROUNDED))
    if steps.sum() > _MOST_PLACES:
        far = f"it turns so often that the loops would have to be closed at {steps.sum():.3g} positions"
        cure = "Give a lower speed or a shorter duration"
        raise SceneError(f"drives.{names[int(moved.max(axis=0).argmax())]}.speed", None, far, cure)
    return steps.astype(int)


class ReferenceCurve(Curve):
    """Curve of the rigid mechanism beside a deforming one, with its independent coordinates, speeds and accelerations.

    Dependent coordinates are NaN where loops don't close, or redundant constraints are violated. ``near``: function of
    times [s] that returns coordinates from which they close, speeds and accelerations, (n_times, .) each.
    """

    def __init__(self, system: System, start: State, near: Callable[[np.ndarray], Iterable[np.ndarray]]) -> None:
        self.system, self.start, self.near = system, start, near

    def rows(self, times: np.ndarray) -> np.ndarray:
        return self.closed(times, BESIDE)

    def closed(self, times: np.ndarray, near: int) -> np.ndarray:
        """Rows at ``times`` [s] with closed loops, see :func:`kaneflex.multibody.dynamics.entries.unfold`."""
        engine = self.system.engine
        engine.choose_speeds(self.start.choice)
        return engine.unfold(engine.rows_of(times, *self.near(times)), near)


class ReferenceBeforeRun(ReferenceCurve):
    """The same before a run: ``near`` gives the independent coordinates, and the others at the start, from which the
    loops are followed."""

    def rows(self, times: np.ndarray) -> np.ndarray:
        engine, ends, free = self.system.engine, np.append(self.start.t, times), self.start.choice.independent
        places = np.hstack([next(iter(self.near(ends)))[:, free], engine.courses(ends)[:, ::3]])
        given = np.append(free, engine.prescribed)
        names = [engine.layout.speeds[k].rpartition(".")[0] for k in given.tolist()]
        moved = places / engine.measure[given] if self.system.layout.cuts else places[:, :0]
        last = np.append(0, np.cumsum(steps_between(moved, names)))
        path, found = np.interp(np.arange(1, last[-1] + 1), last, ends), [self.closed(ends[:1], BESIDE)[:0]]
        for first in range(0, len(path), _AT_ONCE):
            asked = last[(last > first) & (last <= first + _AT_ONCE)] - first - 1
            found.append(self.closed(path[first : first + _AT_ONCE], AHEAD)[asked])
        return np.concatenate(found)


_APART = 1e-15
"""Spacing of fictitious instants, which only order the neighbours, as a share of their time, or of 1 s: nothing else
changes between them."""


class Neighbours(Curve):
    """Neighbouring states of a motion at fictitious successive ``times`` [s].

    ``start``: state of the motion itself; ``given``: their coordinates, independent speeds and accelerations, and
    inputs, (k, coordinates + 2 speeds + inputs); ``states``: rows near them at the time of the motion.
    """

    def __init__(self, system: System, start: State, given: np.ndarray) -> None:
        self.system, self.start, engine = system, start, system.engine
        self.times = start.t + _APART * max(1.0, abs(start.t)) * np.arange(len(given))
        system.project(start.t, start.q, start.u, start.choice)
        q, u, _, inputs = np.split(given, len(start.q) + engine.size * np.arange(3), axis=1)
        self.states, records = engine.rows_of(np.full(len(given), start.t), q, u), list[np.ndarray]()
        for row, added in zip(self.states, inputs, strict=True):
            engine.additions[:] = added
            try:
                records.append(system.unfold(row[None], NEAR_STATES))
            finally:
                engine.additions[:] = 0.0
            check(int(engine.work.now[1]))
        self.records = np.concatenate(records)

    def rows(self, times: np.ndarray) -> np.ndarray:
        return self.records[np.minimum(np.searchsorted(self.times, times), len(self.times) - 1)]
