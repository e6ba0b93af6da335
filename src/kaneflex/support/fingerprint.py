"""Fingerprints of source files in numba's cache keys, so that the cache of a compiled function can't go stale.

numba checks the caller's file only: a cached function that calls a function of another file would keep the old callee
after an edit of that file. Closure values are part of the cache key. A function made of other files therefore
encloses a number that depends on their text, and every edit of them compiles it again. (A default argument would be
part of the key, too, but numba's dispatcher gives all omitted integers the same type.)
"""

import zlib
from collections.abc import Callable
from functools import update_wrapper
from pathlib import Path
from types import CellType, FunctionType
from typing import Any


def made_of(*files: str) -> Callable[[Any], Any]:
    """Decorator, placed below numba's: the function encloses a number that depends on the text of these files."""
    cell = CellType(zlib.crc32(b"".join(Path(file).read_bytes() for file in files)))

    def enclosing(function: FunctionType) -> FunctionType:
        code = function.__code__.replace(co_freevars=("made_of",))
        rest = (function.__globals__, function.__name__, function.__defaults__, (cell,))
        found: Any = update_wrapper(FunctionType(code, *rest), function)
        found.parts = files
        return found

    return enclosing
