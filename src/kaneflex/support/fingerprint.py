"""What compiled code is made of, so that a cache of it can't go stale.

numba looks at the caller's file alone: a cached function that calls one of another file would keep the old callee after
that file was edited. The values that a function encloses are part of the key under which it is cached: one made of
other files encloses a number for their text, and every edit of them compiles it anew. (A default argument would be part
of the key, too, but numba's dispatcher takes all omitted whole numbers for the same type.)
"""

import zlib
from collections.abc import Callable
from functools import update_wrapper
from pathlib import Path
from types import CellType, FunctionType
from typing import Any


def made_of(*files: str) -> Callable[[Any], Any]:
    """A decorator, below numba's: the function encloses a number for the text of these files."""
    cell = CellType(zlib.crc32(b"".join(Path(file).read_bytes() for file in files)))

    def enclosing(function: FunctionType) -> FunctionType:
        code = function.__code__.replace(co_freevars=("made_of",))
        rest = (function.__globals__, function.__name__, function.__defaults__, (cell,))
        return update_wrapper(FunctionType(code, *rest), function)

    return enclosing
