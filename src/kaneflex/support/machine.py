"""Memory of the machine."""

from __future__ import annotations

import os


def installed() -> int | None:
    """The machine's memory [bytes], where the system tells it."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None


def gib(size: float) -> str:
    """A number of bytes as text."""
    return f"{size / 2**30:.3g} GiB"
