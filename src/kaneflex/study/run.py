"""One point of a sweep: solve it, and what is kept of it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from kaneflex.errors import UserError
from kaneflex.study.plan import Plan

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


def solve_point(plan: Plan, point: int) -> Record:
    """Solve a point; it never raises, but says in its record what went wrong."""
    try:
        return _solved(plan, point)
    except UserError as error:
        return Record(point, REFUSED, str(error))
    except Exception as error:  # whatever one point breaks, the others are to be computed
        return Record(point, FAILED, f"{type(error).__name__}: {error}")


def solve_points(plan: Plan) -> tuple[list[Record], float]:
    """Every point of a plan, and the seconds that they took."""
    started = time.perf_counter()
    return [solve_point(plan, point) for point in plan.points], time.perf_counter() - started


def _solved(plan: Plan, point: int) -> Record:
    from kaneflex.loading import load
    from kaneflex.simulation import simulate
    from kaneflex.summary import sensor_summaries

    solution = simulate(load(plan.at(point)))
    outcome = solution.outcome.name.lower()
    if outcome != COMPLETED:
        return Record(point, outcome, solution.trajectory.message)
    found = sensor_summaries(solution)
    series = {name: entry.values for name, entry in solution.series.items()}
    statistics = {name: tuple(getattr(entry, key) for key in STATISTICS) for name, entry in found.items()}
    labels = {name: (entry.unit, entry.meaning) for name, entry in found.items()}
    if plan.sensitivities:
        from kaneflex.sensitivity.report import sensitivities

        derivatives = sensitivities(solution, plan.sensitivities, plan.frozen)
        for name, derivative in derivatives.named().items():
            statistics[name] = tuple(getattr(derivative.of, key) for key in STATISTICS)
            labels[name] = (derivative.of.unit, derivative.meaning)
            series[name] = derivative.values
    return Record(
        point, outcome, "", statistics, labels, solution.times if plan.series else None, series if plan.series else {}
    )
