"""Numerical position analysis of a scene, before anything is derived.

Every joint and drive gives residuals in the bodies' global coordinates x, y, phi. Groups of bodies that are determined
by the ground and the bodies placed before (a driven body, a dyad, ...) are solved one after the other by Newton's
method. The branch at the joint that closes the loop selects one of a dyad's two solutions, as in the equations.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from kaneflex.mechanism.joints import Constraints, Poses, axes_of
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.planar import BodyPoint, Pose, Vector, cross, minus, wrapped
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

_STARTS = 400
"""Starting values from which a group of bodies is tried before it counts as impossible to close."""
_FEW = 2
"""Number of a loop's assemblies checked for singularity."""
_ITERATIONS = 60
"""Perturbations of each of them."""
_IN_VAIN = 60
"""Successive starting values without a new assembly before the search ends."""
_ALIKE = 0.02
"""Difference of angles [rad] above which one of two assemblies counts as nearer."""
_CLOSED = 1e-9
"""Largest gap of a closed joint, in sizes of the mechanism; angles in rad."""
_ROUNDING = 1e-16
"""Largest gap of a joint that further steps do not reduce."""
_LEAST_DAMPING = 1e-14
"""Regularisation in Levenberg and Marquardt's method at singular positions."""
_OPEN = 1e-6
"""Smallest singular value of the constraints' Jacobian, as a share of the largest, that counts as nonzero."""
_PARALLEL = 1e-9
"""Largest sine of the angle between parallel guides."""


@dataclass(frozen=True, eq=False)
class Placement:
    """Rigid mechanism at one configuration; ``placement["rod.c"]`` works as in a RigidMotion at one time.

    Attributes
    ----------
    poses : mapping of str to ndarray (3,)
        Each body's x, y of its start [m] and angle [rad].
    drives : mapping of str to float
        Coordinate of each drive [rad or m].
    """

    poses: Poses
    drives: Mapping[str, float]

    @property
    def times(self) -> np.ndarray:
        return np.zeros(1)

    def __getitem__(self, name: str) -> np.ndarray:
        body, _, kind = name.rpartition(".")
        x, y, phi = self.poses[body]
        return np.array([{"x": x, "y": y, "c": math.cos(phi), "s": math.sin(phi)}[kind]])


def place(mechanism: NumericMechanism, at: Mapping[str, float] | None = None) -> Placement:
    """Place the bodies, with drives at the start of the run or at the coordinates [rad or m] in ``at``.

    Raises
    ------
    SceneError
        If the linkage can't close there, or if the drives do not determine a body's position.
    """
    if mechanism.frame:
        return Placement({name: np.array(body.pose) for name, body in mechanism.bodies.items()}, {})
    drives = {name: float(drive.coordinate(0.0)) for name, drive in mechanism.drives.items()} | dict(at or {})
    poses = _standing(mechanism)
    for group in closing_groups(mechanism):
        poses |= _closed(group.constraints(mechanism, drives), poses, group)
    return Placement(poses, drives)


def closures(mechanism: NumericMechanism, at: Mapping[str, float] | None = None) -> list[tuple[str, Placement]]:
    """All placements at which a mechanism's loops close, its own one first, each with the entries that choose it.

    Raises
    ------
    SceneError
        If the scene's own linkage can't close there.
    """
    own = place(mechanism, at)
    ways = [("", _standing(mechanism))]
    for group in closing_groups(mechanism):
        found, constraints = [], group.constraints(mechanism, own.drives)
        for entries, poses in ways:
            assemblies = _assemblies(constraints, poses) if group.closing else [_closed(constraints, poses, group)]
            found += [(entries + group.chosen_by(poses | each), poses | each) for each in assemblies]
        ways = found[:16]  # more small drawings are of no use

    ways.sort(key=lambda way: not is_same(way[1], own.poses, mechanism.size))
    others = [(entries.strip(), Placement(poses, own.drives)) for entries, poses in ways]
    return [(others[0][0], own), *others[1:]]


def with_branches(scene: Scene) -> Scene:
    """Scene in which every `near` at the closing joint of a dyad is replaced by its branch.

    Raises
    ------
    SceneError
        If the linkage can't close at the start, or both assemblies are equally near.
    """
    if scene.is_frame or not any(joint.near for joint in scene.joints.values()):
        return scene
    mechanism = mechanism_of(scene)
    poses, joints = None, dict(scene.joints)
    for group in closing_groups(mechanism):
        closing = group.closing
        if closing and closing.near and not group.is_larger:
            poses = poses or place(mechanism).poses
            branch = "-" if (group.side(poses) or 0.0) < 0.0 else "+"
            joints[closing.name] = scene.joints[closing.name].model_copy(update={"branch": branch})
    return scene.model_copy(update={"joints": joints})


def drive_rates(mechanism: NumericMechanism, placement: Placement) -> dict[str, dict[str, np.ndarray]]:
    """Velocity (x, y of its start; angle) of every body for unit speed of each drive: drive -> body -> ndarray (3,).

    The same factors relate accelerations, apart from terms that depend on the speeds.
    """
    constraints = Constraints(mechanism, placement.drives)
    jacobian, driven = constraints.jacobian(placement.poses), constraints.driven
    units = np.eye(len(jacobian))[:, len(jacobian) - len(driven) :]
    rates = np.linalg.lstsq(jacobian, units, rcond=None)[0]
    return {drive: constraints.split(velocity) for drive, velocity in zip(driven, rates.T, strict=True)}


def _standing(mechanism: NumericMechanism) -> dict[str, np.ndarray]:
    """Poses of free bodies, which no joint determines."""
    return {name: np.array(free.place) for name, free in mechanism.frees.items()}


def _next_group(mechanism: NumericMechanism, poses: Poses) -> tuple[str, ...]:
    """Smallest group of bodies that joints and drives determine, given the bodies already placed."""
    waiting = [name for name in mechanism.bodies if name not in poses]
    if group := mechanism.smallest_group(poses, waiting, _joints_of):
        return group
    raise SceneError(
        "drives", ", ".join(mechanism.drives) or None, f"the position of {', '.join(waiting)} is not determined",
        "Drive or join these bodies: each needs three constraints by joints and drives; or let one be free",
    )  # fmt: skip


def _joints_of(mechanism: NumericMechanism, placed: Collection[str], group: Sequence[str]) -> list[Joint]:
    """Joints between bodies of a group, or between the group and placed bodies; one of redundant guides."""
    found: list[Joint] = []
    for joint in sorted(mechanism.joints_of(placed, group), key=lambda joint: joint.name not in mechanism.drives):
        if joint.name in mechanism.drives or not any(_holds_as(other, joint) for other in found):
            found.append(joint)
    return [joint for joint in mechanism.joints.values() if joint in found]


def _holds_as(one: Joint, other: Joint) -> bool:
    """True if a guide or a weld is redundant with another one between the same bodies."""
    if {*one.bodies} != {*other.bodies} or one.kind != other.kind or one.kind == "revolute":
        return False
    if one.kind == "weld":
        return True
    c, s = (math.cos(one.angle), math.sin(one.angle)) if one.first.body != other.first.body else (1.0, 0.0)
    (x, y), direction = one.direction, other.direction
    across = x * (s * direction[0] + c * direction[1]) - y * (c * direction[0] - s * direction[1])
    return abs(across) <= _PARALLEL * math.hypot(*one.direction) * math.hypot(*direction)


def _closed(constraints: Constraints, poses: Poses, group: Group) -> dict[str, np.ndarray]:
    """Poses of a group by Newton's method from many starting values, until the scene's branch is found, or for larger
    groups all assemblies."""
    closing, assemblies = group.closing or group.joints[-1], list[dict[str, np.ndarray]]()
    if group.is_larger or closing.near:
        assemblies = _assemblies(constraints, poses)
    else:
        for closed in islice(_assembled(constraints, poses, 1), _IN_VAIN + 1):
            if group.is_on_branch({**poses, **closed}):
                return closed
    if assemblies:
        _check_held(constraints, poses, assemblies, closing)
        return _nearest(closing, assemblies)
    raise SceneError(
        f"joints.{closing.name}.branch", closing.written_branch,
        f"the loop cannot close at {constraints.mechanism.written(constraints.drives)}: {', '.join(group.bodies)}",
        "Change the lengths, or the positions of its drives",
    )  # fmt: skip


def _assemblies(constraints: Constraints, poses: Poses) -> list[dict[str, np.ndarray]]:
    """All ways in which a group closes, as far as many starts find them."""
    found: list[dict[str, np.ndarray]] = []
    in_vain = 0
    for closed in _assembled(constraints, poses, _IN_VAIN):
        if not any(is_same(closed, other, constraints.mechanism.size) for other in found):
            found.append(closed)
            in_vain = 0
        in_vain += 1
        if in_vain > _IN_VAIN:
            break
    return found


def _check_held(constraints: Constraints, placed: Poses, assemblies: Sequence[Poses], closing: Joint) -> None:
    """Raise SceneError for a loop whose assemblies are all singular, so that its bodies can still move."""
    if len(assemblies) <= _FEW:
        return
    for poses in assemblies[: _FEW + 1]:
        sizes = np.linalg.svd(constraints.scaled_jacobian({**placed, **poses}), compute_uv=False)
        if sizes[-1] > _OPEN * sizes[0]:
            return
    raise SceneError(
        f"joints.{closing.name}", None,
        f"singular position: with the loop closed and all drives fixed {', '.join(constraints.bodies)} can still move "
        "together, as with a cylinder between two points of constant distance",
        "Move an end of the cylinder, or another joint of the loop",
    )  # fmt: skip


def _assembled(constraints: Constraints, placed: Poses, at_once: int) -> Iterator[dict[str, np.ndarray]]:
    """Poses at which a group closes, from many random starts at once.

    The sum of squares is minimised by the method of Levenberg (1944) and Marquardt (1963).
    """
    size, count, units = constraints.mechanism.size, len(constraints.bodies), constraints.units
    low, high = np.array([-size, -size, -math.pi]), np.array([size, size, math.pi])
    random = np.random.default_rng(0)
    for first in range(0, _STARTS, at_once):
        starts = min(at_once, _STARTS - first)
        x = random.uniform(low, high, (starts, count, 3)).reshape(starts, -1).T
        damping, residuals = np.full(starts, 1e-2), constraints.residuals({**placed, **constraints.split(x)}) / units
        for _ in range(_ITERATIONS):
            J = constraints.scaled_jacobian({**placed, **constraints.split(x)})
            A = np.swapaxes(J, 1, 2) @ J
            lifted = damping * np.trace(A, axis1=1, axis2=2) / len(x)
            A += lifted[:, None, None] * np.eye(len(x))
            step = np.linalg.solve(A, np.einsum("nrc,nr->nc", J, residuals)[..., None])[..., 0]
            nearer = x - (constraints.scales * step).T
            left = constraints.residuals({**placed, **constraints.split(nearer)}) / units
            better = (left**2).sum(axis=1) < (residuals**2).sum(axis=1)
            x, residuals = np.where(better, nearer, x), np.where(better[:, None], left, residuals)
            damping = np.clip(np.where(better, 0.1, 10.0) * damping, _LEAST_DAMPING, 1e3)
            if not (better & (abs(residuals).max(axis=1) > _ROUNDING)).any():
                break
        closed = abs(residuals).max(axis=1) <= _CLOSED
        yield from map(constraints.split, x.T[closed])


def is_same(one: Poses, other: Poses, size: float) -> bool:
    """True if two assemblies are equal up to whole turns."""
    change = np.array([one[name] - pose for name, pose in other.items()])
    change[:, 2] = wrapped(change[:, 2])
    return bool((abs(change) < 1e-6 * np.array([size, size, 1.0])).all())


def _nearest(closing: Joint, assemblies: list[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Assembly whose bodies' angles are nearest to those at the closing joint.

    Raises SceneError if there are several and the joint gives no angles.
    """
    near, group = closing.near, [*assemblies[0]]

    def off(poses: Poses) -> float:
        turns = np.array([poses[name][2] - angle for name, angle in near.items() if name in group])
        return float(abs(wrapped(turns)).max(initial=0.0))

    strange = [name for name in near if name not in group]
    if strange:
        raise SceneError(
            f"joints.{closing.name}.near.{strange[0]}", None,
            f"it is not in the loop of {closing.name}, which moves {', '.join(group)}", "Name one of these",
        )  # fmt: skip
    ranked = sorted(assemblies, key=off)
    if len(ranked) > 1 and off(ranked[1]) - off(ranked[0]) < _ALIKE:
        lines = (
            ", ".join(f"{name} {math.degrees(math.remainder(poses[name][2], 2 * math.pi)):.1f} deg" for name in group)
            for poses in assemblies
        )
        no_branch = "" if near else ", and branch applies to loops of two bodies only"
        raise SceneError(
            f"joints.{closing.name}.near",
            {name: f"{math.degrees(angle):g} deg" for name, angle in near.items()} or None,
            f"the loop closes in {len(ranked)} ways at the start{no_branch}",
            f"Choose one, like near = {{{group[0]} = "
            f"'{math.degrees(math.remainder(assemblies[0][group[0]][2], 2 * math.pi)):.0f} deg'}}:\n  "
            + "\n  ".join(lines),
        )  # fmt: skip
    return ranked[0]


@dataclass(frozen=True)
class Dyad:
    """Dyad: two bodies, the middle joint between them, and an ``outer`` joint of each on a placed body.

    ``pivots`` are the placed sides of the outer joints, in the order of the middle joint's bodies.
    """

    middle: Joint
    outer: tuple[Joint, Joint]
    pivots: tuple[BodyPoint, BodyPoint]

    @property
    def kinds(self) -> tuple[str, str, str]:
        """Kinds of the dyad's joints from one pivot to the other."""
        return self.outer[0].kind, self.middle.kind, self.outer[1].kind

    @property
    def guide(self) -> int | None:
        """Index of the outer joint that is a guide, if the other two joints are pins."""
        slider = sorted(self.kinds[::2]) == ["prismatic", "revolute"] and self.kinds[1] == "revolute"
        return self.kinds[::2].index("prismatic") if slider else None

    def vectors(self, axes: Mapping[str, Pose]) -> tuple[Vector, Vector] | None:
        """Two vectors that are parallel at a dead centre, and whose cross product has the sign of the branch.

        Three revolutes: both links; the middle joint is to the left of the line between the pivots. Slider: the guide's
        normal and the rod, ahead along the guide. Lever: the slide's normal and the line of the pivots, the slider
        ahead of the lever's pivot. None for other dyads.
        """
        start, end = (axes[pivot.body].place(pivot.at) for pivot in self.pivots)
        head = axes[self.middle.first.body].place(self.middle.first.at)
        if self.kinds == ("revolute", "revolute", "revolute"):
            return minus(end, head), minus(head, start)
        if self.kinds == ("revolute", "prismatic", "revolute"):
            guide, link = self.middle, minus(end, start)
        elif self.guide is not None:
            guide, link = self.outer[self.guide], minus(head, end if self.guide == 0 else start)
        else:
            return None
        x, y = axes[guide.first.body].turn(guide.direction)
        return (y, -x), link


@dataclass(frozen=True)
class Group:
    """Bodies that joints and drives determine, given the bodies placed before.

    ``acting``: all joints that act on them; ``joints``: one of redundant guides; ``dyad``: if they form one.
    """

    bodies: tuple[str, ...]
    acting: tuple[str, ...]
    joints: list[Joint]
    dyad: Dyad | None

    @property
    def is_larger(self) -> bool:
        """True if it is not a driven or welded body or a dyad, and may have more than two assemblies."""
        return len(self.bodies) > 2 or (len(self.bodies) == 2 and len(self.joints) != 3)

    @property
    def closing(self) -> Joint | None:
        """Joint whose ``branch`` or ``near`` chooses the assembly: the first that closes a dyad, else the last."""
        found = [joint for joint in self.joints if joint.closes_loop]
        return found[-1 if self.is_larger else 0] if found else None

    def constraints(self, mechanism: NumericMechanism, drives: Mapping[str, float]) -> Constraints:
        """Constraints of its bodies by all joints and by drives at some coordinates."""
        return Constraints(mechanism, drives, self.bodies, self.acting)

    def side(self, poses: Poses) -> float | None:
        """Number whose sign is the branch of a dyad (see kaneflex.derive.equations.closure); None for others."""
        vectors = None if self.dyad is None else self.dyad.vectors(axes_of(poses))
        return None if vectors is None else cross(*vectors)

    def is_on_branch(self, poses: Poses) -> bool:
        """True if a dyad is on the branch that the scene chooses, or has none."""
        side = self.side(poses)
        return side is None or self.closing is None or side * self.closing.branch >= 0.0

    def chosen_by(self, poses: Poses) -> str:
        """Setting that chooses an assembly; empty where there is none to choose."""
        side, name = self.side(poses), self.bodies[0]
        if self.closing is None:
            return ""
        if side is not None:
            return f" joints.{self.closing.name}.branch={'+' if side >= 0.0 else '-'}"
        return f" joints.{self.closing.name}.near.{name}={math.degrees(float(wrapped(poses[name][2]))):.0f}deg"


def closing_groups(mechanism: NumericMechanism) -> Iterator[Group]:
    """Groups of bodies in the order of placing."""
    placed = _standing(mechanism)
    while len(placed) < len(mechanism.bodies):
        bodies = _next_group(mechanism, placed)
        acting = tuple(joint.name for joint in mechanism.joints_of(placed, bodies))
        joints = _joints_of(mechanism, placed, bodies)
        yield Group(bodies, acting, joints, _dyad_of(bodies, joints))
        placed |= dict.fromkeys(bodies, np.zeros(3))


def _dyad_of(group: tuple[str, ...], joints: Sequence[Joint]) -> Dyad | None:
    between = [joint for joint in joints if {*joint.bodies} == {*group}]
    outer = [joint for joint in joints if joint not in between]
    if len(group) != 2 or len(between) != 1 or len(outer) != 2:
        return None
    (middle,) = between
    first, last = sorted(outer, key=lambda joint: middle.first.body not in joint.bodies)
    start, end = (next(side for side in joint.sides if side.body not in group) for joint in (first, last))
    return Dyad(middle, (first, last), (start, end))
