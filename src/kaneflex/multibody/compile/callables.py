"""Functions of the compiled engine as Python calls them, and kernels as it calls these, by address.

numba is imported only where there is no C compiler, or no library yet.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from kaneflex.multibody.compile.entries import LIBRARIES, compiling, entries_of, sources
from kaneflex.multibody.model.layout import STRUCTURE_KERNELS, Kind
from kaneflex.support.c_library import address_by_numba, c_addresses

_C_TYPES = {"int64": ctypes.c_int64, "float64": ctypes.c_double, "boolean": ctypes.c_bool, "void": None}


class Library(NamedTuple):
    """Compiled functions by name, and whether a C compiler made them."""

    functions: Mapping[str, Callable[..., Any]]
    in_c: bool


@cache
def library(kind: Kind, integrates: bool = True) -> Library:
    """C functions of all entries by name, all compiled on the first call.

    Libraries of mechanisms with contacts, impacts, holds, elastic bodies in space or discontinuous loads have more
    functions. Of rigid bodies in space without ``integrates`` they are fewer, and compile faster.
    """
    integrates = integrates or kind is not Kind.RIGID_SPACE
    name, entries = kind.name.lower() if integrates else "prescribed", entries_of(kind, integrates)
    addresses = c_addresses(f"engine-{name}", sources(), lambda: _typed(kind, entries))
    in_c = bool(addresses)
    if not in_c:
        from kaneflex.multibody.compile import library as by_numba

        with compiling():
            addresses = by_numba.addresses((0,) * (1 + LIBRARIES.index((kind, integrates))))
    found: dict[str, Callable[..., Any]] = {}
    for (function, signature), address in zip(entries.items(), addresses, strict=True):
        returned, _, given = signature.partition("(")
        kinds: list[Any] = [_C_TYPES.get(each, ctypes.c_void_p) for each in given[:-1].split(", ")]
        found[function.rpartition(".")[2]] = ctypes.CFUNCTYPE(_C_TYPES[returned], *kinds)(address)
    return Library(found, in_c)


def _typed(kind: Kind, entries: Mapping[str, str]) -> list[tuple[Any, Sequence[Any]]]:
    """Entries with the types of their arguments."""
    from kaneflex.multibody.compile.mechanisms import HANDED, typed

    return [(function, of.args) for function, of in typed(entries, HANDED[kind]).items()]


def kernel_addresses(kernels: Sequence[Any], in_c: bool) -> list[int]:
    """Addresses of a structure's kernels for a library from a C compiler, or from numba.

    A library of C that came without a C compiler calls functions of numba's by C's conventions.
    """
    if in_c and (found := _kernels_in_c(kernels)):
        return found
    with compiling():
        pairs = zip(kernels, _signatures(), strict=True)
        return [(address_by_numba if in_c else _address)(each, of) for each, of in pairs]


def _kernels_in_c(kernels: Sequence[Any]) -> list[int]:
    """Addresses of kernels from a library of their own; they may be of several modules."""
    modules = dict.fromkeys(Path(each.py_func.__code__.co_filename) for each in kernels)
    parts = [Path(str(import_module(f"kaneflex.generated.{name}").__file__)) for name in ("laws", "tables")]
    pairs = lambda: [(each, of.args) for each, of in zip(kernels, _signatures(), strict=True)]  # noqa: E731
    return c_addresses("-".join(("kernels", *(each.stem for each in modules))), [*modules, *parts], pairs)


def _signatures() -> list[Any]:
    from numba import types

    return [eval(each, vars(types)) for each in STRUCTURE_KERNELS.values()]


def _address(kernel: Any, of: Any) -> int:
    """Address of a function that numba compiles, for other functions of numba's."""
    made = kernel.get_compile_result(of)
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)
