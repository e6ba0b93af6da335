"""Cache folder for numba's compiled kernels on machines where the usual folders can't be written."""

import atexit
import os
import shutil
import sys
import tempfile
from functools import cache
from pathlib import Path

HERE = Path(__file__).parent / "__pycache__"


@cache
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
