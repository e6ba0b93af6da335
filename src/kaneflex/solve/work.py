"""The work of a run, by its counts: what is done besides depends on no clock, so that every machine has one result."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kaneflex.multibody.model import Model
    from kaneflex.solve.solution import Solution

_OF_A_STEP, _IN_SPACE, _OF_A_BAND = 2.5e-6, 1e-6, 5e-8
"""Seconds on one core of a server of 2023, within a factor of three over 16 runs of shipped scenes: of a coupled step
in the plane by each coordinate; of an evaluation in space by the square of the number of speeds, as its mass matrix is
dense; of a one-way step by what factorising a band takes, n (w + 1)^2."""


def nominal_seconds(solution: Solution) -> float:
    """How long [s] a run takes on that machine, its set-up aside."""
    model, run = solution.model, solution.trajectory
    if model.coupled is not None:
        engine, tried = model.coupled.engine, getattr(run, "steps", 0) + getattr(run, "rejected", 0)
        # The tangent of a cycle with contacts or friction is differences of cycles, four for each freedom.
        differs = model.options.start == "periodic" and len(engine.contacts) + len(engine.holds) > 0
        return _OF_A_STEP * tried * engine.size * (1 + 4 * model.solved_for * differs)
    if model.coupled_in_space is not None:
        curve = model.coupled_in_space.curve
        return _IN_SPACE * getattr(curve, "evaluations", 0) * model.coupled_in_space.module.system.speeds ** 2
    return seconds_of_steps(model, model.options.steps) if model.reduced.size else 0.0


def seconds_of_steps(model: Model, steps: int) -> float:
    """The same of so many steps of one-way equations."""
    return _OF_A_BAND * steps * model.system.n * (1 + model.system.half_bandwidth) ** 2
