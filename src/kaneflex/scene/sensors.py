"""Sensors: named quantities of the motion, each with its reference and axes; events at which they cross a value."""

from __future__ import annotations

from functools import cached_property
from typing import Literal

from pydantic import Field, StrictBool, model_validator

from kaneflex.scene.quantities import Address, AddressField, Fibre
from kaneflex.scene.table import SceneTable, the_one_given
from kaneflex.support.errors import Fault

STRESSES = {3: ("xx", "yy", "xy"), 6: ("xx", "yy", "zz", "xy", "yz", "zx")}
"""Names of the stress components in the body's axes, by their number: in the plane three or six, in space six."""
MOTION_KINDS = ("displacement", "velocity", "acceleration", "position")
SECTION_KINDS = ("axial_force", "bending_moment", "torsional_moment", "shear_force", "strain")
POINT_KINDS = MOTION_KINDS + SECTION_KINDS
DRIVE_KINDS = ("drive_torque", "drive_force")
SPRING_KINDS = ("spring_force", "spring_torque")
FLANK_KINDS = ("contact_torque", "contact_angle")
CONTACT_KINDS = ("contact_force", "contact_gap", *FLANK_KINDS)
FRICTION_KINDS = ("friction_force", "friction_torque")
KINDS = (*POINT_KINDS, "stress", "joint_force", *DRIVE_KINDS, *SPRING_KINDS, *CONTACT_KINDS, *FRICTION_KINDS)
RIGID_COMPANIONS = ("axial_force", "joint_force", *DRIVE_KINDS, *SPRING_KINDS)
"""Kinds whose rigid value is also written, as NAME_rigid."""

_UNITS = {
    "displacement": "m", "velocity": "m/s", "acceleration": "m/s^2", "position": "m", "force": "N", "moment": "N m",
    "torque": "N m", "strain": "1", "stress": "Pa", "gap": "m", "angle": "rad",
}  # fmt: skip
_UNITS_OF_ANGLE = {
    "displacement": "rad", "velocity": "rad/s", "acceleration": "rad/s^2", "position": "rad", "force": "N m",
}  # fmt: skip
"""Units of quantities, the last words of kinds; of rotations and moments."""


class Sensor(SceneTable):
    """Measured quantity: exactly one kind, with the address that it is measured at.

    displacement, velocity, acceleration, position: of a body's point; `component` x, y or angle, in `body`
    axes (the default; global for a position) or `global` ones. A displacement is relative to the body's rigid
    `frame`, to the `chord` through its displaced ends or to its `start`. An acceleration reads as an
    accelerometer would (a - g) in body axes, or `kinematic` (a), the default in global axes. A position may
    name a joint: its coordinate, or the position of its second side in its clearance. axial_force (tension positive),
    bending_moment, shear_force, strain (at the height `fibre` above the axis): in the section just before the point,
    or just after it by `cut`, if a force acts there between the ends, or the section changes. stress: at a
    point at which a body's modal data recover it, von Mises' or a component in the body's axes. joint_force: the force
    (component angle: moment) of a joint on `body`, by default the joint's second one. drive_torque: torque that a drive
    applies; drive_force: force of a guide's drive.
    spring_force: the tension of a spring and its damper; spring_torque: the torque of a torsional one against the
    joint's rotation. In space components are x, y, z, and angle_x, angle_y, angle_z for rotations, angular velocities
    and accelerations, and moments about these axes; a bending_moment is about the link's y or z, a shear_force along
    them, torsional_moment about x, and a strain's `fibre` is at y and z of the section. contact_force: the normal force
    of a contact; contact_gap: the distance of its sides, negative for penetration. contact_torque, contact_angle:
    torque and gap of a flank of a joint's backlash. friction_force: force of friction on the second side of a contact
    or a guide, or on the point in contact with a line; friction_torque: torque of friction in a pin.
    """

    displacement: AddressField | None = None
    velocity: AddressField | None = None
    acceleration: AddressField | None = None
    position: AddressField | None = None
    axial_force: AddressField | None = None
    bending_moment: AddressField | None = None
    torsional_moment: AddressField | None = None
    shear_force: AddressField | None = None
    strain: AddressField | None = None
    stress: AddressField | None = None
    joint_force: str | None = None
    drive_torque: str | None = None
    drive_force: str | None = None
    spring_force: str | None = None
    spring_torque: str | None = None
    contact_force: str | None = None
    contact_gap: str | None = None
    contact_torque: str | None = None
    contact_angle: str | None = None
    friction_force: str | None = None
    friction_torque: str | None = None
    relative_to: Literal["frame", "chord", "start"] = "frame"
    component: Literal[
        "x", "y", "z", "angle", "angle_x", "angle_y", "angle_z", "mises", "xx", "yy", "zz", "xy", "yz", "zx"
    ] = Field(default_factory=lambda data: "x" if data.get("stress") is None else "mises")
    axes: Literal["body", "global"] = Field(
        default_factory=lambda data: "global" if all(data.get(kind) is None for kind in MOTION_KINDS[:3]) else "body"
    )
    reading: Literal["accelerometer", "kinematic"] = Field(
        default_factory=lambda data: "accelerometer" if data.get("axes") == "body" else "kinematic"
    )
    body: str | None = None
    fibre: Fibre | None = None
    cut: Literal["before", "after"] = "before"

    @model_validator(mode="after")
    def _consistent(self) -> Sensor:
        kind = the_one_given(self, KINDS)
        needs = {
            "relative_to": ("displacement",),
            "component": (*MOTION_KINDS, "joint_force", "bending_moment", "shear_force", "stress", *SPRING_KINDS),
            "axes": (*MOTION_KINDS, "joint_force"),
            "reading": ("acceleration",),
            "body": ("joint_force",),
            "fibre": ("strain",),
            "cut": SECTION_KINDS,
        }
        self.refuse((field for field, kinds in needs.items() if kind not in kinds), f"does not apply to {kind}")
        if (kind == "stress") != (self.component in ("mises", *STRESSES[6])):
            reason = f"not a component of a {kind.replace('_', ' ')}"
            cure = f"Give mises or one of {', '.join(STRESSES[6])}" if kind == "stress" else "Give x, y, z or an angle"
            raise Fault(reason, cure, below="component")
        if kind == "strain" and self.fibre is None:
            raise Fault("the strain's fibre is not given", "Give fibre, its height above the axis")
        return self

    @cached_property
    def kind(self) -> str:
        return the_one_given(self, KINDS)

    @property
    def quantity(self) -> str:
        """Quantity that the sensor measures: the last word of its kind."""
        return self.kind.rpartition("_")[2]

    @property
    def target(self) -> Address | str:
        """Address measured at, or the joint's or drive's name."""
        return getattr(self, self.kind)

    @cached_property
    def meaning(self) -> str:
        """Description in one line: kind, place, component, axes."""
        text = f"{self.kind.replace('_', ' ')} of {self.target}"
        if self.kind in (*MOTION_KINDS, "joint_force"):
            text += f", {self.component}" + ("" if self.component == "angle" else f" in {self.axes} axes")
        if self.kind == "stress":
            text += ", von Mises'" if self.component == "mises" else f", {self.component} in body axes"
        several = ("bending_moment", "shear_force", *SPRING_KINDS)
        if self.kind in several and "component" in self.model_fields_set:
            text += f", {self.component}"
        if self.kind == "displacement":
            text += f", relative to {self.relative_to}"
        if self.kind == "acceleration" and self.reading == "accelerometer":
            text += ", as an accelerometer reads (a - g)"
        if self.kind == "strain":
            place: tuple[float, ...] = self.fibre if isinstance(self.fibre, tuple) else (self.fibre or 0.0,)
            text += ", fibre {} m above the axis".format(" and ".join(f"{at:g}" for at in place))
        if "cut" in self.model_fields_set:
            text += f", just {self.cut} it"
        return text

    @cached_property
    def unit(self) -> str:
        """SI unit: m, m/s, m/s^2, rad, rad/s, rad/s^2, N, N m, Pa or 1."""
        return (_UNITS_OF_ANGLE if self.component.startswith("angle") else _UNITS)[self.quantity]


class Event(SceneTable):
    """Crossing of `value` by a `sensor`, `up`, `down` or in `both` directions. With `stop` the run ends there.

    `value` is in the sensor's SI unit, or text with a unit.
    """

    sensor: str
    value: float | str = 0.0
    direction: Literal["up", "down", "both"] = "both"
    stop: StrictBool = False
