"""Runs in space by :mod:`kaneflex.multibody.time.collocation`.

If dependent speeds become large relative to independent ones, as near a dead centre, the next step begins with another
choice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, Self

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.codes import CASCADE, DAMPED, PARADOX, TOO_SMALL
from kaneflex.multibody.model.layout import STORED_AT as STORED
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time import run
from kaneflex.multibody.time.dense_output import Steps
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.spatial_curves import Curve
from kaneflex.multibody.time.spring_displacements import overturned
from kaneflex.multibody.unilateral.results import RowRecord
from kaneflex.support.errors import SceneError

BENT_FAR = "Give fewer solve.modes, or divide bodies with such large bending into several welded ones"
"""Advice if a coupled motion cannot continue: equations of the second order in the shapes fail for large bending."""


class SpatialRun(run.Run, Curve):
    """Steps of an integration in space, and the curves between them."""

    whole = True

    def __init__(
        self, system: System, start: State, times: np.ndarray, method: Method, given: np.ndarray | None = None
    ) -> None:
        self.start = start
        super().__init__(system, start, times, method, given)
        self.sloped = DAMPED if system.has_slopes and method.integrator == "radau" else 0.0

    def __getstate__(self) -> dict[str, Any]:
        """Attributes that readers of the run need, without its system; see :meth:`of`."""
        return {name: getattr(self, name) for name in ("start", "turned", "times", "here", "pieces", "counts")}

    def of(self, system: System) -> Self:
        """The run, pickled and restored, of its system loaded again."""
        self.system, self.engine = system, system.engine
        return self

    def _begun(self, start: State) -> tuple[bool, float]:
        free = start.choice.independent
        self._forget_rows()
        rates = self.system.project(start.t, start.q, start.u, start.choice).du
        own = slice(len(self.engine.holds), len(self.engine.holds) + len(self.touching))
        self.stored[own] = self.system.work.touching[own, STORED]
        return True, run.first_step(rates[free], self.bounds.scale[free], self.longest)

    def go(
        self, progress: Callable[[float], None] | None = None, stop: run.Stop | None = None
    ) -> tuple[Outcome, str]:
        try:
            ended = super().go(progress, stop)
        finally:  # for readers there are no change points
            self.engine.numbers(at.CROSSING, at.CHANGE_POINT)[at.WHEN] = -math.inf
        if not self.pieces:
            self.pieces.append((np.vstack([self.here, self.here]), self.engine.choice))
        return ended

    def _turned(self) -> bool:
        return False

    def _reason(self, ended: int) -> tuple[Outcome, str] | None:
        """Outcome if bushings turn too far, the last state is singular, or steps become too short; None otherwise."""
        stuck = f"the motion can't continue after t = {self.here[0]:.6g} s"
        advice = f". {BENT_FAR}" if self.engine.shapes.any() else ""
        if far := overturned(self.system.mechanism, self.system.work.springs):  # in the last attempt
            return Outcome.STUCK, f"{stuck}: {far[1]}. Limit the rotation, or use loads with laws"
        if ended in (CASCADE, PARADOX):
            return None
        try:
            self.system.project(float(self.here[0]), *self.engine.state_of(self.here), self.engine.choice)
        except ArithmeticError as reason:
            return Outcome.SINGULAR, f"{stuck}: {reason}{advice}"
        if ended != TOO_SMALL:
            return None
        return Outcome.STUCK, f"{stuck}: the step size tends to zero{advice}"

    def _chosen_anew(self) -> bool:
        """True if other speeds keep the rank: near a singular position fewer rows would leave a freedom open."""
        before = self.engine.choice
        if super()._chosen_anew() and len(self.engine.choice.rows) == len(before.rows) and self._projected():
            return True
        self.engine.choose_speeds(before)
        self.engine.stand(self.here)
        return False

    def rows(self, times: np.ndarray) -> np.ndarray:
        out, failed = self._read(times)
        if failed is not None:
            why, t = failed.args
            raise self.stopped(f"the motion can't continue after t = {t:.6g} s: {why}", run.CURE)
        return out

    def _record(self, rows: np.ndarray) -> np.ndarray:
        return self._read(rows[:, 0])[0]

    def _read(self, times: np.ndarray) -> tuple[np.ndarray, ArithmeticError | None]:
        """Record at ``times`` [s] up to the first one at which loops do not close, and the reason."""
        system, n = self.system, len(self.system.engine.layout.positions)
        out, given = np.zeros((len(times), len(system.work.kept))), np.zeros((len(times), n + system.engine.size))
        steps = self._steps_of(times)
        begins = np.flatnonzero(np.diff(steps, prepend=-1))
        for first, last in zip(begins, [*begins[1:], len(times)], strict=True):
            curve, (path, choice) = self._curves[steps[first]], self.pieces[steps[first]]
            given[first:last, :n], given[first:last, n:] = curve(times[first:last])
            modes = path[0, system.engine.columns["modes"]]  # sides of discontinuities
            system.engine.modes[:] = modes.reshape(-1, at.MODE_SIZE)
            try:
                system.near(choice, times[first:last], given[first:last], out[first:last])
            except ArithmeticError as reason:
                return out[: first + np.searchsorted(times[first:last], reason.args[1])], reason
        return out, None

    def _rows(self, rows: np.ndarray, touching: np.ndarray) -> tuple[RowRecord, RowRecord]:
        touching, names = touching.copy(), self.system.mechanism.frictions
        for k, name in enumerate(names, start=len(self.engine.holds) - len(names)):
            if len(rows) and self.system.scene.turns_at(name):  # whole turns of a pin from one instant to the next
                touching[:, k, 0] = np.unwrap(touching[:, k, 0])
                touching[:, k, 0] -= whole_turns(touching[0, k, 0])
        return super()._rows(rows, touching)

    @cached_property
    def _curves(self) -> list[Steps]:
        return [Steps(self.engine, rows) for rows, _ in self.pieces]

    def _steps_of(self, times: np.ndarray) -> np.ndarray:
        """Numbers of the pieces in which times of the run [s] are. Raises SceneError for times before it, and after the
        end of one that stopped early."""
        for t in times[times < self.start.t].tolist():
            raise SceneError("t", t, f"the run starts at {self.start.t:.6g} s", "Choose an instant of the run")
        end = float(self.here[0])
        for t in times[times > end].tolist() if end < self.times[-1] else ():
            raise SceneError("t", t, f"the run stopped at {end:.6g} s", "Choose an instant of the run")
        return np.minimum(np.searchsorted([rows[-1, 0] for rows, _ in self.pieces], times), len(self.pieces) - 1)
