"""Positions of all bodies from the drives, in closed form.

Starting from the ground, bodies are placed one after the other: driven ones directly, pairs of undriven ones as
dyads (two bodies and three joints, an Assur group of the second class; see Norton, Design of Machinery, ch. 4).
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sm

from kaneflex.derive.mechanism import GROUND, BodyPoint, JointModel, Mechanism, Vector
from kaneflex.derive.steps import Steps


class UnsupportedLoop(ValueError):
    """Bodies that no chain of driven joints and slider dyads reaches."""


@dataclass(frozen=True)
class Pose:
    """Global position of a body's start and the direction cosines of its x axis."""

    x: sm.Expr
    y: sm.Expr
    c: sm.Expr
    s: sm.Expr

    def turn(self, vector: Vector) -> Vector:
        return self.c * vector[0] - self.s * vector[1], self.s * vector[0] + self.c * vector[1]

    def place(self, point: BodyPoint) -> Vector:
        dx, dy = self.turn(point.at)
        return self.x + dx, self.y + dy


@dataclass(frozen=True)
class Closure:
    """Poses of all bodies, and for each dyad the margin that must stay positive for it to close."""

    poses: dict[str, Pose]
    margins: dict[str, sm.Expr]


def place_bodies(mechanism: Mechanism, drive_angle: dict[str, sm.Expr], steps: Steps) -> Closure:
    """Assign the pose of every body, given each drive's coordinate.

    Raises
    ------
    UnsupportedLoop
        If bodies remain that are neither driven nor in a dyad of two revolutes and a guide; it names them.
    """
    poses = {GROUND: Pose(sm.S.Zero, sm.S.Zero, sm.S.One, sm.S.Zero)}
    margins: dict[str, sm.Expr] = {}
    while len(poses) <= len(mechanism.bodies):
        if not (_place_driven(mechanism, drive_angle, poses, steps) or _place_dyad(mechanism, poses, margins, steps)):
            open_bodies = [name for name in mechanism.bodies if name not in poses]
            raise UnsupportedLoop(
                f"the position of {', '.join(open_bodies)} does not follow from the drives: each body must be driven, "
                "welded, or closed by a dyad of a rod and a guided body"
            )
    return Closure(poses, margins)


def _assign_pose(name: str, c: sm.Expr, s: sm.Expr, at: Vector, point: BodyPoint, steps: Steps) -> Pose:
    """The pose with direction cosines c, s whose ``point`` lies at ``at``."""
    c, s = steps.assign(sm.Symbol(f"c_{name}"), c), steps.assign(sm.Symbol(f"s_{name}"), s)
    dx, dy = Pose(sm.S.Zero, sm.S.Zero, c, s).turn(point.at)
    x, y = steps.assign(sm.Symbol(f"x_{name}"), at[0] - dx), steps.assign(sm.Symbol(f"y_{name}"), at[1] - dy)
    return Pose(x, y, c, s)


def _place_driven(mechanism, drive_angle, poses, steps) -> bool:
    """Place one body that a driven joint or a weld attaches to a placed one."""
    for name, joint in mechanism.joints.items():
        if (name not in mechanism.drives and joint.kind != "weld") or not _one_open(joint, poses):
            continue
        forward = joint.first.body in poses
        base, body = (joint.first, joint.second) if forward else (joint.second, joint.first)
        pose, at = poses[base.body], poses[base.body].place(base)
        c, s = pose.c, pose.s
        sign = 1 if forward else -1
        if name in mechanism.drives and joint.kind == "revolute":
            angle = drive_angle[name]
            cosine = steps.assign(sm.Symbol(f"cos_{name}"), sm.cos(angle))
            sine = steps.assign(sm.Symbol(f"sin_{name}"), sm.sin(angle))
            c, s = pose.c * cosine - sign * pose.s * sine, pose.s * cosine + sign * pose.c * sine
        elif name in mechanism.drives:
            along = pose.turn(joint.direction)
            at = tuple(at[k] + sign * drive_angle[name] * along[k] for k in range(2))
        poses[body.body] = _assign_pose(body.body, c, s, at, body, steps)
        return True
    return False


def _one_open(joint: JointModel, poses: dict[str, Pose]) -> bool:
    return (joint.first.body in poses) != (joint.second.body in poses)


def _place_dyad(mechanism, poses, margins, steps) -> bool:
    """Place a rod and the guided body at its end: revolute - revolute - prismatic."""
    for guide in mechanism.joints.values():
        if guide.kind != "prismatic" or not _one_open(guide, poses):
            continue
        slider = guide.second.body if guide.first.body in poses else guide.first.body
        for link in _revolutes_of(mechanism, slider, guide):
            rod_side, slider_side = (
                (link.first, link.second) if link.second.body == slider else (link.second, link.first)
            )
            if rod_side.body in poses:
                continue
            for pivot in _revolutes_of(mechanism, rod_side.body, link):
                base, foot = (pivot.first, pivot.second) if pivot.first.body in poses else (pivot.second, pivot.first)
                if base.body in poses and foot.body == rod_side.body:
                    rod, body, margin = _close_slider(guide, poses, base, foot, rod_side, slider_side, steps)
                    poses[rod_side.body], poses[slider], margins[guide.name] = rod, body, margin
                    return True
    return False


def _revolutes_of(mechanism: Mechanism, body: str, but: JointModel) -> list[JointModel]:
    return [
        joint
        for joint in mechanism.joints.values()
        if joint.kind == "revolute" and joint is not but and body in (joint.first.body, joint.second.body)
    ]


def _close_slider(guide, poses, base, foot, head, slider_point, steps) -> tuple[Pose, Pose, sm.Expr]:
    """Intersect the circle of the rod's head about its foot with the line on which the guide leads it.

    With t along the guide and n = S t, the rod's vector is R(phi) ab = gamma n + branch w t, where gamma is given
    by the guide's line and w^2 = |ab|^2 - gamma^2 (at gamma = |ab| the linkage is about to break apart).
    """
    known = guide.first if guide.first.body in poses else guide.second
    sliding = guide.second if known is guide.first else guide.first
    frame = poses[known.body]  # a guide locks rotation, so the slider has the direction cosines of its guide
    t = frame.turn(guide.direction)
    n = (-t[1], t[0])
    offset = frame.turn((slider_point.at[0] - sliding.at[0], slider_point.at[1] - sliding.at[1]))
    line, pivot = frame.place(known), poses[base.body].place(base)
    name = head.body
    gamma = steps.assign(sm.Symbol(f"gamma_{name}"), sum(n[k] * (line[k] + offset[k] - pivot[k]) for k in range(2)))
    ab = (head.at[0] - foot.at[0], head.at[1] - foot.at[1])
    reach_squared = ab[0] ** 2 + ab[1] ** 2
    margin = steps.assign(sm.Symbol(f"closure_{guide.name}"), 1 - gamma**2 / reach_squared)
    reach = steps.assign(sm.Symbol(f"w_{name}"), guide.branch * sm.sqrt(reach_squared * margin))
    v = tuple(steps.assign(sm.Symbol(f"rod_{'xy'[k]}_{name}"), gamma * n[k] + reach * t[k]) for k in range(2))
    c = (ab[0] * v[0] + ab[1] * v[1]) / reach_squared
    s = (ab[0] * v[1] - ab[1] * v[0]) / reach_squared
    rod = _assign_pose(name, c, s, pivot, foot, steps)
    tip = (pivot[0] + v[0], pivot[1] + v[1])
    slider = _assign_pose(sliding.body, frame.c, frame.s, tip, slider_point, steps)
    return rod, slider, margin
