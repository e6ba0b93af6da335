"""A mechanism as the tables that compiled recursions walk: a tree of bodies, its sections, and the cuts of its loops."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint

KIND, BLOCK, FIRST, DOF, JOINT, MODAL, SHAPES, PARENT, INBOARD, COURSE, SECTIONS, LAST, ROW, SQUARE, BODY_FIELDS = range(15)
"""Columns of ``Tree.bodies``: which pair of shape counts; where its block of numbers begins; its joint's first
coordinate, their count and the joint's kind; its first modal coordinate and their count; the section that it hangs on
and its own there; the course that prescribes its joint, or -1; its first section and the one after its last; where
its rows begin in vectors over all bodies' speeds, and its square in matrices."""
WELD, REVOLUTE, PRISMATIC, FREE, TURN, SLIDE = range(6)
"""Kinds of joints in the tree; cuts have the first three, and drives of cut joints the last two."""
OWNER, POINT, JACOBIAN, SECTION_FIELDS = range(4)
"""Columns of ``Tree.sections``: the body, or -1; where the point's block begins; where its W begins."""
AT, ON, CUT_COURSE, CUT_ROW, CUT_FIELDS = 1, 2, 3, 4, 5
"""Columns of ``Tree.cuts`` after the kind: first and second section, the course of a drive or -1, its first row."""

_KINDS = {"weld": WELD, "revolute": REVOLUTE, "prismatic": PRISMATIC}
ROWS = {WELD: 3, REVOLUTE: 2, PRISMATIC: 2, TURN: 1, SLIDE: 1}
"""Constraints of a cut by its kind."""
FORCE, FOLLOWER, TORQUE = range(3)
"""Kinds of loads: along a global direction, along one that turns with a section, between two sections."""


class Tree(NamedTuple):
    """Tables of one mechanism (int64 (n, fields), float64) for the compiled recursions.

    bodies, joints: of every body in the order of the tree, its fields and its inboard joint's numbers (sign, angle,
    direction in the parent section's axes [2], stiffness, damping). sections: the ground's first. cuts, guides: of
    every cut its fields, and direction and angle. drives: of every drive its coordinate in y or -1, its kind, its
    sections; its direction is in ``slides``. loads, directions; springs, rates: fields and numbers (k, c, free).
    blocks: numbers of bodies and points. fixed: poses of the ground's sections (x, y, theta). gravity [m/s^2].
    stiffness, damping: of every coordinate of y, what springs and modes hold it with.
    """

    bodies: np.ndarray
    joints: np.ndarray
    sections: np.ndarray
    cuts: np.ndarray
    guides: np.ndarray
    drives: np.ndarray
    slides: np.ndarray
    loads: np.ndarray
    directions: np.ndarray
    springs: np.ndarray
    rates: np.ndarray
    blocks: np.ndarray
    fixed: np.ndarray
    gravity: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray


class Layout(NamedTuple):
    """Names for what the tables count: bodies in the tree's order, sections, and each joint's place."""

    bodies: tuple[str, ...]
    inboard: tuple[str | None, ...]
    sections: Mapping[tuple[str, str], int]
    cuts: tuple[str, ...]
    coordinates: tuple[tuple[str, str], ...]


def build_tree(
    mechanism: Mechanism, counts: Mapping[str, Sequence[int]], block, point_block, kinds: Sequence[tuple[int, int]]
) -> tuple[Tree, Layout]:
    """The tables of a mechanism.

    Parameters
    ----------
    counts : mapping
        Body -> its numbers of axial and of transverse shapes.
    block, point_block : callable
        From a body, or from a body and a point's name, to its block of numbers.
    kinds : sequence
        The pairs of counts that there are.
    """
    order = _order(mechanism)
    sections = _sections(mechanism, order, counts)
    index = {key: k for k, key in enumerate(sections)}
    blocks: list[np.ndarray] = []
    filled = 0

    def put(numbers: np.ndarray) -> int:
        nonlocal filled
        blocks.append(numbers)
        filled += len(numbers)
        return filled - len(numbers)

    bodies = np.zeros((len(order), BODY_FIELDS), np.int64)
    joints = np.zeros((len(order), 6))
    table = np.full((len(sections), SECTION_FIELDS), -1, np.int64)
    prescribed = [name for name, drive in mechanism.drives.items() if not drive.free]
    names: list[tuple[str, str]] = []
    row = square = jacobian = 0
    for k, (body, joint, child) in enumerate(order):
        shapes = sum(counts.get(body, (0, 0))[:2])
        own = [n for n, (owner, _) in enumerate(sections) if owner == body]
        dof = 3 if joint is None else int(joint.kind != "weld")
        inboard = (body, "start") if joint is None else _key(joint.sides[child])
        parent = 0 if joint is None else index[_key(joint.sides[1 - child])]
        kind = FREE if joint is None else _KINDS[joint.kind]
        course = prescribed.index(joint.name) if joint is not None and joint.name in prescribed else -1
        pair = tuple(counts.get(body, (0, 0))[:2])
        bodies[k] = (
            kinds.index(pair), put(block(body)), len(names), dof, kind, len(names) + dof, shapes, parent,
            index[inboard], course, own[0], own[-1] + 1, row, square,
        )  # fmt: skip
        for n in own:
            table[n] = k, put(point_block(*sections[n])), jacobian
            jacobian += 3 * (3 + shapes)
        if joint is None:
            joints[k, 0] = 1.0
        else:
            joints[k] = _tree_joint(mechanism, joint, child)
        owner = body if joint is None else joint.name
        names += [(owner, str(j)) for j in range(dof)] + [(body, f"mode {j}") for j in range(shapes)]
        row += 3 + shapes
        square += (3 + shapes) ** 2
    fixed = np.array([(*_ground(mechanism, name), 0.0) for owner, name in sections if owner == GROUND])
    inboard_joints = [joint for _, joint, _ in order]
    cuts, guides, cut_names = _cuts(mechanism, inboard_joints, index, prescribed)
    drives, slides = _drives(mechanism, order, bodies, index)
    loads, directions = _loads(mechanism, index)
    springs, rates = _springs(mechanism, index)
    stiffness, damping = np.zeros(len(names)), np.zeros(len(names))
    for k in range(len(order)):
        if bodies[k, DOF] == 1:
            stiffness[bodies[k, FIRST]], damping[bodies[k, FIRST]] = joints[k, 4:6]
    tree = Tree(
        bodies, joints, table, cuts, guides, drives, slides, loads, directions, springs, rates,
        np.concatenate(blocks), fixed.ravel(), np.array(mechanism.gravity, float), stiffness, damping,
    )  # fmt: skip
    layout = Layout(
        tuple(body for body, _, _ in order), tuple(None if j is None else j.name for j in inboard_joints), index,
        tuple(cut_names), tuple(names),
    )  # fmt: skip
    return tree, layout


def _key(point: BodyPoint) -> tuple[str, str]:
    return point.body, point.name


def _order(mechanism: Mechanism) -> list[tuple[str, Joint | None, int]]:
    """Every body with its inboard joint (None: it floats freely) and which of the joint's sides is its own.

    From the ground outwards, over the joints that leave least open first: prescribed ones and welds, pins, guides. What
    no joint connects with the ground hangs on it by a free joint.
    """
    joints = list(mechanism.joints.values())

    def openness(joint: Joint) -> int:
        drive = mechanism.drives.get(joint.name)
        if joint.kind == "weld" or (drive is not None and not drive.free):
            return 0
        return 1 if drive is not None else 2

    found: list[tuple[str, Joint | None, int]] = []
    reached = [GROUND]
    waiting = list(mechanism.bodies)
    while waiting:
        for base in reached:  # grows while it is gone through: breadth first
            near = [joint for joint in joints if base in joint.bodies]
            for joint in sorted(near, key=openness):
                child = 1 if joint.first.body == base else 0
                body = joint.sides[child].body
                if body in waiting:
                    waiting.remove(body)
                    reached.append(body)
                    found.append((body, joint, child))
        if waiting:
            body = waiting.pop(0)
            found.append((body, None, 0))
            reached = [body]
    return found


def _sections(mechanism: Mechanism, order, counts) -> list[tuple[str, str]]:
    """(body, point) of every section, the ground's first, then body by body; spread loads have one of their own."""
    points = [side for joint in mechanism.joints.values() for side in joint.sides]
    points += [side for spring in mechanism.springs.values() for side in spring.sides]
    for load in mechanism.loads.values():
        points += [load.point] if load.point is not None else []
        points += [load.spread[0], BodyPoint(load.spread[0].body, f"loads.{load.name}", (0.0, 0.0))] if load.spread else []
    found = {(GROUND, "start"): None} | {_key(point): None for point in points if point.body == GROUND}
    for body, joint, _ in order:
        if joint is None:
            found[(body, "start")] = None
        found |= {_key(point): None for point in points if point.body == body}
    return list(found)


def _ground(mechanism: Mechanism, name: str) -> tuple[float, float]:
    points = [side for joint in mechanism.joints.values() for side in joint.sides]
    points += [side for spring in mechanism.springs.values() for side in spring.sides]
    return next((point.at for point in points if _key(point) == (GROUND, name)), (0.0, 0.0))


def _tree_joint(mechanism: Mechanism, joint: Joint, child: int) -> tuple[float, ...]:
    """Sign of the coordinate, angle and direction of the child's section in the parent's, and springs at the joint.

    Where the child is the joint's first body all is seen from its second: the direction turns back by the angle.
    """
    sign = 1.0 if child == 1 else -1.0
    angle = sign * float(joint.angle) if joint.kind != "revolute" else 0.0
    d = joint.direction
    if child == 0:
        c, s = math.cos(joint.angle), math.sin(joint.angle)
        d = (-(c * d[0] + s * d[1]), -(c * d[1] - s * d[0]))
    springs = [spring for spring in mechanism.springs.values() if spring.joint == joint.name]
    k, c_ = sum(float(s.stiffness) for s in springs), sum(float(s.damping) for s in springs)
    return sign, angle, float(d[0]), float(d[1]), k, c_


def _cuts(mechanism: Mechanism, inboard, index, prescribed) -> tuple[np.ndarray, np.ndarray, list[str]]:
    fields, guides, names, row = [], [], [], 0
    taken = {joint.name for joint in inboard if joint is not None}
    for joint in mechanism.joints.values():
        if joint.name in taken:
            continue
        kinds = [(_KINDS[joint.kind], -1)]
        if joint.name in prescribed:
            kinds.append((SLIDE if joint.slides else TURN, prescribed.index(joint.name)))
        for kind, course in kinds:
            fields.append((kind, *(index[_key(side)] for side in joint.sides), course, row))
            guides.append((*joint.direction, joint.angle if kind in (WELD, PRISMATIC) else 0.0))
            names.append(joint.name)
            row += ROWS[kind]
    return np.array(fields, np.int64).reshape(-1, CUT_FIELDS), np.array(guides, float).reshape(-1, 3), names


def _drives(mechanism: Mechanism, order, bodies, index) -> tuple[np.ndarray, np.ndarray]:
    place = {joint.name: int(bodies[k, FIRST]) for k, (_, joint, _) in enumerate(order) if joint is not None}
    fields, slides = [], []
    for name in mechanism.drives:
        joint = mechanism.joints[name]
        kind = SLIDE if joint.slides else TURN
        fields.append((place.get(name, -1), kind, *(index[_key(side)] for side in joint.sides)))
        slides.append(joint.direction)
    return np.array(fields, np.int64).reshape(-1, 4), np.array(slides, float).reshape(-1, 2)


def _loads(mechanism: Mechanism, index) -> tuple[np.ndarray, np.ndarray]:
    """Kind, section, and the section that the direction turns with, or the second one of a torque."""
    fields, directions = [], []
    for load in mechanism.loads.values():
        if load.joint is not None:
            first, second = (index[_key(side)] for side in mechanism.joints[load.joint].sides)
            fields.append((TORQUE, first, second))
            directions.append((0.0, 0.0))
            continue
        at = load.point if load.spread is None else load.spread[0]
        on = index[_key(at)] if load.spread is None else index[(at.body, f"loads.{load.name}")]
        fields.append((FORCE if load.axes == "global" else FOLLOWER, on, index[_key(at)]))
        directions.append(load.direction)
    return np.array(fields, np.int64).reshape(-1, 3), np.array(directions, float).reshape(-1, 2)


def _springs(mechanism: Mechanism, index) -> tuple[np.ndarray, np.ndarray]:
    """Whether it is torsional, its sections; stiffness, damping, free length or angle."""
    springs = mechanism.springs.values()
    fields = [(int(s.joint is not None), *(index[_key(side)] for side in s.sides)) for s in springs]
    rates = [(s.stiffness, s.damping, s.free) for s in springs]
    return np.array(fields, np.int64).reshape(-1, 3), np.array(rates, float).reshape(-1, 3)
