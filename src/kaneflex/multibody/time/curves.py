"""Curves of a mechanism in space: its states by time."""

from __future__ import annotations

import bisect
from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np

from kaneflex.mechanism.rigid_motion import not_integrated
from kaneflex.multibody.model.codes import GROWN, check
from kaneflex.multibody.model.independent_speeds import choose_anew
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.support.errors import SceneError

_STUCK = 1e-9
"""Share of the time to the next instant within which many steps indicate a diverging drive, as at a law's pole."""


class Curve(ABC):
    """States of a mechanism by the time [s], from its start on; ``work`` of the system then has the last one."""

    system: System
    start: State
    turned: Mapping[str, float] | None = None
    """Angles [rad] with whole turns at the start, of joints that close loops, from the run that this one continues;
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


class Standing(Curve):
    """Start of a mechanism, before free joints or shapes are integrated."""

    def __init__(self, system: System, start: State) -> None:
        self.system, self.start = system, start

    def rows(self, times: np.ndarray) -> np.ndarray:
        start = self.start
        for t in times[times != start.t].tolist():
            raise not_integrated(t)
        self.system.project(start.t, start.q, start.u, start.choice)
        return np.tile(self.system.work.kept, (len(times), 1))


class Followed(Curve):
    """Curve of a mechanism whose drives determine its position: loops are followed step by step.

    Raises SceneError if they do not close; it names the time.
    """

    def __init__(self, system: System, start: State) -> None:
        self.system, self.start, self.track, self.last = system, start, [start], start

    def rows(self, times: np.ndarray) -> np.ndarray:
        out, done = np.zeros((len(times), len(self.system.work.kept))), 0
        state = self._before(times[0])
        self.system.project(state.t, state.q, state.u, state.choice)
        t, choice = state.t, state.choice
        while done < len(times):
            before, asked = t, times[done]
            count, t, outcome = self.system.follow(t, choice, times[done:], out[done:])
            done += count
            try:
                if outcome == GROWN:
                    here = self.system.engine.state(t, choice)
                    choice = choose_anew(self.system, here.q, choice)
                    self.system.project(t, here.q, here.u, choice)
                else:
                    check(outcome)
            except ArithmeticError as reason:
                raise SceneError(
                    "joints", ", ".join(self.system.driven) or "joints", f"{reason}, at t = {t:.6g} s",
                    "Change the lengths, or limit the drives' range",
                ) from None  # fmt: skip
            if not count and outcome != GROWN and t - before < _STUCK * (asked - before):
                raise self._runs_away(t)
            self.last = self.system.engine.state(t, choice)
            if done < len(times):
                bisect.insort(self.track, self.last, key=lambda known: known.t)
        return out

    def _runs_away(self, t: float) -> SceneError:
        """Error for the drive that diverges at t [s]."""
        name = self.system.driven[int(abs(self.system.courses(t)[:, 1]).argmax())]
        return SceneError(
            f"drives.{name}", self.system.scene.drives[name].law, f"its motion is unbounded at t = {t:.6g} s",
            "Give a law that is bounded and smooth over the run, or another duration",
        )  # fmt: skip

    def _before(self, t: float) -> State:
        """The last known state before t, or the start."""
        found = self.track[max(0, bisect.bisect_right(self.track, t, key=lambda known: known.t) - 1)]
        return self.last if found.t < self.last.t <= t else found
