"""Forward dynamics in space: Kane's independent speeds with all coordinates.

The fastest shapes of deforming bodies are of no interest but would limit the step of an explicit method: with them
:mod:`kaneflex.multibody.time.spatial_collocation` integrates, else scipy.

The right-hand side closes the loops before the accelerations are evaluated, so that dependent coordinates in the state
are only first guesses for Newton's method, and nothing drifts. If dependent speeds become large relative to independent
ones, as near a dead centre, the next step begins with another choice.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from kaneflex.integrate.by_scipy import IMPLICIT, SLOW, Pace, jacobian_of
from kaneflex.mechanism.energy import Energy, of_bodies
from kaneflex.multibody.dynamics.load_derivatives import DAMPED
from kaneflex.multibody.dynamics.spatial_bushings import overturned
from kaneflex.multibody.dynamics.spatial_entries import MOVED, NEAR
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.independent_speeds import choose_anew
from kaneflex.multibody.model.spatial_engine import Choice
from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.multibody.time import collocation
from kaneflex.multibody.time.error_bounds import ErrorBounds, Method
from kaneflex.multibody.time.run import HOLDS, TABLES, first_step, held
from kaneflex.multibody.time.spatial_curves import Curve
from kaneflex.multibody.time.spatial_motion import SpatialKinematics
from kaneflex.multibody.time.spatial_passing import EXACT, Passing
from kaneflex.multibody.time.step_curves import Steps
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError

Share = Callable[[float], None]
GROWTH = 8.0
"""Largest dependent speed per independent one, in their measures, before another choice is tried."""
_ABSOLUTE = 1e-2
"""Absolute tolerance, in rad, sizes of the mechanism and their rates, as a share of the relative one."""
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
        self.pace, self.method = Pace(options.duration), options.forward_method
        self.ends: list[float] = []  # of the curves
        self.curves: list[tuple[Any, State]] = []
        self.knots: list[float] = []  # ends of the steps
        self.first: float | None = None  # step to begin with
        self.growth = GROWTH  # beyond which other speeds are tried
        self.works = [np.zeros(2)]
        self.changes: list[float] = []  # instants at which discontinuous loads switch
        self.done = np.zeros(system.engine.count(at.WORKS))  # works of dampers, loads and drives
        self.passing = Passing(system, options.forward_method, options.forward_tolerance)
        self.longest = options.duration / options.steps
        method = Method("radau", options.tolerance, system.mechanism.size, options.bounded)
        self.bounds = ErrorBounds(system.engine, method, self.longest)
        self.reason = ""  # why the rates are not defined
        self.stopped: SceneError | None = None  # error of an incomplete run, raised by the caller

    def go(self) -> None:
        """Integrate to the end of the run. Raises SceneError if the motion can't continue."""
        state = self.start
        while state.t < self.until:
            state = self._collocated(state) if len(self.system.modal_speeds) else self._by_scipy(state)

    def _collocated(self, state: State) -> State:
        """State at the end, or where another choice of speeds is better."""
        system, engine, options, choice = self.system, self.system.engine, self.options, state.choice
        times = self.start.t + self.longest * np.arange(1, options.steps + 1) if self.given is None else self.given
        times[-1] = self.until
        here, wanted = self.first_row(state)
        last, most = system.works_at(here), 1 if options.bounded else _PIECE
        here[last:] = self.done
        sloped = DAMPED if system.has_slopes and options.integrator == "radau" else 0.0
        control = np.array([self.first or wanted, self.longest, _PIECE, 0.0, 0.0, 0.0, 0.0, sloped, 1.0])
        counts, steps, taken = np.zeros(5), np.zeros((_PIECE, len(here))), here[None]
        while here[0] < self.until:
            before, left = here.copy(), times[np.searchsorted(times, here[0], side="right") :][:_PIECE]
            aims, rows = np.concatenate([here[:1], left]), np.zeros((len(left) + 2, len(here)))
            self.bounds.update(taken)
            control[2:5], control[8] = (min(most, PATIENT) if control[6] else most, 0.0, 0.0), 1.0
            most = min(2 * most, _PIECE)  # the largest values so far grow with every piece
            engine.choose_speeds(choice)
            table = TABLES["radau" if control[7] == DAMPED else options.integrator]
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
                self.works += [np.array([row[0], row[1:].sum()]) for row in taken[:, last:]]
                self.curves.append((Steps(system, np.vstack([before, taken])), state))
            self.share((float(here[0]) - self.start.t) / options.duration)
            control[6] = float(ended == collocation.TURNED)
            if ended == collocation.TURNED:
                found, self.first = self._now(here, choice), control[0]
                better = self._better(found)
                if better is not found:
                    return better
            elif ended not in (collocation.DONE, collocation.PAUSED, collocation.CHANGED):
                far = overturned(system.mechanism, system.work.bushings)  # in the last attempt
                raise self._stopped(float(here[0]), self._reason(here, choice), far)
            if self.pace.too_slow(float(here[0]) - self.start.t):
                raise self._stopped(float(here[0]))
        return self._now(here, choice)

    def first_row(self, state: State) -> tuple[np.ndarray, float]:
        """First row of the integration from a state, which the engine's tables then have, and the first step [s]."""
        system, free = self.system, state.choice.independent
        system.project(state.t, state.q, state.u, state.choice)
        self.bounds.begin()
        step = first_step(state.du[free], self.bounds.scale[free], self.longest)
        return system.engine.row(state.t), step

    def _now(self, here: np.ndarray, choice: Choice) -> State:
        """State of a row of the integration."""
        q, u = self.system.state_of(here)
        return self.system.project(float(here[0]), q, u, choice)

    def _reason(self, here: np.ndarray, choice: Choice) -> str:
        """Reason for which steps from a row fail."""
        try:
            self._now(here, choice)
        except ArithmeticError as reason:
            return str(reason)
        return "the step size tends to zero"

    def _by_scipy(self, state: State) -> State:
        """As :meth:`_collocated`, for rigid bodies."""
        import scipy.integrate

        system, tolerance = self.system, self.passing.tolerance
        y = np.concatenate([state.q, state.u[state.choice.independent], self.works[-1]])
        scale = np.concatenate([
            np.ones(system.coordinates), system.measure[state.choice.independent], [np.inf, np.inf]
        ])  # fmt: skip
        rates, sizes = self._rates_of(state), np.where(np.isfinite(scale), scale, 0.0)
        jac = {"jac": jacobian_of(rates, sizes)} if self.method in IMPLICIT else {}
        solver = getattr(scipy.integrate, self.method)(
            rates, state.t, y, self.until, rtol=tolerance, atol=_ABSOLUTE * tolerance * scale,
            first_step=self.first, **jac,
        )  # fmt: skip
        state = self._steps(solver, sizes, state)
        left = self.until - state.t
        wanted = self.passing.step or solver.step_size or solver.h_abs
        self.first = min(wanted, left) if left > 0.0 else None
        return state

    def _steps(self, solver, sizes: np.ndarray, state: State) -> State:
        """Steps with one choice of speeds until another choice or method is better, or the end; returns the state
        there."""
        found = state
        while solver.status == "running":
            before, self.reason = solver.t, ""
            if self.pace.stiff(solver, sizes):
                self.method = "Radau"
                return found
            try:
                with np.errstate(all="ignore"):
                    message = solver.step()
            except (ValueError, np.linalg.LinAlgError):  # an implicit method meets a Jacobian that is not finite
                message, solver.status = "", "failed"
            if solver.status == "failed" or not np.isfinite(solver.y).all():
                raise self._stopped(before, self.reason or message or "the rates are not finite there")
            if self.pace.too_slow(solver.t - self.start.t):
                raise self._stopped(solver.t)
            self.share((float(solver.t) - self.start.t) / self.options.duration)
            self.ends.append(solver.t)
            self.knots.append(solver.t)
            curve = solver.dense_output()
            self.curves.append((curve, state))
            self.works.append(solver.y[-2:].copy())
            self.passing.foresee(solver, state.choice, curve)
            (q,), (u,) = self._unpacked(solver.y[None], state)
            found = self._at(solver.t, q, u, state)
            better = self._better(found)
            if better is not found or self.passing.step:
                return better
        return found

    def _better(self, found: State) -> State:
        """State with another choice of independent speeds, if the dependent ones have become relatively large."""
        system, choice = self.system, found.choice
        if not len(choice.dependent) or not len(choice.independent):
            return found
        grown = _largest(system, choice)
        if grown < self.growth:
            return found
        self.growth = 2.0 * grown  # without a better choice, others are tried rarely
        try:
            other = system.project(found.t, found.q, found.u, choose_anew(system, found.q, choice))
        except ArithmeticError:
            return found
        if not _largest(system, other.choice) < 0.5 * grown:
            return found
        self.growth = GROWTH
        return other

    def _rates_of(self, state: State) -> Callable[[float, np.ndarray], np.ndarray]:
        def rates(t: float, y: np.ndarray) -> np.ndarray:
            self.pace.evaluations += 1
            try:
                (q,), (u,) = self._unpacked(y[None], state)
                found = self.system.project(t, q, u, state.choice)
                if far := overturned(self.system.mechanism, self.system.work.bushings):
                    raise ArithmeticError(far[1])
            except ArithmeticError as reason:  # a shorter step may still find its way
                if np.isfinite(y).all():
                    self.reason = str(reason)
                return np.full(len(y), np.nan)
            moved, powers = self.system.rates()
            return np.concatenate([moved, found.du[found.choice.independent], powers])

        return rates

    def _unpacked(self, y: np.ndarray, like: State) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and speeds of scipy's vectors, (n_times, .) each."""
        u = np.zeros((len(y), self.system.speeds))
        u[:, like.choice.independent] = y[:, self.system.coordinates : -2]
        return y[:, : self.system.coordinates], u

    def _states(self, curve: Callable, like: State, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and speeds of a curve, (n_times, .) each; dependent ones follow from these."""
        if isinstance(curve, Steps):
            return curve(times)
        return self._unpacked(curve(times).T, like)

    def _at(self, t: float, q: np.ndarray, u: np.ndarray, like: State) -> State:
        try:
            return self.system.project(t, q, u, like.choice)
        except ArithmeticError as reason:
            raise self._stopped(t, str(reason)) from None

    def __call__(self, t: float) -> State:
        self.rows(np.array([float(t)]))
        return self.system.state(t, self.curves[self._steps_of(np.array([t]))[0]][1].choice)

    @property
    def evaluations(self) -> int:
        """Evaluations of the accelerations."""
        return self.pace.evaluations

    @property
    def end(self) -> State:
        """Final state."""
        return self(self.ends[-1])

    def rows(self, times: np.ndarray, what: int = NEAR) -> np.ndarray:
        system, n = self.system, self.system.coordinates
        out, given = np.zeros((len(times), len(system.work.kept))), np.zeros((len(times), n + system.speeds))
        steps = self._steps_of(times)
        begins = np.flatnonzero(np.diff(steps, prepend=-1))
        for first, last in zip(begins, [*begins[1:], len(times)], strict=True):
            curve, like = self.curves[steps[first]]
            given[first:last, :n], given[first:last, n:] = self._states(curve, like, times[first:last])
            if isinstance(curve, Steps):
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
        return Energy(kinetic, found["strain energy"], weight, *np.array(self.works).T)

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
        if singular := self.passing.at(t):
            message = singular
            cure = f'Use solve.forward = {{method = "DOP853", tolerance = {EXACT:g}}}, or start so that none is passed'
        reason = f"the motion can't continue after t = {t:.6g} s: {message.rstrip('.')}"
        if not message:
            reason, cure = self.pace.message(t), SLOW
        if len(self.system.modal_speeds):
            cure = f"{BENT_FAR}, or use preset stiffened"
        return SceneError(key, None, reason, cure)


def _largest(system: SpatialSystem, choice: Choice) -> float:
    """Largest entry of the basis, in the measures of the speeds."""
    found = system.basis(choice) / system.measure
    return float(abs(found * system.measure[choice.independent][:, None]).max(initial=0.0))
