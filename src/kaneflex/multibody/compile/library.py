"""Library of the compiled engine's functions for Python, compiled once per machine and called by address.

Numba optimises a compiled function again within each function that contains it, so that several cached functions would
each compile the whole engine. Here a single function contains all entries and returns their addresses; arrays are
passed by address, so that a call takes a few microseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numba import njit
from numba.core import cgutils
from numba.extending import intrinsic
from numba.types import FunctionType, UniTuple, int64

from kaneflex.multibody.compile.entries import LIBRARIES, entries_of, sources
from kaneflex.multibody.compile.mechanisms import HANDED, typed
from kaneflex.multibody.compile.types import OUTER
from kaneflex.support.fingerprint import made_of


def entered(entries: Mapping[Any, Any]) -> Any:
    """Intrinsic that returns the C addresses of compiled functions, given with their signatures."""

    @intrinsic
    def entered(typing):
        return _returned(entries)

    return entered


def _returned(entries: Mapping[Any, Any], *given: Any) -> tuple[Any, Any]:
    """Signature and code of such an intrinsic with arguments of these types."""

    def read(context, builder, sig, args):
        found = []
        for function, of in entries.items():
            made = function.get_compile_result(of)
            context.active_code_library.add_linking_library(made.library)
            kind = context.get_value_type(FunctionType(of).ftype).pointee
            wrapper = cgutils.get_or_insert_function(builder.module, kind, made.fndesc.llvm_cfunc_wrapper_name)
            found.append(builder.ptrtoint(wrapper, context.get_value_type(int64)))
        return context.make_tuple(builder, sig.return_type, found)

    return UniTuple(int64, len(entries))(*given), read


@intrinsic
def _chosen(typing, number):
    kind, integrates = LIBRARIES[number.count - 1]
    return _returned(typed(entries_of(kind, integrates), HANDED[kind]), number)


@njit(cache=True, **OUTER)
@made_of(*map(str, sources()))
def addresses(number):
    """Addresses of all entries of a library, whose number is the length of a tuple, as types choose what is compiled.
    """
    return _chosen(number)
