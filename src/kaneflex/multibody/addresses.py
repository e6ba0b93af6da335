"""Addresses of the kernels of a structure and of its kinds of bodies, compiled if needed."""

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
    """Silence numba's warning about first-class function types during compilation."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
        yield


@cache
def kernel_address(kernel: Any, of: FunctionType) -> int:
    """Address of a kernel for compiled code."""
    found = _compiled(kernel, of)
    return int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))


@cache
def kernel_of_c(kernel: Any, of: FunctionType) -> Callable[..., None]:
    """Kernel as a C function for Python: returns nothing and takes arrays by address."""
    found = _compiled(kernel, of)
    address = found.library.get_pointer_to_function(found.fndesc.llvm_cfunc_wrapper_name)
    kinds = [ctypes.c_double if kind == float64 else ctypes.c_int64 for kind in of.signature.args]
    return ctypes.CFUNCTYPE(None, *kinds)(address)


def _compiled(kernel: Any, of: FunctionType) -> Any:
    with compiling():
        return kernel.get_compile_result(of.signature)


def by_address(value: Any) -> Any:
    """Address of an array or handle; other values unchanged."""
    if isinstance(value, Handle):
        return value.address
    if not isinstance(value, np.ndarray):
        return value
    assert value.flags.c_contiguous
    if value.size and value.flags.writeable:
        return ctypes.addressof(ctypes.c_char.from_buffer(value.data))  # three times as fast as .ctypes.data
    return value.ctypes.data
