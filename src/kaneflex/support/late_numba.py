"""numba's decorator for generated kernels, which imports numba only when a kernel is compiled.

Importing numba takes a fifth of a second. A run evaluates kernels over arrays, or has the C compiler compile them.
"""

from __future__ import annotations

import functools
import importlib
import threading
from collections.abc import Callable
from types import FunctionType
from typing import Any

_LOCK = threading.RLock()


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
