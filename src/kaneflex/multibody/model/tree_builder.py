"""Rows of the tables of a mechanism in construction, in the plane and in space: nodes, stations, sections, axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint
from kaneflex.mechanism.spatial import Side, SpatialMechanism
from kaneflex.multibody.model.body_parameters import Blocks, SpatialBlocks
from kaneflex.multibody.model.layout import DOF, MODAL
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.tree_layout import (
    AT, AXED, AXES_NODE, AXIS, BODY, COORDINATE, COUNT, KIND, OWNER, PARENT, PLACE, ROW_OF, SHAPES, SHIFT, SPEED,
    SPEEDS, STATION, TWIST_NODE, Axis, Deformable, Layout, Names, Place, leading,
)  # fmt: skip

ORIGIN = (0.0, 0.0, 0.0)
AnyMechanism = NumericMechanism | SpatialMechanism
"""Mechanism in the plane or in space."""
Branch = tuple[str, str | None, int]
"""A body, its inboard joint (None: free), and which of the joint's sides belongs to it."""
Row = tuple[int, ...]


def side_of(point: BodyPoint | Side) -> Side:
    """Point of a body, in the plane as in space."""
    if isinstance(point, Side):
        return point
    x, y = map(float, point.at)
    return Side(point.body, (x, y, 0.0))


class Numbers:
    """Array of numbers during its construction."""

    def __init__(self) -> None:
        self.parts: list[np.ndarray] = []
        self.size = 0

    def put(self, numbers: np.ndarray | Sequence[float]) -> int:
        """Append numbers; returns their place."""
        self.parts.append(np.asarray(numbers, float).ravel())
        self.size += self.parts[-1].size
        return self.size - self.parts[-1].size

    def room(self, count: int) -> int:
        return self.put(np.zeros(count))

    @property
    def whole(self) -> np.ndarray:
        return np.concatenate([*self.parts, np.zeros(0)])


class TreeBuilder:
    """Rows of the tables in construction.

    ``d``: numbers of a twist, 3 in the plane, 6 in space; ``made``: shapes of deforming bodies, which links may not
    have; ``w``: numbers of interactions; ``driven``: joints with prescribed courses; ``switches``: number of switches
    of loads' laws; ``acts``, ``ranges``: see :func:`list_acts`; ``cuts``: those of the joints that close loops,
    ``rows_of``: the rows of each of these, ``angles``: True for rows that are angles.
    """

    acts: np.ndarray
    ranges: tuple[int, ...]

    def __init__(self, numbers: Blocks | SpatialBlocks, driven: Sequence[str] = (), switches: int = 0) -> None:
        self.of_bodies, self.d, self.driven, self.switches = numbers, numbers.d, tuple(driven), switches
        self.mechanism = numbers.mechanism
        self.shapes, self.made = dict[str, Deformable](), dict[str, Deformable]()
        self.stations: dict[tuple[str, Place], int] = {}
        self.nodes: list[list[int]] = []
        self.numbers: list[np.ndarray] = []
        self.block, self.w = Numbers(), Numbers()
        self.own: dict[str, np.ndarray | None] = {}
        self.cuts, self.rows_of, self.angles = list[Row](), dict[str, slice](), list[bool]()
        self.carriers: list[tuple[int, np.ndarray]] = [(-1, np.zeros(3))]
        self.sections: dict[Side, int] = {Side(GROUND, ORIGIN): 0}
        self.axes: list[tuple[int, np.ndarray]] = []
        self.node_of = {GROUND: -1}
        self.tree: dict[str, tuple[tuple[int, ...], int]] = {}
        self.speeds: list[tuple[str, str]] = []
        self.positions: list[tuple[str, str]] = []

    def node(
        self, kind: int, parent: int, names: Names = (), positions: Names | None = None,
        rotation: np.ndarray | None = None, place: Sequence[float] | np.ndarray = ORIGIN,
        axis: Sequence[float] | np.ndarray = ORIGIN,
    ) -> int:  # fmt: skip
        """Add a node; ``names`` are those of its speeds, without shapes, ``positions`` of its coordinates."""
        row = np.zeros(3 * (3 if self.d == 3 else 6))
        if self.d == 6:
            row[:9] = np.eye(3).ravel() if rotation is None else np.ravel(rotation)
        row[PLACE], row[AXIS] = place, axis
        self.nodes.append([kind, parent, len(self.positions), len(self.speeds), -1, 0, -1, -1, -1, self.d == 6])
        self.numbers.append(row)
        self.speeds += names
        self.positions += names if positions is None else positions
        return len(self.nodes) - 1

    def body(self, name: str, node: int, at: Place, held: Place | None, freed: str = "") -> None:
        """Add the body of the last node of a chain, joined at a point in its axes.

        ``held``: the place where shapes are held, None for a mean; ``freed``: its axes, like "z", about which its
        section there turns relative to its floating axes.
        """
        self.numbers[node][SHIFT] = at
        if name in self.of_bodies.flexible:
            shapes = self.made[name] = self.of_bodies.flexible[name](held, freed)
            node = self.deforming(name, node, held, shapes) if shapes.count else node
        self.node_of[name] = node
        self.nodes[node][AXED] = 1
        self.own[name] = numbers = self.of_bodies.body(name, self.shapes.get(name))
        if numbers is not None:
            self.nodes[node][BODY] = self.block.put(numbers)

    def deforming(self, name: str, frame: int, held: Place | None, shapes: Deformable) -> int:
        """Add the node of a body's axes and modal coordinates, joined at the place of its axes that is held."""
        self.shapes[name] = shapes
        node = self.node(SHAPES, frame, *self.of_bodies.names(name, shapes))
        self.nodes[node][COUNT] = shapes.count
        if held is not None:
            place = shapes.carrier(held)
            self.stations[name, place] = frame  # its section there
            self.numbers[frame][SHIFT] -= place
            self.numbers[node][SHIFT] = place
            if any(part.any() for part in shapes.at(place)):
                self.nodes[node][AT] = self.block.put(self.of_bodies.station(shapes, *shapes.at(place)))
        return node

    def on(self, side: Side) -> tuple[int, np.ndarray]:
        """Node that carries a point of a body, and its place in that node's axes; on a deforming body a station."""
        at, arm = np.asarray(side.at, float), np.asarray(side.arm)
        if side.body not in self.shapes:
            return self.node_of[side.body], at + arm
        shapes = self.shapes[side.body]
        place = shapes.carrier(side.at)
        if (side.body, place) not in self.stations:
            self.stations[side.body, place] = self.station(side.body, place, shapes.at(place))
        return self.stations[side.body, place], at - place + arm

    def station(self, body: str, place: Place, shapes: tuple[np.ndarray, np.ndarray]) -> int:
        """Add the node of a place of a deforming body."""
        frame = self.node_of[body]
        node = self.node(STATION, frame, place=place)
        self.nodes[node][COORDINATE : SPEED + 1] = self.nodes[frame][COORDINATE : SPEED + 1]
        self.nodes[node][COUNT] = self.shapes[body].count
        self.nodes[node][AT] = self.block.put(self.of_bodies.station(self.shapes[body], *shapes))
        return node

    def section(self, side: Side) -> int:
        """Number of the section at a point of a body, which is added if it is new."""
        if side not in self.sections:
            self.sections[side] = len(self.carriers)
            self.carriers.append(self.on(side))
        return self.sections[side]

    def mean(self, body: str, rises: bool) -> int:
        """Add the mean section of a body, weighted by a load along it that falls or rises; returns its number.

        Shapes are affine in the mean, so the load's power equals that of its resultant there.
        """
        link = cast(Axis, self.shapes[body])  # loads are spread along axes only
        share, x, rows, G = link.spread(*((0.0, 1.0) if rises else (1.0, 0.0)))
        self.carriers.append((self.station(body, (x / share, 0.0, 0.0), (rows / share, G / share)), np.zeros(3)))
        return len(self.carriers) - 1

    def axis(self, side: Side, vector: np.ndarray) -> int:
        """Add an axis in a body's axes that turns with the section at a point; returns its number."""
        self.axes.append((self.on(side)[0], np.asarray(vector, float)))
        return len(self.axes) - 1

    def speed(self, joint: str) -> int:
        """First speed of a joint of the tree."""
        return self.nodes[leading(self.nodes, self.tree[joint])][SPEED]

    @property
    def courses(self) -> list[int]:
        """Coordinate that each course prescribes, or -1 for that of a cut."""
        return [self.speed(name) if name in self.tree else -1 for name in self.driven]

    @property
    def is_light(self) -> bool:
        """True if some body has no mass, or no inertia about some axis."""
        return any(map(self.of_bodies.is_light, self.own.values()))

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays of compiled functions by their names.

        nodes, numbers (n_nodes, 10), (n_nodes, 18), in the plane (n_nodes, 9); bodies (n_bodies, 8) with their joints
        of the tree, see :mod:`kaneflex.multibody.dynamics.articulated`, and their nodes frames (n_bodies, 5); joints,
        points (n_joints, 5), (n_joints, 3): all joints in the scene's order, and their second points in the axes of the
        nodes that carry these; on, at (n_sections,), (n_sections, 3): node (-1: the ground) of every section and the
        place of its point in that node's axes; axis_on, axis_at (n_axes,), (n_axes, 3): the same of axes, in space;
        gravity (3,); K, C: stiffness and damping of the shapes of every body, (count, count), one after the other.
        block: numbers of each body by BODY of ``kaneflex.generated.joints`` or ``spatial``, behind them those of its
        shapes by ``shapes`` or ``spatial_shapes``, and numbers of stations.
        """
        rows, points = list[tuple[int, ...]](), list[tuple[int, np.ndarray]]()
        for name, joint in self.mechanism.joints.items():
            nodes, sign = self.tree.get(name, ((-1,), 1))
            of_cut = self.rows_of.get(name, slice(0, 0))
            points.append(self.on(side_of(joint.sides[1])))
            rows.append((nodes[-1], sign, points[-1][0], of_cut.start, of_cut.stop))
        bodies, frames = self._bodies()
        found = {"bodies": bodies, "frames": frames, "joints": whole(rows, 5), "points": _apart(points)[1]}
        found |= {"nodes": whole(self.nodes, 10), "numbers": np.array(self.numbers), "block": self.block.whole}
        found |= {"gravity": np.array([*self.mechanism.gravity, 0.0][:3])}
        found |= dict(zip(("on", "at"), _apart(self.carriers), strict=True))
        found |= dict(zip(("axis_on", "axis_at"), _apart(self.axes), strict=True))
        shapes = [self.shapes[name] for name in self.node_of if name in self.shapes]
        found["K"], found["C"] = (np.concatenate([np.zeros(0), *(getattr(each, of).ravel() for each in shapes)])
                                  for of in ("stiffness", "damping"))  # fmt: skip
        return found

    @property
    def layout(self) -> Layout:
        """Names of the tables' entries."""
        nodes = {name: node for name, node in self.node_of.items() if name != GROUND}
        return Layout(nodes, self.stations, self.sections, self.shapes, self.tree, self.rows_of, tuple(self.speeds),
                      tuple(self.positions), self.driven)  # fmt: skip

    def _bodies(self) -> tuple[np.ndarray, np.ndarray]:
        """Bodies with their joints, and their nodes. Sets ROW_OF and OWNER of all nodes."""
        rows, frames, phi = list[list[int]](), list[list[int]](), 0
        coupling = square = 0
        begins, last = True, set(self.node_of.values())
        sign = {nodes[0]: side for nodes, side in self.tree.values()}
        for n, node in enumerate(self.nodes):
            parent = node[PARENT]
            if node[KIND] == STATION or node[AT] >= 0:
                node[ROW_OF], phi = phi, phi + node[COUNT]
            if node[KIND] == STATION:
                node[OWNER] = self.nodes[parent][OWNER]
                continue
            if begins:
                up, outboard = -1, -1
                if parent >= 0:
                    outboard = self.nodes[parent][ROW_OF] if self.nodes[parent][KIND] == STATION else -1
                    up = self.nodes[parent][OWNER]
                rows.append([0, 0, node[SPEED], node[SPEED], up, outboard, coupling, square])
                frames.append([n, parent, n, n, sign.get(n, 1)])
            node[OWNER] = len(rows) - 1
            shapes = node[COUNT] if node[KIND] == SHAPES else 0
            rows[-1][DOF] += SPEEDS[node[KIND]]
            if shapes:
                rows[-1][COUNTED], rows[-1][MODAL] = shapes, node[SPEED]
                coupling, square = coupling + shapes, square + shapes**2
            if node[AT] < 0:
                frames[-1][TWIST_NODE] = n
            frames[-1][AXES_NODE], begins = n, n in last
        return whole(rows, 8), whole(frames, 5)


def whole(rows: Sequence, columns: int) -> np.ndarray:
    """Rows of integers as an array."""
    return np.array(rows, int).reshape(-1, columns)


def _apart(carried: Sequence[tuple[int, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n,) of points or axes, and these in the nodes' axes, (n, 3)."""
    return np.array([node for node, _ in carried], int), np.array([each for _, each in carried]).reshape(-1, 3)
