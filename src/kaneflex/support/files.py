"""Reading of files that a user names, and atomic writing of files and folders."""

from __future__ import annotations

import os
import re
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from kaneflex.support.errors import Fault, OutputError

LARGEST_FILE = 64 * 2**20
"""Largest size of a scene, a table or an unpacked archive of arrays [bytes]."""
_MIB = 2**20
_JUST_NOW = 2.0
"""Time within which a new folder gets its lock [s]."""
LONGEST_STEM = 50
"""Letters of a scene's name in a file name: at most four bytes each, of 255 bytes for a name."""


def file_stem(name: str) -> str:
    """Scene's name as the beginning of a file name: letters, digits and "._- ", no path and not hidden.

    Letters that the file system cannot encode are left out.
    """
    known = name.encode(sys.getfilesystemencoding(), "replace").decode(sys.getfilesystemencoding())
    plain = "".join(letter if letter.isalnum() or letter in "._- " else "_" for letter in known)
    return plain.strip(". ")[:LONGEST_STEM] or "scene"


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
    with writing(path):
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


@contextmanager
def whole_folder(path: Path, mark: str, force: bool = False) -> Iterator[Path]:
    """Temporary folder next to ``path`` to write into; it becomes ``path`` when the block ends without an error.

    It is made at once, so that a place that can't be written is known before anything is computed. After an error
    ``path`` is unchanged and the temporary folder removed. Folders of killed processes are removed, too.

    Parameters
    ----------
    path : Path
        Final folder; missing parents are made.
    mark : str
        File that identifies an earlier folder of the same kind; only such a folder is replaced.
    force : bool
        Whether an existing folder may be replaced.

    Raises
    ------
    OutputError
        If ``path`` exists and may not be replaced, or can't be written.
    """
    path = path.resolve()
    _remove_abandoned(path)
    with writing(path):
        _refuse_existing(path, mark, force)
    missing = [parent for parent in path.parents if not parent.exists()]
    partial, lock = path.with_name(f".{path.name}.{os.urandom(4).hex()}"), None
    try:
        with writing(path):
            partial.mkdir(parents=True)
            lock = _locked(partial)
        yield partial
        with writing(path):
            _replace(path, partial)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        for parent in missing:  # innermost first
            if parent.exists() and not any(parent.iterdir()):
                parent.rmdir()
        raise
    finally:
        if lock is not None:
            os.close(lock)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn OSError into an OutputError that names ``path``."""
    try:
        yield
    except OSError as error:
        reason = f"can't be written ({error.strerror or error})"
        raise OutputError(str(path), None, reason, "Choose a writable place") from error


def _locked(folder: Path) -> int | None:
    """Lock on a folder, released by the system when this process ends; None if another process has it.

    Windows has no locks on folders.
    """
    if sys.platform == "win32":
        return None
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle


def _remove_abandoned(path: Path) -> None:
    """Remove unfinished folders of ended processes next to ``path``; restore a folder that was not replaced.

    A new folder may not be locked yet; it is left for the next time.
    """
    known = re.compile(rf"\.{re.escape(path.name)}\.[0-9a-f]{{8}}(\.old)?")
    for folder in [entry for entry in path.parent.glob(".*") if known.fullmatch(entry.name)]:
        new = folder.with_suffix("") if folder.suffix == ".old" else folder
        with suppress(OSError):
            made = time.time() - folder.stat().st_mtime
            lock = _locked(new if new.exists() else folder) if made > _JUST_NOW else None
            if lock is None:
                continue
            if folder is not new and not path.exists():
                folder.rename(path)
            else:
                shutil.rmtree(folder, ignore_errors=True)
            os.close(lock)


def _refuse_existing(path: Path, mark: str, force: bool) -> None:
    if not os.path.lexists(path):
        return
    entries = {entry.name for entry in path.iterdir()}
    if not entries:
        return
    if mark not in entries:
        reason = f"the folder holds other files and no {mark}, so it is not replaced"
        raise OutputError(str(path), None, reason, "Choose another name")
    if not force:
        raise OutputError(str(path), None, "the folder exists", "Choose another name, or replace it with --force")


def _replace(path: Path, partial: Path) -> None:
    """Rename ``partial`` to ``path``; then remove the earlier folder."""
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
    shutil.rmtree(old, ignore_errors=True)


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
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise Fault(f"not a text in UTF-8, from line {line} on", "Save it as UTF-8, or give another file") from None
    except OSError as error:
        raise Fault(f"cannot be read: {error}", "Give a readable UTF-8 file") from None
