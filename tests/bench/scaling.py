"""Section: how the time of a step grows with elements, modes and links, and the error with the steps."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from chains import chain
from scipy.linalg import solve_banded

from bench.interleave import interleave
from bench.ivp_runs import SETTINGS, Case, seconds
from bench.rows import Row
from kaneflex import Model, compare, load, read_scene, with_settings
from kaneflex.integrate.run import Run, integrate

TITLE = "Scaling"
ABOUT = """\
Times are those of one step in the compiled loop, for the engine with various numbers of elements or (with 16 elements)
modes, and for open chains of links with four elements each. For comparison, SciPy's `solve_banded` solves one system
with a matrix of the same size, which is a part of a step. Ratios are to the Newmark step. Two further tasks are a cycle
of the engine with 6 coordinates (error relative to a run of 46080 steps), and 10,000 cycles of 720 steps under preset
`paper`."""
METHODS = ("newmark", "gauss")
ELEMENTS = (1, 4, 16, 64, 256, 1024)
MODES = (2, 5, 11, 23)
"""Beside one static shape of the guided rod: 3 to 24 coordinates."""
LINKS = (1, 2, 4, 8)
STEPS = (360, 720, 1440, 2880, 5760)
CYCLES, STEPS_A_CYCLE, SENSOR = 10_000, 720, "mid_transverse"
ROUNDS, BUDGET = 9, 6.0
WORK = 2e5
"""Coordinates times steps of one timing."""


def rows() -> Iterator[Row]:
    engine = with_settings(read_scene("engine"), ["solve.start=zero"])
    for count in ELEMENTS:
        model = load(with_settings(engine, [f"bodies.rod.beam.elements={count}"]))
        yield from steps_of(f"elements: {count}", model, banded=True)
    for count in MODES:
        model = load(with_settings(engine, ["bodies.rod.beam.elements=16", f"solve.modes={count}"]))
        yield from steps_of(f"modes: {model.system.n} coordinates", model)
    with tempfile.TemporaryDirectory() as folder:
        for count in LINKS:
            scene = with_settings(chain(count, False, Path(folder)), ["solve.steps=2000"])
            yield from steps_of(f"links: {count}", load(scene))
    yield from by_number_of_steps()
    yield from many_cycles()


def steps_of(task: str, model: Model, banded: bool = False) -> Iterator[Row]:
    """A step by each method, and a banded solve."""
    n, band = model.system.n, model.system.half_bandwidth
    steps = int(np.clip(WORK / n, 32, model.options.steps))
    run = Run(model.system, model.scalars, 0.0, model.step, steps)
    timed: dict[str, Callable[[], float]] = {
        name: lambda name=name: 1e-9 * integrate(replace(run, method=name)).ns_per_step for name in METHODS
    }
    if banded:
        timed["scipy's solve_banded"] = lambda: banded_solve(n, band)
    race = interleave(timed, ROUNDS, BUDGET / len(ELEMENTS))
    for name in race:
        note = f"{n} coordinates, half bandwidth {band}"
        yield Row(task, name, race[name], race.ratio(name, METHODS[0]), differs=note)


def banded_solve(n: int, band: int) -> float:
    """Seconds of a solve with a matrix of this size and half bandwidth, the smallest of three."""
    matrix, force = np.ones((2 * band + 1, n)), np.ones(n)
    matrix[band] = 4.0 * band + 1.0  # diagonally dominant
    found = []
    for _ in range(3):
        started = time.perf_counter()
        solve_banded((band, band), matrix, force, check_finite=False)
        found.append(time.perf_counter() - started)
    return min(found)


def by_number_of_steps() -> Iterator[Row]:
    case = Case(load(with_settings(read_scene("engine"), list(SETTINGS))))
    at = [(method, count) for count in STEPS for method in METHODS]
    timed = {f"{method}, {count}": lambda one=(method, count): seconds(case, *one) for method, count in at}
    race = interleave(timed, ROUNDS, BUDGET)
    for method, count in at:
        note = f"error {case.error(case.solved(method, count).z):.1e}"
        yield Row(f"steps a cycle: {count}", method, race[f"{method}, {count}"], differs=note)


def many_cycles() -> Iterator[Row]:
    """Decoupled modes; what they leave out is beside the time."""
    scene = with_settings(read_scene("engine"), ["solve.preset=paper", f"solve.steps={STEPS_A_CYCLE}"])
    model = load(scene)
    total = CYCLES * STEPS_A_CYCLE

    def elapsed() -> float:
        started = time.perf_counter()
        integrate(Run(
            model.system, model.scalars, 0.0, model.step, total, "exact-modal", period_steps=STEPS_A_CYCLE, every=total)
        )
        return time.perf_counter() - started

    race = interleave({"exact-modal": elapsed}, ROUNDS, BUDGET)
    case = Case(model)
    own = case.error(case.solved("exact-modal", STEPS_A_CYCLE).z)
    left_out = next(
        each.rms_difference / each.reference_peak
        for each in compare(scene, ["paper", "stiffened"], "stiffened").differences
        if each.sensor == SENSOR and each.model == "paper"
    )
    off = f"{SENSOR} {left_out:.0%} of its peak (rms) from preset stiffened's"
    note = f"{model.system.n} modes, steps' error {own:.1e}; {off}"
    yield Row(f"cycles: {CYCLES}", "exact-modal", race["exact-modal"], differs=note)
