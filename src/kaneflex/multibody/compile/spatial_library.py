"""Library of the compiled engine's functions in space, see :mod:`kaneflex.multibody.compile.library`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody.compile.addresses import called, entered
from kaneflex.multibody.compile.library import sources
from kaneflex.multibody.dynamics.spatial_entries import ENTRIES, RIGID_ENTRIES
from kaneflex.multibody.dynamics.spatial_work import SPACE
from kaneflex.multibody.model.layout import OUTER
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(*sources("unilateral"), laws.__file__, shape_laws.__file__)
_rigid, _deforming = (entered(SPACE, entries) for entries in (RIGID_ENTRIES, ENTRIES))


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses_of_rigid():
    return _rigid()


@njit(cache=True, **OUTER)
@_made_of_parts
def _addresses():
    return _deforming()


@cache
def library(deforming: bool) -> dict[Any, Callable[..., Any]]:
    """C functions of all entries, by their numba functions; those of rigid bodies are fewer, and compile faster."""
    if deforming:
        return called(_addresses, ENTRIES)
    return called(_addresses_of_rigid, RIGID_ENTRIES)
