"""numba's decorator for generated kernels, which imports numba only when a kernel is compiled, and numba's cache folder
on machines where the usual folders can't be written.

Importing numba takes a fifth of a second. A run evaluates kernels over arrays, or has the C compiler compile them.
"""

from __future__ import annotations

import atexit
import functools
import importlib
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from types import FunctionType
from typing import Any

_LOCK = threading.RLock()
HERE = Path(__file__).parent / "__pycache__"


class Kernel:
    """A function that numba compiles when it is first called, or when another compiled function calls it."""

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        self.py_func, self._options = function, options
        functools.update_wrapper(self, function)

    @functools.cached_property
    def dispatcher(self) -> Any:
        """The function as numba compiles it."""
        with _LOCK:
            return _compiled(self.py_func, self._options)

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        return self.dispatcher(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # asked by copy, pickle and inspect
            raise AttributeError(name)
        return getattr(self.dispatcher, name)

    def __reduce__(self) -> Any:
        return self.dispatcher.__reduce__()

    @property
    def _numba_type_(self) -> Any:
        """The type by which other compiled functions call this one."""
        return self.dispatcher._numba_type_


def njit(**options: Any) -> Callable[[FunctionType], Any]:
    """numba's decorator, which imports numba only when the function has to be compiled."""

    def decorated(function: FunctionType) -> Any:
        within = "<locals>" in function.__qualname__  # one text, but another function each time
        return _compiled(function, options) if within else Kernel(function, options)

    return decorated


def _compiled(function: FunctionType, options: dict[str, Any]) -> Any:
    import numba

    importlib.import_module("kaneflex.support.inner")  # how kaneflex has numba compile
    return numba.njit(**options)(function)


@functools.cache
def ensure_cache_folder() -> Path:
    """Give numba a temporary cache folder if it would find none of its own, and warn.

    `@njit(cache=True)` raises RuntimeError ("no locator available") while a module is being *imported* where
    neither `NUMBA_CACHE_DIR`, nor the module's own `__pycache__`, nor the user's cache folder can be written
    (a read-only install used by an account without a home). numba tries the three in this order
    (numba.core.caching.CacheImpl), and so does this function; it must run before the first jitted module
    is imported. Returns the folder that will be used.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen and _writable(Path(chosen)):
        return Path(chosen)
    if _writable(HERE):
        return HERE
    import platformdirs  # imported here: an ordinary import needs only the two checks above

    user_wide = Path(platformdirs.user_cache_dir("numba", appauthor=False))
    if _writable(user_wide):
        return user_wide
    return _temporary_folder()


def _writable(folder: Path) -> bool:
    """True if a file can be made in `folder`; tries it, as numba does."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _temporary_folder() -> Path:
    # A new private folder rather than a known name in the shared one: cache files are code that numba runs.
    folder = Path(tempfile.mkdtemp(prefix="kaneflex-numba-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:  # it read the environment when it was imported
        sys.modules["numba"].config.CACHE_DIR = str(folder)
    from kaneflex.support.terminal import log_warning  # imported here, as above

    log_warning(
        "no folder for compiled kernels can be written, so every run compiles them again; "
        "set NUMBA_CACHE_DIR to a writable folder to keep them"
    )
    return folder
