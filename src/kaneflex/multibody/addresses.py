"""Kernels of a structure and of its kinds of bodies by their addresses, compiled where they are not yet."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.types import FunctionType, float64

from kaneflex.multibody.tables import Handle


@contextmanager
def compiling() -> Iterator[None]:
    """While numba compiles what takes functions: their types are used without a word."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
        yield


@cache
def kernel_address(kernel: Any, of: FunctionType) -> int:
    """Where compiled code finds a kernel."""
    found = _compiled(kernel, of)
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))


@cache
def kernel_of_c(kernel: Any, of: FunctionType) -> Callable[..., None]:
    """The same machine code as Python calls it, which returns nothing and takes arrays by their addresses."""
    found = _compiled(kernel, of)
    address = found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name)
    kinds = [ctypes.c_double if kind == float64 else ctypes.c_int64 for kind in of.signature.args]
    return ctypes.CFUNCTYPE(None, *kinds)(address)


def _compiled(kernel: Any, of: FunctionType) -> Any:
    with compiling():
        return kernel.get_compile_result(of.signature)


def by_address(value: Any) -> Any:
    """What an array or a handle is handed over by; anything else is as it is."""
    if isinstance(value, Handle):
        return value.address
    if not isinstance(value, np.ndarray):
        return value
    assert value.flags.c_contiguous
    if value.size and value.flags.writeable:
        return ctypes.addressof(ctypes.c_char.from_buffer(value.data))  # in a third of the time that .ctypes.data takes
    return value.ctypes.data
