"""Tables of a mechanism in space from its spanning tree of bodies and the joints that close its loops."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import SpatialJoint, SpatialMechanism
from kaneflex.multibody.model.interactions import list_spatial_acts
from kaneflex.multibody.model.layout import WHAT
from kaneflex.multibody.model.tree_builder import ORIGIN, Built, Names, TreeBuilder
from kaneflex.multibody.model.tree_layout import (
    ANGLES, BALL, COINCIDE, FIXED, ON_PLANE, PERPENDICULAR, RIGID, SLIDE, TURN, Flexible,
)  # fmt: skip
from kaneflex.support.errors import SceneError

_ALIGNED = 1e-9
"""Components of an axis that count as zero."""
_LIGHT = 1e-9
"""Ratio of principal moments of inertia below which the smaller one counts as none."""


class SpatialBuilder(TreeBuilder):
    """Rows of the tables of a mechanism in space in construction."""

    d = 6

    def __init__(self, mechanism: SpatialMechanism, flexible: Flexible) -> None:
        super().__init__(flexible)
        self.mechanism = mechanism

    def numbers_of_body(self, name: str) -> np.ndarray | None:
        body = self.mechanism.bodies[name]
        if not (body.mass or np.any(body.inertia)):
            return None
        shapes = self.shapes[name].numbers() if name in self.shapes else np.zeros(0)
        return np.concatenate([[body.mass], body.centre, body.inertia, shapes])

    def numbers_of_station(self, body: str, rows: np.ndarray, G: np.ndarray) -> np.ndarray:
        """Rows of the shapes, and the columns of G that are not zero."""
        i, j = np.nonzero(np.tril(G.any(axis=0)))
        return np.concatenate([np.ravel(rows), [len(i)], np.column_stack([i, j, G[:, i, j].T]).ravel()])

    def shape_names(self, body: str) -> tuple[Names, Names]:
        units = ["rad" if twists else "m" for twists in self.shapes[body].twisting]
        return ([(f"{body}.shapes.{k}", unit) for k, unit in enumerate(units)],
                [(f"{body}.shape_{k}", unit) for k, unit in enumerate(units)])  # fmt: skip


def build_tables(
    mechanism: SpatialMechanism, flexible: Flexible = RIGID, in_laws: Sequence[str] = (), driven: Sequence[str] = (),
    switches: int = 0, rubs: bool = True,
) -> Built:  # fmt: skip
    """Tables of a mechanism at rest with open loops.

    ``flexible``: shapes of its deforming bodies; ``in_laws``: joints whose coordinates may occur in laws; ``driven``:
    joints with prescribed courses; ``switches``: number of switches of loads' laws; ``rubs``: with friction, whose
    joints then close loops, as friction depends on their reactions.

    Raises
    ------
    SceneError
        If a body is not connected, its initial position is given twice, or too many coordinates of a loop are used.
    """
    builder, cuts, closing, row = SpatialBuilder(mechanism, flexible), list[tuple[int, ...]](), dict[str, slice](), 0
    for name, child in spanning_tree(mechanism, rubs):
        if child < 0:
            _float(builder, name)
        else:
            _hang(builder, mechanism.joints[name], child)
    for name, joint in mechanism.joints.items():
        if name in builder.tree:
            continue
        if name in mechanism.asked and not (rubs and name in mechanism.frictions):
            raise SceneError(
                f"joints.{name}", None,
                "drives, laws, springs or clearances use the coordinates of all joints of its loop",
                "Leave out a drive, a spring, a clearance or a coordinate in a law at one joint of this loop",
            )  # fmt: skip
        found = _cut(builder, joint, row)
        cuts += found
        closing[name] = slice(row, row := row + sum(len(ANGLES[each[WHAT]]) for each in found))
    acts = list_spatial_acts(builder, mechanism, (cuts, closing), in_laws, switches, rubs)
    shapes = [builder.shapes.get(name) for name in builder.node_of if name != GROUND]
    K, C = ([np.zeros(0) if each is None else getattr(each, of) for each in shapes] for of in ("stiffness", "damping"))
    rigid = any(contact.law == "newton" for contact in mechanism.contacts.values())
    inertias = [(body.mass, *body.inertia[:3]) for body in mechanism.bodies.values()]
    light = any(mass <= 0.0 or min(axes) <= _LIGHT * max(axes) for mass, *axes in inertias)
    seconds = {name: joint.sides[1] for name, joint in mechanism.joints.items()}
    return Built(
        builder.tables(acts, mechanism.gravity, seconds), builder.layout(closing, driven), builder.w,
        [builder.speed(name) for name in driven], acts.angles, mechanism.size, switches, K, C, rigid, light=light,
    )  # fmt: skip


def spanning_tree(mechanism: SpatialMechanism, rubs: bool = True) -> list[tuple[str, int]]:
    """Spanning tree from the ground outwards: joints with the number of the outer side, and free bodies, with -1.

    Joints whose coordinate a drive, a law or a spring uses come first, then those of sensors, then those of few
    freedoms, as cuts then have few rows. Those with friction come last, or never if it ``rubs``: where they alone hold
    a group of bodies, its first body moves freely, too.
    """
    order = {name: (name in mechanism.frictions, name not in mechanism.asked, name not in mechanism.read,
                    joint.freedoms) for name, joint in mechanism.joints.items()}  # fmt: skip
    inner, chosen = {name: name for name in (GROUND, *mechanism.bodies)}, list[str]()
    for name in sorted(order, key=order.__getitem__):
        if rubs and name in mechanism.frictions:
            continue
        first, second = (inner[side.body] for side in mechanism.joints[name].sides)
        if first != second:
            chosen.append(name)
            inner = _merged(inner, first, second)
    outer = inner
    for joint in mechanism.joints.values():
        outer = _merged(outer, *(outer[side.body] for side in joint.sides))
    _check_hanging(mechanism, outer)
    held = {inner[name] for name in (GROUND, *mechanism.floating)}
    loose = {inner[name]: name for name in reversed(list(mechanism.bodies)) if inner[name] not in held}.values()
    found: list[tuple[str, int]] = []
    reached, waiting = {GROUND}, [name for name in mechanism.joints if name in chosen]
    for start in (GROUND, *mechanism.floating, *loose):
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


def _merged(group: Mapping[str, str], first: str, second: str) -> dict[str, str]:
    """Groups of bodies with two of them joined."""
    return {body: first if root == second else root for body, root in group.items()}


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


def _hang(builder: SpatialBuilder, joint: SpatialJoint, child: int) -> None:
    """Add the nodes of a joint of the tree, and its outer body.

    Traversed from the second body, a joint's freedoms come in reverse order and with opposite sign.
    """
    mechanism = builder.mechanism
    inner, outer = joint.sides[1 - child], joint.sides[child]
    relative = mechanism.stands(inner.body).T @ mechanism.bodies[outer.body].rotation
    own = np.eye(3) if child == 0 else relative.T  # from the first body's axes into the outer one's, at zero
    moves = [(TURN if name.startswith("angle") else BALL if name == "rotation" else SLIDE, name, own @ axis)
             for name, axis in joint.moves]  # fmt: skip
    if child == 0:
        moves = [(kind, name, -axis) for kind, name, axis in reversed(moves)]
    parent, at = builder.on(inner)
    nodes = list[int]()
    for k, (kind, name, axis) in enumerate(moves or [(FIXED, "", np.zeros(3))]):
        rotation, place = (relative, at) if k == 0 else (None, ORIGIN)
        parent = builder.node(kind, parent, *_names(joint.name, kind, name), rotation, place, axis)
        nodes.append(parent)
    builder.tree[joint.name] = tuple(nodes), 1 if child == 1 else -1
    freed = "" if joint.name in mechanism.prescribed else _turned_about(moves)
    builder.body(outer.body, parent, outer.at, outer.at, freed)


def _turned_about(moves: Sequence[tuple[int, str, np.ndarray]]) -> str:
    """Axes of a body about which its section at a joint turns relative to its floating axes: the joint's axis if it is
    one of the body's, all axes if the joint has several or another one."""
    turns = [axis for kind, _, axis in moves if kind == TURN]
    if len(turns) != 1:
        return "xyz" if turns or any(kind == BALL for kind, *_ in moves) else ""
    about = [name for name, along in zip("xyz", turns[0], strict=True) if abs(along) > _ALIGNED]
    return about[0] if len(about) == 1 else "xyz"


def _names(owner: str, kind: int, name: str) -> tuple[Names, Names]:
    """Speeds and coordinates of a node of a joint or of a free body."""
    if kind == BALL:
        return ([(f"{owner}.omega_{axis}", "rad") for axis in "xyz"],
                [(f"{owner}.quaternion_{part}", "1") for part in "wxyz"])  # fmt: skip
    found = [] if kind == FIXED else [(f"{owner}.{name}", "m" if kind == SLIDE else "rad")]
    return found, found


def _float(builder: SpatialBuilder, name: str) -> None:
    """Nodes of a free body: three that slide along global axes, and a ball."""
    parent = -1
    for axis, row in zip("xyz", np.eye(3), strict=True):
        parent = builder.node(SLIDE, parent, *_names(name, SLIDE, axis), axis=row)
    node = builder.node(BALL, parent, *_names(name, BALL, ""), builder.mechanism.bodies[name].rotation)
    builder.body(name, node, ORIGIN, None)


def _cut(builder: SpatialBuilder, joint: SpatialJoint, row: int) -> list[tuple[int, ...]]:
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
        row += len(ANGLES[what])

    across, parallel = joint.across, joint.parallel
    if across is None:
        add(COINCIDE)
    else:
        for axis in axes(across, 0):
            add(ON_PLANE, axis)
    for one, other in parallel:
        add(PERPENDICULAR, min(axes([one], 0) + axes([other], 1)))
    return found
