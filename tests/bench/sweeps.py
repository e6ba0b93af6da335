"""Section: points of a parameter sweep a second, in one process and in one for each core; cycles in lanes."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from bench import cycles
from bench.interleave import interleave
from bench.rows import Row
from kaneflex.loading import load
from kaneflex.simulation import simulate
from kaneflex.study.plan import Plan, make_plan
from kaneflex.study.processes import in_processes
from kaneflex.study.sweep import Solver, in_this_process

TITLE = "Sweeps"
ABOUT = f"""Time a point of a sweep of the engine over its speed, 6 coordinates, 720 steps a cycle by `gauss`: reading
the settings, building the model, the periodic motion and the statistics of every sensor. Counted from the second result
on, without the start of the processes. *Solving alone* is `simulate` of a model that is there. The ratio is to one
process.

{cycles.ABOUT}"""
STUDY = """scene = "engine"
settings = ["solve.modes=5", "solve.steps=720"]

[parameters]
"drives.main.speed" = {{from = "2000 rpm", to = "6000 rpm", count = {count}}}
"""
POINTS, ROUNDS, BUDGET = 120, 5, 30.0


def rows() -> Iterator[Row]:
    cores = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speeds.toml"
        path.write_text(STUDY.format(count=POINTS))
        plan = make_plan(path)
        model = load(make_plan(path).scene)  # another one: what a loaded scene remembers can't be sent to a process
        timed = {"one process": lambda: seconds_a_point(plan, in_this_process)}
        if cores > 1:
            timed[f"{cores} processes"] = lambda: seconds_a_point(plan, in_processes(cores))
        timed["solving alone"] = lambda: simulate(model).seconds
        race = interleave(timed, ROUNDS, BUDGET)
    for name in race:
        rate = f"{1.0 / race[name].median:.0f} a second"
        yield Row("a point", name, race[name], race.ratio(name, "one process"), differs=rate)
    yield from cycles.rows()


def seconds_a_point(plan: Plan, solver: Solver) -> float:
    """From the second result on.

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
    return (instants[-1] - instants[1]) / (len(instants) - 2)
