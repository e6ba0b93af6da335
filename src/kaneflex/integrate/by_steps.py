"""Integration in steps of equal length, from a given state or the periodic one."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from kaneflex.integrate.methods import method_named
from kaneflex.integrate.periodic import Beginning, Cycle, corrected_state, over_a_cycle, periodic_state
from kaneflex.integrate.stepping import Setup, State, Stored, advance
from kaneflex.integrate.streams import CoefficientStream
from kaneflex.integrate.system import (
    LEFT,
    AffineSystem,
    Outcome,
    Progress,
    Run,
    Table,
    Trajectory,
    check_arguments,
    given_state,
    steps_of_cycle,
)


def by_steps(run: Run, progress: Progress | None = None) -> Trajectory:
    """Integrate by any method but "spectral"; see :func:`kaneflex.integrate.run.integrate`."""
    setup = set_up(run, progress)
    if run.start != "periodic":
        return _run(setup, _started(setup, *given_state(run)), run.n_steps, run.every)
    period = steps_of_cycle(run)
    found = _run(setup, _naming_the_steps(periodic_state(setup, period), run), min(period, run.n_steps), 1)
    steps = run.every * np.arange(run.n_steps // run.every + 1)
    if len(found.times) <= min(period, run.n_steps):  # it stopped before
        steps = steps[steps < len(found.times)]
    z, v, a = (each[steps % period] for each in (found.z, found.v, found.a))
    return replace(found, times=run.t0 + run.step * steps, z=z, v=v, a=a)


def periodic_start(run: Run, progress: Progress | None = None) -> Beginning:
    """Periodic state of a run and its stability."""
    return periodic_state(set_up(run, progress), steps_of_cycle(run))


def cycle_map(
    system: AffineSystem, table: Table, t0: float, period: float, steps: int, method: str = "radau",
    rho_infinity: float = 0.8,
) -> Cycle:  # fmt: skip
    """Discrete monodromy matrix of `steps` steps of a method over one period [s].

    Arguments otherwise as `Run` has them. Raises UserError as `integrate` does.
    """
    cycle = (system, table, t0, period / steps, steps, method, "periodic", steps)
    run = Run(*cycle, rho_infinity=rho_infinity)
    check_arguments(run)
    return over_a_cycle(set_up(run), steps)


def periodic_near(run: Run) -> Trajectory | None:
    """Run from the periodic motion near a given state; None if not found.

    For methods with fixed steps that carry z and v alone. Raises UserError as `integrate` does.
    """
    check_arguments(run)
    setup = set_up(run)
    found = corrected_state(setup, steps_of_cycle(run), *given_state(run))
    return None if found is None else _run(setup, _started(setup, *found), run.n_steps, run.every)


def _naming_the_steps(found: Beginning, run: Run) -> Beginning:
    """Message for growth caused by the steps, not the machine: with the same steps of radau nothing grows."""
    if found.outcome is not Outcome.UNSTABLE or run.method == "radau" or found.multipliers is None:
        return found
    steps = steps_of_cycle(run)
    own = cycle_map(run.system, run.table, run.t0, run.step * steps, steps)
    if own.monodromy is None or abs(np.linalg.eigvals(own.monodromy)).max() > 1.0:
        return found
    growth = abs(found.multipliers[0])
    message = (
        f"unstable steps: with {run.method} a disturbance grows by {growth:.4g} in a cycle, although "
        "the motion is stable; use integrator radau, or more steps"
    )
    return replace(found, state=None, message=message)


def set_up(run: Run, progress: Progress | None = None) -> Setup:
    """Setup of a run with fixed steps; raises UserError as `integrate` does."""
    method, system = method_named(run.method), run.system
    stream = CoefficientStream(run.table, system.n_scalars, run.t0, run.step, method.nodes, run.period_steps)
    if not method.varying:
        from kaneflex.integrate.modal import constants, forces

        stream.read, stream.constant = partial(forces, system), constants(system)
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
    state = State.zeros(setup.system.n, 1)
    state.z[:, 0], state.v[:, 0] = z, v
    if not setup.consistent(state, np.ones(1)):
        outcome = Outcome.SINGULAR
        return Beginning(None, None, outcome, f"{outcome.value}: M is singular at t = {setup.stream.t0:.9g} s")
    state.a[:] = state.q
    return Beginning(state, None, Outcome.COMPLETED, "")


def _run(setup: Setup, beginning: Beginning, n_steps: int, every: int) -> Trajectory:
    if beginning.state is None:
        empty = np.zeros((0, setup.system.n))
        ended = (beginning.outcome, beginning.message, beginning.multipliers)
        return Trajectory(np.zeros(0), empty, empty, empty, *ended, ns_per_step=0.0)
    outcome, message = beginning.outcome, beginning.message + LEFT
    if outcome is Outcome.COMPLETED:
        message = "; ".join(filter(None, (outcome.value, beginning.message)))
    t0, step = setup.stream.t0, setup.stream.step
    rows = n_steps // every + 1
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
