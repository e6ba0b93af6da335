"""Mechanism of a scene with its numbers, in the plane or in space."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from kaneflex.mechanism.numbers import Numbers, acting_parts, given_numbers
from kaneflex.mechanism.parts import Body, Joint, Mass, Mechanism, floating_coordinates
from kaneflex.mechanism.planar import BodyPoint, Number, Vector, quarter_turn
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene
from kaneflex.scene.structure import share_structure
from kaneflex.support.weak_cache import WeakCache


@dataclass(frozen=True, kw_only=True, eq=False)
class NumericMechanism(Numbers, Mechanism):
    """Mechanism in the plane with floats in SI."""

    d: ClassVar[int] = 3
    """Components of a twist."""

    @property
    def free(self) -> tuple[str, ...]:
        """Free joints, then the coordinates of free bodies."""
        return self.free_joints + tuple(name for body in self.frees for name in floating_coordinates(body))

    def exerting(self, joint: str) -> list[str]:
        """Names of the reactions along a joint's freedom."""
        return ["friction"] * (joint in self.frictions) + ["drive"] * (joint in self.drives)


def mechanism_of(scene: Scene) -> Any:
    """NumericMechanism or SpatialMechanism of a scene; made once, since scenes are immutable."""
    return _MADE.of(scene, lambda: _made(scene))


_MADE: WeakCache[Scene, Any] = WeakCache()


def same_mechanism(scene: Scene, like: Scene) -> bool:
    """Reuse the mechanism of another scene if only speeds of drives differ; return True if so.

    Settings and sensors may differ, too, since the mechanism does not depend on them.
    """
    if not _differ_by_speed(scene.drives, like.drives) or any(
        getattr(scene, table) != getattr(like, table) for table in _TABLES
    ):
        return False
    _MADE.of(scene, lambda: replace(mechanism_of(like), drives=scene.drives, horizon=scene.horizon))
    share_structure(scene, like)
    return True


_TABLES = ("gravity", "ground", "bodies", "joints", "masses", "loads", "springs", "contacts", "damping")
"""Tables of a scene, besides drives, on which its mechanism and equations depend."""


def _differ_by_speed(drives: Mapping[str, Any], like: Mapping[str, Any]) -> bool:
    """True if drives differ only in their speeds."""
    return drives.keys() == like.keys() and all(
        drive is like[name]
        or (drive == like[name].model_copy(update={"speed": drive.speed}) and drive.kind == like[name].kind)
        for name, drive in drives.items()
    )


def _made(scene: Scene) -> Any:
    if scene.is_spatial:
        from kaneflex.mechanism.spatial import spatial_mechanism

        return spatial_mechanism(scene)

    def side(address: Address) -> BodyPoint:
        return BodyPoint(*address, scene.point(address))

    def touched(contact: Any, name: str, _: BodyPoint, second: BodyPoint) -> BodyPoint:
        if not contact.corner:
            return second
        size = contact.number("length"), contact.number("height")
        return corner_of(name, second, contact.direction, contact.corner, *size)

    joints, closing = dict[str, Joint](), scene.loop_joints()
    for name, joint in scene.joints.items():
        branch = (1.0 if joint.branch == "+" else -1.0) if name in closing else 1
        first, second = map(side, joint.addresses)
        closed = name in closing, branch, joint.relative_angle, joint.near
        joints[name] = Joint(name, joint.kind, first, second, joint.direction or (1, 0), *closed)
    own = {}
    for name, body in scene.bodies.items():
        pose = None if body.pose is None else (*body.pose.at, body.pose.angle)
        own[name] = Body(name, body.elastic, body.mass, body.centre, body.inertia, pose)
    masses = {name: Mass(name, side(mass.at), mass.mass, mass.inertia) for name, mass in scene.masses.items()}
    reach = [math.hypot(*end.at) for joint in joints.values() for end in joint.sides]
    return NumericMechanism(
        bodies=own, joints=joints, masses=masses, observed=scene.observed, gravity=scene.gravity, frame=scene.is_frame,
        viscous=scene.damping is not None and scene.damping.kind == "viscous",
        **acting_parts(scene, joints, side, touched), **given_numbers(scene, reach),
    )  # fmt: skip


def corner_of(name: str, middle: BodyPoint, inward: Vector, corner: int, length: Number, height: Number) -> BodyPoint:
    """Corner of a block at a face with this inward normal, along the normal turned by 90 deg, or back."""
    x, y = quarter_turn(inward)
    along, out = corner * length / 2, height / 2
    at = middle.at[0] + along * x - out * inward[0], middle.at[1] + along * y - out * inward[1]
    return BodyPoint(middle.body, f"contacts.{name}", at)
