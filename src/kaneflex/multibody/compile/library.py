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

from kaneflex.multibody.compile.entries import entries_of, sources
from kaneflex.multibody.compile.mechanisms import HANDED, typed
from kaneflex.multibody.compile.types import OUTER
from kaneflex.multibody.model.layout import Kind
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(*map(str, sources()))


def entered(entries: Mapping[Any, Any]) -> Any:
    """Intrinsic that returns the C addresses of compiled functions, given with their signatures."""

    @intrinsic
    def entered(typing):
        def read(context, builder, sig, args):
            found = []
            for function, of in entries.items():
                made = function.get_compile_result(of)
                context.active_code_library.add_linking_library(made.library)
                kind = context.get_value_type(FunctionType(of).ftype).pointee
                wrapper = cgutils.get_or_insert_function(builder.module, kind, made.fndesc.llvm_cfunc_wrapper_name)
                found.append(builder.ptrtoint(wrapper, context.get_value_type(int64)))
            return context.make_tuple(builder, sig.return_type, found)

        return UniTuple(int64, len(entries))(), read

    return entered


def _of(kind: Kind, integrates: bool = True) -> Any:
    return entered(typed(entries_of(kind, integrates), HANDED[kind]))


(
    _plain, _contacts, _impacts, _holds, _space, _rigid_space, _switched_space, _contact_space, _hold_space,
) = map(_of, Kind)  # fmt: skip
_prescribed = _of(Kind.RIGID_SPACE, False)


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_plain():
    return _plain()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_contacts():
    return _contacts()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_impacts():
    return _impacts()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_holds():
    return _holds()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_space():
    return _space()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_rigid_space():
    return _rigid_space()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_switched_space():
    return _switched_space()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_contact_space():
    return _contact_space()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_hold_space():
    return _hold_space()


@njit(cache=True, **OUTER)
@_made_of_parts
def addresses_prescribed():
    return _prescribed()
