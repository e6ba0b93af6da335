"""Results of the points of a sweep."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.study.plan import Plan
from kaneflex.support.errors import UserError

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

STATISTICS = ("min", "max", "rms", "mean")
COMPLETED, REFUSED, FAILED = "completed", "refused", "failed"
"""Outcomes in addition to those of a run that stopped early: REFUSED by a UserError, FAILED by any
other error."""


@dataclass(frozen=True, eq=False)
class Record:
    """Result of a point.

    Attributes
    ----------
    point : int
        Number of the point.
    outcome, reason : str
        Outcome of the run, and the reason if it was not completed.
    statistics : mapping of str to tuple of float
        Sensor -> STATISTICS in SI; for completed points only.
    labels : mapping of str to tuple of str
        Sensor -> unit and meaning.
    times : ndarray or None
        Stored instants [s], shape (n_times,), if series are kept.
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


def solve_points(plan: Plan, points: Sequence[int]) -> Generator[Record, None, None]:
    """Solve points in the given order in this process and yield their records; errors are recorded, not raised.

    The record of a point does not depend on the other points.
    """
    for point in points:
        try:
            found = _record(plan, point, plan.variants.solve(plan.settings(point)))
        except UserError as error:
            found = Record(point, REFUSED, str(error))
        except Exception as error:  # an error of one point must not stop the others
            found = Record(point, FAILED, f"{type(error).__name__}: {error}")
        yield found


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
