"""Reading of files that a user names; existence and size are checked first. Raises Fault."""

from __future__ import annotations

import stat
from pathlib import Path

from kaneflex.support.errors import Fault

LARGEST_FILE = 64 * 2**20
"""Largest size of a scene, a table or an unpacked archive of arrays [bytes]."""
_MIB = 2**20


def is_file(path: Path) -> bool:
    """True for a regular file; False also for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long for a name; a zero byte
        return False


def beside(folder: Path, name: str) -> Path:
    """Absolute path of a file named relative to `folder`; unchanged if no such file can exist."""
    try:
        return (folder / name).resolve()
    except (OSError, ValueError, RuntimeError):  # reading it gives the reason
        return folder / name


def check_file(path: Path, largest: int = LARGEST_FILE) -> None:
    """Raise Fault unless a path leads to a regular file of at most this many bytes.

    Reading a pipe or a device might never end. FileNotFoundError passes through.
    """
    try:
        found = path.stat()
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise Fault(f"cannot be read: {reason}", "Give the path of a readable file") from None
    if not stat.S_ISREG(found.st_mode):
        kind = "a folder" if stat.S_ISDIR(found.st_mode) else "a pipe or a device"
        raise Fault(f"cannot be read: it is {kind}", "Give the path of a file")
    check_size(found.st_size, largest)


def check_size(size: int, largest: int = LARGEST_FILE) -> None:
    """Raise Fault if a file has more than this many bytes."""
    if size > largest:
        raise Fault(f"has {size / _MIB:.0f} MiB, the limit is {largest / _MIB:.0f} MiB", "Give a smaller file")


def read_text(path: Path) -> str:
    """Text of a UTF-8 file, without its byte-order mark. Raises Fault; FileNotFoundError passes through."""
    check_file(path)
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise Fault(f"cannot be read: {error}", "Give a readable UTF-8 file") from None
