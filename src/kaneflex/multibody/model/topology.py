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
from kaneflex.multibody.model.body_parameters import Blocks
from kaneflex.multibody.model.interactions import KINDS, ROWS, Branch, Numbers, key_of, list_acts, virtual_inertias
from kaneflex.multibody.model.places import Counts, assign, assign_rows


@dataclass(frozen=True)
class Layout:
    """Names of the tables' entries.

    Attributes
    ----------
    bodies : tuple of str
        In the order of the tree.
    inboard : tuple of (str or None, int)
        Of every body its inboard joint and which side of it is the body's.
    sections : mapping
        (body, point) -> its number; the ground's first.
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
    sections: Mapping[tuple[str, str], int]
    cuts: tuple[str, ...]
    coordinates: tuple[tuple[str, str], ...]
    driven: tuple[str, ...]


def build_tables(
    mechanism: NumericMechanism, counts: Mapping[str, Sequence[int]], blocks: Blocks, measure: float, switches: int = 0
) -> tuple[at.Tables, Layout, tuple[int, int]]:  # fmt: skip
    """Tables of a mechanism at rest with open loops.

    Parameters
    ----------
    counts : mapping
        Body -> its numbers of axial and of transverse shapes.
    measure : float
        Unit of lengths [m].
    switches : int
        Number of switches of loads' laws.

    Returns
    -------
    tables, layout, sizes
        sizes: of the room for real and for complex factors.
    """
    order = _order(mechanism)
    index = {key: k for k, key in enumerate(_sections(mechanism, order))}
    prescribed, numbers = _prescribed(mechanism), Numbers()
    found = _build_bodies(mechanism, order, index, counts, blocks, numbers)
    bodies, sections, coordinates, hold, damping, twists, driven = found
    virtual = virtual_inertias(mechanism, order, index, bodies, numbers.parts, measure)
    acts, ranges, cut_names = list_acts(mechanism, order, bodies, index, prescribed, numbers, virtual, switches)
    counted = Counts(
        3, bodies[:, at.SHAPES].tolist(), len(coordinates), len(sections), twists,
        tuple(ranges), sum(ROWS[int(kind)] for kind in acts[: ranges[1], at.WHAT]), driven, switches,
        any(contact.law == "newton" for contact in mechanism.contacts.values()),
    )  # fmt: skip
    plan, size = assign(counted, numbers)
    assign_rows(plan, acts)
    plan[at.GRAVITY] = numbers.put(mechanism.gravity)
    plan[at.DAMPED] = numbers.put(np.concatenate(damping))
    plan[at.STIFFNESS], plan[at.DAMPING] = (numbers.put([each[k] for each in hold]) for k in range(2))
    plan[at.MEASURE] = numbers.put([1.0 if unit == "rad" else measure for _, unit in coordinates])
    places, w = [_ground(mechanism, name) for owner, name in index if owner == GROUND], np.concatenate(numbers.parts)
    w[plan[at.TOUCH] + at.EXTENT] = measure or 1.0
    _lay_out(plan, sections, w, places)
    held = tuple((None if joint is None else joint.name, child) for _, joint, child in order)
    layout = Layout(tuple(body for body, *_ in order), held, index, *map(tuple, (cut_names, coordinates, prescribed)))
    return at.Tables(plan, bodies, sections, acts, w), layout, (size, size)


def _prescribed(mechanism: Mechanism) -> list[str]:
    """Joints whose courses are prescribed: by laws, then those given at instants."""
    names = [name for name, drive in mechanism.drives.items() if not drive.free]
    return sorted(names, key=lambda name: mechanism.drives[name].kind == "given")


class _Bodies(NamedTuple):
    """Rows of bodies and sections, coordinates with stiffness and damping, damping of shapes; number of rows of phi;
    coordinate of every prescribed drive, or -1 in a cut."""

    bodies: np.ndarray
    sections: np.ndarray
    coordinates: list[tuple[str, str]]
    hold: list[tuple[float, float]]
    damping: list[np.ndarray]
    twists: int
    driven: list[int]


def _build_bodies(
    mechanism: Mechanism, order: Sequence[Branch], index: Mapping[tuple[str, str], int],
    counts: Mapping[str, Sequence[int]], blocks: Blocks, numbers: Numbers,
) -> _Bodies:  # fmt: skip
    names = list(index)
    coordinates: list[tuple[str, str]] = []
    units: tuple[str, ...]
    joint_numbers: tuple[float, ...]
    prescribed = _prescribed(mechanism)
    bodies = np.zeros((len(order), at.NUMBERS + 1), np.int64)
    sections = np.full((len(names), 3), -1, np.int64)
    hold, dampings = list[tuple[float, float]](), list[np.ndarray]()
    row, square, coupling, twists, driven = 0, 0, 0, 0, [-1] * len(prescribed)
    for k, (body, joint, child) in enumerate(order):
        axial, transverse = counts.get(body, (0, 0))[:2]
        shapes, own = axial + transverse, [n for n, (owner, _) in enumerate(names) if owner == body]
        for n in own:
            sections[n] = k, numbers.put(blocks.point(*names[n])), twists
            twists += shapes
        stiffness, damping = blocks.elastic(body)
        if joint is None:
            kind, units, inboard, parent = at.FREE, ("m", "m", "rad"), (body, "start"), 0
            joint_numbers, held = (1.0, 0.0, 1.0, 0.0), [(0.0, 0.0)] * 3
        else:
            kind, inboard, parent = KINDS[joint.kind], key_of(joint.sides[child]), index[key_of(joint.sides[1 - child])]
            units = {at.WELD: (), at.REVOLUTE: ("rad",), at.PRISMATIC: ("m",)}[kind]
            if joint.name in prescribed:
                driven[prescribed.index(joint.name)] = len(coordinates)
            joint_numbers, held = _tree_joint(joint, child), [_holding(mechanism, joint)] * len(units)
        first, (base, _, phi) = len(coordinates), sections[parent].tolist()
        moves = base >= 0 and bodies[base, at.SHAPES] and parent != bodies[base, at.INBOARD]
        bodies[k] = (
            shapes, len(units), first, first + len(units), base, phi if moves else -1, coupling, square,
            numbers.put(blocks.body(body)), kind, parent, index[inboard], own[0], own[-1] + 1, row,
            numbers.put(joint_numbers),
        )  # fmt: skip
        dampings.append(damping.ravel())
        hold += [*held, *zip(stiffness.tolist(), np.diag(damping).tolist(), strict=True)]
        coordinates += _named(body, joint, units, axial, transverse)
        row, square, coupling = row + 3 + shapes, square + shapes**2, coupling + shapes
    return _Bodies(bodies, sections, coordinates, hold, dampings, twists, driven)


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


def _lay_out(
    plan: np.ndarray, sections: np.ndarray, w: np.ndarray, ground: Sequence[tuple[float, float]]
) -> None:
    """Fill constants: sections of the ground, and points of bodies without shapes in their axes.

    Frames begin with the cosine of their initial angle, 0.
    """
    w[plan[at.FRAME] + 3 : plan[at.FORCE] : at.FRAME_SIZE] = 1.0
    for k, place in enumerate(ground):
        w[plan[at.SECTION] + at.SEC * k : plan[at.SECTION] + at.SEC * k + 2] = place
    for k, (owner, point, _) in enumerate(sections):
        if owner >= 0:
            w[plan[at.LOCAL] + at.SEC * k : plan[at.LOCAL] + at.SEC * k + 2] = w[point + 1 : point + 3]


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
    """Points of joints, springs, contacts and loads; a load distributed over a body has a section of its own."""
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
            yield BodyPoint(load.spread[0].body, f"loads.{load.name}", (0.0, 0.0))


def _sections(mechanism: Mechanism, order: Sequence[Branch]) -> list[tuple[str, str]]:
    """(body, point) of every section, the ground's first, then body by body."""
    points = [key_of(point) for point in _points(mechanism)]
    floating = [(body, "start") for body, joint, _ in order if joint is None]
    owners = [GROUND, *(body for body, _, _ in order)]
    wanted = dict.fromkeys([(GROUND, "start"), *floating, *points])
    return [key for owner in owners for key in wanted if key[0] == owner]


def _ground(mechanism: Mechanism, name: str) -> tuple[float, float]:
    return next((point.at for point in _points(mechanism) if key_of(point) == (GROUND, name)), (0.0, 0.0))


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
