"""Working arrays of the compiled functions of a mechanism in space, and the stored part of every instant."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from kaneflex.multibody.spatial_tables import COUNT, Tables

SECTION = 15
"""Numbers of a section."""


class Work(NamedTuple):
    """Arrays filled by the compiled functions, n bodies' nodes, s speeds.

    Attributes
    ----------
    kept : ndarray
        Stored part of an instant: the following arrays, up to ``deforming``.
    q, u, du : ndarray
        Coordinates, speeds, and rates of these.
    sizes : ndarray (n_loads,)
    R, r : ndarray (n, 3, 3), (n, 3)
        Axes and origins.
    v, w, a, e : ndarray (n, 3)
        Velocity of the origin, angular velocity, acceleration of the origin, angular acceleration.
    wrenches : ndarray (n, 6)
        Force and moment about its origin that a node's joint exerts on it.
    multipliers : ndarray (n_rows,)
        Of the cuts' rows.
    along : ndarray (s,)
        Generalised forces along every speed beyond loads, springs and cuts.
    rows : ndarray (n_rows, 15)
        Of the cuts, see ``kaneflex.generated.spatial``.
    springs, twists : ndarray (n_springs, 7), (n_twists, 4)
        Length, tension, force, energy, dissipated power; angle, torque, energy, dissipated power.
    bushings : ndarray (n_bushings, 9)
        Force and moment, energy, dissipated power, angle, see :mod:`kaneflex.multibody.spatial_bushings`.
    deforming : ndarray (4,)
        Kinetic energy, strain energy, that of the weight [J], and dissipated power [W] of shapes.
    P : ndarray (n, 3)
        Position of the joint's point.
    Jv, Jw : ndarray (n, s, 3)
        Partial velocities of the origin, partial angular velocities.
    sections : ndarray (n_sections, 15)
    axes : ndarray (n_axes, 3)
    J : ndarray (n_rows, s)
        Rates of the rows by the speeds.
    M, h : ndarray (s, s), (s,)
    F : ndarray (n, 6)
        Inertia force and moment about its origin of a node's body, less applied ones.
    B, Y : ndarray (6, s)
        Partial velocities of one body in its own axes, and the momentum of each.
    x : ndarray (108,)
        Vectors and matrices at hand.
    I : ndarray ((6 + most shapes)^2,)
        Mass matrix of one body: of its axes, their coupling to shapes, and of the shapes.
    turned : ndarray (27,)
        theta, theta' of a station, then R, T row by row and T' theta' of ``kaneflex.generated.spatial_shapes.section``.
    """

    kept: np.ndarray
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    sizes: np.ndarray
    R: np.ndarray
    r: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    e: np.ndarray
    wrenches: np.ndarray
    multipliers: np.ndarray
    along: np.ndarray
    rows: np.ndarray
    springs: np.ndarray
    twists: np.ndarray
    bushings: np.ndarray
    deforming: np.ndarray
    P: np.ndarray
    Jv: np.ndarray
    Jw: np.ndarray
    sections: np.ndarray
    axes: np.ndarray
    J: np.ndarray
    M: np.ndarray
    h: np.ndarray
    F: np.ndarray
    B: np.ndarray
    Y: np.ndarray
    x: np.ndarray
    I: np.ndarray
    turned: np.ndarray


class Instants(NamedTuple):
    """Stored arrays of :class:`Work` for many instants, which are the first axis."""

    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    sizes: np.ndarray
    R: np.ndarray
    r: np.ndarray
    v: np.ndarray
    w: np.ndarray
    a: np.ndarray
    e: np.ndarray
    wrenches: np.ndarray
    multipliers: np.ndarray
    along: np.ndarray
    rows: np.ndarray
    springs: np.ndarray
    twists: np.ndarray
    bushings: np.ndarray
    deforming: np.ndarray

    @classmethod
    def of(cls, rows: np.ndarray, work: Work) -> Instants:
        """Views of rows that are each like the ``kept`` of a work."""
        parts, first = list[np.ndarray](), 0
        for name in cls._fields:
            one = getattr(work, name)
            parts.append(rows[:, first : first + one.size].reshape(len(rows), *one.shape))
            first += one.size
        return cls(*parts)


def work_of(tables: Tables, coordinates: int, speeds: int, rows: int, loads: int) -> Work:
    """Working arrays of a mechanism."""
    n, sections, axes = len(tables.nodes), len(tables.on), len(tables.axis_on)
    kept = ((coordinates,), (speeds,), (speeds,), (loads,), (n, 3, 3), *((n, 3),) * 5, (n, 6), (rows,), (speeds,),
            (rows, SECTION), (len(tables.springs), 7), (len(tables.twists), 4),
            (len(tables.bushings), 9), (4,))  # fmt: skip
    shapes = int(tables.nodes[:, COUNT].max(initial=0))
    rest = ((n, 3), (n, speeds, 3), (n, speeds, 3), (sections, SECTION), (axes, 3), (rows, speeds), (speeds, speeds),
            (speeds,), (n, 6), (6, speeds), (6, speeds), (108,), ((6 + shapes) ** 2,), (27,))  # fmt: skip
    row, first = np.zeros(sum(map(math.prod, kept))), 0
    parts = list[np.ndarray]()
    for shape in kept:
        parts.append(row[first : first + math.prod(shape)].reshape(shape))
        first += math.prod(shape)
    return Work(row, *parts, *(np.zeros(shape) for shape in rest))
