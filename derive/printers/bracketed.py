"""Entries between brackets, broken over lines in the same way in all texts."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

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
