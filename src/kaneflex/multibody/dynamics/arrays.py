"""Arrays of compiled functions of a mechanism, and the stored part of every instant."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

(
    NODES, SPEEDS, COORDINATES, SECTIONS, AXES, BODIES, KEPT, PHI, GEOMETRY, BALLS, OWN, JOINTS,
) = range(12)  # fmt: skip
"""Places of ``counts``; KEPT: numbers of a record; PHI: rows of phi; GEOMETRY: place in ``w`` of the first of four
geometries of factors in space, of the middle of a step and of its stages; BALLS, OWN: lengths of the tables of
coordinates."""

TABLES = "plan", "bodies", "acts", "w", "pivots", "kernels", "p", "real", "pair"
FIXED = {"nodes": 10, "frames": 5, "joints": 5, "balls": 2, "own": 2, "counts": 1, "on": 1, "axis_on": 1}
NUMBERS = (
    "block", "K", "C", "joint_stiffness", "joint_damping", "virtual_inertia", "row_measure", "kept", "q", "u", "du",
    "multipliers", "along", "energies", "powers", "touching", "y", "J", "h", "L", "M", "alpha", "x", "now", "mass_0",
    "mass_1", "mass_2", "rows", "sections", "sizes", "springs",
)  # fmt: skip
VECTORS = ("numbers", "at", "axis_at", "gravity", "R", "r", "P", "moved", "offset", "bent", "axes", "points", "x3")
TWISTS = ("twist", "rate", "wrenches", "exerted", "slow", "I", "E", "S", "phi", "F")
ORDER = (*TABLES, *FIXED, *NUMBERS, *VECTORS, *TWISTS)
"""Arrays of a mechanism as compiled functions get them: its tables, tables of whole numbers with their columns,
numbers, vectors of three, and of D.

``pivots``: the plan once more, writable; ``kernels``: addresses of those of the structure; ``p``: the parameters of the
structure's module; ``real``, ``pair``: arrays for factors; ``K``, ``C``: stiffness and damping of the shapes of every
body, (count, count), ``joint_stiffness``, ``joint_damping``: of springs at joints of the tree, by their speeds;
``balls``: places of every ball's quaternion in q, and of its rotation vector in y; ``own``: of all other coordinates.
See :class:`Work` for those that Python reads; others are

- ``wrenches`` (n, d): force and moment about its origin that a node's joint exerts on it;
- ``h`` (s,): generalised inertia forces less applied ones and those of the cuts;
- ``I``, ``E``, ``L`` (d b, d), (n_shapes, d), (n_square,): inertia of each of b bodies, coupling to its shapes, and the
  shapes' own, see :mod:`kaneflex.multibody.dynamics.articulated`;
- ``P`` (n, 3): position of the joint's point; ``slow`` (n, d): twist relative to the parent;
- ``moved``, ``bent`` (n, 3), (n, 3, 3): displacement and rotation of a section by shapes, in the body's axes;
- ``S`` (s, d): twist of its node's origin for a unit of every speed of a joint;
- ``phi`` (n_phi, d): twist of a section for a unit of every shape of its body, in the body's axes;
- ``F`` (n, d): twists of the nodes, then momenta of their bodies, for the mass matrix;
- ``alpha`` (3 s,): angular accelerations of balls in their axes at the stages of a step;
- ``x``, ``x3``: numbers of one body or station at hand; the same by three.
"""


@dataclass(eq=False)
class Instants:
    """Record of an instant by names, n nodes, s speeds; arrays of many instants have these as first axis.

    Attributes
    ----------
    q, u, du : ndarray
        Coordinates, speeds, and rates of these. A ball's four coordinates are the unit quaternion of its axes where
        its rotation vector in ``y`` is zero.
    R, r : ndarray (n, 3, 3), (n, 3)
        Axes and origins; in the plane cosine, sine and angle of the axes, and the origin with the angle of its section.
    twist, rate : ndarray (n, d)
        Velocity of the origin and angular velocity; their rates.
    exerted : ndarray (n_joints, d)
        Force and moment of every joint on its second body at its second point, global; in the plane of joints of the
        tree alone, by the joint's rows, then along its coordinate.
    multipliers : ndarray (n_rows,)
        Of the cuts' rows.
    along : ndarray (s,)
        Generalised forces along every speed beyond loads, springs and cuts.
    springs : ndarray (n_springs, 7)
        Length or angle, tension or torque, force, energy, dissipated power; then of bushings, see
        :mod:`kaneflex.multibody.dynamics.bushings`.
    energies : ndarray (3,)
        Kinetic and strain energy, and potential energy of the weight [J].
    powers : ndarray (n_works,)
        Of dissipation without contacts and friction, loads, drives, frictions and contacts [W].
    touching : ndarray (n_unilateral, 7)
        Of frictions, contacts and switches, see :func:`kaneflex.multibody.unilateral.frictions.record`.
    sizes : ndarray (n_loads,)
        Sizes of the loads; behind the record follow those of switches.
    """

    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    R: np.ndarray
    r: np.ndarray
    twist: np.ndarray
    rate: np.ndarray
    exerted: np.ndarray
    multipliers: np.ndarray
    along: np.ndarray
    springs: np.ndarray
    energies: np.ndarray
    powers: np.ndarray
    touching: np.ndarray
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
        """Views of records, which are each like the ``kept`` of a work."""
        parts, first = list[np.ndarray](), 0
        for each in fields(Instants):
            one = getattr(work, each.name)
            parts.append(rows[:, first : first + one.size].reshape(len(rows), *one.shape))
            first += one.size
        return Instants(*parts)


class Columns(NamedTuple):
    """Columns of a record by the coordinates of the bodies, see :attr:`kaneflex.multibody.engine.Engine.recorded`.

    ``q``: place, in space with the axes, row by row, and shapes of each; ``v``, ``a``: twist and shapes' rates, and the
    rates of these; ``forces``: of joints and drives.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    forces: np.ndarray


@dataclass(eq=False)
class Work(Instants):
    """Arrays filled by the compiled functions that Python reads: views of the tables' numbers w.

    Attributes
    ----------
    kept : ndarray
        All that is stored of an instant.
    rows : ndarray (n_rows, 3 + 2 d)
        Of the cuts, see ``kaneflex.generated.spatial``; in the plane also of frictions and contacts.
    y : ndarray (s,)
        Coordinates whose rates are the speeds: of a ball its rotation vector from the axes of its quaternion.
    J : ndarray (n_rows, s)
        Rates of the rows by the speeds, filled on request.
    offset : ndarray (n, 3)
        Place of the joint in the node's axes.
    sections : ndarray (n_sections, 3 + 2 d)
        Place, in the plane with its angle, then twist and its rate.
    axes : ndarray (n_axes, 3)
    virtual_inertia : ndarray (s,)
        Virtual inertia of dependent speeds.
    row_measure : ndarray (n_rows,)
        Unit of every row of the cuts: the mechanism's size [m] or 1 rad.
    M : ndarray (s, s)
        Mass matrix, filled on request.
    now : ndarray (3,)
        Last instant of rows [s], its outcome, and the number of independent speeds.
    """

    kept: np.ndarray
    rows: np.ndarray
    y: np.ndarray
    J: np.ndarray
    offset: np.ndarray
    sections: np.ndarray
    axes: np.ndarray
    virtual_inertia: np.ndarray
    row_measure: np.ndarray
    M: np.ndarray
    now: np.ndarray
