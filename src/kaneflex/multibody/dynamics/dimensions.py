"""Functions of a mechanism in the plane and in space: one name, chosen by the type of its tables.

All others of the engine are one text for both.
"""

from __future__ import annotations

from numba import njit

from kaneflex.multibody.compile.values import by_size, inside
from kaneflex.multibody.dynamics import (
    kinematics,
    planar_tree,
    spatial_forces,
    spatial_kinematics,
    spatial_tree,
)
from kaneflex.multibody.model.layout import OPTIONS


@njit(**OPTIONS)
def place_of(m, what):
    """Place in ``w`` of the geometry at which the current factors were made."""
    inside()
    return m.plan[what]


@njit(**OPTIONS)
def _place_in_use(m, what):
    inside()
    return m.pivots[what]


@njit(**OPTIONS)
def _nothing(m):
    inside()


place_of = by_size(place_of, _place_in_use)
deform = by_size(kinematics.deform, _nothing)
place = by_size(kinematics.place, spatial_kinematics.place)
move = by_size(kinematics.move, spatial_kinematics.move)
accelerate = by_size(kinematics.accelerate, spatial_kinematics.accelerate)
cut_rows = by_size(kinematics.cut_rows, spatial_kinematics.cut_rows)
demand = by_size(kinematics.demand, spatial_forces.demand)
bent = by_size(planar_tree.bent, _nothing)
assemble = by_size(planar_tree.assemble, spatial_tree.assemble)
stiffen = by_size(planar_tree.stiffen, spatial_tree.stiffen)
resist = by_size(planar_tree.resist, spatial_tree.resist)
