"""Runs of one-way models: integration, or solution at each instant, by the method of the preset."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.solve.run_checks import INSTANTS, MAX_STORED, UNREPEATED, refuse_unrepeated
from kaneflex.solve.run_result import RunResult

if TYPE_CHECKING:
    from kaneflex.integrate.run import Run

Progress = Callable[[float], None]
_REPEATS = 1e-6
"""Relative change over a cycle that counts as periodic."""
_ROUNDING = 1e-12
"""Change over a cycle, relative to the largest value of the same unit, that counts as rounding."""


def run_one_way(model: Model, progress: Progress | None = None) -> RunResult:
    """Run of a model without coupled equations, up to the first event that stops it."""
    started = time.perf_counter()
    if model.awaits_run:
        model, progress = _moved(model, progress or (lambda done: None))
    found = RunResult(model, _solved(model, progress), time.perf_counter() - started)
    if not model.scene.events:
        return found
    from kaneflex.solve.events import until_stop

    return until_stop(found)


def _moved(model: Model, progress: Progress) -> tuple[Model, Progress]:
    """Model with an integrated motion, which half of the work is if elastic equations follow, and the rest's progress.
    """
    from kaneflex.solve.loading import integrated

    part = 1.0 if model.options.dynamics == "rigid" else 0.5
    found = integrated(model, lambda done: progress(part * done))
    return found, lambda done: progress(part + (1.0 - part) * done)


def _solved(model: Model, progress: Progress | None) -> Trajectory:
    """Motion by the method of the preset."""
    if model.options.dynamics in ("dynamic", "frozen"):
        from kaneflex.integrate.run import integrate

        return integrate(run_of(model), progress)
    times = model.motion.begin + model.step * np.arange(model.options.steps + 1)
    z = v = a = np.zeros((len(times), 0))
    started, ns = time.perf_counter(), 0.0
    if model.options.dynamics == "quasistatic":
        from kaneflex.solve.quasistatic import quasistatic

        periodic = model.options.cycles and not_repeated(model) is None
        z, v, a = quasistatic(model, times, periodic, progress)
        ns = 1e9 * (time.perf_counter() - started) / len(times)
    return Trajectory(times, z, v, a, Outcome.COMPLETED, Outcome.COMPLETED.value, None, ns)


def storing(model: Model) -> int:
    """Number of steps per stored one."""
    return max(1, -(-model.options.steps // MAX_STORED))


def not_repeated(model: Model) -> str | None:
    """Scalar that is not periodic, in words; None if motion and loads are periodic."""
    period, free = model.scene.period, model.scene.free_joints
    assert period is not None  # checked with the scene
    cycle = model.motion.at(np.linspace(0.0, period, 65))
    shares = np.zeros(1) if free else np.append(0.0, INSTANTS)  # a free joint's motion is known for a cycle only
    before, after = (model.motion.at(period * (shares + later)).values for later in (0.0, 1.0))
    column, sizes, changes = cycle.motion.column, abs(cycle.values).max(axis=0), abs(after - before)
    unit_of, largest = {name: unit for name, unit, *_ in model.module.SCALARS}, cycle.magnitudes(period)
    for name in sorted({name for monomial in model.monomials for name in monomial} & column.keys()):
        k, rounding = column[name], _ROUNDING * largest.get(unit_of.get(name), 0.0)
        if changes[:, k].max() > _REPEATS * sizes[k] + rounding:
            if free and name not in model.scene.loads:
                return f"{free[0]} moves freely, and does not return after a cycle"
            worst = changes[:, k].argmax()
            return UNREPEATED.format(name, before[worst, k], after[worst, k])
    return None


def run_of(model: Model) -> Run:
    """Equations, start and steps of a model for the integrator.

    Raises
    ------
    SceneError
        If a periodic start is requested and the motion or a load is not periodic.
    """
    from kaneflex.integrate.run import Run

    options = model.options
    start: object = options.start
    if options.start == "periodic":
        refuse_unrepeated(not_repeated(model))
    if options.start == "quasistatic":
        from kaneflex.solve.quasistatic import slow_start

        start = slow_start(model)
    if options.start == "given":
        from kaneflex.solve.initial import given_state

        start = given_state(model)
    return Run(
        model.system, model.scalars, 0.0, model.step, options.steps, options.integrator, start=start,
        period_steps=options.steps if options.start == "periodic" else None, every=storing(model),
        rho_infinity=options.rho_infinity, tolerance=options.tolerance,
    )  # fmt: skip
