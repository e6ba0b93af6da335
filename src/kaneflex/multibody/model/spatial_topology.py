"""Tables of a mechanism in space from its spanning tree of bodies and the joints that close its loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import Side, SpatialJoint, SpatialMechanism
from kaneflex.multibody.model.layout import DOF, FORCE_ALONG, MODAL, TORQUE, WHAT
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.spatial_layout import (
    AT,
    AXIS,
    BALL,
    BODY,
    COINCIDE,
    COORDINATE,
    COORDINATES,
    COUNT,
    FIXED,
    KIND,
    ON_PLANE,
    OWNER,
    PARENT,
    PERPENDICULAR,
    PLACE,
    RIGID,
    ROTATION,
    ROW_OF,
    ROWS,
    SHAPES,
    SHIFT,
    SLIDE,
    SPEED,
    SPEEDS,
    STATION,
    TURN,
    Axis,
    Deformable,
    Flexible,
    Layout,
    Place,
    Tables,
    carried,
)  # fmt: skip
from kaneflex.support.errors import SceneError

_ALIGNED = 1e-9
"""Components of an axis that count as zero."""


class _Maker:
    """Rows of the tables in construction."""

    def __init__(self, mechanism: SpatialMechanism, flexible: Flexible) -> None:
        self.mechanism, self.flexible = mechanism, flexible
        self.shapes: dict[str, Deformable] = {}
        self.stations: dict[tuple[str, Place], int] = {}
        self.nodes: list[list[int]] = []
        self.numbers: list[np.ndarray] = []
        self.p: list[np.ndarray] = []
        self.sections: list[tuple[int, np.ndarray]] = [(-1, np.zeros(3))]
        self.axes: list[tuple[int, np.ndarray]] = []
        self.node_of = {GROUND: -1}
        self.speeds: list[str] = []
        self.coordinates = 0

    def node(self, kind: int, parent: int, names: Sequence[str], rotation=None, place=None, axis=None) -> int:
        """Add a node; ``names`` are those of its speeds."""
        row = np.zeros(18)
        row[ROTATION:PLACE] = np.eye(3).ravel() if rotation is None else np.ravel(rotation)
        row[PLACE:AXIS] = 0.0 if place is None else place
        row[AXIS:SHIFT] = 0.0 if axis is None else axis
        self.nodes.append([kind, parent, self.coordinates, len(self.speeds), -1, 0, -1, -1, -1])
        self.numbers.append(row)
        self.coordinates += COORDINATES[kind]
        self.speeds += names
        return len(self.nodes) - 1

    def body(self, name: str, node: int, at: Sequence[float], freed: str = "") -> None:
        """Add the body of the last node of a chain, joined at a point in its axes.

        ``freed``: its axes, like "z", about which its section there turns relative to its floating axes.
        """
        self.numbers[node][SHIFT:] = at
        if name in self.flexible:
            node = self.deforming(name, node, None if name in self.mechanism.floating else tuple(map(float, at)), freed)
        self.node_of[name] = node
        body = self.mechanism.bodies[name]
        if body.mass or np.any(body.inertia):
            shapes = self.shapes[name].numbers() if name in self.shapes else np.zeros(0)
            self.nodes[node][BODY] = self.stored(np.concatenate([[body.mass], body.centre, body.inertia, shapes]))

    def deforming(self, name: str, frame: int, held: Place | None, freed: str) -> int:
        """Add the node of a body's axes and modal coordinates, joined at the place of its axes that is held."""
        shapes = self.shapes[name] = self.flexible[name](held, freed)
        node = self.node(SHAPES, frame, [f"{name}.shapes.{k}" for k in range(shapes.count)])
        self.nodes[node][COUNT] = shapes.count
        if held is not None:
            place = shapes.carrier(held)
            self.stations[name, place] = frame  # its section there
            self.numbers[frame][SHIFT:] -= place
            self.numbers[node][SHIFT:] = place
            if any(part.any() for part in shapes.at(place)):
                self.nodes[node][AT] = self.stored(_of_station(*shapes.at(place)))
        self.coordinates += shapes.count
        return node

    def stored(self, numbers: np.ndarray) -> int:
        """Append numbers to p; returns their place."""
        self.p.append(numbers)
        return sum(map(len, self.p)) - len(numbers)

    def on(self, side: Side) -> tuple[int, np.ndarray]:
        """Node that carries a point of a body, and its place in that node's axes; on a deforming body a station."""
        if side.body in self.shapes:
            shapes = self.shapes[side.body]
            place = shapes.carrier(side.at)
            if (side.body, place) not in self.stations:
                self.stations[side.body, place] = self.station(side.body, place, shapes.at(place))
        return carried(self, side)

    def station(self, body: str, place: Place, numbers: Sequence[np.ndarray]) -> int:
        """Add the node of a place of a deforming body."""
        frame = self.node_of[body]
        node = self.node(STATION, frame, (), place=place)
        self.nodes[node][COORDINATE : SPEED + 1] = self.nodes[frame][COORDINATE : SPEED + 1]
        self.nodes[node][COUNT] = self.shapes[body].count
        self.nodes[node][AT] = self.stored(_of_station(*numbers))
        return node

    def section(self, side: Side) -> int:
        """Add the section at a point of a body; returns its number."""
        self.sections.append(self.on(side))
        return len(self.sections) - 1

    def mean(self, body: str, rises: bool) -> int:
        """Add the mean section of a body, weighted by a load along it that falls or rises; returns its number.

        Shapes are affine in the mean, so the load's power equals that of its resultant there.
        """
        link = cast(Axis, self.shapes[body])  # loads are spread along axes only
        share, x, rows, G = link.spread(*((0.0, 1.0) if rises else (1.0, 0.0)))
        self.sections.append((self.station(body, (x / share, 0.0, 0.0), (rows / share, G / share)), np.zeros(3)))
        return len(self.sections) - 1

    def axis(self, side: Side, vector: np.ndarray) -> int:
        """Add an axis in a body's axes that turns with the section at a point; returns its number."""
        self.axes.append((self.on(side)[0], np.asarray(vector, float)))
        return len(self.axes) - 1


def build_tables(mechanism: SpatialMechanism, flexible: Flexible = RIGID) -> tuple[Tables, Layout]:
    """Tables of a mechanism at rest with open loops; ``flexible``: shapes of its deforming bodies.

    Raises
    ------
    SceneError
        If a body is not connected, its initial position is given twice, or too many coordinates of a loop are used.
    """
    maker, tree, cuts, closing = _Maker(mechanism, flexible), {}, [], dict[str, slice]()
    for name, child in spanning_tree(mechanism):
        if child < 0:
            _float(maker, name)
        else:
            tree[name] = (_hang(maker, mechanism.joints[name], child), 1 if child == 1 else -1)
    rows = 0
    for name, joint in mechanism.joints.items():
        if name in tree:
            continue
        if name in mechanism.asked:
            raise SceneError(
                f"joints.{name}", None,
                "drives, laws or springs use the coordinates of all joints of its loop",
                "Leave out a drive, a spring or a coordinate in a law at one joint of this loop",
            )  # fmt: skip
        found = _cut(maker, joint, rows)
        cuts += found
        closing[name] = slice(rows, rows := rows + sum(ROWS[row[WHAT]] for row in found))
    tables = _tables(maker, cuts, tree)
    nodes = {name: node for name, node in maker.node_of.items() if name != GROUND}
    return tables, Layout(nodes, maker.stations, maker.shapes, tree, closing, tuple(maker.speeds))


def spanning_tree(mechanism: SpatialMechanism) -> list[tuple[str, int]]:
    """Spanning tree from the ground outwards: joints with the number of the outer side, and free bodies, with -1.

    Joints whose coordinate a drive, a law or a spring uses come first, then those of sensors, then those of few
    freedoms, as cuts then have few rows.
    """
    group = {name: name for name in (GROUND, *mechanism.bodies)}
    chosen = []
    order = {name: (name not in mechanism.asked, name not in mechanism.read, joint.freedoms)
             for name, joint in mechanism.joints.items()}  # fmt: skip
    for name in sorted(order, key=order.__getitem__):
        first, second = (group[side.body] for side in mechanism.joints[name].sides)
        if first != second:
            chosen.append(name)
            group = {body: first if root == second else root for body, root in group.items()}
    _check_hanging(mechanism, group)
    found: list[tuple[str, int]] = []
    reached, waiting = {GROUND}, [name for name in mechanism.joints if name in chosen]
    for start in (GROUND, *mechanism.floating):
        if start != GROUND:
            found.append((start, -1))
            reached.add(start)
        while ready := [name for name in waiting if any(s.body in reached for s in mechanism.joints[name].sides)]:
            for name in ready:
                child = 0 if mechanism.joints[name].sides[1].body in reached else 1
                found.append((name, child))
                reached.add(mechanism.joints[name].sides[child].body)
            waiting = [name for name in waiting if name not in ready]
    return found


def _check_hanging(mechanism: SpatialMechanism, group: Mapping[str, str]) -> None:
    """Check that every body is connected to the ground, or to one free body."""
    parts: dict[str, list[str]] = {}
    for body in mechanism.bodies:
        parts.setdefault(group[body], []).append(body)
    for root, bodies in parts.items():
        free = [body for body in bodies if body in mechanism.floating]
        if root == group[GROUND] and free:
            reason = "joints to the ground already determine its position"
            raise SceneError(f"bodies.{free[0]}.free", None, reason, "Leave it out, or give initial speeds at drives")
        if root != group[GROUND] and len(free) != 1:
            if free:
                reason = f"joints connect it to {free[0]}, whose position is given, too"
                raise SceneError(f"bodies.{free[1]}.free", None, reason, "Leave one of them out")
            cure = "Join it to the ground, or let it move freely, like free = {at = [0, 0, 0]}"
            raise SceneError(f"bodies.{bodies[0]}", None, "it has neither a joint nor a position", cure)


def _hang(maker: _Maker, joint: SpatialJoint, child: int) -> tuple[int, ...]:
    """Nodes of a joint of the tree.

    Traversed from the second body, a joint's freedoms come in reverse order and with opposite sign.
    """
    bodies = maker.mechanism.bodies
    inner, outer = joint.sides[1 - child], joint.sides[child]
    relative = maker.mechanism.stands(inner.body).T @ bodies[outer.body].rotation
    own = np.eye(3) if child == 0 else relative.T  # from the first body's axes into the outer one's, at zero
    mechanism = maker.mechanism
    moves = [(TURN if name.startswith("angle") else BALL if name == "rotation" else SLIDE, name, own @ axis)
             for name, axis in joint.moves]  # fmt: skip
    if child == 0:
        moves = [(kind, name, -axis) for kind, name, axis in reversed(moves)]
    parent, at = maker.on(inner)
    nodes = list[int]()
    for k, (kind, name, axis) in enumerate(moves or [(FIXED, "", np.zeros(3))]):
        names = _speed_names(joint.name, kind, name)
        first = {"rotation": relative, "place": at} if k == 0 else {}
        parent = maker.node(kind, parent, names, axis=axis, **first)
        nodes.append(parent)
    maker.body(outer.body, parent, outer.at, "" if joint.name in mechanism.prescribed else _turned_about(moves))
    return tuple(nodes)


def _turned_about(moves: Sequence[tuple[int, str, np.ndarray]]) -> str:
    """Axes of a body about which its section at a joint turns relative to its floating axes: the joint's axis if it is
    one of the body's, all axes if the joint has several or another one."""
    turns = [axis for kind, _, axis in moves if kind == TURN]
    if len(turns) != 1:
        return "xyz" if turns or any(kind == BALL for kind, *_ in moves) else ""
    about = [name for name, along in zip("xyz", turns[0], strict=True) if abs(along) > _ALIGNED]
    return about[0] if len(about) == 1 else "xyz"


def _speed_names(owner: str, kind: int, name: str) -> list[str]:
    if kind == BALL:
        return [f"{owner}.omega_{axis}" for axis in "xyz"]
    return [] if kind == FIXED else [f"{owner}.{name}"]


def _float(maker: _Maker, name: str) -> None:
    """Nodes of a free body: three that slide along global axes, and a ball."""
    parent = -1
    for axis, row in zip("xyz", np.eye(3), strict=True):
        parent = maker.node(SLIDE, parent, [f"{name}.{axis}"], axis=row)
    stands = maker.mechanism.bodies[name].rotation
    node = maker.node(BALL, parent, _speed_names(name, BALL, ""), rotation=stands)
    maker.body(name, node, (0.0, 0.0, 0.0))


def _cut(maker: _Maker, joint: SpatialJoint, row: int) -> list[tuple[int, ...]]:
    """Elementary constraints of a joint that closes a loop, beginning with row ``row``."""
    first, second = (maker.section(side) for side in joint.sides)
    bodies, found = [side.body for side in joint.sides], list[tuple[int, ...]]()

    def axes(vectors: Sequence[np.ndarray], of: int) -> list[int]:
        """Axes from vectors in the first body's axes at zero, fixed in either body."""
        turned = maker.mechanism.stands(bodies[of]).T @ maker.mechanism.stands(bodies[0])
        return [maker.axis(joint.sides[of], turned @ vector) for vector in vectors]

    def add(what: int, axis: int = -1) -> None:
        nonlocal row
        found.append((what, first, second, -1, row, axis))
        row += ROWS[what]

    across, parallel = joint.across, joint.parallel
    if across is None:
        add(COINCIDE)
    else:
        for axis in axes(across, 0):
            add(ON_PLANE, axis)
    for one, other in parallel:
        add(PERPENDICULAR, min(axes([one], 0) + axes([other], 1)))
    return found


def _tables(maker: _Maker, cuts: list, tree: Mapping[str, tuple[tuple[int, ...], int]]) -> Tables:
    mechanism = maker.mechanism
    pushes, springs, stiffness, bushings, cushions = ([] for _ in range(5))
    for number, load in enumerate(mechanism.loads.values()):
        for k, (at, share) in enumerate(load.pushes):
            spread = load.is_spread and at.body in maker.shapes
            section = maker.mean(at.body, rises=k > 0) if spread else maker.section(at)
            turning = at if load.at is not None else Side(at.body, (0.0, 0.0, 0.0))
            turning = turning if load.in_body else Side(GROUND, (0.0, 0.0, 0.0))
            pushes.append([FORCE_ALONG, 0, section, number, maker.axis(turning, share * load.direction), -1])
        if load.joint is not None:
            joint = mechanism.joints[load.joint]
            sections = [maker.section(side) for side in joint.sides]
            pushes.append([TORQUE, *sections, number, maker.axis(joint.sides[0], joint.moves[0][1]), -1])
    for spring in mechanism.springs.values():
        if spring.is_bushing:
            sides = zip(spring.sides, (np.eye(3), mechanism.relative(spring)), strict=True)
            first, second = (min([maker.axis(side, axis) for axis in axes]) for side, axes in sides)
            bushings.append([*(maker.section(side) for side in spring.sides), first, second])
            cushions.append(spring.numbers)
            continue
        stiffness.append(spring.numbers)
        if spring.joint is None:
            springs.append([*(maker.section(side) for side in spring.sides), -1, -1])
        else:
            joint, speed = mechanism.joints[spring.joint], maker.nodes[tree[spring.joint][0][0]][SPEED]
            sections = [maker.section(side) for side in joint.sides]
            springs.append([*sections, maker.axis(joint.sides[0], joint.moves[0][1]), speed])
    bodies, frames = _bodies(maker)
    return Tables(
        _whole(maker.nodes, 9), np.array(maker.numbers).reshape(-1, 18), bodies, frames,
        np.concatenate([*maker.p, np.zeros(0)]),
        np.array([node for node, _ in maker.sections], int), np.array([at for _, at in maker.sections]).reshape(-1, 3),
        np.array([node for node, _ in maker.axes], int), np.array([axis for _, axis in maker.axes]).reshape(-1, 3),
        _whole(cuts, 6), _whole(pushes, 6), _whole(springs, 4), np.array(stiffness, float).reshape(-1, 3),
        _whole(bushings, 4), np.array(cushions, float).reshape(-1, 12),
        np.asarray(mechanism.gravity, float),
    )  # fmt: skip


def _bodies(maker: _Maker) -> tuple[np.ndarray, np.ndarray]:
    """Bodies with their joints, and their nodes. Sets ROW_OF and OWNER of all nodes."""
    rows, frames, phi = list[list[int]](), list[list[int]](), 0
    coupling = square = 0
    begins, last = True, set(maker.node_of.values())
    for n, node in enumerate(maker.nodes):
        parent = node[PARENT]
        if node[KIND] == STATION or node[AT] >= 0:
            node[ROW_OF], phi = phi, phi + node[COUNT]
        if node[KIND] == STATION:
            node[OWNER] = maker.nodes[parent][OWNER]
            continue
        if begins:
            up, outboard = -1, -1
            if parent >= 0:
                outboard = maker.nodes[parent][ROW_OF] if maker.nodes[parent][KIND] == STATION else -1
                up = maker.nodes[parent][OWNER]
            rows.append([0, 0, node[SPEED], node[SPEED], up, outboard, coupling, square])
            frames.append([n, parent, n])
        node[OWNER] = len(rows) - 1
        shapes = node[COUNT] if node[KIND] == SHAPES else 0
        rows[-1][DOF] += SPEEDS[node[KIND]]
        if shapes:
            rows[-1][COUNTED], rows[-1][MODAL] = shapes, node[SPEED]
            coupling, square = coupling + shapes, square + shapes**2
        if node[AT] < 0:
            frames[-1][2] = n
        frames[-1][0], begins = n, n in last
    return _whole(rows, 8), _whole(frames, 3)


def _of_station(rows: np.ndarray, G: np.ndarray) -> np.ndarray:
    """Numbers of a station: its rows of the shapes, and the columns of G that are not zero."""
    i, j = np.nonzero(np.tril(G.any(axis=0)))
    return np.concatenate([np.ravel(rows), [len(i)], np.column_stack([i, j, G[:, i, j].T]).ravel()])


def _whole(rows: Sequence, columns: int) -> np.ndarray:
    return np.array(rows, int).reshape(-1, columns)
