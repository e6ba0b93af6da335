"""Arrays of compiled functions of a mechanism, and in space the stored part of every instant."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numba.types import float64

from kaneflex.multibody.compile.values import Vectors
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.interactions import Numbers
from kaneflex.multibody.model.layout import (
    CONTACT_MECHANISM,
    HOLD_MECHANISM,
    IMPACT_MECHANISM,
    MECHANISM,
    RIGID_SPACE,
    SPACE,
    SWITCHED_SPACE,
    Fixed,
    N,
)  # fmt: skip
from kaneflex.multibody.model.places import Counts, assign
from kaneflex.multibody.model.spatial_layout import SHIFT, Tables

SECTION = 15
"""Numbers of a section, and of a cut's row."""
(
    NODES, SPEEDS, COORDINATES, SECTIONS, AXES, BODIES, KEPT, PHI, GEOMETRY, BALLS, OWN,
) = range(11)  # fmt: skip
"""Places of ``counts``; KEPT: numbers of a row; PHI: rows of phi; GEOMETRY: place in ``w`` of the first of four
geometries of factors, of the middle of a step and of its stages; BALLS, OWN: lengths of the tables of coordinates."""

_V, _W = Vectors(float64, 3), Vectors(float64, 6)
_TABLES = {
    "counts": Fixed(1), "nodes": Fixed(10), "numbers": _V, "frames": Fixed(4), "block": N, "on": Fixed(1), "at": _V,
    "axis_on": Fixed(1), "axis_at": _V, "twisting": Fixed(1), "gravity": _V,
    "K": N, "virtual_inertia": N, "row_measure": N,
    "balls": Fixed(2), "own": Fixed(2),
}  # fmt: skip
_WORK = {
    "kept": N, "q": N, "u": N, "du": N, "R": _V, "r": _V, "twist": _W, "rate": _W,
    "wrenches": _W, "multipliers": N, "along": N, "rows": _V, "deforming": N,
    "y": N, "J": N, "h": N, "I": _W, "E": _W, "L": N, "P": _V, "slow": _W, "moved": _V, "offset": _V, "bent": _V,
    "S": _W, "phi": _W, "sections": _V, "axes": _V, "M": N, "F": _W, "alpha": N, "x": N, "x3": _V, "now": N,
    "mass_0": N, "mass_1": N, "mass_2": N,
}  # fmt: skip
for _each in (SPACE, RIGID_SPACE, SWITCHED_SPACE):
    _each.parts.update({"bodies": Fixed(8)} | _TABLES | _WORK)
"""All numbers of a mechanism in space for compiled code: those of every mechanism, its tables and working arrays.

``twisting``: speeds of torsional springs; ``balls``: places of every ball's quaternion in q, and of its rotation vector
in y; ``own``: of all other coordinates.
"""
PLANAR_TABLES = {
    "counts": Fixed(1), "nodes": Fixed(10), "numbers": _V, "frames": Fixed(4), "on": Fixed(1), "at": _V,
}  # fmt: skip
PLANAR_WORK = {
    **dict.fromkeys(("y", "u", "du", "h"), N),
    **dict.fromkeys(("R", "r", "P", "slow", "moved", "offset", "twist", "rate", "wrenches"), _V),
    **dict.fromkeys(("S", "phi", "sections", "I", "E"), _V), "L": N,
}  # fmt: skip
for _each in (MECHANISM, CONTACT_MECHANISM, IMPACT_MECHANISM, HOLD_MECHANISM):
    _each.parts.update(PLANAR_TABLES | PLANAR_WORK)
"""The same in the plane, where an axis is an angle, and a twist has three numbers."""


@dataclass(eq=False)
class Instants:
    """Stored arrays of an instant, n nodes, s speeds; of many instants, which are then the first axis.

    Attributes
    ----------
    q, u, du : ndarray
        Coordinates, speeds, and rates of these. A ball's four coordinates are the unit quaternion of its axes where
        its rotation vector in ``y`` is zero.
    R, r : ndarray (n, 3, 3), (n, 3)
        Axes and origins.
    twist, rate : ndarray (n, 6)
        Velocity of the origin and angular velocity; their rates.
    wrenches : ndarray (n, 6)
        Force and moment about its origin that a node's joint exerts on it.
    multipliers : ndarray (n_rows,)
        Of the cuts' rows.
    along : ndarray (s,)
        Generalised forces along every speed beyond loads, springs and cuts.
    rows : ndarray (n_rows, 15)
        Of the cuts, see ``kaneflex.generated.spatial``.
    springs : ndarray (n_springs, 7)
        Length or angle, tension or torque, force, energy, dissipated power; then of bushings, see
        :mod:`kaneflex.multibody.dynamics.bushings`.
    deforming : ndarray (4,)
        Kinetic energy, strain energy, that of the weight [J], and dissipated power [W] of shapes.
    sizes : ndarray (n_loads,)
    """

    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    R: np.ndarray
    r: np.ndarray
    twist: np.ndarray
    rate: np.ndarray
    wrenches: np.ndarray
    multipliers: np.ndarray
    along: np.ndarray
    rows: np.ndarray
    springs: np.ndarray
    deforming: np.ndarray
    sizes: np.ndarray

    @property
    def v(self) -> np.ndarray:
        """Velocities of the origins, (n, 3)."""
        return self.twist[..., :3]

    @property
    def omega(self) -> np.ndarray:
        """Angular velocities, (n, 3)."""
        return self.twist[..., 3:]

    @property
    def a(self) -> np.ndarray:
        """Accelerations of the origins, (n, 3)."""
        return self.rate[..., :3]

    @property
    def e(self) -> np.ndarray:
        """Angular accelerations, (n, 3)."""
        return self.rate[..., 3:]

    @classmethod
    def of(cls, rows: np.ndarray, work: Work) -> Instants:
        """Views of rows that are each like the ``kept`` of a work."""
        parts, first = list[np.ndarray](), 0
        for each in fields(Instants):
            one = getattr(work, each.name)
            parts.append(rows[:, first : first + one.size].reshape(len(rows), *one.shape))
            first += one.size
        return Instants(*parts)


@dataclass(eq=False)
class Work(Instants):
    """Arrays filled by the compiled functions, b bodies. Most are views of the tables' numbers w.

    Attributes
    ----------
    kept : ndarray
        All that is stored of an instant.
    y : ndarray (s,)
        Coordinates whose rates are the speeds: of a ball its rotation vector from the axes of its quaternion.
    J : ndarray (n_rows, s)
        Rates of the rows by the speeds, filled on request.
    h : ndarray (s,)
        Generalised inertia forces less applied ones and those of the cuts.
    I, E, L : ndarray (6 b, 6), (n_shapes, 6), (n_square,)
        Inertia of every body, coupling to its shapes, and the shapes' own, see
        :mod:`kaneflex.multibody.dynamics.articulated`.
    P : ndarray (n, 3)
        Position of the joint's point.
    slow : ndarray (n, 6)
        Twist relative to the parent.
    moved, bent : ndarray (n, 3), (n, 3, 3)
        Displacement and rotation of a section by shapes, in the body's axes.
    offset : ndarray (n, 3)
        Place of the joint in the node's axes.
    S : ndarray (s, 6)
        Twist of its node's origin for a unit of every speed of a joint.
    phi : ndarray (n_phi, 6)
        Twist of a section for a unit of every shape of its body, in the body's axes.
    sections : ndarray (n_sections, 15)
    axes : ndarray (n_axes, 3)
    M : ndarray (s, s)
        Mass matrix, filled on request.
    F : ndarray (n, 6)
        Twists of the nodes, then momenta of their bodies, for the mass matrix.
    alpha : ndarray (3 s,)
        Angular accelerations of balls in their axes at the stages of a step.
    x, x3 : ndarray
        Numbers of one body or station at hand; the same by three.
    now : ndarray (3,)
        Last instant of rows [s], its outcome, and the number of independent speeds.
    """

    kept: np.ndarray
    y: np.ndarray
    J: np.ndarray
    h: np.ndarray
    I: np.ndarray
    E: np.ndarray
    L: np.ndarray
    P: np.ndarray
    slow: np.ndarray
    moved: np.ndarray
    offset: np.ndarray
    bent: np.ndarray
    S: np.ndarray
    phi: np.ndarray
    sections: np.ndarray
    axes: np.ndarray
    M: np.ndarray
    F: np.ndarray
    alpha: np.ndarray
    x: np.ndarray
    x3: np.ndarray
    now: np.ndarray


def arrays_of(
    tables: Tables, counts: Counts, coordinates: int
) -> tuple[np.ndarray, np.ndarray, Work, dict[str, int], int]:
    """Plan, numbers w and working arrays of a mechanism; places in w of the factors' geometries and of springs'
    stiffness and damping; length of factors."""
    n, b, s, rows = len(tables.nodes), counts.bodies, counts.coordinates, counts.joint_rows
    springs = counts.ranges[5] - counts.ranges[4]
    parts = {
        "q": (coordinates,), "u": (s,), "du": (s,), "R": (n, 3, 3), "r": (n, 3),
        **dict.fromkeys(("twist", "rate", "wrenches"), (n, 6)), "multipliers": (rows,),
        "along": (s,), "rows": (rows, SECTION), "springs": (springs, 7), "deforming": (4,),
        "sizes": (counts.loads,),
    }  # fmt: skip
    numbers = Numbers()
    plan, size = assign(counts, numbers)
    lengths = [math.prod(shape) for shape in parts.values()]
    first = numbers.room(sum(lengths) + 2 * counts.switches)  # those follow the sizes of the loads
    places = dict(zip(parts, np.cumsum([first, *lengths]).tolist(), strict=False))
    for what, name in {at.RATE: "u", at.ACCEL: "du", at.NOW: "multipliers", at.CUT: "rows", at.SPRING: "springs",
                       at.SIZE: "sizes"}.items():  # fmt: skip
        plan[what] = places[name]
    plan[at.MEASURE] = numbers.room(s)
    plan[at.DAMPED] = numbers.room(counts.square)
    plan[[at.PUSHES, at.PUSHED]] = counts.ranges[6], len(tables.acts)
    stiffness = numbers.room(3 * springs)
    of_sections = 3 * len(tables.on) + SECTION * rows
    geometry = numbers.room(4 * (6 * (s + counts.twists + b) + of_sections))
    w = np.concatenate(numbers.parts)

    def view(where: int, *shape: int) -> np.ndarray:
        return w[where : where + math.prod(shape)].reshape(shape)

    found = {name: view(places[name], *shape) for name, shape in parts.items()}
    x = np.zeros(max(64, (6 + max(counts.shapes, default=0)) ** 2))
    found |= {
        "y": view(plan[at.Y], s), "J": view(plan[at.GRADIENT], rows, s), "h": view(plan[at.DEMAND], s),
        "I": view(plan[at.INERTIAS], 6 * b, 6), "E": view(plan[at.COUPLINGS], counts.coupling, 6),
        "L": view(plan[at.MASSES], counts.square), "P": np.zeros((n, 3)), "slow": np.zeros((n, 6)),
        "moved": np.zeros((n, 3)), "bent": np.zeros((n, 3, 3)), "offset": tables.numbers[:, SHIFT:].copy(),
        "S": np.zeros((s, 6)), "phi": np.zeros((counts.twists, 6)), "sections": _on_ground(tables),
        "axes": np.zeros((len(tables.axis_on), 3)), "M": np.zeros((s, s)), "F": np.zeros((n, 6)),
        "alpha": np.zeros(3 * s), "x": x, "x3": x, "now": np.zeros(3),
    }  # fmt: skip
    work = Work(kept=view(first, sum(lengths)), **found)
    return plan, w, work, {"geometry": geometry, "springs": stiffness}, size


def _on_ground(tables: Tables) -> np.ndarray:
    """Numbers of all sections, with the places of those on the ground."""
    found, held = np.zeros((len(tables.on), SECTION)), tables.on < 0
    found[held, :3] = tables.at[held]
    return found
