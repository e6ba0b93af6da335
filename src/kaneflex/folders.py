"""Folders that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from kaneflex.errors import OutputError


@contextmanager
def whole_folder(path: Path, mark: str, force: bool = False) -> Iterator[Path]:
    """A temporary folder beside ``path`` to write into, which becomes ``path`` when the block ends without an error.

    It is made at once, so that a place that can't be written is known before anything is computed. A block that
    raises leaves ``path`` as it was and nothing beside it.

    Parameters
    ----------
    path : Path
        The folder to be; missing parents are made.
    mark : str
        File by which an earlier folder of the same making is known: only such a one is replaced.
    force : bool
        Whether an existing folder may be replaced.

    Raises
    ------
    OutputError
        If ``path`` exists and may not be replaced, or can't be written.
    """
    path = path.resolve()
    with writing(path):
        _refuse_existing(path, mark, force)
    missing = [parent for parent in path.parents if not parent.exists()]
    partial = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with writing(path):
            partial.mkdir(parents=True)
        yield partial
        with writing(path):
            _replace(path, partial)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        for parent in missing:  # innermost first
            if parent.exists() and not any(parent.iterdir()):
                parent.rmdir()
        raise


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """What the system says against writing, as an OutputError that names ``path``."""
    try:
        yield
    except OSError as error:
        reason = f"can't be written ({error.strerror or error})"
        raise OutputError(str(path), None, reason, "Choose a writable place") from error


def _refuse_existing(path: Path, mark: str, force: bool) -> None:
    if not os.path.lexists(path):
        return
    entries = {entry.name for entry in path.iterdir()}
    if not entries:
        return
    if mark not in entries:
        reason = f"the folder holds other things and no {mark}: it is not replaced"
        raise OutputError(str(path), None, reason, "Choose another name")
    if not force:
        raise OutputError(str(path), None, "the folder exists", "Choose another name, or replace it with --force")


def _replace(path: Path, partial: Path) -> None:
    """``partial`` becomes ``path``; what stood there goes when the new one is in place."""
    if not path.exists():
        partial.rename(path)
        return
    old = partial.with_name(f"{partial.name}.old")
    path.rename(old)
    try:
        partial.rename(path)
    except BaseException:
        old.rename(path)
        raise
    shutil.rmtree(old)
