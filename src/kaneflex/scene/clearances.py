"""Clearances of joints, and the contacts that replace these joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from operator import mul
from typing import Any

from pydantic import field_validator, model_validator

from kaneflex.scene.contact_law import ContactLaw, Friction, friction_in, of_flanks
from kaneflex.scene.contacts import STIFFNESS, Contact, check_friction
from kaneflex.scene.quantities import (
    Address,
    Angle,
    Direction,
    NonNegativeLength,
    PositiveAngle,
    PositiveLength,
    Vector,
)  # fmt: skip
from kaneflex.scene.table import SceneTable, the_one_given
from kaneflex.support.errors import Fault, within

_OF_JOINTS = {
    "revolute": ("radial", "angle"), "prismatic": ("gap",), "spherical": ("radial",), "cylindrical": ("radial",),
}  # fmt: skip
"""Clearances, of which a kind of joint may have one."""
_OF_CLEARANCES = {
    "radial": ("radius", "width", "length", "axial"), "gap": ("length", "height", "breadth", "normal"),
    "angle": ("middle",),
}  # fmt: skip
"""Keys that each kind of clearance may have."""
_NEEDED = {
    ("prismatic", False): ("length",), ("prismatic", True): ("length", "height", "breadth", "normal"),
    ("revolute", True): ("length", "axial"), ("cylindrical", True): ("length",),
}  # fmt: skip
"""Keys that the clearance of a kind of joint needs in the plane, or in space."""
_SIDES = {"revolute": "a pin", "cylindrical": "a pin", "spherical": "a ball", "prismatic": "the block of a guide"}
"""Second side of each kind of joint."""
_LIKE = {"length": "'20 mm'", "axial": "'0.1 mm'", "height": "'20 mm'", "breadth": "'20 mm'", "normal": "[0, 1, 0]"}
"""Examples of keys that only some kinds of joints have."""
_SQUARE = 1e-6
"""Cosine up to which two directions count as perpendicular."""


class Clearance(SceneTable):
    """Clearance of a joint, which then has no reaction: its sides touch by `contact`.

    A revolute joint has a `radial` clearance (radius of the bearing minus radius of the pin); `width` is that of both,
    `radius` that of the pin; of a spherical joint the same of its ball and socket. In space a pin has a `length`: its
    two ends can touch the bearing, that of a revolute joint also faces at an `axial` distance to either side. A guide's
    block has a `gap` to every face in its middle position; it has a `length` and a `height`, and its corners can touch;
    in space the height is along a `normal` of the guide, and it has a `breadth` across both. The bearing and the faces
    are on the joint's first body. `friction` acts where they touch.

    With an `angle` a revolute joint remains ideal and has backlash: `angle` is the play from the `middle` (relative
    angle of the second body) to the flank on either side.
    """

    radial: PositiveLength | None = None
    radius: NonNegativeLength = 0.0
    width: PositiveLength | None = None
    gap: PositiveLength | None = None
    length: PositiveLength | None = None
    axial: PositiveLength | None = None
    height: NonNegativeLength = 0.0
    breadth: PositiveLength | None = None
    normal: Direction | None = None
    angle: PositiveAngle | None = None
    middle: Angle = 0.0
    contact: ContactLaw
    friction: Friction | None = None

    _friction_in = field_validator("friction", mode="before")(lambda value: friction_in(value, turning=False))

    @model_validator(mode="before")
    @classmethod
    def _by_angles(cls, given: object) -> object:
        """Convert numbers of a contact between flanks as torques and angles."""
        if isinstance(given, dict) and "angle" in given and isinstance(given.get("contact"), dict):
            with within("contact"):
                return given | {"contact": of_flanks(given["contact"])}
        return given

    @model_validator(mode="after")
    def _consistent(self) -> Clearance:
        check_friction(self.friction)
        given = the_one_given(self, ("radial", "gap", "angle"))
        if given == "angle" and self.friction is not None:
            raise Fault("flanks do not slide", "Give the joint's own friction", below="friction")
        strange = (key for keys in _OF_CLEARANCES.values() for key in keys if key not in _OF_CLEARANCES[given])
        self.refuse(dict.fromkeys(strange), f"does not apply to a {given} clearance")
        if given == "angle" and self.contact.stiffness is None and self.contact.law != "newton":
            reason = "Hertz's theory does not apply to flanks"
            raise Fault(reason, "Give stiffness, a torque per angle^n", below="contact")
        return self

    def check_kind(self, kind: str) -> None:
        """Raise Fault for a kind of joint that does not have this clearance."""
        wanted = _OF_JOINTS.get(kind, ())
        if all(getattr(self, key) is None for key in wanted):
            cure = f"Give {' or '.join(wanted)}" if wanted else "Leave it out"
            raise Fault(f"a {kind} joint has no such clearance", cure)

    def check_at(self, kind: str, axis: tuple[float, ...]) -> None:
        """Raise Fault for keys that a kind of joint needs, or does not have.

        ``axis``: that of the bearing or the guide, with three components in space.
        """
        if self.angle is not None:
            return
        side, in_space = _SIDES[kind], len(axis) == 3 or kind == "spherical"
        needed, where = _NEEDED.get((kind, in_space), ()), " in space" if in_space and kind != "spherical" else ""
        for key in needed:
            if not getattr(self, key):
                raise Fault(f"{side}{where} needs it", f"Give it, like {key} = {_LIKE[key]}", below=key)
        strange = (key for key in _LIKE if key not in (*needed, "height"))
        self.refuse(strange, f"{side}{where or ' in the plane'} has none")
        if self.width is not None and in_space:
            raise Fault(f"{side}{where} has no width", "Leave it out", below="width")
        if self.normal and (len(self.normal) != 3 or abs(sum(map(mul, self.normal, axis))) > _SQUARE):
            raise Fault("not perpendicular to the guide", "Give three components across it", below="normal")


class ClearanceContact(Contact):
    """Contact that replaces a joint with a clearance; made when the scene is read, never written."""

    of: str
    of_kind: str
    clearance: Clearance
    along: int = 0
    flank: int = 0
    offset: tuple[float, ...] = ()
    """In space: vector from the second side's point to the touching one, in the first body's axes at coordinate 0."""

    @property
    def kind(self) -> str:
        return "angle" if self.flank else super().kind

    @property
    def direction(self) -> Vector:
        return (float(self.flank), 0.0) if self.flank else super().direction

    @property
    def joint(self) -> str:
        return self.of

    def entry(self, name: str) -> str:
        return f"joints.{self.of}.{self.of_kind}"

    @property
    def corner(self) -> int:
        return self.along

    @property
    def room(self) -> float:
        """Distance to first touch from the middle of the clearance [m], for flanks [rad]."""
        clearance = self.clearance
        if clearance.angle is not None:
            return clearance.angle
        if self.kind == "circle-in-circle":
            return clearance.radial or 0.0
        return clearance.gap or clearance.axial or 0.0

    @property
    def touching(self) -> float:
        return self.clearance.radius

    @property
    def reach(self) -> float:
        if self.flank:
            return self.flank * self.clearance.middle - self.room
        if self.kind == "circle-in-circle":
            return self.room
        away = sum(map(mul, self.direction, self.offset)) if self.offset else -self.clearance.height / 2
        return away - self.room

    @property
    def curvature(self) -> float:
        pin, clearance = self.clearance.radius, self.clearance.radial
        if self.axis is not None:
            raise Fault("Hertz's theory does not apply to ends and corners", STIFFNESS, below="contact")
        if self.kind == "point-line" or not pin:
            what = "a corner" if self.kind == "point-line" else "a pin"
            cure = "Give contact.stiffness" if self.kind == "point-line" else "Give its radius, or the joint's width"
            raise Fault(f"Hertz's theory needs a radius, {what} has none", cure, below="contact")
        return clearance / (pin * (pin + clearance))

    def number(self, name: str) -> float:
        if name in ("length", "height"):
            return getattr(self.clearance, name)
        return super().number(name)


def contacts_of(name: str, joint: Any) -> dict[str, ClearanceContact]:
    """Contacts that replace a joint with a clearance: of a pin by the joint's name, of a block NAME_1 to NAME_4.

    NAME_1 to NAME_4 are a block's corners, seen along its guide: 1 and 2 on the right, rear and front, 3 and 4 on the
    left. Backlash has NAME_1, which turns the second body forwards, and NAME_2, backwards; the joint remains.
    In space NAME_1 and NAME_2 are the rear and front ends of a pin along its axis, NAME_3 and NAME_4 its stops against
    the rear and front faces; a block has four corners at each of four faces, NAME_1 to NAME_16.
    """
    first, second = joint.addresses
    clearance = joint.clearance
    shared = {"contact": clearance.contact, "friction": clearance.friction, "of": name, "of_kind": joint.kind,
              "clearance": clearance, "width": clearance.width}  # fmt: skip
    if clearance.angle is None and joint.given_axes and len(joint.given_axes[0]) == 3:
        shared |= {"axis": joint.given_axes[0], "along": 1}
        kinds = {True: "circle_in_circle", False: "point_on_plane"}
        return {
            f"{name}_{k}": ClearanceContact.model_construct(
                **shared | {kinds[inward is None]: (second, first), "normal": inward, "offset": offset}
            )
            for k, (inward, offset) in enumerate(_in_space(joint.given_axes[0], clearance), start=1)
        }
    if clearance.radial is not None:
        return {name: ClearanceContact.model_construct(circle_in_circle=(second, first), **shared)}
    if clearance.angle is not None:
        return {
            f"{name}_{k}": ClearanceContact.model_construct(circle_in_circle=(second, first), flank=flank, **shared)
            for k, flank in ((1, 1), (2, -1))
        }
    x, y = joint.direction
    right, left = (-y, x), (y, -x)  # the faces by their inward normals
    corners = [(right, 1), (right, -1), (left, -1), (left, 1)]
    return {
        f"{name}_{k}": ClearanceContact.model_construct(
            point_on_line=(second, first), normal=inward, along=along, **shared
        )
        for k, (inward, along) in enumerate(corners, start=1)
    }


def _in_space(axis: Vector, clearance: Clearance) -> Iterator[tuple[Vector | None, Vector]]:
    """Contacts of a pin or a block in space: normal of the touched face, None for a bearing, and offset of the touching
    point from the second side's, both in the first body's axes."""

    def times(share: float, direction: Vector) -> Vector:
        return tuple(share * part for part in direction)

    half, ways = (clearance.length or 0.0) / 2, (-1, 1)
    if clearance.radial is not None:
        yield from ((None, times(way * half, axis)) for way in ways)
        yield from ((times(-way, axis), (0.0, 0.0, 0.0)) for way in ways if clearance.axial is not None)
        return
    assert clearance.normal is not None and clearance.breadth is not None  # see Clearance.check_at
    (a, b, c), (x, y, z) = axis, clearance.normal
    right = b * z - c * y, c * x - a * z, a * y - b * x
    sizes = times(clearance.breadth / 2, right), times(clearance.height / 2, clearance.normal)
    for k, side, other, along in product((0, 1), (1, -1), ways, ways):  # right, left, above, below
        parts = times(side, sizes[k]), times(other, sizes[1 - k]), times(along * half, axis)
        yield times(-side, (right, clearance.normal)[k]), tuple(map(sum, zip(*parts, strict=True)))


@dataclass(frozen=True)
class LooseJoint:
    """Joint with a clearance, replaced by contacts in a scene that was read.

    Attributes
    ----------
    sides : tuple of Address
        Side of the bearing or the guide, and side of the pin or block.
    clearance : Clearance
    direction : tuple of float or None
        Unit vector along a guide, in the axes of its body; None for a pin.
    contacts : tuple of str
    axis : tuple of float
        Axis of a pin's bearing in space, in the axes of its body; empty otherwise.
    """

    sides: tuple[Address, Address]
    clearance: Clearance
    direction: Vector | None
    contacts: tuple[str, ...]
    axis: Vector = ()

    @property
    def room(self) -> float:
        """Clearance of a pin's or block's centre: distance to first touch [m]."""
        return self.clearance.radial or self.clearance.gap or 0.0

    @property
    def length(self) -> float:
        """Length of a block along its guide [m]."""
        return self.clearance.length or 0.0


def loose_joints(contacts: Mapping[str, Contact]) -> dict[str, LooseJoint]:
    """Joints replaced by the contacts of their clearance, by name."""
    found: dict[str, LooseJoint] = {}
    made = {key: contact for key, contact in contacts.items() if isinstance(contact, ClearanceContact)}
    made = {key: contact for key, contact in made.items() if not contact.flank}
    for name in dict.fromkeys(contact.joint for contact in made.values()):
        own = {key: contact for key, contact in made.items() if contact.joint == name}
        first = next(iter(own.values()))
        pin, axis = first.kind == "circle-in-circle", first.axis
        x, y = first.direction[:2]  # of a plane guide the normal of its right face
        direction = None if pin else axis or (y, -x)
        found[name] = LooseJoint(first.sides, first.clearance, direction, tuple(own), (axis or ()) if pin else ())
    return found
