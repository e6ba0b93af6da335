"""Section: points of a parameter sweep a second, in one process and in one for each core; cycles alone."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from bench import cycles
from bench.interleave import interleave
from bench.rows import Row, Target
from kaneflex import in_processes, load, simulate
from kaneflex.study.plan import Plan, make_plan
from kaneflex.study.records import solve_points
from kaneflex.study.sweep import Solver

TITLE = "Sweeps"
ABOUT = f"""\
Times are per point of a sweep of the engine over its speed, with 6 coordinates and 720 instants per cycle. *Solving
alone* is `simulate` with a loaded model. Ratios are to one process.

{cycles.ABOUT}"""
STUDY = """scene = "engine"
settings = ["solve.modes=5", "solve.steps=720"]

[parameters]
"drives.main.speed" = {{from = "2000 rpm", to = "6000 rpm", count = {count}}}
"""
POINTS, ROUNDS, BUDGET = 480, 5, 60.0
WARM = POINTS // 4
"""Points before the clock starts."""
TWO_CORES = Target(1 / 1.8, 0.5)
_AT_ONCE = 2e-3
"""Seconds between results of one chunk, at most."""


def rows() -> Iterator[Row]:
    cores = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speeds.toml"
        path.write_text(STUDY.format(count=POINTS))
        plan = make_plan(path)
        model = load(make_plan(path).scene)  # another one: what a loaded scene remembers can't be sent to a process
        timed = {"one process": lambda: seconds_a_point(plan, solve_points)}
        if cores > 1:
            timed[f"{cores} processes"] = lambda: seconds_a_point(plan, in_processes(cores))
        timed["solving alone"] = lambda: simulate(model).seconds
        race = interleave(timed, ROUNDS, BUDGET)
    for name in race:
        rate = f"{1.0 / race[name].median:.0f} a second"
        target = TWO_CORES if name == "2 processes" else None
        yield Row("a point", name, race[name], race.ratio(name, "one process"), target, differs=rate)
    yield from cycles.rows()


def seconds_a_point(plan: Plan, solver: Solver) -> float:
    """After those that warm up the processes, from the end of a chunk on.

    Raises
    ------
    ValueError
        If a point was not completed: its time says nothing.
    """
    instants = []
    for record in solver(plan, list(plan.points)):
        if record.outcome != "completed":
            raise ValueError(f"point {record.point}: {record.outcome}, {record.reason}")
        instants.append(time.perf_counter())
    begun = WARM
    while begun < len(instants) - 2 and instants[begun + 1] - instants[begun] < _AT_ONCE:
        begun += 1
    return (instants[-1] - instants[begun]) / (len(instants) - 1 - begun)
