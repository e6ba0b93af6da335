"""Parts of a spatial mechanism, by numbers in SI.

Degrees of freedom and constraints of joints are defined here: the former move the mechanism's tree, the latter close
the cut joints of its loops.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from kaneflex.mechanism.contacts import Contact
from kaneflex.mechanism.numbers import Numbers, acting_parts, given_numbers
from kaneflex.mechanism.parts import Load
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.springs import Spring
from kaneflex.scene import Scene
from kaneflex.scene.bodies import Body
from kaneflex.scene.clearances import ClearanceContact
from kaneflex.scene.quantities import Address


@dataclass(frozen=True, eq=False)
class SpatialBody:
    """Body: mass [kg], centre [m], moments J_x, J_y, J_z and products J_xy, J_yz, J_zx of inertia about it [kg m^2],
    (6,), and the axes at zero joint coordinates, columns of a matrix (3, 3)."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray
    rotation: np.ndarray

    @property
    def about_centre(self) -> np.ndarray:
        """Inertia about the centre as a matrix, (3, 3)."""
        x, y, z, xy, yz, zx = self.inertia
        return np.array([[x, xy, zx], [xy, y, yz], [zx, yz, z]])


@dataclass(frozen=True)
class Side:
    """Point of a body in its axes [m]; in a deforming one at the end of an ``arm`` that turns with its section."""

    body: str
    at: tuple[float, ...]
    arm: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class SpatialJoint:
    """Joint between two sides; axes and directions are in the first body's axes, at zero coordinates.

    ``axes``: one for a revolute, prismatic or cylindrical joint, two for a universal joint, else none.
    """

    name: str
    kind: str
    sides: tuple[Side, Side]
    axes: tuple[np.ndarray, ...]

    @property
    def moves(self) -> list[tuple[str, np.ndarray]]:
        """Degrees of freedom, first body to second: name and axis of rotations and slides; ``rotation`` of a ball."""
        match self.kind:
            case "revolute":
                return [("angle", self.axes[0])]
            case "prismatic":
                return [("position", self.axes[0])]
            case "cylindrical":
                return [("position", self.axes[0]), ("angle", self.axes[0])]
            case "universal":
                return [("angle_1", self.axes[0]), ("angle_2", self.axes[1])]
            case "spherical":
                return [("rotation", np.zeros(3))]
        return []

    @property
    def freedoms(self) -> int:
        return 3 if self.kind == "spherical" else len(self.moves)

    @property
    def slides(self) -> bool:
        """True if its second point moves along its axis."""
        return self.kind in ("prismatic", "cylindrical")

    @property
    def across(self) -> list[np.ndarray] | None:
        """Axes of the first body along which the second point can't move; None if the two points coincide."""
        return across(self.axes[0]) if self.slides else None

    @property
    def parallel(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Pairs of axes of the first and second body, given at zero coordinates, that stay perpendicular."""
        match self.kind:
            case "revolute" | "cylindrical":
                return [(axis, self.axes[0]) for axis in across(self.axes[0])]
            case "universal":
                return [(self.axes[0], self.axes[1])]
            case "prismatic" | "weld":
                x, y, z = np.eye(3)
                return [(x, y), (y, z), (z, x)]
        return []


def across(axis: np.ndarray) -> list[np.ndarray]:
    """Two unit vectors perpendicular to a unit vector and to each other."""
    least = np.eye(3)[np.argmin(abs(axis))]
    first = np.cross(axis, least)
    first /= np.linalg.norm(first)
    return [first, np.cross(axis, first)]


@dataclass(frozen=True, kw_only=True, eq=False)
class SpatialMechanism(Numbers):
    """Parts of a mechanism in space.

    A lumped mass is part of its rigid body; on a deforming one it is a separate body, welded to it: one of ``lumped``.

    ``observed``: joints without a drive whose coordinates or speeds enter laws of loads; ``read``: those of sensors.
    """

    d: ClassVar[int] = 6
    """Components of a twist."""
    frame: ClassVar[bool] = False
    masses: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    bodies: Mapping[str, SpatialBody]
    joints: Mapping[str, SpatialJoint]
    loads: Mapping[str, Load]
    springs: Mapping[str, Spring]
    contacts: Mapping[str, Contact]
    observed: tuple[str, ...]
    lumped: frozenset[str]
    read: frozenset[str]
    gravity: np.ndarray

    @cached_property
    def asked(self) -> frozenset[str | None]:
        """Joints whose coordinate a drive, a law, a spring or a contact uses."""
        acting: tuple[Any, ...] = (*self.springs.values(), *self.contacts.values())
        return frozenset((*self.drives, *self.observed, *(each.joint for each in acting)))

    def rest_axes(self, body: str) -> np.ndarray:
        """Axes of a body at zero joint coordinates, (3, 3)."""
        return rest_axes(self.bodies, body)

    def relative(self, of: SpatialJoint | Spring) -> np.ndarray:
        """Axes of a second body in those of the first, at zero joint coordinates, (3, 3)."""
        first, second = (self.rest_axes(side.body) for side in of.sides)
        return first.T @ second


def rest_axes(bodies: Mapping[str, SpatialBody], body: str) -> np.ndarray:
    """Axes of a body at zero joint coordinates, (3, 3)."""
    return np.eye(3) if body == GROUND else bodies[body].rotation


def spatial_mechanism(scene: Scene) -> SpatialMechanism:
    """Make the mechanism of a spatial scene."""

    def side(address: Address) -> Side:
        return Side(address.body, scene.point(address))

    bodies = {name: _body(body) for name, body in scene.bodies.items()}
    joints = {}
    for name, joint in scene.joints.items():
        first, second = (side(address) for address in joint.addresses)
        joints[name] = SpatialJoint(
            name, joint.kind, (first, second), tuple(np.asarray(axis) for axis in joint.given_axes)
        )
    for name, mass in scene.masses.items():
        x, y, z = scene.point(mass.at)
        inertia = mass.inertia if isinstance(mass.inertia, tuple) else (0.0, 0.0, 0.0)
        six, on = np.array([*inertia, *np.zeros(6 - len(inertia))]), bodies[mass.at.body]
        if scene.bodies[mass.at.body].deforms:
            beside = (0.0, y, z) if scene.bodies[mass.at.body].elastic else (0.0, 0.0, 0.0)
            section = Side(mass.at.body, (x, y - beside[1], z - beside[2]))
            bodies[name] = SpatialBody(mass.mass, np.array(beside), six, on.rotation)
            joints[name] = SpatialJoint(name, "weld", (section, Side(name, (0.0,) * 3)), ())
        else:
            bodies[mass.at.body] = _with_mass(on, mass.mass, np.array([x, y, z]), six)

    def touched(contact: Contact, name: str, one: Side, other: Side) -> Side:
        if not (isinstance(contact, ClearanceContact) and contact.offset):
            return other
        turn = rest_axes(bodies, other.body).T @ rest_axes(bodies, one.body)
        arm, centre = turn @ contact.offset, np.array(other.at)
        deforms = other.body != GROUND and scene.bodies[other.body].deforms
        return Side(other.body, other.at, tuple(arm)) if deforms else Side(other.body, tuple(centre + arm))

    reach = [float(np.linalg.norm(end.at)) for joint in joints.values() for end in joint.sides]
    read = {sensor.target.body for sensor in scene.sensors.values() if isinstance(sensor.target, Address)}
    return SpatialMechanism(
        bodies=bodies, joints=joints, observed=scene.observed, lumped=frozenset(bodies.keys() - scene.bodies.keys()),
        read=frozenset(read), gravity=np.asarray(scene.vector(scene.gravity)),
        **acting_parts(scene, joints, side, touched), **given_numbers(scene, reach),
    )  # fmt: skip


def _body(body: Body) -> SpatialBody:
    """Make a body; the default inertia is that of a thin bar along x, for elastic ones with the sections' own."""
    given = body.inertia if isinstance(body.inertia, tuple) else (0.0, body.inertia, body.inertia)
    if body.beam is not None:
        of = body.profile.inertia(body.profile.length)
        about_x, about_y, about_z = of.about_y + of.about_z, of.about_y, of.about_z
        slender = float(given[2]) - about_z * body.beam.rotary
        given = (about_x, slender + about_y * body.beam.rotary, slender + about_z * body.beam.rotary)
    inertia = np.array([*given, *np.zeros(6 - len(given))])
    rotation = np.eye(3) if body.rotation is None else body.rotation.matrix
    return SpatialBody(body.mass, np.array([*body.centre, 0.0][:3]), inertia, rotation)


def _with_mass(body: SpatialBody, mass: float, at: np.ndarray, inertia: np.ndarray) -> SpatialBody:
    """Rigid body with a lumped mass at a point, by Steiner's theorem about their common centre."""
    total = body.mass + mass
    centre = (body.mass * body.centre + mass * at) / total if total else body.centre
    six = body.inertia + inertia
    for m, c in ((body.mass, body.centre - centre), (mass, at - centre)):
        x, y, z = c
        six = six + m * np.array([y * y + z * z, z * z + x * x, x * x + y * y, -x * y, -y * z, -z * x])
    return SpatialBody(total, centre, six, body.rotation)
