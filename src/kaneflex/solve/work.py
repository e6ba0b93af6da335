"""Work of a run from its counts, independent of the clock, so that results are the same on every machine."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kaneflex.multibody.model import Model
    from kaneflex.solve.solution import Solution

_OF_A_STEP, _IN_SPACE, _OF_A_BAND = 2.5e-6, 1e-6, 5e-8
"""Seconds on one core of a server of 2023, within a factor of three over 16 runs of shipped
scenes: per coupled step in the plane and coordinate; per evaluation in space and squared number of speeds, as its
mass matrix is dense; per one-way step and operation of a band factorisation, n (w + 1)^2."""


def nominal_seconds(solution: Solution) -> float:
    """Nominal duration [s] of a run on that machine, without set-up."""
    model, run = solution.model, solution.trajectory
    if model.coupled is not None:
        engine, tried = model.coupled.engine, getattr(run, "steps", 0) + getattr(run, "rejected", 0)
        # the tangent of a cycle with contacts or friction takes four cycles per freedom
        differs = model.options.start == "periodic" and len(engine.contacts) + len(engine.holds) > 0
        return _OF_A_STEP * tried * engine.size * (1 + 4 * model.solved_for * differs)
    if model.coupled_in_space is not None:
        curve = model.coupled_in_space.curve
        return _IN_SPACE * getattr(curve, "evaluations", 0) * model.coupled_in_space.module.system.speeds ** 2
    return seconds_of_steps(model, model.options.steps) if model.reduced.size else 0.0


def seconds_of_steps(model: Model, steps: int) -> float:
    """Nominal duration [s] of ``steps`` steps of one-way equations."""
    return _OF_A_BAND * steps * model.system.n * (1 + model.system.half_bandwidth) ** 2
