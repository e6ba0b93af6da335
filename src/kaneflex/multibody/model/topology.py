"""Tables of a mechanism from its spanning tree of bodies and the joints that close its loops."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import SpatialJoint, SpatialMechanism
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.body_parameters import Blocks, SpatialBlocks
from kaneflex.multibody.model.interactions import list_acts
from kaneflex.multibody.model.tree_builder import (
    ORIGIN,
    AnyMechanism,
    Branch,
    TreeBuilder,
    side_of,
)  # fmt: skip
from kaneflex.multibody.model.tree_layout import (
    ANGLES,
    BALL,
    COINCIDE,
    FIXED,
    FREE,
    ON_PLANE,
    PERPENDICULAR,
    SLIDE,
    TURN,
    Names,
)  # fmt: skip
from kaneflex.support.errors import SceneError

_ALIGNED = 1e-9
"""Components of an axis that count as zero."""
_CUTS = {"weld": (at.WELD, (False, False, True)), "revolute": (at.REVOLUTE, (False, False)),
         "prismatic": (at.PRISMATIC, (False, True))}  # fmt: skip
"""Joints that close loops in the plane: which of their rows are angles."""


def build_tables(
    numbers: Blocks | SpatialBlocks, in_laws: Sequence[str] = (), driven: Sequence[str] = (), switches: int = 0,
    rubs: bool = True,
) -> TreeBuilder:  # fmt: skip
    """Tables of a mechanism at rest with open loops.

    ``numbers``: of its bodies and shapes; ``in_laws``: joints whose coordinates may occur in laws; ``rubs``: with
    friction, whose joints then close loops, as friction depends on their reactions.

    Raises
    ------
    SceneError
        If a body is not connected, its initial position is given twice, or too many coordinates of a loop are used.
    """
    mechanism, builder = numbers.mechanism, TreeBuilder(numbers, driven, switches)
    tree = spanning_tree(mechanism, rubs)
    if isinstance(mechanism, SpatialMechanism):
        _check_hanging(mechanism)
    for body, name, child in tree:
        if name is None:
            _float(builder, body)
        else:
            _hang(builder, name, child)
    for name in mechanism.joints:
        if name not in builder.tree:
            _cut(builder, name, rubs)
    builder.acts, builder.ranges = list_acts(builder, in_laws, rubs)
    return builder


def spanning_tree(mechanism: AnyMechanism, rubs: bool = True) -> list[Branch]:
    """Spanning tree from the ground outwards, over the joints of lowest rank and then breadth first.

    Joints with friction come last, or never if it ``rubs``: cuts have their reactions, on which friction depends, as
    unknowns. A group of bodies that no joint holds is attached by a free joint at its body with a given position. In
    the plane a massless body at a free joint carries the next one if possible, as no leaf of a tree may be massless.
    """
    ranks = {name: _rank(mechanism, name, k) for k, name in enumerate(mechanism.joints)
             if not (rubs and name in mechanism.frictions)}  # fmt: skip
    found, light, last = list[Branch](), _massless(mechanism), ""
    reached, waiting = {GROUND: 0}, list(mechanism.bodies)
    while waiting:
        ready = list[tuple[str, str, int, str]]()
        for name in ranks:
            first, second = (side.body for side in mechanism.joints[name].sides)
            if (first in reached) != (second in reached):
                child = int(first in reached)
                ready.append((*((second, first) if child else (first, second)), child, name))
        onwards = [each for each in ready if each[1] == last]
        if onwards:
            body, _, child, name = min(onwards, key=lambda each: (each[0] in light, ranks[each[3]]))
        elif ready:
            body, _, child, name = min(ready, key=lambda each: (ranks[each[3]], reached[each[1]]))
        else:
            body, child, name = next((each for each in mechanism.floating if each in waiting), waiting[0]), 0, ""
        found.append((body, name or None, child))
        last = body if name and any(ranks[name]) and body in light else ""
        reached[body] = len(reached)
        waiting.remove(body)
    return found


def _rank(mechanism: AnyMechanism, name: str, place: int) -> tuple[int, ...]:
    """Rank of a joint: in the plane prescribed ones and welds, then other drives, then all others.

    In space those whose coordinate a drive, a law or a spring uses come first, then those of sensors, then those of few
    freedoms, as cuts then have few rows; those with friction come last. ``place``: in the order of the scene.
    """
    if isinstance(mechanism, SpatialMechanism):
        use = name in mechanism.frictions, name not in mechanism.asked, name not in mechanism.read
        return *use, mechanism.joints[name].freedoms, place
    drive = mechanism.drives.get(name)
    return (0 if mechanism.joints[name].kind == "weld" or (drive and not drive.free) else 1 if drive else 2,)


def _massless(mechanism: AnyMechanism) -> set[str]:
    """Bodies in the plane without mass and inertia."""
    if isinstance(mechanism, SpatialMechanism):
        return set()
    lumped = {mass.point.body for mass in mechanism.masses.values()}
    return {name for name, body in mechanism.bodies.items() if not (body.elastic or body.mass or body.inertia)} - lumped


def _check_hanging(mechanism: SpatialMechanism) -> None:
    """Check that every body is connected to the ground, or to one free body."""
    roots = {GROUND: GROUND}
    for body, name, child in spanning_tree(mechanism, rubs=False):
        roots[body] = body if name is None else roots[mechanism.joints[name].sides[1 - child].body]
        if name is None and body not in mechanism.floating:
            cure = "Join it to the ground, or let it move freely, like free = {at = [0, 0, 0]}"
            reason = "no joint without clearance connects it to the ground, and it has no position"
            raise SceneError(f"bodies.{body}", None, reason, cure)
    for body in mechanism.floating:
        if roots[body] == GROUND:
            reason = "joints to the ground already determine its position"
            raise SceneError(f"bodies.{body}.free", None, reason, "Leave it out, or give initial speeds at drives")
        if roots[body] != body:
            reason = f"joints connect it to {roots[body]}, whose position is given, too"
            raise SceneError(f"bodies.{body}.free", None, reason, "Leave one of them out")


def _in_space(mechanism: AnyMechanism, name: str) -> tuple[SpatialJoint, np.ndarray, float]:
    """Joint in space, axes of its second body in those of the first at zero coordinates (3, 3), and in the plane their
    angle [rad]."""
    if isinstance(mechanism, SpatialMechanism):
        return mechanism.joints[name], mechanism.relative(mechanism.joints[name]), 0.0
    joint = mechanism.joints[name]
    angle = 0.0 if joint.kind == "revolute" else float(joint.angle)
    c, s = math.cos(angle), math.sin(angle)
    axes = {"revolute": [np.array([0.0, 0.0, 1.0])], "prismatic": [np.array([*joint.direction, 0.0])]}
    first, second = map(side_of, joint.sides)
    found = SpatialJoint(name, joint.kind, (first, second), tuple(axes.get(joint.kind, ())))
    return found, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), angle


def _hang(builder: TreeBuilder, name: str, child: int) -> None:
    """Add the nodes of a joint of the tree, and its outer body.

    Traversed from the second body, a joint's freedoms come in reverse order and with opposite sign.
    """
    joint, relative, angle = _in_space(builder.mechanism, name)
    inner, outer = joint.sides[1 - child], joint.sides[child]
    own = np.eye(3) if child == 0 else relative.T  # from the first body's axes into the outer one's, at zero
    moves = [(TURN if move.startswith("angle") else BALL if move == "rotation" else SLIDE, move, own @ axis)
             for move, axis in joint.moves]  # fmt: skip
    if child == 0:
        moves = [(kind, move, -axis) for kind, move, axis in reversed(moves)]
        relative, angle = relative.T, -angle
    parent, place = builder.on(inner)
    rotation, place, nodes = relative, place + np.array([0.0, 0.0, angle]), list[int]()
    for kind, move, axis in moves or [(FIXED, "", np.zeros(3))]:
        parent = builder.node(kind, parent, *_names(name, kind, move), rotation, place, axis)
        rotation, place = np.eye(3), np.zeros(3)
        nodes.append(parent)
    builder.tree[name] = tuple(nodes), 1 if child == 1 else -1
    builder.body(outer.body, parent, outer.at, outer.at, "" if name in builder.driven else _turned_about(moves))


def _turned_about(moves: Sequence[tuple[int, str, np.ndarray]]) -> str:
    """Axes of a body about which its section at a joint turns relative to its floating axes: the joint's axis if it is
    one of the body's, all axes if the joint has several or another one."""
    turns = [axis for kind, _, axis in moves if kind == TURN]
    if len(turns) != 1:
        return "xyz" if turns or any(kind == BALL for kind, *_ in moves) else ""
    about = [name for name, along in zip("xyz", turns[0], strict=True) if abs(along) > _ALIGNED]
    return about[0] if len(about) == 1 else "xyz"


def _names(owner: str, kind: int, name: str) -> tuple[Names, Names]:
    """Speeds and coordinates of a node of a joint or of a free body in space."""
    if kind == BALL:
        return ([(f"{owner}.omega_{axis}", "rad") for axis in "xyz"],
                [(f"{owner}.quaternion_{part}", "1") for part in "wxyz"])  # fmt: skip
    found = [] if kind == FIXED else [(f"{owner}.{name}", "m" if kind == SLIDE else "rad")]
    return found, found


def _float(builder: TreeBuilder, name: str) -> None:
    """Nodes of a free body: in the plane one, in space three that slide along global axes, and a ball."""
    if not isinstance(builder.mechanism, SpatialMechanism):
        names = [(f"{name}.{part}", unit) for part, unit in (("x", "m"), ("y", "m"), ("phi", "rad"))]
        builder.body(name, builder.node(FREE, -1, names), ORIGIN, ORIGIN)
        return
    parent = -1
    for axis, row in zip("xyz", np.eye(3), strict=True):
        parent = builder.node(SLIDE, parent, *_names(name, SLIDE, axis), axis=row)
    node = builder.node(BALL, parent, *_names(name, BALL, ""), builder.mechanism.bodies[name].rotation)
    builder.body(name, node, ORIGIN, None)


def _cut(builder: TreeBuilder, name: str, rubs: bool) -> None:
    """Add the elementary constraints of a joint that closes a loop, in the plane also of its course, if any."""
    mechanism, angles = builder.mechanism, builder.angles
    sections = [builder.section(side_of(side)) for side in mechanism.joints[name].sides]
    rows = list[tuple[int, int, int, Sequence[bool]]]()
    if isinstance(mechanism, SpatialMechanism):
        if name in mechanism.asked and not (rubs and name in mechanism.frictions):
            raise SceneError(
                f"joints.{name}", None,
                "drives, laws, springs or clearances use the coordinates of all joints of its loop",
                "Leave out a drive, a spring, a clearance or a coordinate in a law at one joint of this loop",
            )  # fmt: skip
        rows += [(what, -1, axis, ANGLES[what]) for what, axis in _constraints(builder, mechanism, name)]
    else:
        joint, put = mechanism.joints[name], builder.w.put
        what, are_angles = _CUTS[joint.kind]
        place = put([*joint.direction, joint.angle if joint.kind != "revolute" else 0.0])
        rows.append((what, -1, place, are_angles))
        if name in builder.driven:
            kind, course = at.SLIDE if joint.slides else at.TURN, builder.driven.index(name)
            rows.append((kind, course, put([*joint.direction, 0.0]), (not joint.slides,)))
    first = len(angles)
    for kind, of, place, each in rows:
        builder.cuts.append((kind, *sections, of, len(angles), place))
        angles.extend(each)
    builder.rows_of[name] = slice(first, len(angles))


def _constraints(builder: TreeBuilder, mechanism: SpatialMechanism, name: str) -> Iterator[tuple[int, int]]:
    """Kind and axis of the elementary constraints of a joint in space."""
    joint = mechanism.joints[name]
    bodies = [side.body for side in joint.sides]

    def axes(vectors: Sequence[np.ndarray], of: int) -> list[int]:
        """Axes from vectors in the first body's axes at zero, fixed in either body."""
        turned = mechanism.rest_axes(bodies[of]).T @ mechanism.rest_axes(bodies[0])
        return [builder.axis(joint.sides[of], turned @ vector) for vector in vectors]

    if joint.across is None:
        yield COINCIDE, -1
    else:
        yield from ((ON_PLANE, axis) for axis in axes(joint.across, 0))
    for one, other in joint.parallel:
        yield PERPENDICULAR, min(axes([one], 0) + axes([other], 1))
