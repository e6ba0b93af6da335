"""Of the section of sweeps: periodic motions of the engine, by steps and by harmonics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from bench.interleave import interleave
from bench.rows import Row
from kaneflex import load, read_scene, with_settings
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.spectral import Orbit, periodic_orbit
from kaneflex.solve.one_way_run import run_of

ABOUT = """\
*A cycle* is the periodic motion at one of 64 speeds, computed on one core by `integrate`. The error is the rms
difference of the first bending mode of the rod from a run by `gauss` with 16 times as many steps (the largest of four
speeds). *its motion* is `spectral` without the stability check. Ratios are to `gauss`."""
SPEEDS, STEPS, FINER = 64, 720, 16
ROUNDS, BUDGET = 5, 20.0
BENDING = 1
"""Coordinate rod.mode_1."""
TOLERANCES = (1e-4, 1e-6)


def rows() -> Iterator[Row]:
    speeds = [f"drives.main.speed={speed} rpm" for speed in np.linspace(2000.0, 6000.0, SPEEDS)]
    exact = [run_of(load(with_settings(read_scene("engine"), ["solve.modes=5", speed]))) for speed in speeds]
    timed, errors = {}, {}
    for name, tolerance in (("newmark", 1.0), ("gauss", 1.0), *(("spectral", tolerance) for tolerance in TOLERANCES)):
        runs = [replace(with_table(with_steps(run, STEPS, name)), tolerance=tolerance) for run in exact]
        found = name if name != "spectral" else f"spectral, {tolerance:g}"
        timed[found] = seconds_a_run(runs, integrate)
        errors[found] = f"error {error_of(runs, exact):.1e}"
        if name == "spectral":
            timed[f"{found}, its motion"] = seconds_a_run(runs, orbit_of)
    race = interleave(timed, ROUNDS, BUDGET)
    for name in race:
        ratio = None if name == "gauss" else race.ratio(name, "gauss")
        yield Row("a cycle", name, race[name], ratio, differs=errors.get(name, ""))


def orbit_of(run: Run) -> Orbit:
    return periodic_orbit(run.system, run.table, run.t0, run.step * run.n_steps, run.tolerance)


def with_steps(run: Run, steps: int, method: str) -> Run:
    """The same cycle in another way."""
    return replace(run, step=run.step * run.n_steps / steps, n_steps=steps, period_steps=steps, method=method)


def with_table(run: Run) -> Run:
    """The same run with a table that is there, for the two sets of times that a cycle is read at."""
    read: dict[int, np.ndarray] = {}

    def table(times: np.ndarray) -> np.ndarray:
        if times.size not in read:
            read[times.size] = run.table(times)
        return read[times.size]

    return replace(run, table=table)


def error_of(runs: Sequence[Run], exact: Sequence[Run]) -> float:
    """As ABOUT says."""
    found = []
    for run, model in list(zip(runs, exact, strict=True))[:: SPEEDS // 4]:
        z = integrate(run).z
        finer = integrate(with_steps(model, FINER * STEPS, "gauss")).z[::FINER]
        found.append(np.linalg.norm((z - finer)[:, BENDING]) / np.linalg.norm(finer[:, BENDING]))
    return float(max(found))


def seconds_a_run(runs: Sequence[Run], solve: Callable[[Run], object]) -> Callable[[], float]:
    def seconds() -> float:
        started = time.perf_counter()
        for run in runs:
            solve(run)
        return (time.perf_counter() - started) / len(runs)

    return seconds
