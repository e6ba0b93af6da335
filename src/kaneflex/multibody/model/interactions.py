"""Table of interactions: cut joints, holds, drives, loads, springs and contacts, one per row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from kaneflex.mechanism import contacts, friction
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import Contact, Joint
from kaneflex.mechanism.planar import GROUND, BodyPoint
from kaneflex.mechanism.spatial import Side
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.spatial_layout import SPEED
from kaneflex.multibody.model.tree_builder import TreeBuilder, whole
from kaneflex.support.errors import SceneError

KINDS = {"weld": at.WELD, "revolute": at.REVOLUTE, "prismatic": at.PRISMATIC}
ROWS = {at.WELD: 3, at.REVOLUTE: 2, at.PRISMATIC: 2, at.TURN: 1, at.SLIDE: 1}
"""Number of constraints of a cut joint by kind."""
Branch = tuple[str, Joint | None, int]
"""A body, its inboard joint (None: floating), and which of the joint's sides belongs to it."""


class Numbers:
    """Array w during its construction."""

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


class Sections(dict[tuple[str, str], int]):
    """Number of every section that an interaction asks for: the ground's start is the first."""

    def __init__(self) -> None:
        super().__init__({(GROUND, "start"): 0})

    def __missing__(self, key: tuple[str, str]) -> int:
        self[key] = len(self)
        return self[key]


def key_of(point: BodyPoint) -> tuple[str, str]:
    return point.body, point.name


def virtual_inertias(
    mechanism: NumericMechanism, order: Sequence[Branch], index: Mapping[tuple[str, str], int], bodies: np.ndarray,
    parts: Sequence[np.ndarray], measure: float,
) -> dict[int, float]:  # fmt: skip
    """Section -> virtual inertia [kg m^2] of bodies that could turn freely without it, until their cut joints hold
    them.

    A body without inertia on frictional joints, or also on a pin at its centre, has no place in a tree; nor has one
    without mass at the end of a branch that a cut guide or weld turns. A hold removes the virtual inertia again. Raises
    SceneError for a body without mass with frictional joints.
    """
    rubbing = [mechanism.joints[name] for name in mechanism.frictions if name in mechanism.joints]
    starts = np.cumsum([0, *(part.size for part in parts)])
    blocks = [parts[int(np.searchsorted(starts, fields[at.BLOCK]))] for fields in bodies]
    found: dict[int, float] = {}
    for fields, block, (body, joint, child) in zip(bodies, blocks, order, strict=True):
        own = [each.name for each in rubbing if body in each.bodies]
        turns = joint is None or joint.kind == "revolute"
        if not turns or fields[at.SHAPES]:
            continue
        mass, x, y, second = block[:4]
        if not own:
            if joint is not None and mass <= 0.0 and second <= 0.0 and _turned_by_cuts(mechanism, order, joint, body):
                found[index[key_of(joint.sides[child])]] = block[3] = sum(each[0] for each in blocks) * measure**2
            continue
        if mass <= 0.0:
            raise SceneError(
                f"bodies.{body}.mass", float(mass),
                f"the mass matrix is singular: the friction of {own[0]} acts on a body without mass", "Give it a mass",
            )  # fmt: skip
        inboard = BodyPoint(body, "start", (0.0, 0.0)) if joint is None else joint.sides[child]
        p_x, p_y = (x / mass, y / mass) if joint is None else inboard.at  # pivot
        if second - 2 * (p_x * x + p_y * y) + mass * (p_x**2 + p_y**2) <= 1e-9 * mass * measure**2:
            found[index[key_of(inboard)]] = mass * measure**2
            block[3] += mass * measure**2
    return found


def _turned_by_cuts(mechanism: NumericMechanism, order: Sequence[Branch], inboard: Joint, body: str) -> bool:
    """True if a body is the end of a branch and a cut guide or weld determines its rotation."""
    drive, taken = mechanism.drives.get(inboard.name), [joint for _, joint, _ in order]
    others = [joint for joint in mechanism.joints.values() if body in joint.bodies and joint is not inboard]
    ends = (drive is None or drive.free) and not any(joint in taken for joint in others)
    return ends and any(joint.kind != "revolute" for joint in others)


def _hold_acts(
    mechanism: NumericMechanism, index: Mapping[tuple[str, str], int], cuts: Sequence[str], row: int,
    numbers: Numbers, virtual: Mapping[int, float],
) -> list[tuple[int, ...]]:  # fmt: skip
    """Rows of holds: those that remove virtual inertia, then frictions."""
    found: list[tuple[int, ...]] = []
    for section, inertia in virtual.items():
        found.append((at.TURN, 0, section, -1, row + len(found), numbers.put(friction.numbers_of_virtual(inertia))))
    after = len(mechanism.drives) + len(mechanism.observed) + len(mechanism.loads) + len(mechanism.springs)
    first_contact = len(cuts) + len(virtual) + len(mechanism.frictions) + after
    for name, held in mechanism.frictions.items():
        pair: Joint | Contact
        if name in mechanism.joints:
            pair = joint = mechanism.joints[name]
            kind, of = at.SLIDE if joint.slides else at.TURN, cuts.index(name)
        else:
            pair, kind = mechanism.contacts[name], at.ALONG
            of = first_contact + list(mechanism.contacts).index(name)
        first, second = (index[key_of(side)] for side in pair.sides)
        place = numbers.put(friction.numbers_of(held, pair.direction, of))
        found.append((kind, first, second, -1, row + len(found), place))
    return found


def list_acts(
    mechanism: NumericMechanism, order: Sequence[Branch], bodies: np.ndarray, index: Mapping[tuple[str, str], int],
    prescribed: Sequence[str], numbers: Numbers, virtual: Mapping[int, float], switches: int,
) -> tuple[np.ndarray, list[int], list[str]]:  # fmt: skip
    """Rows of cut joints, holds, drives, loads, springs and contacts; first row of each kind and the end; names of cut
    joints.

    Joints used by laws follow the drives, switching arguments follow the contacts, forces and moments of loads follow
    these.
    """
    taken = {joint.name: k for k, (_, joint, _) in enumerate(order) if joint is not None}
    found: list[tuple[int, ...]] = []
    ends, names, row = [0], [], 0

    def sides(of: Joint) -> tuple[int, int]:
        return index[key_of(of.first)], index[key_of(of.second)]

    for joint in mechanism.joints.values():
        if joint.name in taken:
            continue
        kinds = [(KINDS[joint.kind], -1)]
        if joint.name in prescribed:
            kinds.append((at.SLIDE if joint.slides else at.TURN, prescribed.index(joint.name)))
        for kind, course in kinds:
            angle = float(joint.angle) if kind in (at.WELD, at.PRISMATIC) else 0.0
            found.append((kind, *sides(joint), course, row, numbers.put([*joint.direction, angle])))
            names.append(joint.name)
            row += ROWS[kind]
    ends.append(len(found))
    found += _hold_acts(mechanism, index, names, row, numbers, virtual)
    row += len(found) - ends[-1]
    ends.append(len(found))
    for name in (*mechanism.drives, *mechanism.observed):
        joint = mechanism.joints[name]
        place, of = (int(bodies[taken[name], at.FIRST]), (0, 0)) if name in taken else (-1, sides(joint))
        kind = at.SLIDE if joint.slides else at.TURN
        found.append((kind, *of, place, -1, numbers.put(joint.direction)))
    ends.append(len(found))
    found += [(0, -1, -1, -1, -1, -1)] * len(mechanism.loads)
    ends.append(len(found))
    for spring in mechanism.springs.values():
        kind = at.STRAIGHT if spring.joint is None else at.TORSIONAL
        place = numbers.put([spring.stiffness, spring.damping, spring.free])
        of_tree = 0 if spring.joint in taken else -1
        found.append((kind, *(index[key_of(side)] for side in spring.sides), of_tree, -1, place))
    ends.append(len(found))
    for k, contact in enumerate(mechanism.contacts.values(), start=row):
        what, law = contacts.kind_of(contact), contacts.LAWS.index(contact.law)
        sections = (index[key_of(side)] for side in contact.sides)
        found.append((what, *sections, law, k, numbers.put(contacts.numbers_of(contact))))
    found += [(at.SWITCH, 0, 0, 0, k, -1) for k in range(switches)]
    ends.append(len(found))
    found += _load_acts(mechanism, index, numbers)
    return np.array(found, np.int64).reshape(-1, 6), ends, names


def _load_acts(
    mechanism: NumericMechanism, index: Mapping[tuple[str, str], int], numbers: Numbers
) -> Iterator[tuple[int, ...]]:  # fmt: skip
    """Rows of forces and moments of loads."""
    for k, load in enumerate(mechanism.loads.values()):
        if load.joint is not None:
            first, second = mechanism.joints[load.joint].sides
            yield at.TORQUE, index[key_of(first)], index[key_of(second)], k, -1, -1
            continue
        point = load.point if load.spread is None else load.spread[0]
        assert point is not None and load.direction is not None  # only torques have none
        parts = [(key_of(point), 1.0)]
        if load.spread is not None:
            _, end, *factors = load.spread
            parts = [((point.body, f"loads.{load.name}.{half}"), end.at[0] * float(factor) / 2)
                     for half, factor in enumerate(factors)]  # fmt: skip
        for on, share in parts:
            direction = [share * float(part) for part in load.direction]
            kind = at.FORCE_ALONG if load.axes == "global" else at.FOLLOWER
            yield kind, 0, index[on], k, index[key_of(point)], numbers.put(direction)


def list_spatial_acts(
    builder: TreeBuilder, cuts: Sequence[tuple[int, ...]], tree: Mapping[str, tuple[tuple[int, ...], int]],
    in_laws: Sequence[str], switches: int,
) -> tuple[np.ndarray, tuple[int, ...], np.ndarray, np.ndarray]:  # fmt: skip
    """``acts``, ``ranges``, ``stiffness`` and ``twisting`` of :class:`Tables`."""
    mechanism, joints = builder.mechanism, list[tuple[int, ...]]()
    for name in in_laws:
        kind = at.SLIDE if mechanism.joints[name].kind == "prismatic" else at.TURN
        speed = builder.nodes[tree[name][0][0]][SPEED] if mechanism.joints[name].freedoms == 1 else -1
        joints.append((kind, 0, 0, speed, -1, -1))
    loads, pushes = [(0, -1, -1, -1, -1, -1)] * len(mechanism.loads), _pushes(builder)
    springs, bushings, twisting = list[tuple[int, ...]](), list[tuple[int, ...]](), list[int]()
    stiffness, cushions = [np.zeros((0, 3))], list[np.ndarray]()
    for spring in mechanism.springs.values():
        joint = None if spring.joint is None else mechanism.joints[spring.joint]
        sections = [builder.section(side) for side in (spring if joint is None else joint).sides]
        if spring.is_bushing:
            sides = zip(spring.sides, (np.eye(3), mechanism.relative(spring)), strict=True)
            first, _ = (min([builder.axis(side, axis) for axis in axes]) for side, axes in sides)
            kinds = at.BUSHING, at.ALONG_AXIS, at.ALONG_AXIS, *3 * (at.ABOUT_AXIS,)
            bushings += [(kind, *sections, -1, first + k % 3, -1) for k, kind in enumerate(kinds)]
            cushions.append(np.column_stack([*np.reshape(spring.numbers, (2, 6)), np.zeros(6)]))
            continue
        kind, axis, speed = at.STRAIGHT, -1, -1
        if joint is not None:
            kind, speed = at.TORSIONAL, builder.nodes[tree[joint.name][0][0]][SPEED]
            axis = builder.axis(joint.sides[0], joint.moves[0][1])
        springs.append((kind, *sections, -1, axis, -1))
        stiffness.append(np.reshape(spring.numbers, (1, 3)))
        twisting.append(speed)
    none = list[tuple[int, ...]]()
    parts = cuts, none, joints, loads, [*springs, *bushings], [(at.SWITCH, 0, 0, 0, k, -1) for k in range(switches)]
    ranges = tuple(np.cumsum([0, *map(len, parts)]).tolist())
    acts = whole([row for part in (*parts, pushes) for row in part], 6)
    return acts, ranges, np.vstack([*stiffness, *cushions]), np.array(twisting, int)


def _pushes(builder: TreeBuilder) -> list[tuple[int, ...]]:
    """Forces and moments of loads, as rows of ``acts``."""
    mechanism, found = builder.mechanism, list[tuple[int, ...]]()
    for number, load in enumerate(mechanism.loads.values()):
        for k, (on, share) in enumerate(load.pushes):
            spread = load.is_spread and on.body in builder.shapes
            section = builder.mean(on.body, rises=k > 0) if spread else builder.section(on)
            turning = on if load.at is not None else Side(on.body, (0.0, 0.0, 0.0))
            turning = turning if load.in_body else Side(GROUND, (0.0, 0.0, 0.0))
            axis = builder.axis(turning, share * load.direction)
            found.append((at.FORCE_ALONG, 0, section, number, axis, -1))
        if load.joint is not None:
            joint = mechanism.joints[load.joint]
            sections = [builder.section(side) for side in joint.sides]
            axis = builder.axis(joint.sides[0], joint.moves[0][1])
            found.append((at.TORQUE, *sections, number, axis, -1))
    return found
