"""Contacts between two bodies."""

from __future__ import annotations

from pydantic import field_validator, model_validator

from kaneflex.scene.contact_law import ContactLaw, Friction, cylinders, friction_in, spheres
from kaneflex.scene.quantities import (
    Address,
    AddressPair,
    Direction,
    NonNegativeLength,
    PositiveLength,
    Radii,
    Vector,
)  # fmt: skip
from kaneflex.scene.table import SceneTable, first_given, the_one_given
from kaneflex.support.errors import Fault, within

_KINDS = {
    "point_on_line": "point-line", "point_on_plane": "point-plane", "circle_on_circle": "circle-circle",
    "circle_in_circle": "circle-in-circle",
}  # fmt: skip
_FACES = ("point_on_line", "point_on_plane")
"""Contacts with a face, which has a normal."""
STIFFNESS = "Give contact.stiffness"


def check_friction(friction: Friction | None) -> None:
    """Raise Fault for friction that a contact can't have."""
    if friction is not None:
        with within("friction"):
            friction.check_at("contact")


class Contact(SceneTable):
    """Contact between two bodies.

    `point_on_line`: a point of one body, or a circle of this `radius` about it, stays on the side of a line through a
    point of another body that the `normal` (in that body's axes) points to; in space `point_on_plane` is the same with
    a plane, and a sphere in place of the circle. `circle_on_circle`, `circle_in_circle`
    (the first in the second): circles of these `radii` about two points. In space they are spheres, the second with an
    `axis` (in its body's axes) an endless cylinder. For a stiffness from materials, circles are spheres, or in the
    plane cylinders of a `width`. `friction` acts in the contact.
    """

    point_on_line: AddressPair | None = None
    point_on_plane: AddressPair | None = None
    circle_on_circle: AddressPair | None = None
    circle_in_circle: AddressPair | None = None
    normal: Direction | None = None
    radius: NonNegativeLength = 0.0
    radii: Radii | None = None
    axis: Direction | None = None
    width: PositiveLength | None = None
    contact: ContactLaw
    friction: Friction | None = None

    _friction_in = field_validator("friction", mode="before")(lambda value: friction_in(value, turning=False))

    @model_validator(mode="after")
    def _consistent(self) -> Contact:
        check_friction(self.friction)
        given = the_one_given(self, tuple(_KINDS))
        face = given in _FACES
        if face and self.normal is None:
            what, like = ("line", "[0, 1]") if given == "point_on_line" else ("plane", "[0, 0, 1]")
            raise Fault(f"the side of the {what} is not given", f"Give normal, like normal = {like}")
        if not face and self.radii is None:
            raise Fault("the circles have no radii", "Give radii, like radii = ['10 mm', '10.05 mm']")
        self.refuse(("radii", "axis") if face else ("normal", "radius"), f"does not apply to {given}")
        radii = self.radii or (0.0, 0.0)
        if given == "circle_in_circle" and not radii[0] < radii[1]:
            raise Fault("the first circle does not fit into the second", "Give the smaller radius first", below="radii")
        if given == "circle_on_circle" and not any(radii):
            raise Fault("two points cannot touch", "Give at least one of them a radius", below="radii")
        first, second = self.sides
        if first.body == second.body:
            raise Fault("both sides are on the same body", "Name points of two bodies", below=given)
        _ = self.pushing  # raises Fault
        return self

    @property
    def kind(self) -> str:
        return _KINDS[first_given(self, tuple(_KINDS))]

    @property
    def key(self) -> str:
        """Keys of its two points in the contact's table."""
        return first_given(self, tuple(_KINDS))

    @property
    def sides(self) -> tuple[Address, Address]:
        """Side of the line or of the outer circle, and the side that the force pushes along the normal."""
        return getattr(self, self.key)[::-1]

    @property
    def direction(self) -> Vector:
        """Normal of a line or plane, or axis of a cylinder, in the axes of its body; (0, 0) without them."""
        return self.normal or self.axis or (0.0, 0.0)

    @property
    def touching(self) -> float:
        """Radius of the side that the force pushes along the normal [m]."""
        return self.radius if self.radii is None else self.radii[0]

    @property
    def reach(self) -> float:
        """Distance of the two points at first touch, along the normal of a line [m]."""
        if self.radii is None:
            return self.radius
        first, second = self.radii
        return first + second if self.kind == "circle-circle" else second - first

    @property
    def pushing(self) -> tuple[float, float]:
        """Stiffness K [N/m^n] and exponent n; 0 and 1 of rigid sides. Raises Fault for shapes beyond Hertz."""
        if self.law == "newton":
            if self.width is not None:
                raise Fault("does not apply to law newton, which has rigid sides", "Leave it out", below="width")
            return 0.0, 1.0
        if self.contact.stiffness is not None:
            if self.width is not None:
                reason = "cannot be combined with contact.stiffness, which is that of the whole width"
                raise Fault(reason, "Leave it out", below="width")
            return self.contact.stiffness, self.contact.exponent
        modulus, load = self.contact.contact_modulus, self.contact.load
        if self.width is None:
            if load is not None:
                reason = "does not apply to spheres, which follow a power law"
                raise Fault(reason, "Leave it out, or give a width", below="contact.load")
            return spheres(modulus, self.curvature), 1.5
        if self.key in _FACES:
            raise Fault(
                "Hertz's theory gives no depth of a cylinder on a plane: it depends on the whole body",
                "Give contact.stiffness and exponent, or leave width out for a sphere", below="width",
            )  # fmt: skip
        return cylinders(modulus, self.width, self.reach, load)

    @property
    def curvature(self) -> float:
        """Curvature 1/R of two spheres, or of a sphere and a plane [1/m]. Raises Fault without a radius."""
        if self.axis is not None:
            raise Fault("Hertz's theory of spheres does not apply to cylinders", STIFFNESS, below="contact")
        if self.radii is None:
            radii: tuple[float, ...] = (self.radius,)
        else:
            radii = (self.radii[0], -self.radii[1] if self.kind == "circle-in-circle" else self.radii[1])
        if 0.0 in radii:
            reason = "Hertz's theory needs a radius, a point has none"
            raise Fault(reason, "Give its radius, or contact.stiffness", below="contact")
        return sum(1 / radius for radius in radii)

    @property
    def law(self) -> str:
        return self.contact.law

    @property
    def joint(self) -> str | None:
        """Joint with this clearance."""
        return None

    @property
    def corner(self) -> int:
        """Position of a block's corner along the normal turned by 90 deg: 1 or -1; 0 for other contacts."""
        return 0

    def table_key(self, name: str) -> str:
        """Key of the contact of this name in the scene; it may be a joint's clearance."""
        return f"contacts.{name}" if self.joint is None else f"joints.{self.joint}.clearance"

    def entry(self, name: str) -> str:
        """Entry of the scene with the two points of the contact of this name."""
        return f"contacts.{name}.{self.key}"

    def number(self, name: str) -> float:
        """Value of the contact's parameter of this name in the equations."""
        numbers = {"reach": self.reach, "radius": self.touching, "stiffness": self.pushing[0]}
        numbers |= {"exponent": self.pushing[1], "damping": self.contact.damping or 0.0}
        restitution = self.contact.restitution
        return (numbers | {"restitution": 1.0 if restitution is None else restitution})[name]
