"""Addresses of the kernels of a structure and of its kinds of bodies, compiled if needed."""

from __future__ import annotations

import ctypes
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from numba.core import cgutils
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.extending import intrinsic
from numba.types import FunctionType, UniTuple, boolean, float64, int64, void

from kaneflex.multibody.model.layout import Handle

C_TYPES = {int64: ctypes.c_int64, float64: ctypes.c_double, boolean: ctypes.c_bool, void: None}


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


def entered(mechanism: Any, entries: Mapping[Any, Any]) -> Any:
    """Intrinsic that returns the C addresses of entries; ``mechanism``: the type of their first argument."""

    @intrinsic
    def entered(typing):
        def read(context, builder, sig, args):
            found = []
            for function, entry in entries.items():
                of = entry.return_type(mechanism, *entry.args[1:])
                made = function.get_compile_result(of)
                context.active_code_library.add_linking_library(made.library)
                kind = context.get_value_type(FunctionType(of).ftype).pointee
                wrapper = cgutils.get_or_insert_function(builder.module, kind, made.fndesc.llvm_cfunc_wrapper_name)
                found.append(builder.ptrtoint(wrapper, context.get_value_type(int64)))
            return context.make_tuple(builder, sig.return_type, found)

        return UniTuple(int64, len(entries))(), read

    return entered


def called(addresses: Any, entries: Mapping[Any, Any]) -> dict[Any, Callable[..., Any]]:
    """C functions of entries by the compiled function that returns their addresses."""
    with compiling():
        found = addresses()
    of_c: dict[Any, Callable[..., Any]] = {}
    for (function, signature), address in zip(entries.items(), found, strict=True):
        kinds: list[Any] = [C_TYPES.get(kind, ctypes.c_void_p) for kind in (signature.return_type, *signature.args)]
        of_c[function] = ctypes.CFUNCTYPE(*kinds)(address)
    return of_c
