"""Forward dynamics in space: Kane's independent speeds with all coordinates.

The fastest shapes of deforming bodies are of no interest but would limit the step of an explicit method: with them
:mod:`kaneflex.multibody.time.spatial_collocation` integrates, else scipy.

The right-hand side closes the loops before the accelerations are evaluated, so that dependent coordinates in the state
are only first guesses for Newton's method, and nothing drifts. If dependent speeds become large relative to independent
ones, as near a dead centre, the next step begins with another choice.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from kaneflex.integrate.by_scipy import IMPLICIT, SLOW, Pace, jacobian_of
from kaneflex.mechanism.energy import Energy, of_bodies
from kaneflex.multibody.dynamics.spatial_bushings import overturned
from kaneflex.multibody.dynamics.spatial_entries import MOVED, NEAR
from kaneflex.multibody.dynamics.spatial_instant import DONE, GROWN, OVERTURNED, REASONS
from kaneflex.multibody.model.independent_speeds import choose_anew
from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.multibody.time.coefficients import RADAU, integrals
from kaneflex.multibody.time.spatial_collocation import EVALUATIONS, GROWTH, LONGEST, OUTCOME, ROW, WANTED
from kaneflex.multibody.time.spatial_curves import Curve
from kaneflex.multibody.time.spatial_motion import SpatialKinematics
from kaneflex.multibody.time.spatial_passing import EXACT, Passing
from kaneflex.multibody.time.spatial_steps import Choice, step_size, steps_of
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError

Share = Callable[[float], None]
_GROWTH = 10.0
"""Largest dependent speed per independent one, in their measures, before another choice is tried."""
_ABSOLUTE = 1e-2
"""Absolute tolerance, in rad, sizes of the mechanism and their rates, as a share of the relative one."""
BENT_FAR = "Give fewer solve.modes, or divide bodies with such large bending into several welded ones"
"""Advice if a coupled motion cannot continue: equations of the second order in the shapes fail for large bending."""
_PIECE = 256
"""Steps per call of compiled code, after which a run can be interrupted."""


class Run(Curve):
    """Steps of an integration from a start, and the curves between them."""

    def __init__(
        self, system: SpatialSystem, options: Options, start: State, share: Share = lambda done: None
    ) -> None:
        self.share = share
        self.system, self.options, self.start = system, options, start
        self.pace, self.method = Pace(options.duration), options.forward_method
        self.ends: list[float] = []  # of the curves
        self.curves: list[tuple[Callable[[Any], np.ndarray], State]] = []
        self.knots: list[float] = []  # ends of the steps
        self.first: float | None = None  # step to begin with
        self.growth = _GROWTH  # beyond which other speeds are tried
        self.works = [np.zeros(2)]
        self.passing = Passing(system, options.forward_method, options.forward_tolerance)
        self.reason = ""  # for which the rates were not known somewhere
        self.stopped: SceneError | None = None  # why it came to no end, where that is for another one to say

    def go(self) -> None:
        """Integrate to the end of the run. Raises SceneError if the motion can't continue."""
        state = self.start
        while state.t < self.options.duration:
            state = self._collocated(state) if len(self.system.modal_speeds) else self._by_scipy(state)

    def _collocated(self, state: State) -> State:
        """State at the end, or where another choice of speeds is better."""
        system, options, choice = self.system, self.options, state.choice
        scale = options.tolerance * system.measure
        steps = steps_of(system.tables, choice, system.coordinates, scale, len(state.sizes))
        times = options.duration / options.steps * np.arange(1, options.steps + 1)
        times[-1] = options.duration
        control = steps.control
        control[[GROWTH, LONGEST]] = self.growth, times[0]
        control[ROW] = np.searchsorted(times, state.t, side="right")
        begin = state.q, state.u, state.du, self.works[-1]
        for part, value in zip((steps.q, steps.u, steps.du, steps.works), begin, strict=True):
            part[:] = value
        steps.t[:] = state.t
        largest = (abs(state.du[choice.independent]) / steps.scale[choice.independent]).max(initial=0.0)
        control[WANTED] = min(self.first or np.inf, np.sqrt(20.0 / largest) if largest else np.inf)
        while steps.t[0] < options.duration:
            rows = np.zeros((_PIECE, step_size(system.coordinates, system.speeds)))
            rows = rows[: system.collocate(choice, steps, times, rows)].copy()
            self.pace.evaluations += int(control[EVALUATIONS])
            control[EVALUATIONS] = 0.0
            if len(rows):
                self.ends.append(steps.t[0])
                self.knots += rows[:, 1].tolist()
                self.works += list(rows[:, 2:4])
                self.curves.append((_Piece(rows, choice, system.coordinates), state))
            self.share(float(steps.t[0]) / options.duration)
            outcome = int(control[OUTCOME])
            if outcome not in (DONE, GROWN):
                raise self._stopped(float(steps.t[0]), REASONS[outcome], outcome == OVERTURNED)
            if self.pace.too_slow(float(steps.t[0])):
                raise self._stopped(float(steps.t[0]))
            if outcome == GROWN:
                found, self.first = system.project(float(steps.t[0]), steps.q, steps.u, choice), control[WANTED]
                better = self._better(found)
                if better is not found:
                    return better
                control[GROWTH] = self.growth
        return system.project(options.duration, steps.q, steps.u, choice)

    def _by_scipy(self, state: State) -> State:
        """As :meth:`_collocated`, for rigid bodies."""
        import scipy.integrate

        options, system, tolerance = self.options, self.system, self.passing.tolerance
        y = np.concatenate([state.q, state.u[state.choice.independent], self.works[-1]])
        scale = np.concatenate([
            np.ones(system.coordinates), system.measure[state.choice.independent], [np.inf, np.inf]
        ])  # fmt: skip
        rates, sizes = self._rates_of(state), np.where(np.isfinite(scale), scale, 0.0)
        jac = {"jac": jacobian_of(rates, sizes)} if self.method in IMPLICIT else {}
        solver = getattr(scipy.integrate, self.method)(
            rates, state.t, y, options.duration, rtol=tolerance, atol=_ABSOLUTE * tolerance * scale,
            first_step=self.first, **jac,
        )  # fmt: skip
        state = self._steps(solver, sizes, state)
        left = options.duration - state.t
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
            if self.pace.too_slow(solver.t):
                raise self._stopped(solver.t)
            self.share(float(solver.t) / self.options.duration)
            self.ends.append(solver.t)
            self.knots.append(solver.t)
            curve = solver.dense_output()
            self.curves.append((curve, state))
            self.works.append(solver.y[-2:].copy())
            self.passing.foresee(solver, state.choice, curve)
            found = self._at(solver.t, solver.y, state)
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
        self.growth = 2.0 * grown  # where nothing is better others are not tried at every step
        try:
            other = system.project(found.t, found.q, found.u, choose_anew(system, found.q, choice))
        except ArithmeticError:
            return found
        if not _largest(system, other.choice) < 0.5 * grown:
            return found
        self.growth = _GROWTH
        return other

    def _rates_of(self, state: State) -> Callable[[float, np.ndarray], np.ndarray]:
        def rates(t: float, y: np.ndarray) -> np.ndarray:
            self.pace.evaluations += 1
            try:
                found = self._projected(t, y, state)
                if far := overturned(self.system.mechanism, self.system.work.bushings):
                    raise ArithmeticError(far[1])
            except ArithmeticError as reason:  # a shorter step may still find its way
                if np.isfinite(y).all():
                    self.reason = str(reason)
                return np.full(len(y), np.nan)
            moved, powers = self.system.rates(found.choice)
            return np.concatenate([moved, found.du[found.choice.independent], powers])

        return rates

    def _projected(self, t: float, y: np.ndarray, like: State) -> State:
        """State of an integrator's vector."""
        u = np.zeros(self.system.speeds)
        u[like.choice.independent] = y[self.system.coordinates : -2]
        return self.system.project(t, y[: self.system.coordinates], u, like.choice)

    def _at(self, t: float, y: np.ndarray, like: State) -> State:
        try:
            return self._projected(t, y, like)
        except ArithmeticError as reason:
            raise self._stopped(t, str(reason)) from None

    def __call__(self, t: float) -> State:
        k = self._steps_of(np.array([t]))[0]
        curve, like = self.curves[k]
        return self._at(t, curve(t), like)

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
            y = curve(times[first:last])
            given[first:last, :n] = y[:n].T
            given[first:last, n + like.choice.independent] = y[n:-2].T
            try:
                system.near(like.choice, times[first:last], given[first:last], out[first:last], what)
            except ArithmeticError as reason:
                raise self._stopped(reason.args[1], reason.args[0]) from None
        return out

    def moved(self, times: np.ndarray) -> np.ndarray:
        return self.rows(times, MOVED)

    def _steps_of(self, times: np.ndarray) -> np.ndarray:
        """Numbers of the curves on which times of the run [s] are."""
        return np.minimum(np.searchsorted(self.ends, times), len(self.ends) - 1)

    def energy(self, motion: SpatialKinematics) -> Energy:
        """Energy at the ends of the steps."""
        times = np.array([0.0, *self.knots])
        found, bodies = motion.moved(times), self.system.mechanism.bodies
        parts = [(name, body.mass, body.about_centre, body.centre) for name, body in bodies.items()]
        kinetic, weight = of_bodies(found, parts, self.system.mechanism.gravity)
        kinetic, weight = kinetic + found["kinetic energy"], weight + found["weight energy"]
        return Energy(kinetic, found["strain energy"], weight, *np.array(self.works).T)

    def _stopped(self, t: float, message: str = "", by_bushing: bool = False) -> SceneError:
        far = overturned(self.system.mechanism, self.system.work.bushings) if by_bushing else None
        if far:
            reason = f"the motion can't continue after t = {t:.6g} s: {far[1]}"
            return SceneError(f"springs.{far[0]}.bushing", None, reason, "Turn it less, or use a torque with a law")
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


class _Piece:
    """Steps of the compiled integration as scipy's dense output: coordinates and independent speeds by the polynomials
    of the stages, and works at the ends of steps."""

    def __init__(self, rows: np.ndarray, choice: Choice, coordinates: int) -> None:
        n, speeds = coordinates, rows.shape[1] // 4 - 1 - coordinates
        self.begins, self.lengths, self.works = rows[:, 0], rows[:, 1] - rows[:, 0], rows[:, 2:4]
        known = [*range(n), *(n + choice.independent)]
        self.start, *self.stages = rows[:, 4:].reshape(len(rows), 4, n + speeds).transpose(1, 0, 2)[:, :, known]

    def __call__(self, t: float | np.ndarray) -> np.ndarray:
        """Columns at ``t`` [s]."""
        times = np.atleast_1d(np.asarray(t, float))
        k = np.clip(np.searchsorted(self.begins, times, side="right") - 1, 0, None)
        shares = integrals(RADAU, (times - self.begins[k]) / self.lengths[k])
        found = self.start[k]
        for stage, share in zip(self.stages, shares, strict=True):
            found = found + (share * self.lengths[k])[:, None] * stage[k]
        found = np.hstack([found, self.works[k]]).T
        return found if np.ndim(t) else found[:, 0]


def _largest(system: SpatialSystem, choice: Choice) -> float:
    """Largest entry of the basis, in the measures of the speeds."""
    found = system.basis(choice) / system.measure
    return float(abs(found * system.measure[choice.independent][:, None]).max(initial=0.0))
