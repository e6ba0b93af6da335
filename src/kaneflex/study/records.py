"""Points of a sweep: what is kept of each."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.study.plan import Plan
from kaneflex.support.errors import UserError

if TYPE_CHECKING:
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

    What a record holds does not depend on the points beside it.
    """
    for point in points:
        try:
            found = _record(plan, point, plan.variants.solve(plan.settings(point)))
        except Exception as error:  # whatever one point breaks, the others are to be computed
            found = _failure(point, error)
        yield found


def solve_chunk(plan: Plan) -> tuple[list[Record], float]:
    """Every point of a plan, and the seconds that they took."""
    started = time.perf_counter()
    return list(solve_points(plan, list(plan.points))), time.perf_counter() - started


def _failure(point: int, error: Exception) -> Record:
    if isinstance(error, UserError):
        return Record(point, REFUSED, str(error))
    return Record(point, FAILED, f"{type(error).__name__}: {error}")


def _record(plan: Plan, point: int, solution: Solution) -> Record:
    outcome = solution.outcome.name.lower()
    if outcome != COMPLETED:
        return Record(point, outcome, solution.trajectory.message)
    series = {name: entry.values for name, entry in solution.series.items()}
    found = {name: solution.statistics(name) for name in series}
    kept = {name: tuple(getattr(entry, key) for key in STATISTICS) for name, entry in found.items()}
    labels = {name: (entry.unit, entry.meaning) for name, entry in solution.series.items()}
    if plan.sensitivities:
        from kaneflex.study.sensitivity.report import sensitivities

        derivatives = sensitivities(solution, plan.sensitivities, plan.frozen)
        for name, derivative in derivatives.named().items():
            kept[name] = tuple(getattr(derivative.of, key) for key in STATISTICS)
            labels[name] = (derivative.of.unit, derivative.meaning)
            series[name] = derivative.values
    if not plan.series:
        return Record(point, outcome, "", kept, labels)
    which = plan.poincare.instants(len(solution.times)) if plan.poincare else slice(None)
    series = {name: values[which] for name, values in series.items()}
    return Record(point, outcome, "", kept, labels, solution.times[which], series)
