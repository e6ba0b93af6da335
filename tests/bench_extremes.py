"""The extremes suite in full: ``make extremes`` writes ``docs/extremes.md`` and its picture; minutes, with progress."""

from __future__ import annotations

import argparse
import sys
import tempfile
from itertools import product
from pathlib import Path

import csv_tables
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

Scenes with extreme speeds, stiffnesses and step sizes are compared with closed forms, scaling laws or limits.

Table as CSV: [extremes](data/extremes.csv)

## Results by method

The columns are presets; `radau`, `newmark`, `generalised-alpha` and `gauss` are integrators of `stiffened`. A number is
the error relative to the largest expected value. An error in brackets is larger than the case allows; the run then
warns. A word is the outcome of the run. A dash means that the case was not run. `gauss` was run only for forces and
accelerations.

![Errors and outcomes of every case](pictures/extremes.png)

"""
RULES = """
## Conclusions

- **Slow motions** (a step covers thousands of vibration periods) and **stiff links next to soft ones**: use `radau`
  or `generalised-alpha`, which work down to 1e-9 rpm. `gauss` and `newmark` find no periodic motion.
- **Forces and accelerations** may contain unresolved vibrations. `radau` and `generalised-alpha` damp them; with
  `gauss` and `newmark` a run warns.
- **`coupled` at low speed**: forces and accelerations are accurate to 6e-4 down to 0.001 rpm.
- **Compression beyond buckling**: `stiffened` diverges, with a warning that states the buckling load. `linear` does
  not show buckling. `coupled` gives correct results.
- **Excited vibrations with periods shorter than a step**: only `exact-modal` (preset `paper`) stays accurate; other
  runs warn.
- **Elements**: rounding errors grow with about the fourth power of the number of elements, to 5e-4 with 1024.
- **Dead centres**: positions are accurate even if the rod is longer than the crank by only a part in 10^9.
"""
CYCLES_HEAD = f"""
## A million cycles

The table shows the solution of $\\ddot z + z = 0$ over {CYCLES:,} cycles of {STEPS} steps: the change of the amplitude,
the phase error per cycle, and the part of the final phase error that is due to rounding.

| integrator | amplitude | phase in a cycle [rad] | rounding [rad] |
|---|---|---|---|
"""
SINGLE_HEAD = """
## Kernels in single precision

Largest difference between the generated kernels in float32 and in float64, relative to the largest entry:

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


def table(cases: list[Case], found: dict[tuple[Case, str], Ending]) -> str:
    """Write the table of all cases; returns the text that shows it."""
    rows = [
        [case.group, case.name, f"{case.within:.0e}" if case.within else "-",
         *(cell(case, method, found.get((case, method))) for method in METHODS)]
        for case in cases
    ]  # fmt: skip
    return csv_tables.write("extremes", ["group", "case", "within", *METHODS], rows)


def draw(cases: list[Case], found: dict[tuple[Case, str], Ending], path: Path) -> None:
    """Every case a row, every method a column: the colour is the error, a word the outcome."""
    values = np.full((len(cases), len(METHODS)), np.nan)
    with styled():
        page = new_figure(10.5, 0.2 * len(cases) + 1.5, "Error or outcome of every case")
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
    text = f"| scene | {' | '.join(kernels)} |\n{'|---' * (len(kernels) + 1)}|\n"
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
    text = HEAD + table(cases, found) + RULES + CYCLES_HEAD + drifts() + SINGLE_HEAD + single_precisions() + FOOT
    asked.output.write_text(text, encoding="utf-8", newline="\n")
    picture = asked.output.parent / PICTURE
    picture.parent.mkdir(exist_ok=True)
    draw(cases, found, picture)


if __name__ == "__main__":
    main()
