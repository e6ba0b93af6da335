"""Files that a user names: found and bounded before they are read, or refused by a Fault."""

from __future__ import annotations

import stat
from pathlib import Path

from kaneflex.support.errors import Fault

LARGEST_FILE = 64 * 2**20
"""Bytes of a scene or a table at most, and of what an archive of arrays unpacks to."""
_MIB = 2**20


def is_file(path: Path) -> bool:
    """Whether there is a regular file; no for a name that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long for a name; a zero byte
        return False


def beside(folder: Path, name: str) -> Path:
    """The absolute path of a file named relative to `folder`; as it stands where there can be no such file."""
    try:
        return (folder / name).resolve()
    except (OSError, ValueError, RuntimeError):  # reading it says why
        return folder / name


def check_file(path: Path, largest: int = LARGEST_FILE) -> None:
    """Raise Fault unless a path leads to a regular file of so many bytes at most.

    A pipe would be waited for, and a device read, without end. FileNotFoundError passes through.
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
    """Raise Fault if a file has more than so many bytes."""
    if size > largest:
        raise Fault(f"holds {size / _MIB:.0f} MiB, more than {largest / _MIB:.0f} MiB", "Give a smaller file")


def read_text(path: Path) -> str:
    """The text of a UTF-8 file, without its byte-order mark. Raises Fault; FileNotFoundError passes through."""
    check_file(path)
    try:
        return path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise Fault(f"cannot be read: {error}", "Give a readable UTF-8 file") from None
