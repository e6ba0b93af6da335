"""Rows to docs/benchmarks.json, and from there to the page, its tables and the picture.

Sections that are measured anew replace what was there, the others stay as they were, each with its date and machine.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import ModuleType

import csv_tables

from bench.interleave import Spread
from bench.machine import describe
from bench.picture import draw
from bench.rows import Row, Target
from kaneflex.support.files import write_text

HEAD = """# Benchmarks

kaneflex, hand-written C and other programs run in turn, in several rounds. Times are medians over the rounds, with
quartiles; ratios are medians of the ratios in each round. The column *target* shows the required value and, in
brackets, the desired value, with the result: *met* (the required value is reached), *exceeded* (the desired value is
reached) or *missed*. All runs except the sweeps use one thread.

Tables as CSV: [latency](data/benchmarks-latency.csv), [kernels](data/benchmarks-kernels.csv),
[exudyn](data/benchmarks-exudyn.csv), [precision](data/benchmarks-precision.csv),
[ivp](data/benchmarks-ivp.csv), [impacts](data/benchmarks-impacts.csv),
[scaling](data/benchmarks-scaling.csv), [sweeps](data/benchmarks-sweeps.csv)

![Kernels, whole runs, scaling and latency](pictures/benchmarks.png)
"""
FOOT = """
Made by `make bench`, for some sections by `make bench SECTIONS="kernels latency"`; do not edit. `make setup
EXTRAS=peer,bench` installs the other programs. The numbers are in [benchmarks.json](benchmarks.json).
"""
DATA = "benchmarks.json"
COLUMNS = ("task", "with", "median", "quartiles", "ratio", "target", "notes")
RATIO_TO = {
    "latency": "the reference computation", "kernels": "C, kaneflex", "scaling": "newmark",
    "sweeps": "one process, gauss",
}  # fmt: skip
"""References of the ratios in sections in which it is not kaneflex."""


@dataclass(frozen=True)
class Section:
    """Rows that were measured together, and where."""

    machine: Mapping[str, str]
    rows: tuple[Row, ...]

    @classmethod
    def read(cls, stored: Mapping) -> Section:
        rows = []
        for row in stored["rows"]:
            time = None if row["time"] is None else Spread(**row["time"])
            target = None if row["target"] is None else Target(**row["target"])
            rows.append(Row(**(row | {"time": time, "target": target})))
        return cls(stored["machine"], tuple(rows))


def read(docs: Path) -> dict[str, dict]:
    """Stored sections by name."""
    path = docs / DATA
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def store(docs: Path, name: str, rows: Iterable[Row]) -> None:
    """Put a section's rows in the place of those that were there."""
    stored = read(docs) | {name: asdict(Section(describe(), tuple(rows)))}
    write_text(docs / DATA, json.dumps(stored, indent=1) + "\n")


def show(docs: Path, modules: Mapping[str, ModuleType]) -> None:
    """Write the page and the picture of what is stored, in the order of the sections' ``modules``."""
    sections = sections_of(docs, modules)
    for name, section in sections.items():
        head, *rows = table(section.rows, f"ratio to {RATIO_TO.get(name, 'kaneflex')}")
        csv_tables.write(f"benchmarks-{name}", head, rows, docs)
    write_text(docs / "benchmarks.md", page(sections, modules))
    draw({name: section.rows for name, section in sections.items()}, docs / "pictures" / "benchmarks.png")


def sections_of(docs: Path, modules: Mapping[str, ModuleType]) -> dict[str, Section]:
    stored = read(docs)
    return {name: Section.read(stored[name]) for name in modules if name in stored}


def page(sections: Mapping[str, Section], modules: Mapping[str, ModuleType]) -> str:
    parts = [HEAD]
    for name in sections:
        module = modules[name]
        parts.append(f"\n## {module.TITLE}\n\n{module.ABOUT}\n\n{csv_tables.shown(f'benchmarks-{name}')}")
    return "".join(parts) + f"\n## Where and when\n\n{machines(sections, modules)}\n" + FOOT


def machines(sections: Mapping[str, Section], modules: Mapping[str, ModuleType]) -> str:
    """A line of shared properties, then one for each day and machine with its sections."""
    described = [set(section.machine.items()) for section in sections.values()]
    common = set.intersection(*described) if described else set()
    titles: dict[str, list[str]] = {}
    for name, section in sections.items():
        where = ", ".join(f"{key} {value}" for key, value in section.machine.items() if (key, value) not in common)
        titles.setdefault(where, []).append(modules[name].TITLE)
    first = next(iter(sections.values()), None)
    shared = [f"{key} {value}" for key, value in first.machine.items() if (key, value) in common] if first else []
    lines = [f"- {', '.join(names)}: {where}" for where, names in titles.items()]
    return "\n".join([f"- All: {', '.join(shared)}", *lines])


def table(rows: Iterable[Row], ratio: str = "ratio") -> list[list[str]]:
    """Head and rows as text, with a heading of the ratios; a column that is empty throughout is left out."""
    lines = [cells(row) for row in rows]
    head = [ratio if column == "ratio" else column for column in COLUMNS]
    used = [k for k in range(len(COLUMNS)) if any(line[k] for line in lines)]
    return [[line[k] for k in used] for line in (head, *lines)]


def cells(row: Row) -> tuple[str, ...]:
    if row.time is None:
        return (row.task, row.candidate, row.missing, "", "", target_of(row), row.differs)
    time = row.time
    scale, unit = (1.0, row.unit) if row.unit else unit_of(time.median)
    quartiles = f"{scale * time.low:.3g} to {scale * time.high:.3g}" if time.low < time.high else ""
    digits = ".0f" if time.median * scale >= 1000 else ".3g"
    ratio = "" if row.ratio is None else f"{row.ratio:.3g}"
    median = f"{scale * time.median:{digits}} {unit}"
    return (row.task, row.candidate, median, quartiles, ratio, target_of(row), row.differs)


def target_of(row: Row) -> str:
    """Like "<= 1.15 (0.9): met"; without a verdict where nothing was measured."""
    if row.target is None:
        return ""
    reach, *dream = (limit_of(row, limit) for limit in (row.target.reach, row.target.dream) if limit is not None)
    hoped = f" ({dream[0]})" if dream else ""
    verdict = {"dream": "exceeded"}.get(row.verdict() or "", row.verdict())
    return f"{'>=' if row.target.at_least else '<='} {reach}{hoped}{f': {verdict}' if verdict else ''}"


def limit_of(row: Row, limit: float) -> str:
    if not row.of_time:
        return f"{limit:g}"
    scale, unit = (1.0, row.unit) if row.unit else unit_of(limit)
    return f"{scale * limit:.{4 if row.unit else 3}g} {unit}"


def unit_of(seconds: float) -> tuple[float, str]:
    """Factor and unit in which a time is read at ease."""
    return next(((scale, unit) for scale, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")) if seconds * scale >= 1.0),
                (1e9, "ns"))  # fmt: skip
