"""Library of the compiled engine's functions in space, see :mod:`kaneflex.multibody.compile.library`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit

from kaneflex.multibody.compile.addresses import called, entered
from kaneflex.multibody.compile.library import sources
from kaneflex.multibody.dynamics.spatial_entries import ENTRIES, PRESCRIBED_ENTRIES
from kaneflex.multibody.model.layout import OUTER, RIGID_SPACE, SPACE, SWITCHED_SPACE, Handed
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(*sources())
_prescribed, _integrated, _switched_prescribed, _switched = (
    entered(space, entries) for space in (RIGID_SPACE, SWITCHED_SPACE) for entries in (PRESCRIBED_ENTRIES, ENTRIES)
)
_elastic = entered(SPACE, ENTRIES)


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_prescribed():
    return _prescribed()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses():
    return _integrated()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_elastic():
    return _elastic()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_switched_prescribed():
    return _switched_prescribed()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_switched():
    return _switched()


_ENTERED = {
    (RIGID_SPACE, False): _addresses_of_prescribed, (RIGID_SPACE, True): _addresses,
    (SPACE, True): _addresses_of_elastic,
    (SWITCHED_SPACE, False): _addresses_of_switched_prescribed, (SWITCHED_SPACE, True): _addresses_of_switched,
}  # fmt: skip


@cache
def library(space: Handed, integrates: bool) -> dict[Any, Callable[..., Any]]:
    """C functions of all entries, by their numba functions; without ``integrates`` they are fewer, and compile faster.

    ``space``: the argument type; mechanisms with elastic bodies or discontinuous loads have more functions.
    """
    return called(_ENTERED[space, integrates], ENTRIES if integrates else PRESCRIBED_ENTRIES)
