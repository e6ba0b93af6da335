"""Forces and moments of joints, drives, loads, springs and contacts on a body, in its own axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kaneflex.mechanism import planar
from kaneflex.mechanism.body_frame import BodyFrame, cross, normal
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import CIRCLES
from kaneflex.mechanism.planar import BodyPoint
from kaneflex.mechanism.rigid_motion import RigidMotion

if TYPE_CHECKING:
    from kaneflex.mechanism.spatial import Side, SpatialMechanism

    Parts = NumericMechanism | SpatialMechanism
    Point = Side | BodyPoint
    Reactions = Callable[[str], np.ndarray]
    """Function from the name of a reaction to its series (n_times,)."""
_SIGNS = (-1.0, 1.0)
"""Signs of what a joint, spring or contact exerts on its first and second body."""


class Wrench(NamedTuple):
    """Point of a force in the body's axes [m], the force [N] and the moment about that point [N m], (3, n_times) each;
    in the plane (2, n_times) and a moment (n_times,).

    ``by``: the joint, load, spring or contact that exerts it; ``on``: its point of the body in the scene [m].
    """

    by: str
    on: tuple[float, ...]
    at: np.ndarray
    force: np.ndarray
    moment: np.ndarray

    @property
    def about_start(self) -> np.ndarray:
        """Force and its moment about the body's start, (3 or 6, n_times)."""
        return np.vstack([self.force, moment_of(self.at, self.force) + self.moment])


def joint_force(mechanism: Parts, motion: RigidMotion, name: str, reaction: Reactions) -> np.ndarray:
    """Global force of a joint on its second body, (2 or 3, n_times), from its reactions by name."""
    if not isinstance(mechanism, NumericMechanism):
        return np.array([reaction(f"{name}.force_{axis}") for axis in "xyz"])
    joint = mechanism.joints[name]
    if not joint.slides:
        return np.array([reaction(f"{name}.force_x"), reaction(f"{name}.force_y")])
    t = motion.frame(joint.first.body).to_global(joint.direction)
    along = sum(reaction(f"{name}.{by}") * t for by in mechanism.exerting(name))
    return np.asarray(reaction(f"{name}.normal") * normal(t) + along)


def joint_moment(mechanism: Parts, name: str, reaction: Reactions) -> np.ndarray:
    """Moment of a joint on its second body, global (3, n_times), in the plane (n_times,), by names of reactions."""
    if not isinstance(mechanism, NumericMechanism):
        return np.array([reaction(f"{name}.moment_{axis}") for axis in "xyz"])
    if mechanism.joints[name].kind != "revolute":
        return reaction(f"{name}.moment")
    exerted = [reaction(f"{name}.{by}") for by in mechanism.exerting(name)]  # the pin itself exerts no moment
    return np.asarray(sum(exerted) if exerted else np.zeros_like(reaction(f"{name}.force_x")))


def moment_of(arm: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Moment of a force at an arm: arm x force, in the plane about z."""
    return cross(arm, force) if len(force) == 3 else np.asarray(planar.cross(arm, force))


def wrenches_on(mechanism: Parts, motion: RigidMotion, body: str) -> Iterator[Wrench]:
    """Wrenches on a body except inertia and weight."""
    parts: Any = mechanism
    on = _Body(mechanism, motion, body)
    for name, joint in parts.joints.items():
        for side, sign in zip(joint.sides, _SIGNS, strict=True):
            if side.body == body:
                force = joint_force(mechanism, motion, name, motion.__getitem__)
                moment = joint_moment(mechanism, name, motion.__getitem__)
                # a guide's force acts at the second point, as the first one slides along it
                yield on.wrench(name, side, sign * force, sign * moment, joint.sides[1] if joint.slides else side)
    for name, load in parts.loads.items():
        for side, share in load.pushes:
            if side.body == body:
                force = np.outer(load.direction, share * motion[name])
                yield on.wrench(name, side, on.axes(side).to_global(force) if load.in_body else force)
        if load.joint is not None:
            yield from on.torque(name, load.joint, motion[name])
    for name, spring in parts.springs.items():
        if spring.joint is not None:
            yield from on.torque(name, spring.joint, -motion[f"{name}.torque"])
            continue
        for side, sign in zip(spring.sides, _SIGNS, strict=True):
            if side.body == body:
                yield on.of_spring(name, spring, side, sign)
    for name, contact in parts.contacts.items():
        if contact.kind == "angle":
            yield from on.torque(name, contact.joint, contact.direction[0] * motion[f"{name}.force"])
            continue
        if contact.kind in CIRCLES:
            gap = on.place(contact.second) - on.place(contact.first)
            if len(contact.direction) == 3:  # the axis of a bearing in space
                axis = on.axes(contact.first).to_global(contact.direction)
                gap = gap - np.sum(axis * gap, axis=0) * axis
            direction = CIRCLES[contact.kind] * gap / np.maximum(np.linalg.norm(gap, axis=0), np.finfo(float).tiny)
        else:
            direction = on.axes(contact.first).to_global(contact.direction)
        push, drag = motion[f"{name}.force"] * direction, np.zeros_like(direction)
        if name in parts.frictions:
            drag = on.drag(name, direction)
        bearing = contact.kind in CIRCLES and len(contact.direction) == 3
        outside = bearing or (contact.kind == "point-plane" and not contact.radius)  # the first body's surface
        arm = contact.radius + (motion[f"{name}.gap"] if outside and name in parts.frictions else 0.0)
        moment = moment_of(-arm * direction, drag)
        for side, sign in zip(contact.sides, _SIGNS, strict=True):
            if side.body == body:
                yield on.wrench(name, side, sign * (push + drag), sign * moment, at=contact.second)


@dataclass(frozen=True, eq=False)
class _Body:
    """Body on which wrenches act."""

    mechanism: Parts
    motion: RigidMotion
    body: str

    @property
    def frame(self) -> BodyFrame:
        return self.motion.frame(self.body)

    def axes(self, side: Point) -> BodyFrame:
        """Axes that a point of a body rotates with."""
        return self.motion.section_frame(side)[0]

    def place(self, side: Point) -> np.ndarray:
        """Global position of a point."""
        axes, there = self.motion.section_frame(side)
        return axes.place(there.at)

    def drag(self, contact: str, direction: np.ndarray) -> np.ndarray:
        """Global friction force of a contact on its second side, in the plane along its normal turned by 90 deg."""
        if isinstance(self.mechanism, NumericMechanism):
            return self.motion[f"{contact}.friction"] * normal(direction)
        return np.array([self.motion[f"{contact}.friction_{axis}"] for axis in "xyz"])

    def wrench(
        self, by: str, side: Point, force: np.ndarray, moment: np.ndarray | None = None, at: Point | None = None
    ) -> Wrench:
        """Wrench of a global force and moment; ``at``: point of the force, if not that of the body."""
        local, no_moment = self.frame.to_body, np.zeros_like(force[0] if len(force) == 2 else force)
        moment = no_moment if moment is None else moment if len(force) == 2 else local(moment)
        return Wrench(by, side.at, local(self.place(at or side) - self.frame.origin), local(force), moment)

    def torque(self, by: str, joint: str, torque: np.ndarray) -> Iterator[Wrench]:
        """Torque about a joint's axis, on its second body."""
        of: Any = self.mechanism.joints[joint]
        moment = torque
        if not isinstance(self.mechanism, NumericMechanism):
            moment = torque * self.axes(of.sides[0]).to_global(of.axes[0])
        for side, sign in zip(of.sides, _SIGNS, strict=True):
            if side.body == self.body:
                yield self.wrench(by, side, np.zeros_like(self.frame.origin), sign * moment)

    def of_spring(self, name: str, spring: Any, side: Point, sign: float) -> Wrench:
        """Wrench of a spring between two points, or of a bushing, on one of them."""
        motion, (first, second) = self.motion, spring.sides
        if isinstance(self.mechanism, NumericMechanism):
            return self.wrench(name, side, sign * np.array([motion[f"{name}.force_x"], motion[f"{name}.force_y"]]))
        if spring.is_bushing:
            axes = self.axes(first)
            force, moment = (axes.to_global(np.array([motion[f"{name}.{part}_{axis}"] for axis in "xyz"]))
                             for part in ("force", "moment"))  # fmt: skip
            return self.wrench(name, side, -sign * force, -sign * moment, second)  # at the second point, as of a guide
        along = self.place(first) - self.place(second)
        pull = spring.stiffness * along
        if spring.is_directed:
            pull = motion[f"{name}.tension"] * along / np.hypot(np.hypot(along[0], along[1]), along[2])
        return self.wrench(name, side, sign * pull)
