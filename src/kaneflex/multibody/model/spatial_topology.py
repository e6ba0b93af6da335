"""Tables of a mechanism in space from its spanning tree of bodies and the joints that close its loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import SpatialJoint, SpatialMechanism
from kaneflex.multibody.model.interactions import list_spatial_acts
from kaneflex.multibody.model.layout import DOF, MODAL, WHAT
from kaneflex.multibody.model.layout import SHAPES as COUNTED
from kaneflex.multibody.model.spatial_layout import (
    AT, BALL, COINCIDE, COUNT, FIXED, KIND, ON_PLANE, OWNER, PARENT, PERPENDICULAR, RIGID, ROW_OF, ROWS, SHAPES,
    SLIDE, SPEED, SPEEDS, STATION, TURN, Flexible, Layout, Tables,
)  # fmt: skip
from kaneflex.multibody.model.tree_builder import TreeBuilder, whole
from kaneflex.support.errors import SceneError

_ALIGNED = 1e-9
"""Components of an axis that count as zero."""


def build_tables(
    mechanism: SpatialMechanism, flexible: Flexible = RIGID, in_laws: Sequence[str] = (), switches: int = 0
) -> tuple[Tables, Layout]:
    """Tables of a mechanism at rest with open loops.

    ``flexible``: shapes of its deforming bodies; ``in_laws``: joints whose coordinates may occur in laws; ``switches``:
    number of switches of loads' laws.

    Raises
    ------
    SceneError
        If a body is not connected, its initial position is given twice, or too many coordinates of a loop are used.
    """
    builder, tree, cuts, closing = TreeBuilder(mechanism, flexible), {}, [], dict[str, slice]()
    for name, child in spanning_tree(mechanism):
        if child < 0:
            _float(builder, name)
        else:
            tree[name] = (_hang(builder, mechanism.joints[name], child), 1 if child == 1 else -1)
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
        found = _cut(builder, joint, rows)
        cuts += found
        closing[name] = slice(rows, rows := rows + sum(ROWS[row[WHAT]] for row in found))
    tables = _tables(builder, *list_spatial_acts(builder, cuts, tree, in_laws, switches))
    nodes = {name: node for name, node in builder.node_of.items() if name != GROUND}
    names = tuple(builder.speeds), tuple(builder.positions)
    return tables, Layout(nodes, builder.stations, builder.shapes, tree, closing, *names)


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


def _hang(builder: TreeBuilder, joint: SpatialJoint, child: int) -> tuple[int, ...]:
    """Nodes of a joint of the tree.

    Traversed from the second body, a joint's freedoms come in reverse order and with opposite sign.
    """
    bodies = builder.mechanism.bodies
    inner, outer = joint.sides[1 - child], joint.sides[child]
    relative = builder.mechanism.stands(inner.body).T @ bodies[outer.body].rotation
    own = np.eye(3) if child == 0 else relative.T  # from the first body's axes into the outer one's, at zero
    mechanism = builder.mechanism
    moves = [(TURN if name.startswith("angle") else BALL if name == "rotation" else SLIDE, name, own @ axis)
             for name, axis in joint.moves]  # fmt: skip
    if child == 0:
        moves = [(kind, name, -axis) for kind, name, axis in reversed(moves)]
    parent, at = builder.on(inner)
    nodes = list[int]()
    for k, (kind, name, axis) in enumerate(moves or [(FIXED, "", np.zeros(3))]):
        names = _speed_names(joint.name, kind, name)
        first = {"rotation": relative, "place": at} if k == 0 else {}
        parent = builder.node(kind, parent, names, axis=axis, **first)
        nodes.append(parent)
    builder.body(outer.body, parent, outer.at, "" if joint.name in mechanism.prescribed else _turned_about(moves))
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


def _float(builder: TreeBuilder, name: str) -> None:
    """Nodes of a free body: three that slide along global axes, and a ball."""
    parent = -1
    for axis, row in zip("xyz", np.eye(3), strict=True):
        parent = builder.node(SLIDE, parent, [f"{name}.{axis}"], axis=row)
    stands = builder.mechanism.bodies[name].rotation
    node = builder.node(BALL, parent, _speed_names(name, BALL, ""), rotation=stands)
    builder.body(name, node, (0.0, 0.0, 0.0))


def _cut(builder: TreeBuilder, joint: SpatialJoint, row: int) -> list[tuple[int, ...]]:
    """Elementary constraints of a joint that closes a loop, beginning with row ``row``."""
    first, second = (builder.section(side) for side in joint.sides)
    bodies, found = [side.body for side in joint.sides], list[tuple[int, ...]]()

    def axes(vectors: Sequence[np.ndarray], of: int) -> list[int]:
        """Axes from vectors in the first body's axes at zero, fixed in either body."""
        turned = builder.mechanism.stands(bodies[of]).T @ builder.mechanism.stands(bodies[0])
        return [builder.axis(joint.sides[of], turned @ vector) for vector in vectors]

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


def _tables(
    builder: TreeBuilder, acts: np.ndarray, ranges: tuple[int, ...], stiffness: np.ndarray, twisting: np.ndarray
) -> Tables:  # fmt: skip
    bodies, frames = _bodies(builder)
    return Tables(
        whole(builder.nodes, 10), np.array(builder.numbers).reshape(-1, 18), bodies, frames,
        np.concatenate([*builder.p, np.zeros(0)]),
        *_carriers(builder.sections), *_carriers(builder.axes),
        acts, ranges, stiffness, twisting, np.asarray(builder.mechanism.gravity, float),
    )  # fmt: skip


def _carriers(carried: Sequence[tuple[int, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n,) of points or axes, and these in the nodes' axes, (n, 3)."""
    return np.array([node for node, _ in carried], int), np.array([each for _, each in carried]).reshape(-1, 3)


def _bodies(builder: TreeBuilder) -> tuple[np.ndarray, np.ndarray]:
    """Bodies with their joints, and their nodes. Sets ROW_OF and OWNER of all nodes."""
    rows, frames, phi = list[list[int]](), list[list[int]](), 0
    coupling = square = 0
    begins, last = True, set(builder.node_of.values())
    for n, node in enumerate(builder.nodes):
        parent = node[PARENT]
        if node[KIND] == STATION or node[AT] >= 0:
            node[ROW_OF], phi = phi, phi + node[COUNT]
        if node[KIND] == STATION:
            node[OWNER] = builder.nodes[parent][OWNER]
            continue
        if begins:
            up, outboard = -1, -1
            if parent >= 0:
                outboard = builder.nodes[parent][ROW_OF] if builder.nodes[parent][KIND] == STATION else -1
                up = builder.nodes[parent][OWNER]
            rows.append([0, 0, node[SPEED], node[SPEED], up, outboard, coupling, square])
            frames.append([n, parent, n, n])
        node[OWNER] = len(rows) - 1
        shapes = node[COUNT] if node[KIND] == SHAPES else 0
        rows[-1][DOF] += SPEEDS[node[KIND]]
        if shapes:
            rows[-1][COUNTED], rows[-1][MODAL] = shapes, node[SPEED]
            coupling, square = coupling + shapes, square + shapes**2
        if node[AT] < 0:
            frames[-1][2] = n
        frames[-1][0], begins = n, n in last
    return whole(rows, 8), whole(frames, 4)
