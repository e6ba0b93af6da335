"""Tables of measured numbers: files in docs/data, which the site shows on the pages that name them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

DOCS = Path(__file__).parent.parent / "docs"


def write(name: str, head: Sequence[str], rows: Sequence[Sequence[str]], docs: Path = DOCS) -> str:
    """Write docs/data/NAME.csv; returns the text that shows it on a page of docs."""
    file = docs / "data" / f"{name}.csv"
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream, lineterminator="\n").writerows([head, *rows])
    return shown(name)


def shown(name: str) -> str:
    return f"```{{measured}} {name}\n```\n"


def read(name: str, docs: Path = DOCS) -> list[list[str]]:
    """The table's rows below its head; empty where it was never written."""
    file = docs / "data" / f"{name}.csv"
    if not file.exists():
        return []
    with file.open(encoding="utf-8", newline="") as stream:
        return list(csv.reader(stream))[1:]
