"""Of the section of sweeps: periodic motions of the engine, by steps alone and in vector lanes, and by harmonics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from bench.interleave import interleave
from bench.rows import Row, Target
from kaneflex.integrate.batch import integrate_batch
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.spectral import Orbit, periodic_orbit
from kaneflex.scene import read_scene, with_settings
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import run_of

ABOUT = """*A cycle*: the periodic motion at one of 64 speeds on one core, systems and tables of the motion being there:
by `integrate` one after the other, or by `integrate_batch` in eight lanes; the ratio is to the same method alone.
*A step* is one in a lane without what finds the periodic state. The error is the root mean square of the difference of
the rod's first bending mode to 16 times as many steps by `gauss`, relative to its own: the largest at four speeds.
*spectral* is the motion by its harmonics, with what tells whether it is stable, and *its motion* without that; its
ratio is to `gauss` alone."""
SPEEDS, STEPS, FINER = 64, 720, 16
ROUNDS, BUDGET = 5, 20.0
BENDING = 1
"""Coordinate rod.mode_1."""
TOLERANCES = (1e-4, 1e-6)
HARMONICS = {1e-4: Target(reach=40e-6, dream=27e-6), 1e-6: Target(reach=300e-6, dream=150e-6)}
CYCLE, STEP = Target(reach=30e-6, dream=15e-6), Target(reach=20e-9, dream=16e-9)
_AGREEMENT = 1e-9
"""What lanes may change, of a coordinate's largest value."""


def rows() -> Iterator[Row]:
    speeds = [f"drives.main.speed={speed} rpm" for speed in np.linspace(2000.0, 6000.0, SPEEDS)]
    exact = [run_of(load(with_settings(read_scene("engine"), ["solve.modes=5", speed]))) for speed in speeds]
    for method in ("newmark", "gauss"):
        runs = [with_table(with_steps(run, STEPS, method)) for run in exact]
        yield from race_of(method, runs, error_of(runs, exact))
    yield from by_harmonics(exact)


def by_harmonics(exact: Sequence[Run]) -> Iterator[Row]:
    """Rows of the spectral solver."""
    for tolerance in TOLERANCES:
        runs = [replace(with_table(with_steps(run, STEPS, "spectral")), tolerance=tolerance) for run in exact]
        error = error_of(runs, exact)
        timed = {
            "gauss, alone": seconds_a_run(
                [replace(run, method="gauss") for run in runs], lambda runs: [integrate(run) for run in runs]
            ),
            f"spectral, {tolerance:g}": seconds_a_run(runs, lambda runs: [integrate(run) for run in runs]),
            f"spectral, {tolerance:g}, its motion": seconds_a_run(runs, lambda runs: [orbit_of(run) for run in runs]),
        }
        race = interleave(timed, ROUNDS, BUDGET)
        reference, whole, motion = race
        yield Row("a cycle", whole, race[whole], race.ratio(whole, reference), differs=f"error {error:.1e}")
        yield Row("a cycle", motion, race[motion], race.ratio(motion, reference), HARMONICS[tolerance], True)


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


def race_of(method: str, runs: Sequence[Run], error: float) -> Iterator[Row]:
    """Rows of a method.

    Raises
    ------
    ValueError
        If a motion is not what it is alone: its time says nothing.
    """
    for run, found in zip(runs, integrate_batch(runs), strict=True):
        alone = integrate(run).z
        if found is None or not (abs(found.z - alone) <= _AGREEMENT * abs(alone).max()).all():
            raise ValueError(f"{method}, step {run.step}: in lanes it is not what it is alone")
    from_rest = [replace(run, start="zero") for run in runs]
    timed = {
        f"{method}, alone": seconds_a_run(runs, lambda runs: [integrate(run) for run in runs]),
        f"{method}, lanes": seconds_a_run(runs, integrate_batch),
        f"{method}, lanes, steps alone": lambda: seconds_a_step(from_rest),
    }
    race = interleave(timed, ROUNDS, BUDGET)
    alone, lanes, steps = race
    yield Row("a cycle", alone, race[alone], differs=f"error {error:.1e}")
    about = f"10,000 in {1e4 * race[lanes].median:.2g} s, error {error:.1e}"
    yield Row("a cycle", lanes, race[lanes], race.ratio(lanes, alone), CYCLE, True, about)
    yield Row("a step", steps, race[steps], None, STEP, True, "in each lane")


def seconds_a_run(runs: Sequence[Run], solve: Callable[[Sequence[Run]], object]) -> Callable[[], float]:
    def seconds() -> float:
        started = time.perf_counter()
        solve(runs)
        return (time.perf_counter() - started) / len(runs)

    return seconds


def seconds_a_step(runs: Sequence[Run]) -> float:
    """Of a lane, by the median of all runs."""
    return 1e-9 * float(np.median([found.ns_per_step for found in integrate_batch(runs)]))
