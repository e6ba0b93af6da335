"""What ``run --tolerance`` chooses compared with brute force: ``make bench-choice`` writes ``docs/choice-table.md``.

All times are processor time. Each scene has a process and a time limit of its own; one that fails leaves its reason.
The page is written after each case, so that an interrupted run keeps what it has measured. ``make bench-choice
CASES='engine "engine, 2000 rpm"'`` measures some cases anew and leaves the other rows as they are.
"""

from __future__ import annotations

import argparse
import datetime
import json
import platform
import random
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import csv_tables

from kaneflex import Scene, SceneError, read_scene, shipped_scenes, with_settings
from kaneflex.solve.summary_tables import Choice
from kaneflex.solve.variants import Variant
from kaneflex.study.runs import Runs, Timing, clock
from kaneflex.study.trade.candidates import candidates_of, check_request, neutral, neutral_settings
from kaneflex.study.trade.choice import choose
from kaneflex.study.trade.reference import KNOWN, Reference, denser, find_reference
from kaneflex.study.trade.trials import Trials
from kaneflex.support.files import write_text

PAGE = Path(__file__).parent.parent / "docs" / "choice-table.md"
TOLERANCES = (0.1, 0.01, 0.001, 0.0001)
ENGINE = ("mid_transverse", "tip_axial", "mid_global_x", "mid_global_y", "rod_mid_strain")
Case = tuple[str, tuple[str, ...], tuple[str, ...] | None]
"""Shipped scene, settings, sensors that count (all by default)."""
CASES: dict[str, Case] = {
    "engine": ("engine", (), None),
    "engine, deformation only": ("engine", (), ENGINE),
    "engine, 2000 rpm": ("engine", ("main.speed=2000 rpm",), ENGINE),
    "engine, 12000 rpm": ("engine", ("main.speed=12000 rpm",), ENGINE),
    "engine, 36000 rpm": ("engine", ("main.speed=36000 rpm",), ENGINE),
    "engine-transient": ("engine-transient", (), ENGINE),
    "engine-elastic-crank": ("engine-elastic-crank", (), ("mid_transverse", "tip_axial")),
    "spin-up": ("spin-up", (), None),
    "spin-up, 1 rad/s": ("spin-up", ("hub.speed=1 rad/s",), ("tip_transverse", "root_moment")),
    "rotating-cantilever": ("rotating-cantilever", (), None),
    "quick-return": ("quick-return", (), None),
    "slider-crank-150": ("slider-crank-150", (), ("mid_transverse",)),
    "pin-ended-cross": ("pin-ended-cross", (), None),
    "free-frame": ("free-frame", (), None),
    "pulsating-strut": ("pulsating-strut", (), None),
    "engine-rig": ("engine-rig", (), ("mid_transverse", "tip_axial")),
    "engine-paper": ("engine-paper", (), ("mid_transverse",)),
}
"""Name in the table -> case: first those with other settings or fewer sensors, then the other shipped scenes."""
RANDOM: dict[str, dict[str, tuple[float, str]]] = {
    "engine": {"main.speed": (4000, "rpm"), "rod.beam.I": (7008, "mm^4"), "piston.mass": (214, "g")},
    "engine-elastic-crank": {"main.speed": (3000, "rpm"), "piston.mass": (214, "g")},
    "four-bar": {"main.speed": (200, "rpm"), "masses.at_second.mass": (42, "g")},
    "four-bar-motor": {"masses.flywheel.inertia": (2e-3, "kg m^2"), "crank.mass": (31.6, "g")},
    "six-bar": {"main.speed": (300, "rpm"), "platform.mass": (300, "g")},
    "quick-return": {"main.speed": (120, "rpm"), "ram.mass": (5, "kg"), "lever.mass": (3, "kg")},
    "rotating-cantilever": {"shaft.speed": (20, "rad/s"), "push.value": (100, "mN")},
    "two-link-arm": {"masses.load.mass": (1, "kg"), "upper.beam.I": (26667, "mm^4")},
    "elastic-pendulum": {"strip.length": (1, "m"), "hinge.angle": (-20, "deg")},
    "spatial-slider-crank-elastic": {"shaft.speed": (500, "rpm"), "slider.mass": (200, "g")},
    "swept-blade": {"shaft.speed": (500, "rpm"), "push.value": (10, "mN")},
    "slider-crank-clearance": {"main.speed": (1500, "rpm"), "wrist.clearance.radial": (100, "um")},
}
"""Scenes with random numbers: entry -> number and unit, of which each case has a half to twice as much."""
SECONDS = 20.0
"""For the brute force of a scene: half of it for first runs, the rest for repeats; as much for repeats of the fastest,
of which there is one round at least."""
LIMIT = 600.0
NEAR = 1.3
"""Ratio of times up to which a chosen model is about as fast as the cheapest one."""
CLOSE = 5
"""Fastest models of each tolerance that are repeated with the chosen ones."""
HEAD = """# Choices compared with brute force

The table lists the model that [`kaneflex run --tolerance`](trade.md#by-a-tolerance) chooses, its largest error relative
to the finest converged reference, the fastest model that `kaneflex trade` finds within the tolerance (by brute force,
budget 20 s), and the ratio of their run times, in processor time. The time to choose includes the time to derive the
equations. `CASES` in `tests/bench_choice.py` lists the sensors that were considered. In rows *SCENE with ENTRY = ...*
numbers are random.

{outcome}

Table as CSV: [choices](data/choices.csv)

"""
TABLE = "choices"
COLUMNS = (
    "scene", "tolerance", "chosen", "error", "cheapest by brute force", "time, chosen / cheapest", "to choose [s]"
)  # fmt: skip
FOOT = """
{date}, {machine}, Python {python}. Made by `make bench-choice`; do not edit.
"""


def _other_cases() -> dict[str, Case]:
    """Shipped scenes that have several models, and the random ones: the same on every machine."""
    known = {scene for scene, settings, _ in CASES.values() if not settings}
    found: dict[str, Case] = {}
    for scene in shipped_scenes():
        with suppress(SceneError):  # rigid, or with modal data
            check_request(read_scene(scene), TOLERANCES[0], SECONDS, None)
            found |= {} if scene in known else {scene: (scene, (), None)}
    for scene, entries in RANDOM.items():
        draw = random.Random(scene).uniform
        settings = tuple(f"{path}={number * 2.0 ** draw(-1.0, 1.0):.3g} {unit}"
                         for path, (number, unit) in entries.items())  # fmt: skip
        found[f"{scene} with {', '.join(settings)}"] = (scene, settings, None)
    return found


CASES |= _other_cases()


def rows_of(case: str) -> list[list[str]]:
    """The table's rows of one case."""
    name, settings, sensors = CASES[case]
    scene = with_settings(read_scene(name), settings)
    choices, reasons = {}, {}
    for tolerance in TOLERANCES:
        try:
            choices[tolerance] = choose(scene, tolerance, sensors)
        except SceneError as error:
            reasons[tolerance] = error.reason
    rows: dict[float, list[str]] = {}
    rows |= {tolerance: _row(case, tolerance, reason, "", "", "", "") for tolerance, reason in reasons.items()}
    if choices:
        rows |= _beside_brute_force(case, scene, sensors, choices)
    return [rows[tolerance] for tolerance in TOLERANCES]


def _beside_brute_force(
    case: str, scene: Scene, sensors: tuple[str, ...] | None, choices: dict[float, Choice]
) -> dict[float, list[str]]:
    basis = neutral(scene)
    runs = Runs(basis)
    names, named = sensors or [*scene.sensors], sensors is not None
    references = {tolerance: find_reference(runs, names, tolerance, KNOWN, named) for tolerance in choices}
    finest = finest_of(runs, references)
    doubts = {**finest.doubts, **finest.open}
    trials = {  # of the sensors that are known at each tolerance
        tolerance: Trials(runs, tolerance, replace(finest, doubts={name: doubts[name] for name in own.doubts}))
        for tolerance, own in references.items()
    }
    candidates = [each for own in references.values() for each in candidates_of(basis, own.stored)]
    laid = len(neutral_settings(scene.raw))
    chosen = {tolerance: Variant(found.model, tuple(found.settings[laid:])) for tolerance, found in choices.items()}
    until = clock() + SECONDS / 2
    for candidate in dict.fromkeys((*chosen.values(), *candidates)):
        if clock() > until and candidate not in chosen.values():
            print(f"  no time for {candidate.name}", file=sys.stderr)
            continue
        for each in trials.values():
            each.within(candidate)
    there = [each.candidate for each in trials[min(choices)].tried.values() if each.differences]
    total = _medians(runs.repeats(there, clock() + SECONDS / 2))
    good = {of: [each for each in total if trials[of].tried[each].within] for of in chosen}
    # on a slow machine all have been repeated once: those between which a ratio decides are repeated together
    close = (each for found in good.values() for each in sorted(found, key=total.__getitem__)[:CLOSE])
    total |= _medians(runs.repeats([*dict.fromkeys((*chosen.values(), *close))], clock() + SECONDS))
    rows = {}
    for tolerance, candidate in chosen.items():
        differences = trials[tolerance].tried[candidate].differences
        error = max(each.error for each in differences if each.sensor in choices[tolerance].sensors)
        best = min(good[tolerance], key=total.__getitem__, default=candidate)
        rows[tolerance] = _row(
            case, tolerance, candidate.name, f"{100 * error:.2g} %", best.name,
            f"{total[candidate] / total[best]:.2f}", f"{choices[tolerance].seconds:.1f}",
        )  # fmt: skip
    return rows


def finest_of(runs: Runs, references: Mapping[float, Reference]) -> Reference:
    """Finest of the references by tolerance; straight lines between the instants of each sensor are as close as the
    least tolerance at which it is known requires."""
    levels = {tolerance: own.levels.index(own.model) for tolerance, own in references.items()}
    finest = references[max(references, key=lambda tolerance: (levels[tolerance], -tolerance))]
    run, least = runs.run(finest.model), dict[str, float]()
    for tolerance in sorted(references, reverse=True):
        least |= dict.fromkeys(references[tolerance].doubts, tolerance)
    limits = {name: tolerance / 2 * abs(run.curves.values[name]).max() for name, tolerance in least.items()}
    return replace(finest, curves=denser(run, limits, [*finest.doubts, *finest.open]))


def _medians(repeats: Mapping[Variant, Sequence[Timing]]) -> dict[Variant, float]:
    """Median time of the runs of each model [s]."""
    return {each: sorted(timing.total for timing in found)[len(found) // 2] for each, found in repeats.items()}


def _row(case: str, tolerance: float, *cells: str) -> list[str]:
    return [case, f"{100 * tolerance:g} %", *cells]


def outcome_of(rows: list[list[str]]) -> str:
    """Chosen models within their tolerances, and the largest ratio of run times."""
    chosen = [row for row in rows if row[5]]
    within = sum(float(row[3].split()[0]) <= float(row[1].split()[0]) for row in chosen)
    ratios = [float(row[5]) for row in chosen]
    close = sum(ratio <= NEAR for ratio in ratios)
    return (
        f"Of {len(chosen)} chosen models {within} are within their tolerance. {close} of them take at most {NEAR:g} "
        f"times as long as\nthe cheapest model, all at most {max(ratios, default=1.0):.2f} times. In "
        f"{len(rows) - len(chosen)} cases no model is chosen, for the reason in the\ntable."
    )


def rows_in_a_process(case: str) -> list[list[str]]:
    """The rows of a case, by a process of its own, or a row with the reason why there are none."""
    command = [sys.executable, __file__, "--one", case]
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return [[case, "", f"not within {LIMIT:.0f} s", "", "", "", ""]]
    if done.returncode:
        return [[case, "", f"failed, exit code {done.returncode}", "", "", "", ""]]
    return json.loads(done.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"of {', '.join(CASES)}; all by default")
    parser.add_argument("--one", metavar="CASE", help="the rows of one case as JSON, in this process")
    arguments = parser.parse_args()
    if arguments.one:
        print(json.dumps(rows_of(arguments.one)))
        return
    started, there = time.perf_counter(), csv_tables.read(TABLE)
    rows = {case: [row for row in there if row[0] == case] for case in CASES}
    if unknown := [case for case in arguments.cases if case not in CASES]:
        parser.error(f"unknown: {', '.join(unknown)}")
    for case in arguments.cases or CASES:
        print(f"{time.perf_counter() - started:6.0f} s  {case}", file=sys.stderr)
        rows[case] = rows_in_a_process(case)
        print("\n".join(map(" | ".join, rows[case])), file=sys.stderr)
        foot = FOOT.format(date=datetime.date.today(), machine=platform.machine(), python=platform.python_version())
        found = [row for case in CASES for row in rows[case]]
        write_text(PAGE, HEAD.format(outcome=outcome_of(found)) + csv_tables.write(TABLE, COLUMNS, found) + foot)


if __name__ == "__main__":
    main()
