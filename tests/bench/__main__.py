"""``python -m bench [SECTION ...]``: measure, and write docs/benchmarks.json, its page and its picture."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from bench import exudyn_runs, impacts, ivp_runs, kernels, latency, precision, quick, report, scaling, sweeps
from bench.rows import Row

DOCS = Path(__file__).parents[2] / "docs"
SECTIONS = {
    "latency": latency,
    "kernels": kernels,
    "exudyn": exudyn_runs,
    "precision": precision,
    "ivp": ivp_runs,
    "impacts": impacts,
    "scaling": scaling,
    "sweeps": sweeps,
}


def shown(rows: Iterable[Row]) -> list[Row]:
    """All rows, each printed as it comes."""
    found = []
    for row in rows:
        found.append(row)
        task, candidate, median, quartiles, ratio, target, _ = report.cells(row)
        print(f"  {task:34} {candidate:26} {median:>8} {quartiles:>16} {ratio:>7}  {target}", flush=True)
    return found


def main(arguments: Sequence[str] | None = None) -> int:
    """The exit code. Each section is written when it is finished, so that an interruption loses one at most."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"{', '.join(SECTIONS)}; by default all")
    parser.add_argument("--quick", action="store_true", help="check loose ratios of the kernels, write nothing")
    parser.add_argument("--page", action="store_true", help="measure nothing, write page and picture anew")
    parser.add_argument("-o", "--output", type=Path, default=DOCS, metavar="DIR", help="where to write")
    asked = parser.parse_args(arguments)
    unknown = [name for name in asked.sections if name not in SECTIONS]
    if unknown:
        parser.error(f"no section {unknown[0]!r}: there are {', '.join(SECTIONS)}")
    if asked.quick:
        wrong = quick.broken(shown(quick.rows()))
        print("\n".join(wrong) or "all ratios are within their bounds")
        return int(bool(wrong))
    if asked.page:
        report.show(asked.output, SECTIONS)
        return 0
    try:
        for name in asked.sections or SECTIONS:
            started = time.perf_counter()
            print(f"{name}: {SECTIONS[name].TITLE}", flush=True)
            report.store(asked.output, name, shown(SECTIONS[name].rows()))
            report.show(asked.output, SECTIONS)
            print(f"  {time.perf_counter() - started:.0f} s", flush=True)
    except KeyboardInterrupt:
        print(f"interrupted; finished sections are in {asked.output}", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
