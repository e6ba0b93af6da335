"""The extremes suite in full: ``make extremes`` writes ``docs/extremes.md`` and its picture; minutes, with progress."""

from __future__ import annotations

import argparse
import sys
import tempfile
from itertools import product
from pathlib import Path

import numpy as np
from extreme_cases import CASES, spike_cases
from extreme_numerics import ANGLE_OF_A_STEP, drift, single_precision
from extremes import METHODS, Case, Ending, attempt, judge

from kaneflex.plots.style import new_figure, styled

PAGE = Path(__file__).parent.parent / "docs" / "extremes.md"
PICTURE = Path("pictures") / "extremes.png"
CYCLES, STEPS = 1_000_000, 64
SINGLE = ("engine", "rotating-cantilever")
HEAD = """# Extremes

What is left of a result where a scene is driven to its limits. Each case has an expectation from elsewhere: a closed
form, a law of scaling, a limit. It ends in one of three ways, and in no other: within its stated accuracy, with a
warning, or in a named outcome or refusal that says the reason and the cure. `tests/test_extremes.py` runs the short
form with the other tests, `make extremes` the full one, which writes this page.

- [Which method survives what](#which-method-survives-what), [what to take from it](#what-to-take-from-it)
- [A million cycles](#a-million-cycles), [kernels in single precision](#kernels-in-single-precision)

## Which method survives what

Columns are presets; `radau`, `newmark`, `generalised-alpha` and `gauss` are the integrators of `stiffened`. A number
is the error relative to the largest expected value; one in brackets is beyond the case's accuracy, and the run says why
in a warning. A word is the named end. A dash: the method isn't meant for the case, or, for `gauss`, that its
displacements are as good as those of `radau`, and no forces are asked for.

![Errors and named ends of every case](pictures/extremes.png)
"""
RULES = """
## What to take from it

- **Speeds that are slow beside the vibrations**, steps of thousands of their periods: `radau` and `generalised-alpha`
  go down to 1e-9 rpm, as `quasistatic` does. Integrators without damping of their own, `gauss` and `newmark`, leave
  multipliers of one, which rounding then decides: no periodic state is found, and the message says so.
- **Stiff beside soft links**: the same holds of the stiff link's frequencies.
- **Forces and accelerations**: what an integrator without damping leaves of vibrations that its steps don't resolve is
  too small to be seen in displacements, but counts at its stiffness in accelerations, joint and section forces. `radau`
  and `generalised-alpha` extinguish it; a run by `gauss` or `newmark` warns where its forces by the equations of motion
  and by the change of velocities part. What many steps add up, as where vibrations from rest lose a little in each, no
  single one shows: where it could matter, the run is repeated in half steps, and a warning says by how much they part.
- **`coupled` at speeds that are slow beside the vibrations**: forces are right, but a vibration within the tolerance,
  1e-9 m at thousands of hertz, is as large as the slow accelerations of 60 rpm; a run at a tenth of the tolerance shows
  it, and a warning says so. At start `quasistatic` it has no cell: those cases compare one-way
  presets.
- **Compression beyond buckling**, as by a piston of 1e8 kg: `stiffened` diverges, since its axial forces are those of
  the rigid mechanism, and a warning names the buckling load; `linear` doesn't know of it, `coupled` goes through.
- **Steps beyond the periods**: nothing grows without bounds, a warning names the steps that would do, and only
  `exact-modal`, of preset `paper`, is still right.
- **Elements**: rounding grows with about the fourth power of their number, to 1e-4 on 1024.
- **Dead centres**: what happens there in a fraction of a step is named; the dead centre itself is refused.
- **`coupled`** lengthens its steps as vibrations die, and so goes down to some 0.01 rpm; far below, rounding decides
  about the steps, and a cycle takes millions.
"""
CYCLES_HEAD = f"""
## A million cycles

z'' + z = 0 from rest at one, {CYCLES:,} cycles of {STEPS} steps: amplitude gained, phase lost in a cycle, and what of
the phase after all of them the method's own rational function does not explain.

| integrator | amplitude | phase in a cycle [rad] | unexplained [rad] |
| --- | --- | --- | --- |
"""
SINGLE_HEAD = """
## Kernels in single precision

The generated kernels fill whatever they are given. Largest difference of float32 from float64, over the largest
entry:

"""
FOOT = "\nMade by `make extremes`; do not edit.\n"


def cell(case: Case, method: str, ending: Ending | None) -> str:
    """A table's cell; raises AssertionError where a case ends otherwise than it states."""
    if ending is None:
        return "-"
    fault = judge(case, method, ending)
    assert not fault, f"{case}, {method}: {fault}"
    if ending.error is None:
        return ending.outcome.replace("_", " ")
    if case.within == 0.0:
        return "runs"
    return f"{ending.error:.0e}" if ending.error <= case.within else f"({ending.error:.0e})"


def endings(cases: list[Case]) -> dict[tuple[Case, str], Ending]:
    """Every case by every method that it names."""
    found = {}
    for k, case in enumerate(cases):
        for method in case.methods:
            print(f"{k + 1:3d} of {len(cases)}  {case}, {method}", file=sys.stderr, flush=True)
            found[case, method] = attempt(case, method)
    return found


def tables(cases: list[Case], found: dict[tuple[Case, str], Ending]) -> str:
    """One table a group, in the order of the cases."""
    text = ""
    for group in dict.fromkeys(case.group for case in cases):
        text += f"\n### {group.capitalize()}\n\n| case | within | {' | '.join(METHODS)} |\n"
        text += "| --- " * (len(METHODS) + 2) + "|\n"
        for case in cases:
            if case.group == group:
                cells = [cell(case, method, found.get((case, method))) for method in METHODS]
                text += f"| {case.name} | {f'{case.within:.0e}' if case.within else '-'} | {' | '.join(cells)} |\n"
    return text


def draw(cases: list[Case], found: dict[tuple[Case, str], Ending], path: Path) -> None:
    """Every case a row, every method a column: the colour is the error, a word how it ended."""
    values = np.full((len(cases), len(METHODS)), np.nan)
    with styled():
        page = new_figure(10.5, 0.2 * len(cases) + 1.5, "Error of every case, or how it ends")
        axes = page.subplots()
        for (row, case), (column, method) in product(enumerate(cases), enumerate(METHODS)):
            ending = found.get((case, method))
            if ending is None:
                continue
            if ending.error is None:
                axes.text(column, row, ending.outcome.replace("_", " "), ha="center", va="center", fontsize=5.5)
            elif case.within:
                values[row, column] = np.log10(np.clip(ending.error, 1e-16, 1.0))
            else:
                axes.text(column, row, "runs", ha="center", va="center", fontsize=5.5)
        shown = axes.imshow(values, aspect="auto", cmap="viridis_r", vmin=-12, vmax=0)
        axes.grid(False)
        axes.set_xticks(range(len(METHODS)), METHODS, rotation=30, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(len(cases)), [str(case) for case in cases], fontsize=6)
        page.colorbar(shown, ax=axes, label="log10 of the error", shrink=0.5)
        page.savefig(path, dpi=120)


def drifts() -> str:
    """Rows of the table of a million cycles."""
    rows = ""
    for method in ANGLE_OF_A_STEP:
        print(f"{CYCLES:,} cycles of {method}", file=sys.stderr, flush=True)
        amplitude, phase, unexplained = drift(method, CYCLES, STEPS)
        assert abs(amplitude) < 1e-6 and unexplained < 1e-6, f"{method}: {amplitude:g}, {unexplained:g}"
        rows += f"| {method} | {amplitude:.0e} | {phase:.1e} | {unexplained:.0e} |\n"
    return rows


def single_precisions() -> str:
    """The table of kernels in single precision."""
    found = {scene: single_precision(scene) for scene in SINGLE}
    kernels = list(next(iter(found.values())))
    text = f"| scene | {' | '.join(kernels)} |\n{'| --- ' * (len(kernels) + 1)}|\n"
    for scene, errors in found.items():
        text += f"| {scene} | {' | '.join(f'{errors[name]:.0e}' for name in kernels)} |\n"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=PAGE, help="file to write; the picture goes beside it")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        cases = [*CASES, *spike_cases(Path(folder))]
        found = endings(cases)
    text = HEAD + tables(cases, found) + RULES + CYCLES_HEAD + drifts() + SINGLE_HEAD + single_precisions() + FOOT
    asked.output.write_text(text, encoding="utf-8", newline="\n")
    picture = asked.output.parent / PICTURE
    picture.parent.mkdir(exist_ok=True)
    draw(cases, found, picture)


if __name__ == "__main__":
    main()
