"""Tables of a mechanism's tree for compiled loops, in the plane and in space.

Every joint of the tree is a chain of *nodes*, each of which turns about an axis, slides along one, turns as a ball, or
is fixed: a universal joint is two nodes that turn, a cylindrical one slides and turns, and a free body has three that
slide and a ball, in the plane a single node. The last node of a chain carries the body: a deforming one by its section
at the joint. A further node has its axes and modal coordinates: about the axes that the joint leaves free, shapes
rotate the section relative to the floating axes. A *station* for each place with a joint, spring or load moves with the
section there. Joints outside the tree are *cuts*, which close its loops by constraints.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from kaneflex.mechanism.spatial import Side

FIXED, TURN, SLIDE, BALL, SHAPES, STATION = range(6)
FREE = BALL
"""In the plane a node with three freedoms moves along x and y and turns; there are no balls."""
(
    KIND, PARENT, COORDINATE, SPEED,  # kind, parent, first coordinate and first speed
    # Where the numbers of a body that has mass begin in ``block``, else -1; number of shapes of a body that deforms.
    BODY, COUNT,
    # Where the numbers of a station begin in ``block``: in space N and psi, (3, COUNT) each, then of G the number of
    # its columns (3,) that are not zero, and each with its two shapes before it, i >= j. Of a node of shapes those of
    # its joint's section, from which they move the axes back, -1 if they don't.
    AT,
    ROW_OF, OWNER,  # first row in ``phi`` of a node that shapes move, else -1; number in ``bodies`` of a node's body
    AXED,  # in the plane 1 if a point away from its origin or a direction has its axes, else these are not computed
) = range(10)  # fmt: skip
"""Columns of ``nodes``."""
(
    AXES_NODE, HUNG_ON,  # node of a body's axes, and the one that it hangs on, or -1
    # Node whose twist is the body's for :mod:`kaneflex.multibody.dynamics.articulated`: the last of its joint where
    # shapes turn the axes back from it.
    TWIST_NODE,
    # First node of its joint; -1 where the tree passes through the joint from its second body to its first, else 1.
    JOINT_NODE, SIGN,
) = range(5)  # fmt: skip
"""Columns of ``frames``."""
(
    # Last node of its chain, or -1 outside the tree; -1 if the tree passes from its second body to its first, else 1.
    LAST_NODE, SIDE,
    CARRIER, FIRST_ROW, LAST_ROW,  # node of its second point, or -1 on the ground; its rows among those of the cuts
) = range(5)  # fmt: skip
"""Columns of ``joints``."""
PLACE, AXIS, SHIFT = slice(-9, -6), slice(-6, -3), slice(-3, None)
"""Columns of ``numbers``: joint's point in the parent's axes, in the plane with the angle there; axis; the joint's
point in its own axes. In space the axes at zero in the parent's, (3, 3), precede them."""
COINCIDE, PERPENDICULAR, ON_PLANE = range(3)
ANGLES = (3 * (False,), (True,), (False,))
"""Rows of an elementary constraint: which are angles."""
SPEEDS = (0, 1, 1, 3, 0, 0)
"""Speeds of a node by its kind, without shapes."""


Place = tuple[float, ...]
"""Coordinates of a point in its body's axes [m]."""
Names = Sequence[tuple[str, str]]
"""Names and units of coordinates."""


class Deformable(Protocol):
    """Shapes of a body with zero displacement at the place held by a joint of the tree, and zero rotation there except
    about axes that this joint leaves free."""

    @property
    def count(self) -> int:
        """Number of shapes."""

    @property
    def counts(self) -> tuple[int, ...]:
        """Shapes of each kind: axial and transverse ones, in space of links more."""

    @property
    def twisting(self) -> np.ndarray:
        """True for each shape of twist, whose coordinate is an angle."""

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of the modal coordinates [N/m], (count, count)."""

    @property
    def damping(self) -> np.ndarray:
        """Damping of the modal coordinates [N s/m], (count, count)."""

    def numbers(self) -> np.ndarray:
        """Parameters of ``kaneflex.generated.spatial_shapes``."""

    def carrier(self, at: Place) -> Place:
        """Place whose shapes carry a point: of a link the point on its axis in the same section."""

    def at(self, place: Place) -> tuple[np.ndarray, np.ndarray]:
        """N and psi, (6, count), and G (3, count, count) at a carrier."""


class Axis(Deformable, Protocol):
    """Shapes of a link, which are defined all along its axis."""

    def spread(self, first: float, last: float) -> tuple[float, float, np.ndarray, np.ndarray]:
        """Integrals of a function that changes linearly from ``first`` at the start to ``last`` at the end: of itself,
        times x, times the rows, and times G of :meth:`at`."""


Flexible = Mapping[str, Callable[[Place | None, str], Deformable]]
"""Deforming body -> its shapes, by the place of its joint of the tree (None: a free body), and by the axes, like "z" or
"xyz", about which this joint leaves its rotation free."""
RIGID: Flexible = {}


@dataclass(frozen=True, eq=False)
class Layout:
    """Names of the tables' entries.

    Attributes
    ----------
    node_of : mapping
        Body -> its node, in the order of the tree.
    stations : mapping
        Carrier of points of a body that deforms, by the body and its place -> the node that stands there.
    sections : mapping
        Point of a body, by the body and its place -> number of its section.
    shapes : mapping
        Body that deforms -> its shapes.
    tree : mapping
        Joint of the tree -> its nodes, and -1 where the tree goes through it from its second body to its first.
    cuts : mapping
        Joint that closes a loop -> its rows, that of its drive in the plane last.
    coordinates : tuple of (str, str)
        Name and unit of the coordinate of every generalised speed, like ``shaft.angle`` or ``ball.omega_x``.
    positions : tuple of (str, str)
        Name and unit of every coordinate of a state: a ball has a unit quaternion.
    driven : tuple of str
        Joints whose courses are prescribed, those with given courses last.
    """

    node_of: Mapping[str, int]
    stations: Mapping[tuple[str, Place], int]
    sections: Mapping[Side, int]
    shapes: Mapping[str, Deformable]
    tree: Mapping[str, tuple[tuple[int, ...], int]]
    cuts: Mapping[str, slice]
    coordinates: tuple[tuple[str, str], ...]
    positions: tuple[tuple[str, str], ...]
    driven: tuple[str, ...]

    @cached_property
    def speeds(self) -> tuple[str, ...]:
        """Names of the generalised speeds."""
        return tuple(name for name, _ in self.coordinates)

    @cached_property
    def inboard(self) -> tuple[str | None, ...]:
        """Joint of the tree of every body; None of free bodies."""
        joint_at = {nodes[-1]: name for name, (nodes, _) in self.tree.items()}
        deforms = self.shapes.keys()
        return tuple(joint_at.get(node - (body in deforms)) for body, node in self.node_of.items())


def leading(nodes: Sequence[Sequence[int]] | np.ndarray, chain: tuple[tuple[int, ...], int]) -> int:
    """Node with the first coordinate of a joint of the tree; for a cylindrical joint, its rotation."""
    ordered = chain[0][:: chain[1]]
    return next((node for node in ordered if nodes[node][KIND] != SLIDE), ordered[0])
