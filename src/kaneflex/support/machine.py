"""Memory of the machine."""

from __future__ import annotations

import os


def installed() -> int | None:
    """Memory of the machine [bytes]; None if unknown."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return None


def gib(size: float) -> str:
    """Number of bytes as text in GiB."""
    return f"{size / 2**30:.3g} GiB"
