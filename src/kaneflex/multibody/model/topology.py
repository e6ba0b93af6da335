"""Tables of a planar mechanism for compiled recursions: a tree of bodies, its sections, the cuts of its loops."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model import spatial_layout as of
from kaneflex.multibody.model.body_parameters import Blocks
from kaneflex.multibody.model.interactions import (
    KINDS,
    ROWS,
    Branch,
    Numbers,
    Sections,
    key_of,
    list_acts,
    virtual_inertias,
)  # fmt: skip
from kaneflex.multibody.model.places import Counts, assign, assign_rows

_NODES = {at.WELD: of.FIXED, at.REVOLUTE: of.TURN, at.PRISMATIC: of.SLIDE, at.FREE: of.FREE}
"""Node of a joint by its kind."""
_FIRST_SHAPE = 2
"""Place of the numbers of the first shape among those of a point, see ``kaneflex.generated.body``."""


@dataclass(frozen=True)
class Layout:
    """Names of the tables' entries.

    Attributes
    ----------
    bodies : tuple of str
        In the order of the tree.
    inboard : tuple of (str or None, int)
        Of every body its inboard joint and which side of it is the body's.
    carriers : mapping
        (body, point) -> the node that carries it, -1 on the ground, and its place in that node's axes [m].
    sections : mapping
        (body, point) -> its number, of points with cut joints, springs, contacts and loads.
    cuts : tuple of str
        Joint of every cut; a driven one is there twice.
    coordinates : tuple of (str, str)
        Name and unit of every coordinate: JOINT.angle or JOINT.position, of a body on no joint BODY.x, BODY.y and
        BODY.phi, then BODY.axial_K and BODY.transverse_K.
    driven : tuple of str
        Joints whose courses are prescribed, those with given courses last.
    """

    bodies: tuple[str, ...]
    inboard: tuple[tuple[str | None, int], ...]
    carriers: Mapping[tuple[str, str], tuple[int, tuple[float, float]]]
    sections: Mapping[tuple[str, str], int]
    cuts: tuple[str, ...]
    coordinates: tuple[tuple[str, str], ...]
    driven: tuple[str, ...]


class Built(NamedTuple):
    """Tables of a mechanism, their names, and the length of the arrays of factors; tables of nodes and sections by
    their names; places in w, and lengths, of the arrays that compiled functions fill."""

    tables: at.Tables
    layout: Layout
    size: int
    nodes: Mapping[str, np.ndarray]
    views: Mapping[str, tuple[int, int]]


def build_tables(
    mechanism: NumericMechanism, counts: Mapping[str, Sequence[int]], blocks: Blocks, measure: float, switches: int = 0
) -> Built:  # fmt: skip
    """Tables of a mechanism at rest with open loops.

    Parameters
    ----------
    counts : mapping
        Body -> its numbers of axial and of transverse shapes.
    measure : float
        Unit of lengths [m].
    switches : int
        Number of switches of loads' laws.
    """
    order = _order(mechanism)
    prescribed, numbers, nodes, index = _prescribed(mechanism), Numbers(), _Nodes(), Sections()
    for point in (BodyPoint(GROUND, "start", (0.0, 0.0)), *_points(mechanism)):
        if point.body == GROUND:
            nodes.stand(key_of(point), -1, (float(point.at[0]), float(point.at[1])))
    bodies, coordinates, hold, damping, driven = _build_bodies(mechanism, order, counts, blocks, numbers, nodes)
    virtual = virtual_inertias(mechanism, order, index, bodies, numbers.parts, measure)
    acts, ranges, cut_names = list_acts(mechanism, order, bodies, index, prescribed, numbers, virtual, switches)
    counted = Counts(
        3, bodies[:, at.SHAPES].tolist(), len(coordinates), len(index), nodes.twists,
        tuple(ranges), sum(ROWS[int(kind)] for kind in acts[: ranges[1], at.WHAT]), driven, switches,
        any(contact.law == "newton" for contact in mechanism.contacts.values()),
    )  # fmt: skip
    plan, size = assign(counted, numbers)
    assign_rows(plan, acts)
    plan[at.GRAVITY] = numbers.put(mechanism.gravity)
    plan[at.DAMPED] = numbers.put(np.concatenate(damping))
    plan[at.STIFFNESS], plan[at.DAMPING] = (numbers.put([each[k] for each in hold]) for k in range(2))
    plan[at.MEASURE] = numbers.put([1.0 if unit == "rad" else measure for _, unit in coordinates])
    plan[[at.PUSHES, at.PUSHED]] = ranges[6], len(acts)
    views = _views(plan, counted, nodes, numbers)
    w = np.concatenate(numbers.parts)
    w[plan[at.TOUCH] + at.EXTENT] = measure or 1.0
    on, places = np.array([nodes.carriers[key][0] for key in index]), np.zeros((len(index), 3))
    places[:, :2] = [nodes.carriers[key][1] for key in index]
    sections = w[plan[at.SECTION] : plan[at.SECTION] + at.SEC * len(index)].reshape(-1, at.SEC)
    sections[on < 0, :3] = places[on < 0]
    held = tuple((None if joint is None else joint.name, child) for _, joint, child in order)
    layout = Layout(tuple(body for body, *_ in order), held, nodes.carriers, dict(index),
                    *map(tuple, (cut_names, coordinates, prescribed)))  # fmt: skip
    tables = {
        "counts": np.array([len(nodes.rows), len(coordinates), 0, len(index), 0, len(order), 0, nodes.twists, 0, 0, 0]),
        "nodes": np.array(nodes.rows), "numbers": np.array(nodes.numbers), "frames": np.array(nodes.frames),
        "on": on, "at": places,
    }  # fmt: skip
    return Built(at.Tables(plan, bodies, acts, w), layout, size, tables, views)


def _prescribed(mechanism: Mechanism) -> list[str]:
    """Joints whose courses are prescribed: by laws, then those given at instants."""
    names = [name for name, drive in mechanism.drives.items() if not drive.free]
    return sorted(names, key=lambda name: mechanism.drives[name].kind == "given")


class _Bodies(NamedTuple):
    """Rows of bodies, coordinates with stiffness and damping, damping of shapes; coordinate of every prescribed drive,
    or -1 in a cut."""

    bodies: np.ndarray
    coordinates: list[tuple[str, str]]
    hold: list[tuple[float, float]]
    damping: list[np.ndarray]
    driven: list[int]


_Point = tuple[tuple[float, float], np.ndarray]
"""Place of a point in its body's axes [m], and its numbers for the kernels."""


class _Nodes:
    """Nodes of the tree and its sections in construction: see :mod:`kaneflex.multibody.model.spatial_layout`."""

    def __init__(self) -> None:
        self.rows: list[list[int]] = []
        self.carriers: dict[tuple[str, str], tuple[int, tuple[float, float]]] = {}
        self.numbers: list[np.ndarray] = []
        self.frames: list[tuple[int, int, int, int]] = []
        self.twists = 0

    def add(self, kind: int, parent: int, speed: int, owner: int, place: Sequence[float]) -> int:
        """Add a node at a place of its parent's axes, with their angle in it."""
        self.rows.append([kind, parent, 0, speed, -1, 0, -1, -1, owner, 0])
        self.numbers.append(np.array([place, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]))
        return len(self.rows) - 1

    def carry(self, node: int, block: int, shift: tuple[float, float]) -> None:
        """Let a node have a body's axes, with its joint at ``shift`` in them."""
        self.rows[node][of.BODY], self.rows[node][of.AXED] = block, 1
        self.numbers[node][2, :2] = shift

    def deform(self, node: int, count: int, point: int, moves: bool) -> None:
        """Let shapes move a node by the numbers of a point."""
        row = self.rows[node]
        row[of.COUNT] = count
        if moves:
            row[of.AT], row[of.ROW_OF], self.twists = point, self.twists, self.twists + count

    def stand(self, point: tuple[str, str], node: int, place: tuple[float, float]) -> None:
        """Let a node carry a point at a place in its axes."""
        self.carriers[point] = node, place

    def row_of(self, node: int) -> int:
        return self.rows[node][of.ROW_OF] if node >= 0 else -1


def _build_bodies(
    mechanism: Mechanism, order: Sequence[Branch], counts: Mapping[str, Sequence[int]], blocks: Blocks,
    numbers: Numbers, nodes: _Nodes,
) -> _Bodies:  # fmt: skip
    points = {body: {(body, "start"): None} if joint is None else {} for body, joint, _ in order}
    for key in map(key_of, _points(mechanism)):
        points.get(key[0], {})[key] = None
    coordinates: list[tuple[str, str]] = []
    units: tuple[str, ...]
    prescribed, dampings = _prescribed(mechanism), list[np.ndarray]()
    bodies = np.zeros((len(order), at.NUMBERS + 1), np.int64)
    hold, square, coupling, driven = list[tuple[float, float]](), 0, 0, [-1] * len(prescribed)
    for k, (body, joint, child) in enumerate(order):
        axial, transverse = counts.get(body, (0, 0))[:2]
        shapes = axial + transverse
        stiffness, damping = blocks.elastic(body)
        joint_numbers, held, kind = (1.0, 0.0, 1.0, 0.0), [(0.0, 0.0)] * 3, at.FREE
        units, inboard, parent = ("m", "m", "rad"), (body, "start"), (GROUND, "start")
        if joint is not None:
            kind, inboard, parent = KINDS[joint.kind], key_of(joint.sides[child]), key_of(joint.sides[1 - child])
            units = {at.WELD: (), at.REVOLUTE: ("rad",), at.PRISMATIC: ("m",)}[kind]
            if joint.name in prescribed:
                driven[prescribed.index(joint.name)] = len(coordinates)
            joint_numbers, held = _tree_joint(joint, child), [_holding(mechanism, joint)] * len(units)
        first, block = len(coordinates), numbers.put(blocks.body(body))
        up, place = nodes.carriers[parent]
        node = nodes.add(_NODES[kind], up, first, k, (*place, joint_numbers[1]))
        nodes.numbers[node][1] = _axis(kind, joint_numbers)
        own = {key: blocks.point(*key) for key in points[body]}
        _add_body(nodes, node, up, block, (shapes, first + len(units)), own, inboard, numbers)
        base = nodes.rows[up][of.OWNER] if up >= 0 else -1
        bodies[k] = (
            shapes, len(units), first, first + len(units), base, nodes.row_of(up), coupling, square, block, kind,
            numbers.put(joint_numbers),
        )  # fmt: skip
        dampings.append(damping.ravel())
        hold += [*held, *zip(stiffness.tolist(), np.diag(damping).tolist(), strict=True)]
        coordinates += _named(body, joint, units, axial, transverse)
        square, coupling = square + shapes**2, coupling + shapes
    return _Bodies(bodies, coordinates, hold, dampings, driven)


def _add_body(
    nodes: _Nodes, joint: int, up: int, block: int, shapes: tuple[int, int],
    points: Mapping[tuple[str, str], _Point], inboard: tuple[str, str], numbers: Numbers,
) -> None:  # fmt: skip
    """Add a body to the node of its joint: that one of a rigid body; else a node of its axes, and of every section.

    ``shapes``: their number, and the first one; ``points``: places and numbers of the sections.
    """
    (count, first), owner = shapes, nodes.rows[joint][of.OWNER]
    if not count:
        nodes.carry(joint, block, points[inboard][0])
        for key, (place, _) in points.items():
            nodes.stand(key, joint, place)
        nodes.frames.append((joint, up, joint, joint))
        return
    axes = nodes.add(of.SHAPES, joint, first, owner, (0.0, 0.0, 0.0))
    shift, own = points[inboard]
    nodes.carry(axes, block, shift)
    moves = bool(own[_FIRST_SHAPE:].any())
    nodes.deform(axes, count, numbers.put(own), moves)
    nodes.stand(inboard, joint, (0.0, 0.0))
    for key, (place, values) in points.items():
        if key != inboard:
            node = nodes.add(of.STATION, axes, first, owner, (*place, 0.0))
            nodes.deform(node, count, numbers.put(values), True)
            nodes.stand(key, node, (0.0, 0.0))
    nodes.frames.append((axes, up, joint if moves else axes, joint))


def _axis(kind: int, joint: Sequence[float]) -> tuple[float, float, float]:
    """Twist of a joint's node for a unit of its speed, in the node's axes, from the joint's numbers."""
    sign, angle, x, y = joint
    if kind == at.REVOLUTE:
        return 0.0, 0.0, sign
    c, s = math.cos(angle), math.sin(angle)
    return (c * x + s * y, c * y - s * x, 0.0) if kind == at.PRISMATIC else (0.0, 0.0, 0.0)


def _from(base: str, joints: Sequence[Joint], openness: Callable[[Joint], int]) -> list[tuple[str, Joint, int]]:
    """Bodies at the other ends of the joints of a body or of the ground, ordered by the joints' freedoms."""
    near = sorted((joint for joint in joints if base in joint.bodies), key=openness)
    sides = [1 if joint.first.body == base else 0 for joint in near]
    return [(joint.sides[child].body, joint, child) for joint, child in zip(near, sides, strict=True)]


def _named(
    body: str, joint: Joint | None, units: Sequence[str], axial: int, transverse: int
) -> Iterator[tuple[str, str]]:
    """Names and units of the coordinates of a body's inboard joint and shapes."""
    for part, unit in zip(("x", "y", "phi"), units, strict=False):
        own = {"rad": "angle", "m": "position"}[unit]
        yield (f"{body}.{part}" if joint is None else f"{joint.name}.{own}"), unit
    for kind, count in (("axial", axial), ("transverse", transverse)):
        yield from ((f"{body}.{kind}_{k}", "m") for k in range(count))


def _views(plan: np.ndarray, counted: Counts, nodes: _Nodes, numbers: Numbers) -> dict[str, tuple[int, int]]:
    """Places in w, and lengths, of the arrays of nodes that compiled functions fill."""
    count, n = len(nodes.rows), counted.coordinates
    lengths = {
        at.Y: n, at.RATE: n, at.ACCEL: n, at.DEMAND: n, at.SECTION: at.SEC * counted.sections,
        at.INERTIAS: 9 * counted.bodies, at.COUPLINGS: 3 * counted.coupling, at.MASSES: counted.square,
    }  # fmt: skip
    names = "y", "u", "du", "h", "sections", "I", "E", "L"
    found = {name: (int(plan[place]), length) for name, (place, length) in zip(names, lengths.items(), strict=True)}
    parts = {name: np.zeros(3 * count) for name in ("r", "P", "slow", "moved", "twist", "rate", "wrenches")}
    parts |= {"R": np.tile((1.0, 0.0, 0.0), count), "offset": np.array([each[2] for each in nodes.numbers]).ravel()}
    parts |= {"S": np.zeros(3 * n), "phi": np.zeros(3 * nodes.twists)}
    return found | {name: (numbers.put(part), part.size) for name, part in parts.items()}


def _holding(mechanism: Mechanism, joint: Joint) -> tuple[float, float]:
    """Stiffness and damping of the springs at a joint."""
    springs = [spring for spring in mechanism.springs.values() if spring.joint == joint.name]
    return sum(float(spring.stiffness) for spring in springs), sum(float(spring.damping) for spring in springs)


def _order(mechanism: NumericMechanism) -> list[Branch]:
    """Bodies in the order of the tree, each with its branch.

    From the ground outwards, over the joints with the fewest freedoms first: prescribed ones and welds, pins, guides. A
    group without a joint to the ground is attached by a free joint at its body with a given position. A massless body
    at a free joint carries the next one if possible, as no leaf of a tree may be massless. Joints with friction become
    cuts: their reactions, on which friction depends, are then unknowns.
    """
    joints = [joint for name, joint in mechanism.joints.items() if name not in mechanism.frictions]
    lumped = {mass.point.body for mass in mechanism.masses.values()}

    def openness(joint: Joint) -> int:
        drive = mechanism.drives.get(joint.name)
        if joint.kind == "weld" or (drive is not None and not drive.free):
            return 0
        return 1 if drive is not None else 2

    def light(name: str) -> bool:
        body = mechanism.bodies[name]
        return not (body.elastic or body.mass or body.inertia or name in lumped)

    found: list[Branch] = []
    reached = [GROUND]
    waiting = list(mechanism.bodies)
    while waiting:
        for base in reached:  # grows while it is gone through: breadth first
            todo = _from(base, joints, openness)
            for body, joint, child in todo:  # grows, too, beyond bodies without mass
                if body in waiting:
                    waiting.remove(body)
                    reached.append(body)
                    found.append((body, joint, child))
                    if openness(joint) and light(body):
                        onwards = [branch for branch in _from(body, joints, openness) if branch[0] in waiting]
                        todo += sorted(onwards, key=lambda branch: light(branch[0]))[:1]
        if waiting:
            body = next((name for name in waiting if mechanism.bodies[name].free is not None), waiting[0])
            waiting.remove(body)
            found.append((body, None, 0))
            reached = [body]
    return found


def _points(mechanism: Mechanism) -> Iterator[BodyPoint]:
    """Points of joints, springs, contacts and loads; a load distributed over a body has two, one of the part that falls
    from its start to its end, one of the part that rises."""
    for joint in mechanism.joints.values():
        yield from joint.sides
    for spring in mechanism.springs.values():
        yield from spring.sides
    for contact in mechanism.contacts.values():
        yield from contact.sides
    for load in mechanism.loads.values():
        if load.point is not None:
            yield load.point
        if load.spread is not None:
            yield load.spread[0]
            for half in range(2):
                yield BodyPoint(load.spread[0].body, f"loads.{load.name}.{half}", (0.0, 0.0))


def _tree_joint(joint: Joint, child: int) -> tuple[float, ...]:
    """Sign of the coordinate, angle and direction of the child's section in the parent's.

    If the child is the joint's first body, all are relative to the second: the direction turns back by the angle.
    """
    sign = 1.0 if child == 1 else -1.0
    angle = sign * float(joint.angle) if joint.kind != "revolute" else 0.0
    x, y = joint.direction
    if child == 0:
        c, s = math.cos(joint.angle), math.sin(joint.angle)
        x, y = -(c * x + s * y), -(c * y - s * x)
    return sign, angle, float(x), float(y)
