"""Solve the unfinished points of a plan, then write the dataset."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kaneflex.study.plan import Plan, make_plan
from kaneflex.study.records import COMPLETED, Record, solve_points
from kaneflex.study.store import BEGIN_ANEW, RESULT_FILE, Store, alone, open_store, write_netcdf
from kaneflex.support.arguments import takes
from kaneflex.support.errors import Fault, OutputError
from kaneflex.support.files import writing
from kaneflex.support.labelled import Labelled, read_dataset, read_labelled
from kaneflex.support.terminal import silent

if TYPE_CHECKING:
    import xarray

_RECENT = 200
"""Number of recent points whose rate is reported: the first ones include compilation."""


@dataclass(frozen=True)
class Progress:
    """Progress of a sweep: `done` of `total` points, `failed` of them, `now` of them since the start; `rate` of the
    last points [1/s], 0 before the first."""

    done: int
    total: int
    failed: int
    now: int
    rate: float

    @property
    def seconds_left(self) -> float | None:
        """Time left at this rate [s]; None before the first point."""
        return (self.total - self.done) / self.rate if self.rate else None

    def __str__(self) -> str:
        left = "" if self.seconds_left is None else f", {duration(self.seconds_left)} left"
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{self.done} of {self.total} points{failed}, {self.rate:.3g} a second{left}"


def duration(seconds: float) -> str:
    """Duration in s, min and h: 48 s, 3 min 5 s, 2 h 7 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    return f"{whole // 60} min {whole % 60} s" if whole < 3600 else f"{whole // 3600} h {whole % 3600 // 60} min"


@dataclass(frozen=True)
class Finished:
    """A complete sweep: file of the dataset, number of points, and reasons of failed points by number."""

    path: Path
    total: int
    failures: dict[int, str]

    @property
    def labelled(self) -> Labelled:
        """The dataset as plain arrays; coordinates are among the variables."""
        with _faults_of(self.path):
            return read_labelled(self.path)

    @property
    def dataset(self) -> xarray.Dataset:
        """The dataset, read from its file."""
        with _faults_of(self.path):
            return read_dataset(self.path)


Solver = Callable[[Plan, Sequence[int]], Generator[Record, None, None]]
"""Solves the points with these numbers, in any order."""


@takes(study="study", folder="path", solver="function", progress="function")
def sweep(
    study: Plan | Path | str | Mapping[str, Any],
    folder: Path | str,
    solver: Solver = solve_points,
    progress: Callable[[Progress], None] | None = None,
    force: bool = False,
) -> Finished:
    """Compute the unfinished points of a study, then write the dataset into the folder.

    After an interruption, the next call continues with the unfinished points.

    Parameters
    ----------
    study : Plan, path or mapping
        A study's file, or its tables, as for :func:`kaneflex.study.plan.make_plan`.
    folder : path
        New or empty folder, or that of the same sweep.
    solver : Solver
        Solves the points, by default in this process; in several: :func:`kaneflex.in_processes`. The results don't
        depend on it.
    progress : callable, optional
        Called with a Progress at the start and after each point.
    force : bool
        Whether to begin again in a sweep's folder.

    Raises
    ------
    OutputError
        If the folder holds other files, is damaged, can't be written, or another sweep is writing into it.
    """
    plan, folder = study if isinstance(study, Plan) else make_plan(study), Path(folder)
    with alone(folder):
        store = open_store(folder, plan, force)
        if store.result is None:
            _complete(plan, store, solver, progress or silent)
            with writing(folder):
                write_netcdf(plan, store, folder / RESULT_FILE)
                store.close()
    return _finished(store, plan)


def _complete(plan: Plan, store: Store, solver: Solver, progress: Callable[[Progress], None]) -> None:
    total, before = len(plan.points), len(store.finished)
    failed = sum(record.outcome != COMPLETED for record in store.records(store.finished))
    moments = deque([time.perf_counter()], maxlen=_RECENT)  # contains the start until _RECENT points are finished
    progress(Progress(before, total, failed, 0, 0.0))
    todo = [point for point in plan.points if point not in store.finished]
    with closing(solver(plan, todo)) as records:  # ends the workers whenever the loop ends
        for record in records:
            store.add(record)
            failed += record.outcome != COMPLETED
            done = len(store.finished)
            moments.append(time.perf_counter())
            rate = (len(moments) - 1) / max(moments[-1] - moments[0], 1e-9)
            progress(Progress(done, total, failed, done - before, rate))


_ENDINGS = ("point", "outcome", "reason")


@contextmanager
def _faults_of(path: Path) -> Iterator[None]:
    try:
        yield
    except Fault as fault:
        raise OutputError(str(path), None, fault.reason, BEGIN_ANEW) from fault


def _finished(store: Store, plan: Plan) -> Finished:
    path = store.result
    assert path is not None
    with _faults_of(path):
        found = read_labelled(path, _ENDINGS)
    if found.attributes.get("study") != plan.digest or not found.variables.keys() >= {*_ENDINGS}:
        raise OutputError(str(path), None, "it belongs to another study", BEGIN_ANEW)
    endings = zip(*(found.variables[name][1] for name in _ENDINGS), strict=True)
    failures = {int(point): str(reason) for point, outcome, reason in endings if outcome != COMPLETED}
    return Finished(path, len(plan.points), failures)
