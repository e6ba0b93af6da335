"""Positions of all bodies from the drives, in closed form where there is one.

Starting from the ground, bodies are placed one after the other: driven ones directly, pairs of undriven ones as
dyads (two bodies and three joints, an Assur group of the second class; see Norton, Design of Machinery, ch. 4), larger
groups by Newton's method (see :mod:`kaneflex.derive.equations.newton`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import sympy as sm

from kaneflex.derive.equations.newton import Closed, Loop, close_group, hung
from kaneflex.derive.ir.functions import T
from kaneflex.derive.ir.program import Steps
from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, Vector, cross, dot, minus, quarter_turn


class UnsupportedLoop(ValueError):
    """Bodies that the drives and the joints do not place."""


@dataclass(frozen=True)
class Closure:
    """Poses of all bodies, and for each loop the margin that must stay positive for it to close.

    Those of the ``loops`` that Newton's method closes have ``gaps`` beside it: what it leaves open [m].
    """

    poses: dict[str, Pose]
    margins: dict[str, sm.Expr]
    gaps: dict[str, sm.Expr]
    loops: tuple[Loop, ...]


def place_bodies(mechanism: Mechanism, drive_angle: dict[str, sm.Expr], steps: Steps) -> Closure:
    """Assign the pose of every body, given each drive's coordinate.

    Raises
    ------
    UnsupportedLoop
        If bodies remain that joints and drives leave open, or hold more than once; it names them.
    """
    poses = {GROUND: Pose(sm.S.Zero, sm.S.Zero, sm.S.One, sm.S.Zero)}
    margins: dict[str, sm.Expr] = {}
    closed: list[Closed] = []
    # the seeds of Newton's method are tabulated against the drive where there is one
    against = next(iter(drive_angle.values())) if len(drive_angle) == 1 else T
    while len(poses) <= len(mechanism.bodies):
        if _place_driven(mechanism, drive_angle, poses, steps) or _place_dyad(mechanism, poses, margins, steps):
            continue
        found = close_group(mechanism, drive_angle, poses, against, steps)
        if found is None:
            open_bodies = [name for name in mechanism.bodies if name not in poses]
            raise UnsupportedLoop(f"the position of {', '.join(open_bodies)} does not follow from the drives")
        poses |= found.poses
        margins[found.loop.closing] = found.margin
        closed.append(found)
    gaps = {found.loop.closing: found.gap for found in closed}
    return Closure(poses, margins, gaps, tuple(found.loop for found in closed))


def _assign_pose(name: str, c: sm.Expr, s: sm.Expr, at: Vector, point: BodyPoint, steps: Steps) -> Pose:
    """Pose with direction cosines c, s whose ``point`` lies at ``at``."""
    c, s = steps.assign(f"c_{name}", c), steps.assign(f"s_{name}", s)
    dx, dy = Pose(sm.S.Zero, sm.S.Zero, c, s).turn(point.at)
    return Pose(steps.assign(f"x_{name}", at[0] - dx), steps.assign(f"y_{name}", at[1] - dy), c, s)


def _place_driven(mechanism: Mechanism, drive_angle: dict[str, sm.Expr], poses: dict[str, Pose], steps: Steps) -> bool:
    """Place one body that a driven joint or a weld attaches to a placed one."""
    for name, joint in mechanism.joints.items():
        if (name in mechanism.drives or joint.kind == "weld") and _one_open(joint, poses):
            body, at, (c, s) = hung(joint, poses, drive_angle.get(name, joint.angle), steps.assign)
            poses[body.body] = _assign_pose(body.body, c, s, at, body, steps)
            return True
    return False


def _one_open(joint: Joint, poses: dict[str, Pose]) -> bool:
    return (joint.first.body in poses) != (joint.second.body in poses)


def _place_dyad(mechanism: Mechanism, poses: dict[str, Pose], margins: dict[str, sm.Expr], steps: Steps) -> bool:
    """Place two bodies that a joint connects to each other and one joint each to placed bodies."""
    for middle in mechanism.joints.values():
        if not {GROUND, *poses}.isdisjoint(middle.bodies):
            continue
        for one, other in product(*(_sides(mechanism, poses, body, middle) for body in middle.bodies)):
            kinds = one.joint.kind, middle.kind, other.joint.kind
            if kinds in _DYADS:
                joints = middle, one.joint, other.joint
                closing = next((joint for joint in joints if joint.closes_loop), other.joint)
                margins[closing.name] = _DYADS[kinds](_Dyad(middle, one, other, closing), poses, steps)
                return True
    return False


@dataclass(frozen=True)
class _Side:
    """An outer joint of a dyad: its point on a placed body and its point on the dyad's body."""

    joint: Joint
    base: BodyPoint
    foot: BodyPoint


@dataclass(frozen=True)
class _Dyad:
    """Two bodies with their joints; the branch is that of the joint that closes the loop."""

    middle: Joint
    first: _Side
    second: _Side
    closing: Joint

    def pivots(self, poses: dict[str, Pose], steps: Steps) -> tuple[Vector, Vector, Vector, sm.Expr]:
        """Points of both outer joints on the placed bodies, the vector d between them, and d^2."""
        pivot, other = (poses[side.base.body].place(side.base.at) for side in (self.first, self.second))
        d = _assigned(f"d_{self.first.foot.body}", minus(other, pivot), steps)
        return pivot, other, d, steps.assign(f"square_{self.first.foot.body}", dot(d, d))


def _sides(mechanism: Mechanism, poses: dict[str, Pose], body: str, but: Joint) -> list[_Side]:
    """Joints of a body to placed ones, without one joint."""
    return [
        _Side(joint, *(joint.sides if joint.first.body in poses else reversed(joint.sides)))
        for joint in mechanism.joints.values()
        if joint is not but and body in joint.bodies and _one_open(joint, poses)
    ]


def _assigned(name: str, vector: Vector, steps: Steps) -> Vector:
    return tuple(steps.assign(f"{name}_{axis}", v) for axis, v in zip("xy", vector, strict=True))


def _align(name: str, inside: Vector, outside: Vector, square: sm.Expr, at: Vector, foot: BodyPoint, steps) -> Pose:
    """The pose that turns a body-fixed vector of squared length ``square`` into a global one, ``foot`` being ``at``."""
    return _assign_pose(name, dot(inside, outside) / square, cross(inside, outside) / square, at, foot, steps)


def _close_slider(dyad: _Dyad, poses: dict[str, Pose], steps: Steps) -> sm.Expr:
    """Revolute, revolute, guide: the circle of the rod's head about its foot meets the line of the guide.

    With t along the guide and n = S t, the rod's vector is R(phi) ab = gamma n + branch w t. The guide's line gives
    gamma, and w^2 = |ab|^2 - gamma^2; at gamma = |ab| the loop can no longer close.
    """
    rod, guide = dyad.first, dyad.second
    head, slider_point = dyad.middle.first, dyad.middle.second
    if rod.joint.kind == "prismatic":
        rod, guide, head, slider_point = guide, rod, slider_point, head
    frame = poses[guide.base.body]  # a guide locks rotation, so the slider has the direction cosines of its carrier
    t = frame.turn(guide.joint.direction)
    n = quarter_turn(t)
    offset = frame.turn(minus(slider_point.at, guide.foot.at))
    line, pivot = frame.place(guide.base.at), poses[rod.base.body].place(rod.base.at)
    name = head.body
    gap = tuple(line[k] + offset[k] - pivot[k] for k in range(2))
    gamma = steps.assign(f"gamma_{name}", dot(n, gap))
    ab = minus(head.at, rod.foot.at)
    square = dot(ab, ab)
    margin = steps.assign(f"closure_{dyad.closing.name}", 1 - gamma**2 / square)
    reach = steps.assign(f"w_{name}", dyad.closing.branch * sm.sqrt(square * margin))
    v = _assigned(f"span_{name}", (gamma * n[0] + reach * t[0], gamma * n[1] + reach * t[1]), steps)
    poses[name] = _align(name, ab, v, square, pivot, rod.foot, steps)
    tip = (pivot[0] + v[0], pivot[1] + v[1])
    poses[slider_point.body] = _assign_pose(slider_point.body, frame.c, frame.s, tip, slider_point, steps)
    return margin


def _close_triangle(dyad: _Dyad, poses: dict[str, Pose], steps: Steps) -> sm.Expr:
    """Three revolutes: two circles meet. Branch + puts the middle joint to the left of the line between the pivots.

    With d from the first pivot to the second, the first body's span is v = a d + branch h S d,
    a = (r_1^2 - r_2^2 + d^2) / (2 d^2) and h^2 = r_1^2 / d^2 - a^2.
    """
    one, two, name = dyad.first, dyad.second, dyad.first.foot.body
    inside_1 = minus(dyad.middle.first.at, one.foot.at)
    inside_2 = minus(dyad.middle.second.at, two.foot.at)
    pivot, other, d, square = dyad.pivots(poses, steps)
    r_1, r_2 = dot(inside_1, inside_1), dot(inside_2, inside_2)
    a = steps.assign(f"share_{name}", (r_1 - r_2 + square) / (2 * square))
    margin = steps.assign(f"closure_{dyad.closing.name}", 1 - a**2 * square / r_1)
    h = steps.assign(f"height_{name}", dyad.closing.branch * sm.sqrt(r_1 * margin / square))
    v = _assigned(f"span_{name}", (a * d[0] - h * d[1], a * d[1] + h * d[0]), steps)
    poses[name] = _align(name, inside_1, v, r_1, pivot, one.foot, steps)
    poses[two.foot.body] = _align(two.foot.body, inside_2, minus(v, d), r_2, other, two.foot, steps)
    return margin


def _close_lever(dyad: _Dyad, poses: dict[str, Pose], steps: Steps) -> sm.Expr:
    """Revolute, guide, revolute: a slider on a lever, both turning by one angle. Branch + has the slider ahead.

    In the lever's axes the pivots are apart by w = w_n n + u t with t along the guide, w_n fixed by the bodies, and
    u^2 = d^2 - w_n^2.
    """
    one, two, name, t = dyad.first, dyad.second, dyad.first.foot.body, dyad.middle.direction
    pivot, other, d, square = dyad.pivots(poses, steps)
    fixed = tuple(
        dyad.middle.first.at[k] - one.foot.at[k] + two.foot.at[k] - dyad.middle.second.at[k] for k in range(2)
    )
    across = steps.assign(f"across_{name}", cross(t, fixed))
    margin = steps.assign(f"closure_{dyad.closing.name}", 1 - across**2 / square)
    along = steps.assign(f"along_{name}", dyad.closing.branch * sm.sqrt(square * margin))
    w = (along * t[0] - across * t[1], along * t[1] + across * t[0])
    poses[name] = lever = _align(name, w, d, square, pivot, one.foot, steps)
    poses[two.foot.body] = _assign_pose(two.foot.body, lever.c, lever.s, other, two.foot, steps)
    return margin


_DYADS = {
    ("revolute", "revolute", "prismatic"): _close_slider,
    ("prismatic", "revolute", "revolute"): _close_slider,
    ("revolute", "revolute", "revolute"): _close_triangle,
    ("revolute", "prismatic", "revolute"): _close_lever,
}
"""Kinds of the first body's outer joint, of the middle joint, of the second body's outer joint."""
