"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from kaneflex.errors import OutputError


def write_text(path: Path, text: str) -> None:
    """Write a text file by renaming a finished temporary one, so that no reader meets half of it.

    Raises
    ------
    OutputError
        If the file can't be written; it names the path and the reason.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
                file.write(text)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError(str(path), None, f"can't be written ({error.strerror})", "Choose a writable place") from error
