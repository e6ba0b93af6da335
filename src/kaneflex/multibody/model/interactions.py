"""Table of interactions: cut joints, holds, drives, loads, springs and contacts, one per row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from kaneflex.mechanism import contacts, friction
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import Contact, Joint
from kaneflex.mechanism.planar import GROUND, BodyPoint
from kaneflex.mechanism.spatial import Side, SpatialMechanism, across
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.tree_builder import ORIGIN, Interactions, TreeBuilder, whole
from kaneflex.multibody.model.tree_layout import ANGLES, SPEED
from kaneflex.support.errors import SceneError

_ANGLES = {at.WELD: (False, False, True), at.REVOLUTE: (False, False), at.PRISMATIC: (False, True), at.TURN: (True,),
           at.SLIDE: (False,)}  # fmt: skip
"""Rows of a cut in the plane by its kind: which are angles."""
Branch = tuple[str, Joint | None, int]
"""A body, its inboard joint (None: floating), and which of the joint's sides belongs to it."""
Row = tuple[int, ...]
_LOAD = (0, -1, -1, -1, -1, -1)
"""Row of a load, whose forces and moments have rows of their own."""


def side_of(point: BodyPoint) -> Side:
    """Point of a planar body as one in space."""
    return Side(point.body, (float(point.at[0]), float(point.at[1]), 0.0))


def virtual_inertias(builder: TreeBuilder, mechanism: NumericMechanism, order: Sequence[Branch]) -> np.ndarray:
    """Virtual inertia [kg m^2] of the speeds of bodies that frictional joints hold, (speeds,).

    A body without inertia on such joints, or also on a pin at its centre, has no place in a tree. A row of the factors
    removes the virtual inertia again. Raises SceneError for a body without mass.
    """
    rubbing = [mechanism.joints[name] for name in mechanism.frictions if name in mechanism.joints]
    found, measure = np.zeros(len(builder.speeds)), mechanism.size
    for body, joint, child in order:
        own = [each.name for each in rubbing if body in each.bodies]
        turns = joint is None or joint.kind == "revolute"
        if not own or not turns or body in builder.shapes:
            continue
        mass, x, y, second = builder.own[body][:4]
        turning = builder.nodes[builder.node_of[body]][SPEED] + (2 if joint is None else 0)
        if mass <= 0.0:
            raise SceneError(
                f"bodies.{body}.mass", float(mass),
                f"the mass matrix is singular: the friction of {own[0]} acts on a body without mass", "Give it a mass",
            )  # fmt: skip
        p_x, p_y = (x / mass, y / mass) if joint is None else side_of(joint.sides[child]).at[:2]  # pivot
        if second - 2 * (p_x * x + p_y * y) + mass * (p_x**2 + p_y**2) <= 1e-9 * mass * measure**2:
            found[turning] = mass * measure**2
    return found


def _hold_acts(builder: TreeBuilder, mechanism: NumericMechanism, cuts: Sequence[str], row: int) -> list[Row]:
    """Rows of frictions."""
    found: list[Row] = []
    after = len(mechanism.drives) + len(mechanism.observed) + len(mechanism.loads) + len(mechanism.springs)
    first_contact = len(cuts) + len(mechanism.frictions) + after
    for name, held in mechanism.frictions.items():
        pair: Joint | Contact
        if name in mechanism.joints:
            pair = joint = mechanism.joints[name]
            kind, of = at.SLIDE if joint.slides else at.TURN, cuts.index(name)
        else:
            pair, kind = mechanism.contacts[name], at.ALONG
            of = first_contact + list(mechanism.contacts).index(name)
        place = builder.w.put(friction.numbers_of(held, pair.direction, of))
        found.append((kind, *_sections(builder, pair), -1, row + len(found), place))
    return found


def _sections(builder: TreeBuilder, of: Joint | Contact) -> list[int]:
    """Sections of both sides."""
    return [builder.section(side_of(side)) for side in of.sides]


def list_acts(
    builder: TreeBuilder, mechanism: NumericMechanism, prescribed: Sequence[str], switches: int
) -> Interactions:
    """Interactions in the plane.

    Joints used by laws follow the drives, switching arguments follow the contacts, forces and moments of loads follow
    these.
    """
    joints, put = mechanism.joints, builder.w.put
    cuts, names, rows, row = list[Row](), list[str](), dict[str, slice](), 0
    kinds = {"weld": at.WELD, "revolute": at.REVOLUTE, "prismatic": at.PRISMATIC}
    for name, joint in joints.items():
        if name in builder.tree:
            continue
        closed = [(kinds[joint.kind], -1)]
        if name in prescribed:
            closed.append((at.SLIDE if joint.slides else at.TURN, prescribed.index(name)))
        rows[name] = slice(row, row + sum(len(_ANGLES[kind]) for kind, _ in closed))
        for kind, course in closed:
            angle = float(joint.angle) if kind in (at.WELD, at.PRISMATIC) else 0.0
            cuts.append((kind, *_sections(builder, joint), course, row, put([*joint.direction, angle])))
            names.append(name)
            row += len(_ANGLES[kind])
    holds = _hold_acts(builder, mechanism, names, row)
    drives = list[Row]()
    for name in (*mechanism.drives, *mechanism.observed):
        joint, hung = joints[name], name in builder.tree
        of = (0, 0, builder.speed(name)) if hung else (*_sections(builder, joint), -1)
        drives.append((at.SLIDE if joint.slides else at.TURN, *of, -1, put(joint.direction)))
    loads: list[Row] = [_LOAD] * len(mechanism.loads)
    springs = list[Row]()
    for spring in mechanism.springs.values():
        kind, sides = at.STRAIGHT if spring.joint is None else at.TORSIONAL, map(side_of, spring.sides)
        place = put([spring.stiffness, spring.damping, spring.free])
        speed = builder.speed(spring.joint) if spring.joint in builder.tree else -1
        springs.append((kind, *map(builder.section, sides), speed, -1, place))
    touching = list[Row]()
    for k, contact in enumerate(mechanism.contacts.values(), start=row + len(holds)):
        law, sections = contacts.LAWS.index(contact.law), _sections(builder, contact)
        touching.append((contacts.kind_of(contact), *sections, law, k, put(contacts.numbers_of(contact))))
    touching += [(at.SWITCH, 0, 0, 0, k, -1) for k in range(switches)]
    parts = cuts, holds, drives, loads, springs, touching
    angles = [angle for kind, *_ in cuts for angle in _ANGLES[kind]]
    return _in_turn(parts, [*_load_acts(builder, mechanism)], rows, angles)


def _in_turn(
    parts: Sequence[Sequence[Row]], pushes: Sequence[Row], cuts: Mapping[str, slice], angles: Sequence[bool]
) -> Interactions:
    """Rows of all kinds in turn."""
    ranges = tuple(np.cumsum([0, *map(len, parts)]).tolist())
    acts = whole([row for part in (*parts, pushes) for row in part], 6)
    return Interactions(acts, ranges, cuts, angles)


def _load_acts(builder: TreeBuilder, mechanism: NumericMechanism) -> Iterator[Row]:
    """Rows of forces and moments of loads.

    A load distributed over a body has two, of the part that falls from its start to its end, and of the one that rises.
    """
    for k, load in enumerate(mechanism.loads.values()):
        if load.joint is not None:
            yield at.TORQUE, *_sections(builder, mechanism.joints[load.joint]), k, -1, -1
            continue
        point = load.point if load.spread is None else load.spread[0]
        assert point is not None and load.direction is not None  # only torques have none
        turning, parts = builder.section(side_of(point)), [(point.at[0], 1.0)]
        sections = [turning]
        if load.spread is not None:
            _, end, *factors = load.spread
            parts = [((1 + half) * end.at[0] / 3, end.at[0] * float(factor) / 2)
                     for half, factor in enumerate(factors)]  # fmt: skip
            sections = [
                builder.mean(point.body, rises=half > 0) if point.body in builder.shapes
                else builder.section(Side(point.body, (x, 0.0, 0.0)))
                for half, (x, _) in enumerate(parts)
            ]  # fmt: skip
        for section, (_, share) in zip(sections, parts, strict=True):
            direction = [share * float(part) for part in load.direction]
            kind = at.FORCE_ALONG if load.axes == "global" else at.FOLLOWER
            yield kind, 0, section, k, turning, builder.w.put(direction)


def list_spatial_acts(
    builder: TreeBuilder, mechanism: SpatialMechanism, cuts: tuple[Sequence[Row], Mapping[str, slice]],
    in_laws: Sequence[str], switches: int, rubs: bool,
) -> Interactions:  # fmt: skip
    """Interactions in space.

    ``cuts``: their rows, and those of every joint; ``in_laws``: joints whose coordinates may occur in laws; ``rubs``:
    with friction.
    """
    holds, row = list[Row](), max((rows.stop for rows in cuts[1].values()), default=0)
    rubbing = {name: held for name, held in mechanism.frictions.items() if rubs and name in mechanism.joints}
    faces = [name for name in mechanism.frictions if rubs and name in mechanism.contacts]
    for name, held in rubbing.items():
        pair, own = mechanism.joints[name], cuts[1][name]
        of, (one, other) = next(k for k, cut in enumerate(cuts[0]) if cut[at.ROW_AT] == own.start), pair.sides
        x, y = across(pair.axes[0])
        axis = min(builder.axis(one, each) for each in (pair.axes[0], x, y))
        builder.axis(other, mechanism.relative(pair).T @ x)
        place = builder.w.put(friction.numbers_of(held, (axis, own.stop), of))
        sections = [builder.section(side) for side in pair.sides]
        holds.append((at.SLIDE if pair.slides else at.TURN, *sections, -1, row + len(faces) + len(holds), place))
    joints, springs, bushings = list[Row](), list[Row](), list[Row]()
    for name in in_laws:
        kind = at.SLIDE if mechanism.joints[name].kind == "prismatic" else at.TURN
        known = mechanism.joints[name].freedoms == 1 and name in builder.tree
        joints.append((kind, 0, 0, builder.speed(name) if known else -1, -1, -1))
    for spring in mechanism.springs.values():
        joint = None if spring.joint is None else mechanism.joints[spring.joint]
        sections = [builder.section(side) for side in (spring if joint is None else joint).sides]
        if spring.is_bushing:
            sides = zip(spring.sides, (np.eye(3), mechanism.relative(spring)), strict=True)
            first, _ = (min([builder.axis(side, axis) for axis in axes]) for side, axes in sides)
            kinds = at.BUSHING, at.ALONG_AXIS, at.ALONG_AXIS, *3 * (at.ABOUT_AXIS,)
            place = builder.w.put(np.column_stack([*np.reshape(spring.numbers, (2, 6)), np.zeros(6)]))
            bushings += [(kind, *sections, -1, first + k % 3, place + 3 * k) for k, kind in enumerate(kinds)]
            continue
        kind, axis, speed = at.STRAIGHT, -1, -1
        if joint is not None:
            kind, speed, axis = at.TORSIONAL, builder.speed(joint.name), builder.axis(joint.sides[0], joint.moves[0][1])
        springs.append((kind, *sections, speed, axis, builder.w.put(spring.numbers)))
    loads: list[Row] = [_LOAD] * len(mechanism.loads)
    of = sum(map(len, (cuts[0], holds, joints, loads, springs, bushings))) + 2 * len(faces)
    along, beside = _face_acts(builder, mechanism, faces, row, of)
    holds = [*beside, *holds, *along]
    touching = list[Row]()
    for k, contact in enumerate(mechanism.contacts.values(), start=row + len(holds)):
        axis, speed, law = -1, -1, contacts.LAWS.index(contact.law)
        if contact.kind == "angle":
            assert contact.joint is not None  # whose flanks these are
            normal, speed = mechanism.joints[contact.joint].moves[0][1], builder.speed(contact.joint)
            axis = builder.axis(contact.first, contact.direction[0] * normal)
        elif contact.kind == "point-plane":
            axis = builder.axis(contact.first, np.asarray(contact.direction))
        numbers = *contacts.numbers_of(contact), axis, speed
        sections = [builder.section(side) for side in contact.sides]
        touching.append((contacts.kind_of(contact), *sections, law, k, builder.w.put(numbers)))
    touching += [(at.SWITCH, 0, 0, 0, k, -1) for k in range(switches)]
    parts = cuts[0], holds, joints, loads, [*springs, *bushings], touching
    angles = [angle for kind, *_ in cuts[0] for angle in ANGLES[kind]]
    return _in_turn(parts, _pushes(builder, mechanism), cuts[1], angles)


def _face_acts(
    builder: TreeBuilder, mechanism: SpatialMechanism, faces: Sequence[str], row: int, of: int
) -> tuple[list[Row], list[Row]]:
    """Rows of the frictions of contacts, along the slip and across it; ``of``: number of the first contact.

    The latter are the first frictions, so that those with results of their own come last.
    """
    along, beside = list[Row](), list[Row]()
    for k, name in enumerate(faces):
        contact, held, count = mechanism.contacts[name], mechanism.frictions[name], len(mechanism.frictions)
        number, normal = of + list(mechanism.contacts).index(name), np.asarray(contact.direction)
        axes = [*across(normal), normal] if contact.kind == "point-plane" else np.eye(3)
        axis, sections = min([builder.axis(contact.first, each) for each in axes]), map(builder.section, contact.sides)
        one, two = k - len(faces), k - len(faces) - count
        both = [builder.w.put(friction.numbers_of(held, (axis, other), number)) for other in (two, one)]
        first, second = sections
        along.append((at.ALONG, first, second, -1, row + count + k, both[0]))
        beside.append((at.ACROSS, first, second, -1, row + k, both[1]))
    return along, beside


def _pushes(builder: TreeBuilder, mechanism: SpatialMechanism) -> list[Row]:
    """Forces and moments of loads, as rows of ``acts``."""
    found = list[Row]()
    for number, load in enumerate(mechanism.loads.values()):
        for k, (on, share) in enumerate(load.pushes):
            spread = load.is_spread and on.body in builder.shapes
            section = builder.mean(on.body, rises=k > 0) if spread else builder.section(on)
            turning = on if load.at is not None else Side(on.body, ORIGIN)
            turning = turning if load.in_body else Side(GROUND, ORIGIN)
            axis = builder.axis(turning, share * load.direction)
            found.append((at.FORCE_ALONG, 0, section, number, axis, -1))
        if load.joint is not None:
            joint = mechanism.joints[load.joint]
            sections = [builder.section(side) for side in joint.sides]
            axis = builder.axis(joint.sides[0], joint.moves[0][1])
            found.append((at.TORQUE, *sections, number, axis, -1))
    return found
