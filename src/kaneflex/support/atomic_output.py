"""Atomic writing of files."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from kaneflex.support.errors import OutputError


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically; see `write_bytes`."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, data: bytes, mode: int | None = None) -> None:
    """Write a file by renaming a finished temporary file, so that no reader finds half of it.

    ``mode`` holds the permission bits; by default those of the user's new files.

    Raises
    ------
    OutputError
        If the file can't be written; it names the path and the reason.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
            # a temporary file is private to the user, the written one need not be
            os.chmod(temporary, 0o666 & ~_umask() if mode is None else mode)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(str(path), None, f"can't be written ({error.strerror})", "Choose a writable place") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def refuse_existing(path: Path, force: bool, example: str) -> None:
    """Raise OutputError for a folder, and unless ``force`` for an existing file; ``example`` is a valid name."""
    if path.is_dir():
        raise OutputError(str(path), None, "is a folder", f"Give the name of a file, like {example}")
    if path.exists() and not force:
        raise OutputError(str(path), None, "the file exists", "Choose another name, or replace it with --force")
