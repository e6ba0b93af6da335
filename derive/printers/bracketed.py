"""Entries between brackets, and reads of numbers, broken over lines in the same way in all texts."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator, Sequence

LINE = 120
"""Characters of a line."""


def bracketed(opening: str, entries: Sequence[str], closing: str, width: int = LINE) -> str:
    """Entries on one line, or on as many lines of their own as they need; no entry is broken."""
    line = f"{opening}{', '.join(entries)}{closing}"
    if len(line) <= width:
        return line
    inside = textwrap.fill(
        ", ".join(entry.replace(" ", "\0") for entry in entries) + ",", width,
        initial_indent="    ", subsequent_indent="    ", break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
    return f"{opening}\n{inside}\n{closing}".replace("\0", " ")


def reads(numbers: Iterable[tuple[str, str]], width: int = LINE - 4) -> Iterator[str]:
    """Statements that read numbers, given by their names and places, six at once."""
    numbers = list(numbers)
    for first in range(0, len(numbers), 6):
        names, places = zip(*numbers[first : first + 6], strict=True)
        line = f"{', '.join(names)} = {', '.join(places)}"
        yield line if len(line) <= width else bracketed("(", names, f") = {', '.join(places)}", width)
