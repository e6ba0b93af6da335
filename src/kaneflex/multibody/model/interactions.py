"""Table of interactions: cut joints, frictions, drives, loads, springs and contacts, one per row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from kaneflex.mechanism import contacts, friction
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import Side, SpatialMechanism, across
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.tree_builder import ORIGIN, Row, TreeBuilder, side_of, whole

_LOAD = (0, -1, -1, -1, -1, -1)
"""Row of a load, whose forces and moments have rows of their own."""


def list_acts(builder: TreeBuilder, in_laws: Sequence[str], rubs: bool) -> tuple[np.ndarray, tuple[int, ...]]:
    """Interactions (n_acts, 6), see ``acts`` in :mod:`kaneflex.multibody.model.layout`, and their ranges: first places
    of cuts, frictions, drives and joints in laws, loads, springs, and contacts and switches, and the end.

    Forces and moments of loads follow. ``in_laws``: joints whose coordinates may occur in laws; ``rubs``: with
    friction.
    """
    mechanism, drives = builder.mechanism, list[Row]()
    loads = [_LOAD] * len(mechanism.loads)
    joints: Mapping[str, Any] = mechanism.joints
    for name in in_laws:
        joint, known = joints[name], name in builder.tree
        if isinstance(mechanism, SpatialMechanism):
            speed = builder.speed(name) if known and joint.freedoms == 1 else -1
            drives.append((at.SLIDE if joint.kind == "prismatic" else at.TURN, 0, 0, speed, -1, -1))
            continue
        of = (0, 0, builder.speed(name)) if known else (*_sections(builder, joint), -1)
        drives.append((at.SLIDE if joint.slides else at.TURN, *of, -1, builder.w.put(joint.direction)))
    springs = _spring_acts(builder)
    row = len(builder.angles)
    others = len(builder.cuts) + len(drives) + len(loads) + len(springs)
    frictions = _friction_acts(builder, others) if rubs else []
    touching = [*_contact_acts(builder, row + len(frictions))]
    touching += [(at.SWITCH, 0, 0, 0, k, -1) for k in range(builder.switches)]
    parts: Sequence[Sequence[Row]] = (builder.cuts, frictions, drives, loads, springs, touching)
    ranges = tuple(np.cumsum([0, *map(len, parts)]).tolist())
    return whole([row for part in (*parts, _load_acts(builder)) for row in part], 6), ranges


def _sections(builder: TreeBuilder, of: Any) -> list[int]:
    """Sections of both sides of a joint, a contact or a spring."""
    return [builder.section(side_of(side)) for side in of.sides]


def _friction_acts(builder: TreeBuilder, others: int) -> list[Row]:
    """Rows of friction in joints, then of contacts; ``others``: number of interactions that are neither frictions
    nor contacts.

    In space a contact's friction has two rows, along the slip and across it. The latter are the first ones, so that
    those with results of their own come last.
    """
    beside, found = list[tuple[int, Any, int]](), list[tuple[int, Any, int]]()
    mechanism, put = builder.mechanism, builder.w.put
    pairs: Mapping[str, Any] = {**mechanism.joints, **mechanism.contacts}
    faces = [name for name in mechanism.frictions if name in mechanism.contacts]
    count, space = len(mechanism.frictions), isinstance(mechanism, SpatialMechanism)
    for name, held in mechanism.frictions.items():
        if name in faces:
            break
        pair, own = pairs[name], builder.rows_of[name]
        of = next(k for k, cut in enumerate(builder.cuts) if cut[at.ROW_AT] == own.start)
        if isinstance(mechanism, SpatialMechanism):
            (one, other), (x, y) = pair.sides, across(pair.axes[0])
            axis = min(builder.axis(one, each) for each in (pair.axes[0], x, y))
            builder.axis(other, mechanism.relative(pair).T @ x)
        direction = (axis, 0.0) if space else pair.direction if pair.slides else (0.0, 0.0)
        place = put(friction.numbers_of(held, direction, of, own.stop))
        found.append((at.SLIDE if pair.slides else at.TURN, pair, place))
    for k, name in enumerate(faces, start=-len(faces)):
        contact, held = pairs[name], mechanism.frictions[name]
        of = others + count + len(faces) * space + [*mechanism.contacts].index(name)
        directions = [contact.direction]
        if space:
            normal = np.asarray(contact.direction)
            axes = [*across(normal), normal] if contact.kind == "point-plane" else np.eye(3)
            axis = min([builder.axis(contact.first, each) for each in axes])
            directions = [(axis, k - count), (axis, k)]
        places = [put(friction.numbers_of(held, direction, of)) for direction in directions]
        found.append((at.ALONG, contact, places[0]))
        beside += [(at.ACROSS, contact, place) for place in places[1:]]
    rows = enumerate([*beside, *found], start=len(builder.angles))
    return [(kind, *_sections(builder, pair), -1, row, place) for row, (kind, pair, place) in rows]


def _spring_acts(builder: TreeBuilder) -> list[Row]:
    """Rows of springs; those of bushings in space come last, six of each."""
    found, bushings, mechanism, put = list[Row](), list[Row](), builder.mechanism, builder.w.put
    joints: Mapping[str, Any] = mechanism.joints
    for spring in mechanism.springs.values():
        joint, axis, speed = None if spring.joint is None else joints[spring.joint], -1, -1
        sections = _sections(builder, spring)
        if spring.is_bushing and isinstance(mechanism, SpatialMechanism):
            sides = zip(spring.sides, (np.eye(3), mechanism.relative(spring)), strict=True)
            first, _ = (min([builder.axis(side, axis) for axis in axes]) for side, axes in sides)
            kinds = at.BUSHING, at.ALONG_AXIS, at.ALONG_AXIS, *3 * (at.ABOUT_AXIS,)
            place = put(np.column_stack([spring.stiffness, spring.damping, np.zeros(6)]))
            bushings += [(kind, *sections, -1, first + k % 3, place + 3 * k) for k, kind in enumerate(kinds)]
            continue
        if joint is not None and builder.d == 6:
            axis = builder.axis(joint.sides[0], joint.moves[0][1])
        if spring.joint in builder.tree:
            speed = builder.speed(spring.joint)
        kind = at.STRAIGHT if joint is None else at.TORSIONAL
        found.append((kind, *sections, speed, axis, put((spring.stiffness, spring.damping, spring.free))))
    return [*found, *bushings]


def _contact_acts(builder: TreeBuilder, row: int) -> Iterator[Row]:
    """Rows of contacts, beginning with row ``row``."""
    mechanism = builder.mechanism
    for k, contact in enumerate(mechanism.contacts.values(), start=row):
        numbers, law = contacts.numbers_of(contact), contacts.LAWS.index(contact.law)
        if isinstance(mechanism, SpatialMechanism):
            axis, speed = -1, -1
            if contact.kind == "angle":
                assert contact.joint is not None  # whose flanks these are
                normal, speed = mechanism.joints[contact.joint].moves[0][1], builder.speed(contact.joint)
                axis = builder.axis(contact.first, contact.direction[0] * normal)
            elif len(contact.direction) == 3:  # of a plane, or of a bearing's axis
                axis = builder.axis(contact.first, np.asarray(contact.direction))
            numbers = *numbers, axis, speed
        yield contacts.kind_of(contact), *_sections(builder, contact), law, k, builder.w.put(numbers)


def _load_acts(builder: TreeBuilder) -> Iterator[Row]:
    """Rows of forces and moments of loads.

    A load distributed over a body has two, of the part that falls from its start to its end, and of the one that rises.
    """
    joints: Mapping[str, Any] = builder.mechanism.joints
    for number, load in enumerate(builder.mechanism.loads.values()):
        if load.joint is not None:
            joint = joints[load.joint]
            axis = builder.axis(joint.sides[0], joint.moves[0][1]) if builder.d == 6 else -1
            yield at.TORQUE, *_sections(builder, joint), number, axis, -1
            continue
        for k, (point, share) in enumerate(load.parts):
            on, direction = side_of(point), share * np.array(load.direction, float)
            spread = load.spread is not None
            mean = spread and on.body in builder.shapes
            section = builder.mean(on.body, rises=k > 0) if mean else builder.section(on)
            start = Side(on.body, ORIGIN) if spread else on
            if builder.d == 6:
                axis = builder.axis(start if load.in_body else Side(GROUND, ORIGIN), direction)
                yield at.FORCE_ALONG, 0, section, number, axis, -1
            else:
                kind = at.FOLLOWER if load.in_body else at.FORCE_ALONG
                place = builder.w.put(direction)
                yield kind, 0, section, number, builder.section(start), place
