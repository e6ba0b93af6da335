"""Library of the compiled engine's functions for Python, compiled once per machine and called by address.

Numba optimises a compiled function again within each function that contains it, so that several cached functions would
each compile the whole engine. Here a single function contains all entries and returns their addresses; arrays are
passed by address, so that a call takes a few microseconds.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from numba import njit

from kaneflex.generated import body, contact, friction, joints, spatial, spatial_shapes
from kaneflex.multibody.compile.addresses import called, entered
from kaneflex.multibody.dynamics import independent_speeds, reduction, unfolding
from kaneflex.multibody.dynamics.spatial_entries import ENTRIES as SPATIAL_ENTRIES
from kaneflex.multibody.dynamics.spatial_entries import PRESCRIBED_ENTRIES
from kaneflex.multibody.model import layout
from kaneflex.multibody.model.layout import (
    CONTACT_MECHANISM,
    CONTACT_SPACE,
    HOLD_MECHANISM,
    HOLD_SPACE,
    IMPACT_MECHANISM,
    IMPACT_SPACE,
    MECHANISM,
    OUTER,
    RIGID_SPACE,
    SPACE,
    SWITCHED_SPACE,
    Handed,
)
from kaneflex.multibody.time import collocation
from kaneflex.support import inner
from kaneflex.support.fingerprint import made_of


def sources() -> list[str]:
    """Files of the engine's compiled functions."""
    multibody = Path(layout.__file__).parents[1]
    files = [each for name in ("compile", "dynamics", "time", "unilateral") for each in (multibody / name).glob("*.py")]
    compiled = (str(each) for each in files if b"numba" in each.read_bytes())
    generated = (each.__file__ for each in (body, contact, friction, joints, spatial, spatial_shapes))
    return sorted([*compiled, *generated, inner.__file__, *map(str, (multibody / "model").glob("*layout.py"))])


_made_of_parts = made_of(*sources())
PLANE = 3
"""D of a mechanism in the plane."""
ENTRIES = collocation.ENTRIES | unfolding.ENTRIES | reduction.ENTRIES | independent_speeds.ENTRIES
_plain, _with_contacts, _with_impacts, _with_holds = (
    entered(each, ENTRIES) for each in (MECHANISM, CONTACT_MECHANISM, IMPACT_MECHANISM, HOLD_MECHANISM)
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
def _addresses_with_impacts():
    return _with_impacts()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_with_holds():
    return _with_holds()


_ENTERED = {
    MECHANISM: _addresses, CONTACT_MECHANISM: _addresses_with_contacts, IMPACT_MECHANISM: _addresses_with_impacts,
    HOLD_MECHANISM: _addresses_with_holds,
}  # fmt: skip

_prescribed, _integrated, _switched_prescribed, _switched = (
    entered(space, entries)
    for space in (RIGID_SPACE, SWITCHED_SPACE)
    for entries in (PRESCRIBED_ENTRIES, SPATIAL_ENTRIES)
)
_elastic, _contacts_in_space, _impacts_in_space, _holds_in_space = (
    entered(space, SPATIAL_ENTRIES) for space in (SPACE, CONTACT_SPACE, IMPACT_SPACE, HOLD_SPACE)
)


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_prescribed():
    return _prescribed()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_in_space():
    return _integrated()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_elastic():
    return _elastic()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_contacts_in_space():
    return _contacts_in_space()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_impacts_in_space():
    return _impacts_in_space()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_holds_in_space():
    return _holds_in_space()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_switched_prescribed():
    return _switched_prescribed()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_switched():
    return _switched()


_ENTERED_IN_SPACE = {
    (RIGID_SPACE, False): _addresses_of_prescribed, (RIGID_SPACE, True): _addresses_in_space,
    (SPACE, True): _addresses_of_elastic, (CONTACT_SPACE, True): _addresses_of_contacts_in_space,
    (IMPACT_SPACE, True): _addresses_of_impacts_in_space, (HOLD_SPACE, True): _addresses_of_holds_in_space,
    (SWITCHED_SPACE, False): _addresses_of_switched_prescribed, (SWITCHED_SPACE, True): _addresses_of_switched,
}  # fmt: skip


@cache
def library(mechanism: Handed, integrates: bool = True) -> dict[Any, Callable[..., Any]]:
    """C functions of all entries, by their numba functions; all compiled on the first call.

    ``mechanism``: the argument type; those with contacts, impacts, holds, elastic bodies in space or discontinuous
    loads have more functions. In space without ``integrates`` they are fewer, and compile faster.
    """
    if mechanism.d == PLANE:
        return called(_ENTERED[mechanism], ENTRIES)
    return called(_ENTERED_IN_SPACE[mechanism, integrates], SPATIAL_ENTRIES if integrates else PRESCRIBED_ENTRIES)
