"""Runs in space by :mod:`kaneflex.multibody.time.collocation`.

If dependent speeds become large relative to independent ones, as near a dead centre, the next step begins with another
choice.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from kaneflex.integrate.by_scipy import Pace
from kaneflex.mechanism.energy import Energy, of_bodies
from kaneflex.multibody.dynamics.load_derivatives import DAMPED
from kaneflex.multibody.dynamics.spatial_bushings import overturned
from kaneflex.multibody.dynamics.spatial_entries import MOVED, NEAR
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.independent_speeds import choose_anew
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.time import collocation
from kaneflex.multibody.time.error_bounds import ErrorBounds, Method
from kaneflex.multibody.time.run import HOLDS, TABLES, first_step, held
from kaneflex.multibody.time.spatial_curves import Curve
from kaneflex.multibody.time.spatial_motion import SpatialKinematics
from kaneflex.multibody.time.step_curves import Steps
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError

Share = Callable[[float], None]
BENT_FAR = "Give fewer solve.modes, or divide bodies with such large bending into several welded ones"
"""Advice if a coupled motion cannot continue: equations of the second order in the shapes fail for large bending."""
_PIECE, PATIENT = 256, 16
"""Steps per call of compiled code, after which a run can be interrupted; the same with a choice of speeds that should
be replaced but for which there is no better one."""


class Run(Curve):
    """Steps of an integration from a start over the duration of the options, and the curves between them.

    ``given``: ends of the steps of deforming bodies [s], in place of error control.
    """

    def __init__(
        self, system: SpatialSystem, options: Options, start: State, share: Share = lambda done: None,
        turned: Mapping[str, float] | None = None, given: np.ndarray | None = None,
    ) -> None:  # fmt: skip
        self.share, self.turned, self.given = share, turned, given
        self.system, self.options, self.start = system, options, start
        self.until = start.t + options.duration if given is None else float(given[-1])
        self.pace = Pace(options.duration)
        self.ends: list[float] = []  # of the curves
        self.curves: list[tuple[Steps, State]] = []
        self.knots: list[float] = []  # ends of the steps
        self.first: float | None = None  # step to begin with
        self.works = [np.zeros((1, 2))]
        self.changes: list[float] = []  # instants at which discontinuous loads switch
        self.done = np.zeros(system.engine.count(at.WORKS))  # works of dampers, loads and drives
        self.longest = options.duration / options.steps
        self.method = method_in_space(system, options)
        self.bounds = ErrorBounds(system.engine, self.method, self.longest)
        self.bounds.begin()
        self.stopped: SceneError | None = None  # error of an incomplete run, raised by the caller

    def go(self) -> None:
        """Integrate to the end of the run. Raises SceneError if the motion can't continue."""
        state: State | None = self.start
        try:
            while state is not None:
                state = self._integrated(state)
        finally:  # for readers there are no change points
            self.system.engine.numbers(at.CROSSING, at.CHANGE_POINT)[at.WHEN] = -math.inf

    def _integrated(self, state: State) -> State | None:
        """State where another choice of speeds is better; None at the end."""
        system, engine, options, choice = self.system, self.system.engine, self.options, state.choice
        integrator = self.method.integrator
        times = self.start.t + self.longest * np.arange(1, options.steps + 1) if self.given is None else self.given
        times[-1] = self.until
        here, wanted = self.first_row(state)
        last, most = system.engine.columns["works"].start, 1 if self.method.bounded else _PIECE
        here[last:] = self.done
        sloped = DAMPED if system.has_slopes and integrator == "radau" else 0.0
        control = np.array([self.first or wanted, self.longest, _PIECE, 0.0, 0.0, 0.0, 0.0, sloped, 1.0])
        counts, steps, taken = np.zeros(5), np.zeros((_PIECE, len(here))), here[None]
        while here[0] < self.until:
            before, left = here.copy(), times[np.searchsorted(times, here[0], side="right") :][:_PIECE]
            aims, rows = np.concatenate([here[:1], left]), np.zeros((len(left) + 2, len(here)))
            self.bounds.update(taken)
            control[2:5], control[8] = (min(most, PATIENT) if control[6] else most, 0.0, 0.0), 1.0
            most = min(2 * most, _PIECE)  # the largest values so far grow with every piece
            engine.choose_speeds(choice)
            table = TABLES["radau" if control[7] == DAMPED else integrator]
            ends = here[:0] if self.given is None else left
            ended = engine.integrate(table, control, here, ends, aims, rows, counts, steps, wide=len(here))
            taken = steps[: int(control[4])]
            self.pace.evaluations, counts[2] = self.pace.evaluations + 3 * int(counts[2]), 0.0
            if control[8] == 2.0:
                self.changes.append(float(here[0]))
            if len(taken):
                self.ends.append(float(here[0]))
                self.knots += taken[:, 0].tolist()
                self.done = here[last:].copy()
                self.works.append(np.column_stack([taken[:, last], taken[:, last + 1 :].sum(axis=1)]))
                self.curves.append((Steps(system, np.vstack([before, taken])), state))
            self.share((float(here[0]) - self.start.t) / options.duration)
            control[6] = float(ended == collocation.TURNED)
            if ended == collocation.TURNED:
                try:
                    found, self.first = self._now(here, choice), control[0]
                except ArithmeticError as reason:
                    raise self._stopped(float(here[0]), str(reason)) from None
                better = self._better(found)
                if better is not found:
                    return better
            elif ended not in (collocation.DONE, collocation.PAUSED, collocation.CHANGED):
                far = overturned(system.mechanism, system.work.springs)  # in the last attempt
                raise self._stopped(float(here[0]), self._reason(here, choice), far)
            if self.pace.too_slow(float(here[0]) - self.start.t):
                raise self._stopped(float(here[0]))
        return None

    def first_row(self, state: State) -> tuple[np.ndarray, float]:
        """First row of the integration from a state, which the engine's tables then have, and the first step [s]."""
        system, free = self.system, state.choice.independent
        system.project(state.t, state.q, state.u, state.choice)
        step = first_step(state.du[free], self.bounds.scale[free], self.longest)
        return system.engine.row(state.t), step

    def _now(self, here: np.ndarray, choice: Choice) -> State:
        """State of a row of the integration."""
        q, u = self.system.engine.state_of(here)
        return self.system.project(float(here[0]), q, u, choice)

    def _reason(self, here: np.ndarray, choice: Choice) -> str:
        """Reason for which steps from a row fail."""
        try:
            self._now(here, choice)
        except ArithmeticError as reason:
            return str(reason)
        return "the step size tends to zero"

    def _better(self, found: State) -> State:
        """State with another choice of independent speeds, if there is one."""
        choice = choose_anew(self.system, found.q, found.choice)
        if choice is found.choice:
            return found
        try:
            return self.system.project(found.t, found.q, found.u, choice)
        except ArithmeticError:
            return found

    def __call__(self, t: float) -> State:
        self.rows(np.array([float(t)]))
        return self.system.engine.state(t, self.curves[self._steps_of(np.array([t]))[0]][1].choice)

    @property
    def evaluations(self) -> int:
        """Evaluations of the accelerations."""
        return self.pace.evaluations

    @property
    def end(self) -> State:
        """Final state."""
        return self(self.ends[-1])

    def rows(self, times: np.ndarray, what: int = NEAR) -> np.ndarray:
        system, n = self.system, len(self.system.state_coordinates)
        out, given = np.zeros((len(times), len(system.work.kept))), np.zeros((len(times), n + system.engine.size))
        steps = self._steps_of(times)
        begins = np.flatnonzero(np.diff(steps, prepend=-1))
        for first, last in zip(begins, [*begins[1:], len(times)], strict=True):
            curve, like = self.curves[steps[first]]
            given[first:last, :n], given[first:last, n:] = curve(times[first:last])
            system.engine.contacts[:, at.BEGUN_AT] = curve.sides
            try:
                system.near(like.choice, times[first:last], given[first:last], out[first:last], what)
            except ArithmeticError as reason:
                raise self._stopped(reason.args[1], reason.args[0]) from None
        return out

    def moved(self, times: np.ndarray) -> np.ndarray:
        return self.rows(times, MOVED)

    def _steps_of(self, times: np.ndarray) -> np.ndarray:
        """Numbers of the curves on which times of the run [s] are. Raises SceneError for times before it."""
        for t in times[times < self.start.t].tolist():
            raise SceneError("t", t, f"the run starts at {self.start.t:.6g} s", "Choose an instant of the run")
        return np.minimum(np.searchsorted(self.ends, times), len(self.ends) - 1)

    def energy(self, motion: SpatialKinematics) -> Energy:
        """Energy at the ends of the steps."""
        times = np.array([self.start.t, *self.knots])
        found, bodies = motion.moved(times), self.system.mechanism.bodies
        parts = [(name, body.mass, body.about_centre, body.centre) for name, body in bodies.items()]
        kinetic, weight = of_bodies(found, parts, self.system.mechanism.gravity)
        kinetic, weight = kinetic + found["kinetic energy"], weight + found["weight energy"]
        return Energy(kinetic, found["strain energy"], weight, *np.vstack(self.works).T)

    def _stopped(self, t: float, message: str = "", far: tuple[str, str] | None = None) -> SceneError:
        if name := held(self.system.engine, self.system.module):
            reason, cure = f"after t = {t:.6g} s the law {HOLDS}", "Use a smooth law, like tanh(1000 * x)"
            return SceneError(f"loads.{name}.law", self.system.scene.loads[name].law, reason, cure)
        if far:
            reason = f"the motion can't continue after t = {t:.6g} s: {far[1]}"
            cure = "Limit the rotation, or use loads with laws"
            return SceneError(f"springs.{far[0]}.bushing", None, reason, cure)
        free = next((name for name, drive in self.system.scene.drives.items() if drive.kind == "free"), None)
        floating = self.system.mechanism.floating
        key = f"drives.{free}" if free is not None else f"bodies.{floating[0]}.free" if floating else "solve.preset"
        cure = "Shorten the duration, or change loads or start so that no loop locks"
        reason = f"the motion can't continue after t = {t:.6g} s: {message.rstrip('.')}"
        if not message:
            entry = "tolerance" if self.options.dynamics == "coupled" else "forward.tolerance"
            reason, cure = self.pace.message(t), f"Shorten the duration, or raise solve.{entry}"
        if self.system.engine.shapes.any():
            cure = f"{BENT_FAR}, or use preset stiffened"
        return SceneError(key, None, reason, cure)


def method_in_space(system: SpatialSystem, options: Options) -> Method:
    """Method of integration: under preset coupled that of the scene, else for the motion before anything deforms."""
    size = system.mechanism.size
    if options.dynamics == "coupled":
        return Method(options.integrator, options.tolerance, size, options.bounded)
    return Method(options.forward_method, options.forward_tolerance, size)
