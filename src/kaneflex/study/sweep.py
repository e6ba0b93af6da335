"""Go through the points of a plan that are not finished, and write the dataset."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kaneflex.study.dataset import demand_zarr, write_netcdf, write_zarr
from kaneflex.study.plan import Plan, make_plan
from kaneflex.study.records import COMPLETED, Record, solve_points
from kaneflex.study.store import BEGIN_ANEW, RESULT_FILES, Store, alone, open_store
from kaneflex.support.arguments import takes
from kaneflex.support.errors import Fault, OutputError
from kaneflex.support.labelled import read_dataset, read_labelled
from kaneflex.support.output_folders import writing
from kaneflex.support.terminal import silent

if TYPE_CHECKING:
    import xarray

_RECENT = 200
"""Points whose rate is told: not the first ones, for which everything was compiled."""


@dataclass(frozen=True)
class Progress:
    """How far a sweep is: points `done` of `total`, `failed` of them, `now` of them since it was started; and how many
    points a second the last ones were, 0 before the first.
    """

    done: int
    total: int
    failed: int
    now: int
    rate: float

    @property
    def seconds_left(self) -> float | None:
        """Time left at that rate [s]; None before the first point."""
        return (self.total - self.done) / self.rate if self.rate else None

    def __str__(self) -> str:
        left = "" if self.seconds_left is None else f", {duration(self.seconds_left)} left"
        failed = f", {self.failed} failed" if self.failed else ""
        return f"{self.done} of {self.total} points{failed}, {self.rate:.3g} a second{left}"


def duration(seconds: float) -> str:
    """Seconds in words of a clock: 48 s, 3 min 5 s, 2 h 7 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    return f"{whole // 60} min {whole % 60} s" if whole < 3600 else f"{whole // 3600} h {whole % 3600 // 60} min"


@dataclass(frozen=True)
class Finished:
    """A complete sweep: its dataset's file, how many points it has, and the reasons of those that failed by number."""

    path: Path
    total: int
    failures: dict[int, str]

    @property
    def dataset(self) -> xarray.Dataset:
        """The dataset, read from its file."""
        with _faults_of(self.path):
            return read_dataset(self.path)


Solver = Callable[[Plan, Sequence[int]], Generator[Record, None, None]]
"""Solves the points of these numbers, in whatever order."""


def in_this_process(plan: Plan, points: Sequence[int]) -> Generator[Record, None, None]:
    """Some points after the others."""
    yield from solve_points(plan, points)


@takes(study="study", folder="path", solver="function", progress="function", form="text")
def sweep(
    study: Plan | Path | str | Mapping[str, Any],
    folder: Path | str,
    solver: Solver = in_this_process,
    progress: Callable[[Progress], None] | None = None,
    force: bool = False,
    form: str = "netcdf",
) -> Finished:
    """Compute what is not finished of a plan, then write the dataset into the folder.

    Whatever stops it, a point that was finished is not computed again by the next call.

    Parameters
    ----------
    study : Plan, path or mapping
        A study's file, or its tables, of which :func:`kaneflex.study.plan.make_plan` makes the plan.
    folder : path
        New, or that of the same sweep.
    solver : Solver
        Where the points are solved: in this process; :func:`kaneflex.in_processes` and :func:`kaneflex.on_cluster`
        make others. The results don't depend on it.
    progress : callable, optional
        Called with a Progress at the start and after each point.
    force : bool
        Whether to begin anew in a sweep's folder.
    form : str
        "netcdf", or "zarr", which is written block by block.

    Raises
    ------
    SceneError
        If zarr is wanted and not installed.
    OutputError
        If the folder holds other things, is damaged, can't be written, or another sweep is writing into it.
    """
    plan, folder = study if isinstance(study, Plan) else make_plan(study), Path(folder)
    if form == "zarr":
        demand_zarr()
    with alone(folder):
        store = open_store(folder, plan, force)
        if store.result is None:
            _complete(plan, store, solver, progress or silent)
            write = {"netcdf": write_netcdf, "zarr": write_zarr}[form]
            with writing(folder):
                write(plan, store, folder / RESULT_FILES[form])
                store.close()
    return _finished(store, plan)


def _complete(plan: Plan, store: Store, solver: Solver, progress: Callable[[Progress], None]) -> None:
    total, before = len(plan.points), len(store.finished)
    failed = sum(record.outcome != COMPLETED for record in store.records(store.finished))
    moments = deque([time.perf_counter()], maxlen=_RECENT)  # the start, as long as few are finished
    progress(Progress(before, total, failed, 0, 0.0))
    todo = [point for point in plan.points if point not in store.finished]
    with closing(solver(plan, todo)) as records:  # whatever ends the loop ends the workers
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
        raise OutputError(str(path), None, "it is not the dataset of this study", BEGIN_ANEW)
    endings = zip(*(found.variables[name][1] for name in _ENDINGS), strict=True)
    failures = {int(point): str(reason) for point, outcome, reason in endings if outcome != COMPLETED}
    return Finished(path, len(plan.points), failures)
