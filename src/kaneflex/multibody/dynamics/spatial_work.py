"""Arrays of compiled functions of a mechanism in space, and the stored part of every instant."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba.types import CPointer, float64, int64

from kaneflex.multibody.compile.values import Vectors
from kaneflex.multibody.model.layout import Fixed, Handed, N
from kaneflex.multibody.model.spatial_layout import COUNT, KIND, STATION, Tables

SECTION = 15
"""Numbers of a section."""
(
    NODES, SPEEDS, COORDINATES, SECTIONS, AXES, CUTS, ROWS, FORCES, TORQUES, SPRINGS, TWISTS, BUSHINGS, LOADS, BODIES,
    KEPT, DRIVEN, OBSERVED, PHI, SHAPES_OF_ALL, SQUARES,
) = range(20)  # fmt: skip
"""Places of ``counts``; KEPT: numbers of a row; OBSERVED: joints whose coordinates occur in magnitudes; PHI,
SHAPES_OF_ALL, SQUARES: lengths of phi, E and L."""

_V, _W = Vectors(float64, 3), Vectors(float64, 6)
_PARTS = {
    "counts": Fixed(1), "nodes": Fixed(8), "numbers": _V, "bodies": Fixed(8), "frames": Fixed(2), "p": N,
    "on": Fixed(1), "at": _V, "axis_on": Fixed(1), "axis_at": _V, "cuts": Fixed(6), "forces": Fixed(3),
    "torques": Fixed(4), "spring_ends": Fixed(2), "stiffness": _V, "twist_ends": Fixed(4), "torsion": _V,
    "bushing_ends": Fixed(4), "cushions": _V, "gravity": _V,
}  # fmt: skip
_WORK = {
    "kept": N, "q": N, "u": N, "du": N, "sizes": N, "R": _V, "r": _V, "v": _V, "w": _V, "a": _V, "e": _V,
    "wrenches": _W, "multipliers": N, "along": N, "rows": _V, "springs": N, "twists": N, "bushings": N, "deforming": N,
    "P": _V, "S": _W, "phi": _W, "place": _V, "arm": _V, "sections": _V, "axes": _V, "J": N, "M": N, "h": N, "F": _W,
    "felt": _W, "joint_axes": _W, "I": _W, "E": _W, "L": N, "x": N, "x3": _V,
}  # fmt: skip
_LAWS = {
    "kernels": CPointer(int64), "law_p": N, "driven": Fixed(1), "observed": Fixed(2), "law_x": N, "course": N, "now": N,
    "added": N, "K": N, "C": N,
}  # fmt: skip
SPACE = Handed("Mechanism in space", **_PARTS, **_WORK, **_LAWS)
"""All numbers of a mechanism in space for compiled code: its tables, working arrays and laws."""


class Laws(NamedTuple):
    """Arguments of a structure's own kernels, and the progress of rows.

    Attributes
    ----------
    kernels : ndarray (2,)
        Addresses of those of :data:`kaneflex.multibody.model.layout.STRUCTURE_KERNELS`.
    p : ndarray
        Their parameters.
    driven : ndarray (n_driven,)
        Coordinates of the prescribed drives.
    observed : ndarray (n_observed, 2)
        Place in ``x`` and node of every joint whose coordinate occurs in magnitudes.
    x, course : ndarray
        Input of magnitudes, and output of courses.
    now : ndarray (2,)
        Last instant of rows [s], and its outcome.
    added : ndarray (n_loads + n_driven,)
        Additions to the sizes of the loads and to the accelerations of the prescribed drives.
    """

    kernels: np.ndarray
    p: np.ndarray
    driven: np.ndarray
    observed: np.ndarray
    x: np.ndarray
    course: np.ndarray
    now: np.ndarray
    added: np.ndarray


class Work(NamedTuple):
    """Arrays filled by the compiled functions, n nodes, b bodies, s speeds.

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
        Force and moment, energy, dissipated power, angle, see :mod:`kaneflex.multibody.dynamics.spatial_bushings`.
    deforming : ndarray (4,)
        Kinetic energy, strain energy, that of the weight [J], and dissipated power [W] of shapes.
    P : ndarray (n, 3)
        Position of the joint's point.
    S : ndarray (s, 6)
        Twist of its node's origin for a unit of every speed of a joint.
    phi : ndarray (n_phi, 6)
        Twist of a station for a unit of every shape of its body.
    place, arm : ndarray (b, 3)
        Station that a body hangs on from its parent's origin; the body's origin from there.
    sections : ndarray (n_sections, 15)
    axes : ndarray (n_axes, 3)
    J : ndarray (n_rows, s)
        Rates of the rows by the speeds.
    M, h : ndarray (s, s), (s,)
        Mass matrix, filled on request; generalised inertia forces less applied ones.
    F, felt : ndarray (n, 6)
        Inertia force and moment about its origin of a node's body, less applied ones; the same with all nodes beyond.
    joint_axes : ndarray (s, 6)
        S at the origins of the bodies.
    I, E, L : ndarray (6 b, 6), (n_shapes, 6), (n_square,)
        Inertia of every body, coupling to its shapes, and the shapes' own, see
        :mod:`kaneflex.multibody.dynamics.articulated`.
    x, x3 : ndarray
        Numbers of one body or station at hand; the same by three.
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
    S: np.ndarray
    phi: np.ndarray
    place: np.ndarray
    arm: np.ndarray
    sections: np.ndarray
    axes: np.ndarray
    J: np.ndarray
    M: np.ndarray
    h: np.ndarray
    F: np.ndarray
    felt: np.ndarray
    joint_axes: np.ndarray
    I: np.ndarray
    E: np.ndarray
    L: np.ndarray
    x: np.ndarray
    x3: np.ndarray


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
    n, b, sections, axes = len(tables.nodes), len(tables.bodies), len(tables.on), len(tables.axis_on)
    kept = ((coordinates,), (speeds,), (speeds,), (loads,), (n, 3, 3), *((n, 3),) * 5, (n, 6), (rows,), (speeds,),
            (rows, SECTION), (len(tables.springs), 7), (len(tables.twists), 4),
            (len(tables.bushings), 9), (4,))  # fmt: skip
    counts = tables.bodies[:, 0]
    phi, most = int(tables.nodes[tables.nodes[:, KIND] == STATION, COUNT].sum()), int(counts.max(initial=0))
    rest = ((n, 3), (speeds, 6), (phi, 6), (b, 3), (b, 3), (sections, SECTION), (axes, 3), (rows, speeds),
            (speeds, speeds), (speeds,), (n, 6), (n, 6), (speeds, 6), (6 * b, 6), (int(counts.sum()), 6),
            (int((counts**2).sum()),), (max(64, (6 + most) ** 2),))  # fmt: skip
    row, first = np.zeros(sum(map(math.prod, kept))), 0
    parts = list[np.ndarray]()
    for shape in kept:
        parts.append(row[first : first + math.prod(shape)].reshape(shape))
        first += math.prod(shape)
    made = [np.zeros(shape) for shape in rest]
    return Work(*[row, *parts, *made, made[-1]])
