"""Error estimates compared with true errors, into ``docs/accuracy.md``: ``python tests/bench_accuracy.py``.

So are runs under preset coupled; ``python tests/bench_accuracy.py coupled`` measures these alone anew, and ``python
tests/bench_accuracy.py SCENE ...`` the plus-minus of these scenes alone.

The truth is the scene's own finest model: preset stiffened with four times the elements, all modes, four times the
steps by radau; under coupled one with as many elements and steps and four times the modes. What it is off by itself is
estimated, too, and sensors that a run has to ten times that are left out.
"""

import math
import statistics
import sys
import warnings
from pathlib import Path

import csv_tables
import numpy as np

import kaneflex
from kaneflex import load, shipped_scenes, simulate, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.solve import error_estimates

PAGE = Path(__file__).parent.parent / "docs" / "accuracy.md"
MODELS = {
    "unchanged": (),
    "rigid": ("solve.preset=rigid",),
    "quasistatic": ("solve.preset=quasistatic",),
    "linear": ("solve.preset=linear",),
    "stiffened, 2 modes": ("solve.preset=stiffened", "solve.modes=2"),
    "stiffened, 2 elements": ("solve.preset=stiffened", "ELEMENTS=2"),
    "stiffened, tolerance 1e-3": ("solve.preset=stiffened", "solve.tolerance=1e-3"),
    "stiffened, a quarter of the steps": ("solve.preset=stiffened", "solve.integrator=radau", "STEPS/4"),
}
COUPLED_SCENES = (
    "engine", "four-bar", "quick-return", "rotating-cantilever", "six-bar", "slider-crank-150", "spin-up",
    "two-link-arm", "elastic-double-pendulum", "elastic-pendulum", "engine-torque-elastic", "four-bar-motor",
    "spin-up-torque", "spatial-slider-crank-elastic",
)  # fmt: skip
COUPLED_MODELS = {
    "coupled": ("solve.preset=coupled",),
    "coupled, 1 mode": ("solve.preset=coupled", "solve.modes=1"),
    "coupled, 2 elements": ("solve.preset=coupled", "solve.modes=2", "ELEMENTS=2"),
    "coupled, tolerance 1e-5": ("solve.preset=coupled", "solve.tolerance=1e-5", "STEPS/8"),
    "rigid": ("solve.preset=rigid",),
    "quasistatic": ("solve.preset=quasistatic",),
    "linear": ("solve.preset=linear",),
    "stiffened": ("solve.preset=stiffened",),
}
COLUMNS = (
    "scene", "model", "number of sensors", "largest error, share of the peak", "effectivity: least", "median",
    "greatest",
)  # fmt: skip
PAGE_TEXT = """# Accuracy of results

Every run [estimates the error](scene/solve.md#error-estimates) of its sensors. *Effectivity* is the largest estimate
of a sensor divided by its largest true error: 1 is exact, above 1 is safe.

Tables as CSV: [one-way](data/accuracy.csv), [coupled](data/accuracy-coupled.csv)

## One-way presets

The reference is preset `stiffened` with four times the elements, all modes, and four times the steps by `radau`. The
table does not include sensors whose error is below ten times that of the reference or below 1e-6 of their peak, nor
quasi-static runs of scenes that start from rest. For `linear` the greatest effectivity is that of a sensor of
`pulsating-strut`, whose error is overestimated.

{one_way}
## Preset coupled

The table contains runs under `coupled`, and one-way runs with `solve.errors = "all"`. The reference is `coupled` with
four times the elements and steps, 12 modes per link (6 in space) and 1/300 of the tolerance. The error of the reference
is estimated as a quarter of its change when elements and modes are halved. Sensors whose error is below ten times this
value are left out.

{coupled}
Made by `python tests/bench_accuracy.py [coupled]`; do not edit.
"""


def page() -> str:
    """The text of docs/accuracy.md, of the tables in docs/data."""
    tables = {"one_way": "accuracy", "coupled": "accuracy-coupled"}
    filled = {key: by_model(csv_tables.read(name)) + "\n" + csv_tables.shown(name) for key, name in tables.items()}
    return PAGE_TEXT.format(**filled)


def by_model(rows):
    """A short table over all scenes."""
    text = f"| model | effectivity: least | median | greatest |\n{'|---' * 4}|\n"
    for model in dict.fromkeys(row[1] for row in rows):
        found = [row for row in rows if row[1] == model and row[2].isdigit()]
        least, medians, greatest = ([float(row[k]) for row in found] for k in (4, 5, 6))
        numbers = (min(least), statistics.median(medians), max(greatest))
        text += f"| {model} | {' | '.join(f'{number:.2f}' for number in numbers)} |\n"
    return text


def settings_of(scene, model):
    elements = [name for name, body in scene.bodies.items() if body.elastic]
    steps = load(scene).options.steps
    for setting in model:
        if setting.startswith("ELEMENTS="):
            yield from (f"bodies.{name}.beam.elements={setting.partition('=')[2]}" for name in elements)
        elif setting.startswith("STEPS/"):
            fewer = steps // int(setting.partition("/")[2])
            yield f"solve.steps={next(n for n in range(fewer, 0, -1) if steps % n == 0)}"  # at instants of the finest
        else:
            yield setting


def solved(scene, settings):
    return simulate(load(with_settings(scene, list(settings))))


def finest(scene):
    """The reference's solution."""
    elements = {name: 4 * body.beam.elements for name, body in scene.bodies.items() if body.elastic}
    steps = 4 * load(scene).options.steps
    fine = [f"bodies.{name}.beam.elements={count}" for name, count in elements.items()]
    return solved(scene, ["solve.preset=stiffened", "solve.modes=all", "solve.integrator=radau",
                          f"solve.steps={steps}", *fine])  # fmt: skip


def rows(name):
    """A row for each model of a scene whose error is estimated."""
    scene = kaneflex.read_scene(name)
    options = load(scene).options
    elastic = any(body.elastic for body in scene.bodies.values())
    if not elastic or options.dynamics != "dynamic" or load(scene).module.FREE:
        return
    reason = solved(scene, ()).errors[1]
    if reason:
        yield [f"`{name}`", "unchanged", "-", "-", "-", "-", reason]
        return
    truth = finest(scene)
    own, _ = truth.errors
    if truth.outcome is not Outcome.COMPLETED:
        yield [f"`{name}`", "-", "-", "-", "-", "-", f"its finest model: {truth.message}"]
        return
    for label, model in MODELS.items():
        if (label == "quasistatic" and scene.solve.start == "zero") or (label == "rigid" and scene.is_frame):
            continue
        found = solved(scene, settings_of(scene, model))
        yield from row(name, label, found, truth, {sensor: estimate.total for sensor, estimate in own.items()})


def row(name, label, found, truth, own):
    """A run's estimates beside a truth that is itself off by ``own`` in each sensor; nothing where none counts."""
    estimates, reason = found.errors
    if reason:
        yield [f"`{name}`", label, "-", "-", "-", "-", reason]
        return
    every = round((len(truth.times) - 1) / (len(found.times) - 1))
    ratios, largest = [], 0.0
    for sensor, estimate in estimates.items():
        expected = truth.series[sensor].values[::every]
        size = abs(truth.series[sensor].values).max()
        error = abs(found.series[sensor].values - expected).max()
        if size and error > max(1e-6 * size, 10.0 * own.get(sensor, 0.0)):
            ratios.append(estimate.total / error)
            largest = max(largest, error / size)
    if ratios:
        numbers = (min(ratios), statistics.median(ratios), max(ratios))
        shown = (f"{number:.2f}" for number in numbers)
        yield [f"`{name}`", label, str(len(ratios)), f"{largest:.1e}", *shown]


def coupled_rows(name):
    """A row for each coupled model of a scene, and for each one-way model beside it."""
    if name not in COUPLED_SCENES:
        return
    scene = kaneflex.read_scene(name)
    coupled = load(with_settings(scene, ["solve.preset=coupled"]))
    modes = 6 if scene.is_spatial else 12
    truth, half = (
        solved(scene, ["solve.preset=coupled", f"solve.modes={modes // (4 // times)}", f"solve.steps={steps}",
                       f"solve.tolerance={max(coupled.options.tolerance / 300, 1e-13)}",
                       *(f"bodies.{each}.beam.elements={times * body.beam.elements}"
                         for each, body in scene.bodies.items() if body.elastic)])
        for times, steps in ((4, 4 * coupled.options.steps), (2, 4 * coupled.options.steps))
    )  # fmt: skip
    own = {sensor: abs(truth.series[sensor].values - half.series[sensor].values).max() / 4 for sensor in scene.sensors}
    free, one_way = coupled.module.FREE, scene.solve.preset != "coupled" or name == "elastic-double-pendulum"
    for label, model in COUPLED_MODELS.items():
        slow = label == "quasistatic" and (free or scene.solve.start == "zero")
        if not slow and (one_way or label.startswith("coupled")):
            errors = "quick" if label.startswith("coupled") else "all"  # all parts of coupled ones take three runs
            settings = [*settings_of(scene, model), f"solve.errors={errors}"]
            yield from row(name, label, solved(scene, settings), truth, own)


def table(rows_of, names, kept=()):
    """The rows of all shipped scenes, of those not named as they were."""
    lines = []
    for name in shipped_scenes():
        for row in rows_of(name) if name in names else [row for row in kept if row[0] == f"`{name}`"]:
            print(*row, sep=" | ", flush=True)
            lines.append(row)
    return lines


def main() -> None:
    asked, names = sys.argv[1:], shipped_scenes()
    error_estimates.LONGEST = math.inf
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if not {*asked} <= {"coupled"}:
            csv_tables.write("accuracy", COLUMNS, table(rows, asked, csv_tables.read("accuracy")))
        elif not asked:
            csv_tables.write("accuracy", COLUMNS, table(rows, names))
        if "coupled" in asked or not asked:
            csv_tables.write("accuracy-coupled", COLUMNS, table(coupled_rows, names))
        PAGE.write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
