"""Library of the compiled engine's functions in space, see :mod:`kaneflex.multibody.compile.library`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit

from kaneflex.generated import spatial as laws
from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.multibody.compile import addresses, values
from kaneflex.multibody.compile.addresses import called, entered
from kaneflex.multibody.dynamics import (
    algebra,
    articulated,
    change_points,
    courses,
    dense_lu,
    dimensions,
    load_derivatives,
    loop_closure,
    loop_condition,
    loop_factors,
    powers,
    reduction,
    rotation_vectors,
    spatial_bushings,
    spatial_entries,
    spatial_forces,
    spatial_kinematics,
    spatial_tree,
    spatial_work,
    tree,
    unfolding,
)  # fmt: skip
from kaneflex.multibody.dynamics.spatial_entries import ENTRIES, RIGID_ENTRIES
from kaneflex.multibody.dynamics.spatial_work import SPACE
from kaneflex.multibody.model import layout, spatial_layout
from kaneflex.multibody.model.layout import OUTER
from kaneflex.multibody.time import coefficients, collocation, stage_residuals, state_record
from kaneflex.support import inner
from kaneflex.support.fingerprint import made_of

_made_of_parts = made_of(
    laws.__file__, shape_laws.__file__, addresses.__file__, algebra.__file__, articulated.__file__,
    change_points.__file__, coefficients.__file__, collocation.__file__, courses.__file__, dense_lu.__file__,
    dimensions.__file__, inner.__file__, layout.__file__, load_derivatives.__file__, loop_closure.__file__,
    loop_condition.__file__, loop_factors.__file__, powers.__file__, reduction.__file__, rotation_vectors.__file__,
    spatial_bushings.__file__, spatial_entries.__file__, spatial_forces.__file__, spatial_kinematics.__file__,
    spatial_layout.__file__, spatial_tree.__file__, spatial_work.__file__, stage_residuals.__file__,
    state_record.__file__, tree.__file__, unfolding.__file__, values.__file__,
)  # fmt: skip
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
