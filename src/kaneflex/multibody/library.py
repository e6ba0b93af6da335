"""Library of the compiled engine's functions for Python, compiled once per machine and called by address.

Numba optimises a compiled function again within each function that contains it, so that several cached functions would
each compile the whole engine. Here a single function contains all entries and returns their addresses; arrays are
passed by address, so that a call takes a few microseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit

from kaneflex.generated import contact, friction, joints
from kaneflex.multibody import (
    acting,
    addresses,
    bending,
    bristles,
    change_points,
    closed_factors,
    coefficients,
    collocation,
    complementarity,
    contact_numbers,
    contact_search,
    contacts,
    dense_lu,
    dependents,
    hold_powers,
    holds,
    impulses,
    loops,
    powers,
    recursion,
    reduction,
    rigid_contacts,
    rigid_friction,
    rows,
    slopes,
    stand_ins,
    step_curve,
    sticking,
    switching,
    tables,
    tree,
    unfolding,
    yielding,
)  # fmt: skip
from kaneflex.multibody.addresses import called, entered
from kaneflex.multibody.tables import CONTACT_MECHANISM, HOLD_MECHANISM, MECHANISM, OUTER, Handed
from kaneflex.support import inner
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(
    acting.__file__, addresses.__file__, bending.__file__, bristles.__file__, change_points.__file__,
    closed_factors.__file__, coefficients.__file__, collocation.__file__, complementarity.__file__,
    contact.__file__, contact_numbers.__file__, contact_search.__file__, contacts.__file__, dense_lu.__file__,
    dependents.__file__, friction.__file__, hold_powers.__file__, holds.__file__, impulses.__file__, inner.__file__,
    joints.__file__, loops.__file__, powers.__file__, recursion.__file__, reduction.__file__,
    rigid_contacts.__file__, rigid_friction.__file__, rows.__file__, slopes.__file__, stand_ins.__file__,
    step_curve.__file__, sticking.__file__, switching.__file__, tables.__file__, tree.__file__, unfolding.__file__,
    yielding.__file__,
)  # fmt: skip
ENTRIES = collocation.ENTRIES | unfolding.ENTRIES | reduction.ENTRIES
_plain, _with_contacts, _with_holds = (
    entered(each, ENTRIES) for each in (MECHANISM, CONTACT_MECHANISM, HOLD_MECHANISM)
)


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses():
    return _plain()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_with_contacts():
    return _with_contacts()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_with_holds():
    return _with_holds()


_ENTERED = {
    MECHANISM: _addresses, CONTACT_MECHANISM: _addresses_with_contacts, HOLD_MECHANISM: _addresses_with_holds,
}  # fmt: skip


@cache
def library(mechanism: Handed) -> dict[Any, Callable[..., Any]]:
    """C functions of all entries, by their numba functions; all compiled on the first call.

    ``mechanism``: the argument type; those with contacts or holds have more functions.
    """
    return called(_ENTERED[mechanism], ENTRIES)
