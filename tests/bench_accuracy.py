"""The plus-minus of runs beside their true errors, into ``docs/accuracy.md``: ``python tests/bench_accuracy.py``.

The truth is the scene's own finest model: preset stiffened with four times the elements, all modes, four times the
steps by radau. What it is off by itself is estimated, too, and sensors that a run has to ten times that are left out.
"""

import statistics
import warnings
from pathlib import Path

import numpy as np

import kaneflex
from kaneflex import load, simulate
from kaneflex.integrate.outcome import Outcome
from kaneflex.scene import shipped_scenes, with_settings

PAGE = Path(__file__).parent.parent / "docs" / "accuracy.md"
MODELS = {
    "as it is": (),
    "rigid": ("solve.preset=rigid",),
    "quasistatic": ("solve.preset=quasistatic",),
    "linear": ("solve.preset=linear",),
    "stiffened, 2 modes": ("solve.preset=stiffened", "solve.modes=2"),
    "stiffened, 2 elements": ("solve.preset=stiffened", "ELEMENTS=2"),
    "stiffened, tolerance 1e-3": ("solve.preset=stiffened", "solve.tolerance=1e-3"),
    "stiffened, a quarter of the steps": ("solve.preset=stiffened", "solve.integrator=radau", "STEPS/4"),
}
HEAD = """# What a run is off by

Every periodic run of a one-way preset says what its sensors may be off by: [how](scene.md#what-a-run-is-off-by). Here
is that beside the true error, measured against the scene's finest model (preset `stiffened`, four times the elements,
all modes, four times the steps by `radau`). *Effectivity* is the estimate over the true error, each the largest over
the cycle: 1 is exact, above 1 safe. Sensors whose error is below ten times that of the finest model, or below 1e-6 of
their peak, are left out. `python tests/bench_accuracy.py` writes this page.

| scene | model | sensors | largest error, share of the peak | effectivity: least | median | greatest |
| --- | --- | --- | --- | --- | --- | --- |
"""


def settings_of(scene, model):
    elements = [name for name, body in scene.bodies.items() if body.elastic]
    steps = load(scene).options.steps
    for setting in model:
        if setting.startswith("ELEMENTS="):
            yield from (f"bodies.{name}.beam.elements={setting.partition('=')[2]}" for name in elements)
        elif setting.startswith("STEPS/"):
            yield f"solve.steps={steps // int(setting.partition('/')[2])}"
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
    """A row for each model of a scene whose motion is periodic and whose error is estimated."""
    scene = kaneflex.read_scene(name)
    options = load(scene).options
    elastic = any(body.elastic for body in scene.bodies.values())
    if not elastic or scene.solve.start != "periodic" or not options.cycles or options.dynamics != "dynamic":
        return
    reason = solved(scene, ()).errors[1]
    if reason:
        yield f"| `{name}` | as it is | - | - | - | - | {reason} |"
        return
    truth = finest(scene)
    own, _ = truth.errors
    if truth.outcome is not Outcome.COMPLETED:
        yield f"| `{name}` | - | - | - | - | - | its finest model: {truth.message} |"
        return
    for label, model in MODELS.items():
        found = solved(scene, settings_of(scene, model))
        estimates, reason = found.errors
        if reason:
            yield f"| `{name}` | {label} | - | - | - | - | {reason} |"
            continue
        every = round((len(truth.times) - 1) / (len(found.times) - 1))
        ratios, largest = [], 0.0
        for sensor, estimate in estimates.items():
            expected = truth.series[sensor].values[::every]
            size = abs(truth.series[sensor].values).max()
            error = abs(found.series[sensor].values - expected).max()
            if size and error > max(1e-6 * size, 10.0 * own[sensor].total if own else 0.0):
                ratios.append(estimate.total / error)
                largest = max(largest, error / size)
        if ratios:
            numbers = (min(ratios), statistics.median(ratios), max(ratios))
            shown = " | ".join(f"{number:.2f}" for number in numbers)
            yield f"| `{name}` | {label} | {len(ratios)} | {largest:.1e} | {shown} |"


def main() -> None:
    lines = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in shipped_scenes():
            for row in rows(name):
                print(row, flush=True)
                lines.append(row)
    PAGE.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
