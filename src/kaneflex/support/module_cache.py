"""Private cache folder of the modules that kaneflex derived for the user.

A module is code. It is imported only if nobody else can write the folder and the file, and if its text matches the
digest at its end. Modified or incomplete files are regenerated.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import stat
import tempfile
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from kaneflex.support.contract import FORMAT
from kaneflex.support.files import write_bytes
from kaneflex.support.terminal import log_warning

_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_SEAL = re.compile(rb"\n# sha256 ([0-9a-f]{64})\n\Z")


def cache_folder() -> Path:
    """Folder of the modules that kaneflex derived for the user, one for each state of the generator.

    Made private if missing; replaced by a temporary folder if it can't be written or belongs to another user.
    """
    import platformdirs

    root = Path(platformdirs.user_cache_dir("kaneflex", appauthor=False))
    name = f"format-{FORMAT}-{_generator()}"
    reason = _why_not(root) or _why_not(root / name)
    return root / name if reason is None else _temporary(str(root), reason) / name


def _why_not(folder: Path) -> str | None:
    """Make an own folder private; return the reason if that fails."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.stat()
        if not _ours(found):
            return "it belongs to another user"
        if found.st_mode & _OTHERS:
            folder.chmod(0o700)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        return error.strerror or str(error)
    return None


def _ours(found: os.stat_result) -> bool:
    return not hasattr(os, "getuid") or found.st_uid == os.getuid()


@cache
def _temporary(root: str, reason: str) -> Path:
    folder = Path(tempfile.mkdtemp(prefix="kaneflex-modules-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    log_warning(
        f"derived equations can't be kept in {root} ({reason}), so every run derives them again; "
        "set XDG_CACHE_HOME to a writable folder of your own"
    )
    return folder


@cache
def _generator() -> str:
    """Digest of the generator's sources, of the packages that it reads a scene with, and of the modules that
    generated modules import."""
    return _digest(*(f"kaneflex.{room}" for room in ("derive", "generated", "mechanism", "scene", "support")))[:12]


@cache
def sources_digest() -> str:
    """Digest of all sources of kaneflex, so that results of different states are not combined."""
    return _digest("kaneflex", "kaneflex.derive", "kaneflex.generated")[:16]


def _digest(*packages: str) -> str:
    digest = hashlib.sha256()
    for package in packages:
        folder = Path(find_spec(package).origin).parent
        for source in sorted(folder.rglob("*.py")):
            digest.update(f"{package}/{source.relative_to(folder).as_posix()}\0".encode())
            digest.update(source.read_bytes())
    return digest.hexdigest()


def sealed(text: str) -> bytes:
    """Text of a module with its digest appended."""
    data = text.encode()
    return data + f"\n# sha256 {hashlib.sha256(data).hexdigest()}\n".encode()


def is_sealed(data: bytes) -> bool:
    """True if a module's text matches its digest."""
    found = _SEAL.search(data)
    return found is not None and hashlib.sha256(data[: found.start()]).hexdigest().encode() == found[1]


def keep(path: Path, data: bytes) -> None:
    """Write a file that only its owner may read and write."""
    write_bytes(path, data, mode=0o600)


def kept(path: Path) -> bytes | None:
    """Cached module; None unless it exists, belongs to the user and matches its digest."""
    try:
        with path.open("rb") as file:
            found, data = os.fstat(file.fileno()), file.read()
    except OSError:
        return None
    return data if _ours(found) and not found.st_mode & _OTHERS and is_sealed(data) else None
