"""Points of a sweep: solve them, side by side where they are alike, and what is kept of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.study.plan import Plan
from kaneflex.support.errors import UserError

if TYPE_CHECKING:
    from kaneflex.multibody.model import Model
    from kaneflex.solve.solution import Solution

STATISTICS = ("min", "max", "rms", "mean")
COMPLETED, REFUSED, FAILED = "completed", "refused", "failed"
"""Outcomes beside those of a run that stopped early: a point that can't be run, and one that broke the program."""


@dataclass(frozen=True, eq=False)
class Record:
    """What is kept of a point.

    Attributes
    ----------
    point : int
        Its number.
    outcome, reason : str
        How it ended, and why if not completed.
    statistics : mapping of str to tuple of float
        Sensor -> STATISTICS in SI; of completed points only.
    labels : mapping of str to tuple of str
        Sensor -> unit and meaning.
    times : ndarray or None
        Stored instants [s], shape (n_times,), where series are kept.
    series : mapping of str to ndarray
        Sensor -> values in SI, each of shape (n_times,).
    """

    point: int
    outcome: str
    reason: str = ""
    statistics: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    labels: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    times: np.ndarray | None = None
    series: Mapping[str, np.ndarray] = field(default_factory=dict)


def solve_points(plan: Plan, points: Sequence[int]) -> Iterator[Record]:
    """Records of points in their order; it never raises, but says in a record what went wrong.

    As many as there are lanes are in work at a time. What a record holds does not depend on the points beside it.
    """
    from kaneflex.integrate.lanes import LANES

    for first in range(0, len(points), LANES):
        yield from _solved(plan, points[first : first + LANES])


def solve_chunk(plan: Plan) -> tuple[list[Record], float]:
    """Every point of a plan, and the seconds that they took."""
    started = time.perf_counter()
    return list(solve_points(plan, list(plan.points))), time.perf_counter() - started


def _solved(plan: Plan, points: Sequence[int]) -> Iterator[Record]:
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import simulate_together, solve

    def begin(point: int) -> Model:
        return load(plan.at(point), like=next(reversed(models.values()), None))

    def finish(point: int, model: Model) -> Record:
        return _record(plan, point, solutions.get(point) or solve(model))

    models: dict[int, Model] = {}
    failed: dict[int, Record] = {}
    for point in points:
        loaded = _tried(begin, point)
        (failed if isinstance(loaded, Record) else models)[point] = loaded
    try:
        solutions = dict(zip(models, simulate_together(list(models.values())), strict=True))
    except Exception:  # whatever it is: the point that breaks it says so when it is solved by itself
        solutions = {}
    for point in points:
        yield failed[point] if point in failed else _tried(finish, point, models[point])


def _tried(action: Callable[..., Model | Record], point: int, *more: Model) -> Model | Record:
    """What the action gives of a point, or a record of what went wrong with it."""
    try:
        return action(point, *more)
    except UserError as error:
        return Record(point, REFUSED, str(error))
    except Exception as error:  # whatever one point breaks, the others are to be computed
        return Record(point, FAILED, f"{type(error).__name__}: {error}")


def _record(plan: Plan, point: int, solution: Solution) -> Record:
    from kaneflex.response.time_statistics import statistics

    outcome = solution.outcome.name.lower()
    if outcome != COMPLETED:
        return Record(point, outcome, solution.trajectory.message)
    series = {name: entry.values for name, entry in solution.series.items()}
    found = {name: statistics(values, solution.times) for name, values in series.items()}
    kept = {name: tuple(getattr(entry, key) for key in STATISTICS) for name, entry in found.items()}
    labels = {name: (entry.unit, entry.meaning) for name, entry in solution.series.items()}
    if plan.sensitivities:
        from kaneflex.study.sensitivity.report import sensitivities

        derivatives = sensitivities(solution, plan.sensitivities, plan.frozen)
        for name, derivative in derivatives.named().items():
            kept[name] = tuple(getattr(derivative.of, key) for key in STATISTICS)
            labels[name] = (derivative.of.unit, derivative.meaning)
            series[name] = derivative.values
    return Record(
        point, outcome, "", kept, labels, solution.times if plan.series else None, series if plan.series else {}
    )
