"""Integration of a system with the table of its scalars by a method."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from kaneflex.integrate.disturbances import FEWEST, monodromy
from kaneflex.integrate.methods import method_named
from kaneflex.integrate.outcome import Floquet, Outcome, Trajectory
from kaneflex.integrate.periodic import (
    LONGEST_STEP,
    Beginning,
    Cycle,
    corrected_state,
    leading,
    over_a_cycle,
    periodic_state,
    repeated,
)
from kaneflex.integrate.spectral import Orbit, periodic_orbit
from kaneflex.integrate.stepping import Progress, Setup, State, Stored, advance
from kaneflex.integrate.streams import CoefficientStream, Table, one_after_the_other
from kaneflex.integrate.system import AffineSystem
from kaneflex.support.errors import UserError

LEFT = "; the result is the unstable periodic motion"
"""Message about a periodic motion whose disturbances grow."""
_CLEAR, _SQUARED = 0.5, 4
"""Smallest growth per cycle for which piecewise constant equations do not decide on stability; number of squarings of
the monodromy matrix."""
Start = str | tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Run:
    """Input of an integration: system, table, start, steps and method.

    table: scalars of the motion, shape (n_times, n_scalars), at an array of times in s; asked once for a
        cycle if `period_steps` is given, else for one piece of the run after the other.
    t0, step: in s. n_steps: at least 1.
    method: a name in `methods.METHODS`.
    start: "zero", a pair (z, v) of arrays of shape (n,), or "periodic": the motion that repeats itself after
        `period_steps` steps, from one cycle of every unit state (2 n + 1 columns that share one
        factorisation a step), so that no transient has to die.
    period_steps: steps of one cycle of the table.
    every: store one step in so many, the first one included.
    rho_infinity: spectral radius of generalised-alpha at infinite frequency, 0 to 1.
    scipy_method: of solve_ivp, for the method "scipy".
    tolerance: of the method "spectral": error of the motion, relative, in the energy norm.
    """

    system: AffineSystem
    table: Table
    t0: float
    step: float
    n_steps: int
    method: str = "newmark"
    start: Start = "zero"
    period_steps: int | None = None
    every: int = 1
    rho_infinity: float = 0.8
    scipy_method: str = "DOP853"
    tolerance: float = 1e-6


def integrate(run: Run, progress: Progress | None = None) -> Trajectory:
    """Integrate M z'' + C z' + K z = F.

    progress: called with the finished share of the work, first of the periodic start, then of the run.

    A run that grows without bound or has a singular step stops there with a named outcome, as does a periodic start
    without a periodic state. An unstable periodic motion is returned for its cycle, with that outcome. Raises UserError
    for invalid arguments, and for a table with numbers that are not finite.
    """
    chosen = method_named(run.method)
    check_arguments(run)
    system = run.system
    if run.method == "spectral":
        return _spectral(run, progress)
    if chosen.coefficients is None:
        stream = CoefficientStream(run.table, system.n_scalars, run.t0, run.step, chosen.nodes, run.period_steps)
        return solve_ivp_run(system, stream, run.n_steps, run.every, given_state(run), run.scipy_method, progress)
    setup = set_up(run, progress)
    if run.start == "periodic":
        found = _naming_the_steps(periodic_state(setup, _steps_of_cycle(run)), run)
    else:
        found = _started(setup, *given_state(run))
    if found.state is None:
        empty = np.zeros((0, system.n))
        ended = (found.outcome, found.message, found.multipliers)
        return Trajectory(np.zeros(0), empty, empty, empty, *ended, ns_per_step=0.0)
    return _run(setup, found, run.n_steps, run.every)


def _spectral(run: Run, progress: Progress | None) -> Trajectory:
    """Periodic motion by its harmonics, or by steps of radau if too many harmonics are needed."""
    started, steps = time.perf_counter(), _steps_of_cycle(run)
    period = run.step * steps
    orbit = periodic_orbit(run.system, run.table, run.t0, period, run.tolerance)
    if orbit.reason:
        return replace(integrate(replace(run, method="radau"), progress), solver=f"radau, in steps: {orbit.reason}")
    outcome, message, multipliers = _judged(run, orbit, progress)
    if outcome is Outcome.UNSTABLE:
        message += LEFT
    elif outcome is not Outcome.COMPLETED:
        found = integrate(replace(run, method="radau"), progress)
        return replace(found, solver="radau, in steps: stability is uncertain with harmonics")
    message = "; ".join(filter(None, ("" if outcome is Outcome.UNSTABLE else outcome.value, message)))
    at = run.every * np.arange(run.n_steps // run.every + 1)
    z, v, a = np.ascontiguousarray(orbit.at(steps).swapaxes(1, 2)).take(at, axis=1, mode="wrap")
    ns_per_step = 1e9 * (time.perf_counter() - started) / steps
    times = run.t0 + run.step * at
    return Trajectory(times, z, v, a, outcome, message, multipliers, ns_per_step, orbit.said)


def _judged(run: Run, orbit: Orbit, progress: Progress | None) -> tuple[Outcome, str, Floquet]:
    """Stability of a periodic motion: whether disturbances grow, a message, and the Floquet multipliers.

    By steps with constant equations, or by radau if these are uncertain. They give no information about vibrations much
    faster than the steps, as in a machine that hardly moves.
    """
    steps, grid = _steps_of_cycle(run), orbit.grid
    if run.step * steps / FEWEST * grid.fastest > LONGEST_STEP:
        return Outcome.COMPLETED, "the stability is unknown: the steps are too long", None
    moved = monodromy(grid)
    if dies_away(moved):
        return Outcome.COMPLETED, "", partial(_eigenvalues, moved)
    cycle = replace(run, method="radau", n_steps=steps)
    judged = periodic_state(set_up(cycle, progress), steps)
    return judged.outcome, judged.message, judged.multipliers


def dies_away(moved: np.ndarray) -> bool:
    """True if a monodromy matrix certainly damps disturbances.

    The root of a power's norm is an upper bound of the spectral radius, and close to it.
    """
    power = moved
    for _ in range(_SQUARED):
        power = power @ power
    return float(np.linalg.norm(power)) ** (0.5**_SQUARED) < _CLEAR


def _eigenvalues(matrix: np.ndarray) -> np.ndarray:
    return leading(np.linalg.eigvals(matrix), len(matrix) // 2)


def _steps_of_cycle(run: Run) -> int:
    assert run.period_steps is not None  # or no periodic start was asked for: `check_arguments`
    return run.period_steps


def cycle_map(
    system: AffineSystem, table: Table, t0: float, period: float, steps: int, method: str = "radau",
    rho_infinity: float = 0.8,
) -> Cycle:  # fmt: skip
    """Discrete monodromy matrix of `steps` steps of a method over one period [s].

    Arguments otherwise as `Run` has them; not for the method "scipy". Raises UserError as `integrate` does.
    """
    cycle = (system, table, t0, period / steps, steps, method, "periodic", steps)
    run = Run(*cycle, rho_infinity=rho_infinity)
    check_arguments(run)
    return over_a_cycle(set_up(run), steps)


def periodic_near(run: Run) -> tuple[np.ndarray, np.ndarray] | None:
    """Start of a periodic motion near a given state, with all steps of a run as its cycle; None if not found.

    For methods with fixed steps that carry z and v alone. Raises UserError as `integrate` does.
    """
    check_arguments(run)
    setup = set_up(replace(run, period_steps=run.n_steps))
    return corrected_state(setup, run.n_steps, *given_state(run))


def _naming_the_steps(found: Beginning, run: Run) -> Beginning:
    """Message for growth caused by the steps, not the machine: with the same steps of radau nothing grows."""
    if found.outcome is not Outcome.UNSTABLE or run.method == "radau" or found.multipliers is None:
        return found
    steps = _steps_of_cycle(run)
    own = cycle_map(run.system, run.table, run.t0, run.step * steps, steps)
    if own.monodromy is None or abs(np.linalg.eigvals(own.monodromy)).max() > 1.0:
        return found
    growth = abs(found.multipliers[0])
    message = (
        f"unstable steps: with {run.method} a disturbance grows by {growth:.4g} in a cycle, in the "
        "machine it does not; use integrator radau, or more steps"
    )
    return replace(found, state=None, message=message)


def set_up(run: Run, progress: Progress | None = None) -> Setup:
    """Setup of a run with fixed steps; raises UserError as `integrate` does."""
    method, system = method_named(run.method), run.system
    if method.lanes:
        read, constant = partial(one_after_the_other, nodes=len(method.nodes)), None
    else:
        from kaneflex.integrate.modal import constants, forces

        read, constant = partial(forces, system), constants(system)
    times = (run.t0, run.step, method.nodes, run.period_steps)
    stream = CoefficientStream(run.table, system.n_scalars, *times, read, constant)
    row = stream.first_row()
    coefficients = np.array(method.coefficients(system, row, run.step, run.rho_infinity))
    return Setup(system, method, stream, coefficients, _scales(system, row, run.step, method.state_vectors), progress)


def _scales(system: AffineSystem, row: np.ndarray, step: float, state_vectors: int) -> tuple[float, ...]:
    """Powers of a time: a step, or the fastest vibration's 1 / omega if a step is longer.

    Products of a cycle's matrices would lose small numbers compared with velocities times a long step.
    """
    diagonal = slice(system.half_bandwidth, None, 2 * system.half_bandwidth + 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        squares = np.abs((system.K @ row)[diagonal] / (system.M @ row)[diagonal])
    fastest = np.sqrt(squares[np.isfinite(squares)].max(initial=0.0))
    time = step if fastest * step <= 1.0 else 1.0 / fastest
    return (1.0, time, time * time)[:state_vectors]


def _started(setup: Setup, z: np.ndarray, v: np.ndarray) -> Beginning:
    state = State.zeros(1, setup.system.n)
    state.z[0], state.v[0] = z, v
    if not setup.consistent(state, np.ones(1)):
        outcome = Outcome.SINGULAR
        return Beginning(None, None, outcome, f"{outcome.value}: M is singular at t = {setup.stream.t0:.9g} s")
    state.a[:] = state.q
    return Beginning(state, None, Outcome.COMPLETED, "")


def _run(setup: Setup, beginning: Beginning, n_steps: int, every: int) -> Trajectory:
    outcome, message = beginning.outcome, beginning.message + LEFT
    if outcome is Outcome.COMPLETED:
        message = "; ".join(filter(None, (outcome.value, beginning.message)))
    t0, step = setup.stream.t0, setup.stream.step
    rows = n_steps // every + 1
    cycle = repeated(setup, beginning)
    if cycle is not None:
        motion, ns_per_step = cycle
        steps = every * np.arange(rows)
        ended = (outcome, message, beginning.multipliers)
        return Trajectory(t0 + step * steps, *(each[steps % len(each)] for each in motion), *ended, ns_per_step)
    state = beginning.state
    setup.consistent(state, np.ones(1))
    stored = Stored.of(state, rows)
    advanced = advance(setup, state, np.ones(1), n_steps, every, stored, True)
    if advanced.outcome is not Outcome.COMPLETED:
        at = t0 + advanced.steps * step
        message = f"{advanced.outcome.value}, at t = {at:.9g} s, step {advanced.steps} of {n_steps}"
        # without the failed step, and without earlier numbers that are not finite
        rows = max(advanced.steps - 1, 0) // every + 1
        rows = int(np.logical_and.accumulate(np.isfinite(np.hstack(stored)[:rows]).all(axis=1)).sum())
    times = t0 + step * (every * np.arange(rows))
    ended = (advanced.outcome if advanced.outcome is not Outcome.COMPLETED else outcome, message, beginning.multipliers)
    return Trajectory(times, *(out[:rows] for out in stored), *ended, advanced.ns_per_step)


def given_state(run: Run) -> tuple[np.ndarray, np.ndarray]:
    n = run.system.n
    if isinstance(run.start, str):
        return np.zeros(n), np.zeros(n)
    z, v = (np.asarray(part, dtype=float) for part in run.start)
    for name, part in (("z", z), ("v", v)):
        if part.shape != (n,) or not np.isfinite(part).all():
            raise UserError(f"start {name}", part, f"must be {n} finite numbers", "Give one number for each coordinate")
    return z, v


def check_arguments(run: Run) -> None:
    step, start = run.step, run.start
    if not (np.isfinite(step) and step > 0.0):
        raise UserError("step", step, "a step must be a positive time", "Give it in s")
    for name, value in (("steps", run.n_steps), ("every", run.every), ("period_steps", run.period_steps)):
        if value is not None and value < 1:
            raise UserError(name, value, "there must be at least one step", "Give a whole number from 1 on")
    if isinstance(start, str) and start not in ("zero", "periodic"):
        raise UserError("start", start, "unknown start", "Give zero, periodic or a state")
    if start == "periodic" and run.period_steps is None:
        raise UserError("start", start, "the motion has no cycle", "Give the drive a speed and a cycle")
    if start != "periodic" and run.method == "spectral":
        raise UserError("start", start, "the integrator spectral finds periodic motions only", "Use radau")
    if start == "periodic" and run.method == "scipy":
        raise UserError("start", start, "scipy can't find a periodic start", "Start from a state that radau found")


_RELATIVE, _ABSOLUTE = 1e-11, 1e-16  # tolerances: near the best that the methods of solve_ivp reach
_METHODS = ("DOP853", "Radau", "LSODA", "RK45", "BDF")


def solve_ivp_run(
    system: AffineSystem,
    stream: CoefficientStream,
    n_steps: int,
    every: int,
    start: tuple[np.ndarray, np.ndarray],
    scipy_method: str,
    progress: Progress | None = None,
) -> Trajectory:
    """Integrate with steps chosen by scipy's method and report at every `every`-th step of the stream."""
    from kaneflex.integrate.by_scipy import solution

    if scipy_method not in _METHODS:
        cure = f"Use one of {', '.join(_METHODS)}"
        raise UserError("scipy_method", scipy_method, "unknown to solve_ivp", cure)
    n = system.n
    times = stream.t0 + stream.step * (every * np.arange(n_steps // every + 1))

    def accelerations(t: float, z: np.ndarray, v: np.ndarray) -> np.ndarray:
        row = stream.row(t)
        mass, damping, stiffness, force = (system.dense(name, row) for name in ("M", "C", "K", "F"))
        return np.linalg.solve(mass, force - damping @ v - stiffness @ z)

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        return np.concatenate((x[n:], accelerations(t, x[:n], x[n:])))

    span, first = (times[0], times[-1]), np.concatenate(start)
    started = time.perf_counter()
    curve, failed = solution(scipy_method, slope, span, first, progress, [0], rtol=_RELATIVE, atol=_ABSOLUTE)
    spent = time.perf_counter() - started
    times = times[times <= (span[0] if curve is None else curve.t_max)]
    states = first[None] if curve is None else curve(times).T
    z, v = states[:, :n], states[:, n:]
    a = np.array([accelerations(*each) for each in zip(times, z, v, strict=True)]).reshape(-1, n)
    outcome = Outcome.UNSTABLE if failed else Outcome.COMPLETED
    message = f"{outcome.value}: {failed}" if failed else outcome.value
    return Trajectory(times, z, v, a, outcome, message, None, 1e9 * spent / n_steps)
