"""Runs in space by :mod:`kaneflex.multibody.time.collocation`.

If dependent speeds become large relative to independent ones, as near a dead centre, the next step begins with another
choice.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from kaneflex.integrate.by_scipy import Pace
from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.energy import Energy, of_bodies
from kaneflex.multibody.dynamics.bushings import overturned
from kaneflex.multibody.dynamics.load_derivatives import DAMPED
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time import run
from kaneflex.multibody.time.dense_output import Steps
from kaneflex.multibody.time.error_bounds import Method
from kaneflex.multibody.time.spatial_curves import Curve
from kaneflex.multibody.time.spatial_motion import SpatialKinematics
from kaneflex.support.errors import SceneError

BENT_FAR = "Give fewer solve.modes, or divide bodies with such large bending into several welded ones"
"""Advice if a coupled motion cannot continue: equations of the second order in the shapes fail for large bending."""


class SpatialRun(run.Run, Curve):
    """Steps of an integration in space, and the curves between them.

    ``stopped``: error of an incomplete run, raised by the caller.
    """

    whole = True

    def __init__(
        self, system: SpatialSystem, start: State, times: np.ndarray, method: Method, given: np.ndarray | None = None
    ) -> None:
        self.start, self.pace = start, Pace(float(times[-1] - times[0]))
        self.stopped: SceneError | None = None
        super().__init__(system, start, times, method, given)
        self.sloped = DAMPED if system.has_slopes and method.integrator == "radau" else 0.0

    def _begun(self, start: State) -> tuple[bool, float]:
        free = start.choice.independent
        rates = self.system.project(start.t, start.q, start.u, start.choice).du
        return True, run.first_step(rates[free], self.bounds.scale[free], self.longest)

    def go(
        self, progress: Callable[[float], None] | None = None, stop: run.Stop | None = None
    ) -> tuple[Outcome, str]:
        """Integrate to the end of the run. Raises SceneError if the motion can't continue."""

        def share(done: float) -> None:
            self.pace.evaluations = self.evaluations
            if progress is not None:
                progress(done)
            if self.pace.too_slow(float(self.here[0]) - self.start.t):
                raise self._stopped()

        try:
            outcome, message = super().go(share, stop)
        finally:  # for readers there are no change points
            self.engine.numbers(at.CROSSING, at.CHANGE_POINT)[at.WHEN] = -math.inf
        if outcome is not Outcome.COMPLETED:
            raise self._stopped(message)
        return outcome, message

    def _turned(self) -> bool:
        far = overturned(self.system.mechanism, self.system.work.springs)  # in the last attempt
        try:
            self.system.project(float(self.here[0]), *self.engine.state_of(self.here), self.engine.choice)
        except ArithmeticError as reason:
            raise self._stopped(str(reason), far) from None
        raise self._stopped("the step size tends to zero", far)

    def _chosen_anew(self) -> bool:
        """True if other speeds keep the rank: near a singular position fewer rows would leave a freedom open."""
        before = self.engine.choice
        if super()._chosen_anew() and len(self.engine.choice.rows) == len(before.rows) and self._projected():
            return True
        self.engine.choose_speeds(before)
        self.engine.stand(self.here)
        return False

    @property
    def evaluations(self) -> int:
        """Evaluations of the accelerations."""
        return 3 * int(self.counts[2])

    def rows(self, times: np.ndarray) -> np.ndarray:
        system, n = self.system, len(self.system.state_coordinates)
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
                raise self._stopped(reason.args[0], t=reason.args[1]) from None
        return out

    @cached_property
    def _curves(self) -> list[Steps]:
        return [Steps(self.engine, rows) for rows, _ in self.pieces]

    def _steps_of(self, times: np.ndarray) -> np.ndarray:
        """Numbers of the pieces in which times of the run [s] are. Raises SceneError for times before it."""
        for t in times[times < self.start.t].tolist():
            raise SceneError("t", t, f"the run starts at {self.start.t:.6g} s", "Choose an instant of the run")
        return np.minimum(np.searchsorted([rows[-1, 0] for rows, _ in self.pieces], times), len(self.pieces) - 1)

    def energy(self, motion: SpatialKinematics) -> Energy:
        """Energy at the ends of the steps."""
        rows = np.vstack([self.pieces[0][0][:1], *(rows[1:] for rows, _ in self.pieces)])
        works = rows[:, self.engine.columns["works"]]
        found, bodies = motion.at(rows[:, 0]), self.system.mechanism.bodies
        parts = [(name, body.mass, body.about_centre, body.centre) for name, body in bodies.items()]
        kinetic, weight = of_bodies(found, parts, self.system.mechanism.gravity)
        kinetic, weight = kinetic + found["kinetic energy"], weight + found["weight energy"]
        return Energy(kinetic, found["strain energy"], weight, works[:, 0], works[:, 1:].sum(axis=1))

    def _stopped(self, message: str = "", far: tuple[str, str] | None = None, t: float | None = None) -> SceneError:
        """Error for a motion that can't continue after t [s], by default after the last step."""
        t, scene = float(self.here[0]) if t is None else t, self.system.scene
        if name := run.held(self.engine, self.system.module):
            reason, cure = f"after t = {t:.6g} s the law {run.HOLDS}", "Use a smooth law, like tanh(1000 * x)"
            return SceneError(f"loads.{name}.law", scene.loads[name].law, reason, cure)
        if far:
            reason = f"the motion can't continue after t = {t:.6g} s: {far[1]}"
            cure = "Limit the rotation, or use loads with laws"
            return SceneError(f"springs.{far[0]}.bushing", None, reason, cure)
        free = next((name for name, drive in scene.drives.items() if drive.kind == "free"), None)
        floating = self.system.mechanism.floating
        key = f"drives.{free}" if free is not None else f"bodies.{floating[0]}.free" if floating else "solve.preset"
        cure = "Shorten the duration, or change loads or start so that no loop locks"
        reason = f"the motion can't continue after t = {t:.6g} s: {message.rstrip('.')}"
        if not message:
            entry = "tolerance" if self.system.coupled else "forward.tolerance"
            reason, cure = self.pace.message(t), f"Shorten the duration, or raise solve.{entry}"
        if self.engine.shapes.any():
            cure = f"{BENT_FAR}, or use preset stiffened"
        return SceneError(key, None, reason, cure)
