"""Precompiled kernels of an installation, so that its first runs need no compilation.

Each function is shipped twice: as machine code, used if the processor has the same instructions as the one that made
it, and as LLVM bitcode of the optimised function, which depends on the platform only. On other processors machine
code is made from the bitcode, in a tenth of the compile time. numba caches either as if it had compiled the function.

An archive is for one platform and for the versions of Python, numba and llvmlite in its name, and contains a digest
of its sources. If anything differs, or without an archive, as in a checkout, functions are compiled.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1]
_SOURCES = "sources"
"""Member of an archive that holds the digest of its sources."""
_LOG = logging.getLogger(__name__)


def use() -> None:
    """Make numba search the archive before it compiles kaneflex's functions; without a matching archive do nothing."""
    if _archive_here().is_file():
        _look_here()


@contextmanager
def recording(archive: Path) -> Iterator[None]:
    """Store kaneflex's functions that are compiled within the block in a new archive; numba's cache must be empty."""
    from numba.core.caching import FunctionCache
    from numba.core.serialize import dumps

    save = FunctionCache._save_overload
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_LZMA) as kept:

        def save_here_too(self, sig, result) -> None:
            save(self, sig, result)
            if _ours(self) and self._impl.check_cachable(result):
                (name, _, (machine, shared)), *rest = result._reduce()
                whole = result.library.serialize_using_bitcode()[-1]
                # the last part of numba's tuple are the processor's instructions: its name only tunes the machine code
                parts = name, result.codegen.magic_tuple()[-1], machine, whole, shared, rest
                kept.writestr(_key(self, sig, result.codegen), dumps(parts))

        FunctionCache._save_overload = save_here_too
        try:
            yield
        finally:
            FunctionCache._save_overload = save
            kept.writestr(_SOURCES, _sources())


@cache
def archive_name() -> str:
    """Name of the archive for this platform and these versions."""
    import llvmlite
    import numba
    from llvmlite.binding import get_process_triple

    python = f"py{sys.version_info.major}{sys.version_info.minor}"
    return f"kernels-{get_process_triple()}-{python}-numba{numba.__version__}-llvmlite{llvmlite.__version__}.zip"


def _archive_here() -> Path:
    return PACKAGE / "support" / archive_name()


@cache
def _look_here() -> None:
    """Read and install the archive, once per process."""
    from numba.core.caching import FunctionCache

    load = FunctionCache._load_overload

    def load_or_make(self, sig, context):
        found = load(self, sig, context)
        if found is None and self._enabled and _ours(self):
            found = _made(self, sig, context)
        return found

    FunctionCache._load_overload = load_or_make


def _made(kept: Any, sig: Any, context: Any) -> Any:
    """Shipped function, stored in numba's cache; None if it was not shipped or can't be read."""
    from llvmlite.binding import parse_bitcode

    codegen = context.codegen()
    try:
        archive = _open()
        name = _key(kept, sig, codegen)
        if archive is None or name not in archive.NameToInfo:
            return None
        library, instructions, machine, whole, shared, rest = pickle.loads(archive.read(name))
        if instructions != codegen.magic_tuple()[-1]:
            machine = codegen._tm.emit_object(parse_bitcode(whole))
        payload = ((library, "object", (machine, shared)), *rest)
        found = kept._impl.rebuild(context, payload)
        kept._impl.locator.ensure_cache_path()
        kept._cache_file.save(kept._index_key(sig, codegen), payload)
    except Exception as error:  # a damaged archive, or an error of LLVM: compile instead
        _LOG.info("%s is compiled, since its precompiled form can't be used: %s", kept._name, error)
        return None
    return found


@cache
def _open() -> zipfile.ZipFile | None:
    """Archive, if it was made from these sources."""
    archive = zipfile.ZipFile(_archive_here())
    return archive if archive.read(_SOURCES) == _sources() else None


def _sources() -> bytes:
    """Digest of all modules of the package."""
    digest = hashlib.sha256()
    for path in sorted(PACKAGE.rglob("*.py")):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest().encode()


def _ours(kept: Any) -> bool:
    return kept._py_func.__module__.startswith("kaneflex.")


def _key(kept: Any, sig: Any, codegen: Any) -> str:
    """Name of a function with its closure values and argument types."""
    function, enclosed = kept._py_func, kept._index_key(sig, codegen)[-1]
    said = "\0".join((function.__module__, function.__qualname__, str(sig), *enclosed))
    return hashlib.sha256(said.encode()).hexdigest()
