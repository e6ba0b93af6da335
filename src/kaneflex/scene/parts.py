"""Joints, drives, loads, damping, sensors and the solve table of a scene."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    StrictBool,
    ValidationInfo,
    field_validator,
    model_validator,
)

from kaneflex.scene.quantities import (
    Abscissa,
    Address,
    AddressField,
    AddressPair,
    Angle,
    Axes,
    BodyInertia,
    CountOrAll,
    Direction,
    DriveCoordinate,
    ForceOrTorque,
    LawText,
    NonNegativeMass,
    NonNegativeRatio,
    NumberPair,
    PositiveArea,
    PositiveLength,
    PositiveRatio,
    PositiveTime,
    WholeNumber,
    either,
)
from kaneflex.scene.table import SceneTable, first_given, late, the_one_given
from kaneflex.scene.tables import SPEEDS, Table, abscissae, read_table
from kaneflex.support.errors import Fault, nearest, within
from kaneflex.support.interpolation import Interpolation
from kaneflex.support.units import FORCE, FORCE_PER_LENGTH, PRESSURE, TORQUE, to_si

if TYPE_CHECKING:
    from kaneflex.scene.clearances import Clearance
    from kaneflex.scene.contact_law import Friction
    from kaneflex.scene.start import Start
else:
    (Friction,) = late("kaneflex.scene.contact_law", "Friction")
    (Clearance,) = late("kaneflex.scene.clearances", "Clearance")
    (Start,) = late("kaneflex.scene.start", "Start")

PRESETS = {
    "rigid": "kinematics, inverse dynamics and joint reactions; nothing deforms",
    "quasistatic": "static deformation at each instant, (K_s + K_d + K_g) z = F; no damping",
    "paper": "the paper's model: one element per link, elastic rotations shared at pins, frozen decoupled modes",
    "linear": "vibration about the rigid motion, without geometric stiffness",
    "stiffened": "linear with geometric stiffness and shortening by bending",
    "coupled": "nonlinear: motion and deformation act on each other; error-controlled steps",
}
_TIGHTEST = 1e-13
"""Smallest tolerance; below it rounding errors dominate."""
_LIKE_DIRECTION = "Give it, like direction = [1, 0], in space [1, 0, 0]"
_STARTS = ("zero", "quasistatic", "periodic")
TERM_NAMES = ("spin", "gyroscopic", "euler", "geometric", "damping", "rotary", "shear", "gravity")


JOINT_KINDS = ("revolute", "prismatic", "weld", "cylindrical", "universal", "spherical")
SEVERAL_FREEDOMS = ("cylindrical", "universal", "spherical")
"""Kinds of joints with more than one degree of freedom."""
START_SPEEDS = {"cylindrical": "initial_speeds", "universal": "initial_speeds", "spherical": "angular_velocity"}
"""Key of the initial speeds of such a joint, if it is free."""
IN_THE_PLANE = "In a planar scene use two springs between separate points, along x and along y"


class Joint(SceneTable):
    """Joint between two points: `revolute`, `prismatic` (along `direction`, in the first body's axes) or
    `weld`. In space a revolute joint has an `axis`, and there are `cylindrical` (rotates about an `axis` and slides
    along it), `universal` (rotates about two `axes`, one fixed to each body) and `spherical` joints. Axes are given in
    the first body's axes, at zero joint coordinates.

    `branch`, at the joint that closes a loop of two bodies, chooses between its two closures; a larger loop may have
    more. Alternatively `near` gives approximate angles of its bodies at the start. `rotation` is that of elastic bodies
    at a revolute joint: released (each its own) or shared (the paper's model). `relative_angle` (rad) is the angle
    of the second body relative to the first in a weld. A `clearance` of a pin or a guide replaces the joint by
    contacts. A clearance in an angle is backlash: the joint remains ideal. `friction` opposes the motion.
    """

    revolute: AddressPair | None = None
    prismatic: AddressPair | None = None
    weld: AddressPair | None = None
    cylindrical: AddressPair | None = None
    universal: AddressPair | None = None
    spherical: AddressPair | None = None
    direction: Direction | None = None
    axis: Direction | None = None
    axes: Axes | None = None
    branch: Literal["+", "-"] = "+"
    near: dict[str, Angle] = Field(default={})
    rotation: Literal["released", "shared"] = "released"
    relative_angle: Angle = 0.0
    clearance: Clearance | None = None
    friction: Friction | None = None

    @field_validator("friction", mode="before")
    @classmethod
    def _friction_in(cls, value: object, info: ValidationInfo) -> object:
        from kaneflex.scene.contact_law import friction_in

        return friction_in(value, turning=info.data.get("revolute") is not None)

    @model_validator(mode="after")
    def _consistent(self) -> Joint:
        kind = the_one_given(self, JOINT_KINDS)
        if kind == "prismatic" and self.direction is None:
            raise Fault("a prismatic joint slides along a direction", _LIKE_DIRECTION)
        if kind != "prismatic" and self.direction is not None:
            raise Fault(f"a {kind} joint has no direction", "Leave it out", below="direction")
        for field, kinds in {"axis": ("revolute", "cylindrical"), "axes": ("universal",)}.items():
            if kind not in kinds and getattr(self, field) is not None:
                raise Fault(f"a {kind} joint has no {field}", "Leave it out", below=field)
        if kind != "weld" and self.relative_angle:
            raise Fault(f"a {kind} joint has no angle", "Leave it out", below="relative_angle")
        if self.addresses[0].body == self.addresses[1].body:
            raise Fault("both sides are on the same body", "Join two bodies", below=kind)
        if self.near and "branch" in self.model_fields_set:
            raise Fault("branch chooses the closure already", "Leave branch or near out", below="near")
        if self.clearance is not None:
            self._check_clearance(kind, self.clearance)
        if self.friction is not None:
            self._check_friction(kind, self.friction)
        return self

    @property
    def given_axes(self) -> tuple[tuple[float, ...], ...]:
        """Axes or direction of the joint in the first body's axes, as many as its kind has in space."""
        return self.axes or tuple(axis for axis in (self.axis, self.direction) if axis is not None)

    @property
    def has_backlash(self) -> bool:
        """True if the clearance is backlash in the angle: the joint still holds its two points together."""
        return self.clearance is not None and self.clearance.angle is not None

    def _check_friction(self, kind: str, friction: Friction) -> None:
        if self.clearance is not None and not self.has_backlash:
            raise Fault("a joint with a clearance has no reaction", "Give clearance.friction", below="friction")
        with within("friction"):
            friction.check_at(kind)

    def _check_clearance(self, kind: str, clearance: Clearance) -> None:
        from kaneflex.scene.clearances import contacts_of

        with within("clearance"):
            clearance.check_kind(kind)
        if clearance.angle is None:
            self.refuse(("branch", "near", "rotation"), "a joint with a clearance does not couple rotations")
        with within("clearance"):
            clearance.check_at(kind, self.given_axes[0] if self.given_axes else ())
            for contact in contacts_of("", self).values():
                _ = contact.pushing

    @cached_property
    def kind(self) -> str:
        return first_given(self, JOINT_KINDS)

    @cached_property
    def addresses(self) -> tuple[Address, Address]:
        return getattr(self, self.kind)


class Mass(SceneTable):
    """Lumped `mass` (kg) with its `inertia` (kg m^2), fixed to the point `at` of a body.

    In space the inertia is about the point, in the body's axes, with components as a body's own.
    """

    at: AddressField
    mass: NonNegativeMass = 0.0
    inertia: BodyInertia = 0.0

    @model_validator(mode="after")
    def _something(self) -> Mass:
        if not self.model_fields_set & {"mass", "inertia"}:
            raise Fault("neither mass nor inertia", "Give at least one of them")
        return self


class Load(SceneTable):
    """Load: a point force along `direction`, in fixed (`global`) or `body` axes, in N; a force distributed along a
    body, in N/m; or a torque in N m at a joint.

    `torque_at` names a revolute joint, or in space also a cylindrical one: the torque acts on its second body, its
    opposite on the first. A force `spread_on` a body acts per length from its start to its end, times a factor that
    varies linearly between the two numbers of its `profile`. The magnitude is a constant `value`; a `law` in t, joints'
    coordinates (NAME) and speeds (NAME_speed); or a `table` (CSV) of its `column` in `unit`, else in the unit of its
    heading, `against` one of these names. The table is read at x - `offset`; with a `period` it repeats, and its ends
    may differ by `closing` times its largest value; `interpolation` connects its rows. A force's table may contain the
    gauge pressure on an `area` (m^2), or on the circle of a `bore` (m).
    """

    force_on: AddressField | None = None
    torque_at: str | None = None
    spread_on: str | None = None
    profile: NumberPair = (1.0, 1.0)
    direction: Direction | None = None
    axes: Literal["global", "body"] = "global"
    value: ForceOrTorque | None = None
    law: LawText | None = None
    table: str | None = None
    column: str | None = None
    unit: str | None = None
    area: PositiveArea | None = None
    bore: PositiveLength | None = None
    against: str | None = None
    period: Abscissa | None = None
    offset: Abscissa = 0.0
    closing: NonNegativeRatio = 0.01
    interpolation: Interpolation = Field(default="pchip", description="between the rows of a table")

    @field_validator("value", mode="before")
    @classmethod
    def _force_or_torque(cls, value: object, info: ValidationInfo) -> float:
        spread = FORCE_PER_LENGTH if info.data.get("spread_on") else FORCE
        return to_si(value, TORQUE if info.data.get("torque_at") else spread)

    @field_validator("period", "offset", mode="before")
    @classmethod
    def _in_its_dimension(cls, value: object, info: ValidationInfo) -> float:
        dimensions = abscissae(info.data.get("against"))
        if info.field_name == "period" and dimensions == SPEEDS:
            raise Fault("a speed is not periodic", "Leave it out")
        number = either(value, *dimensions)
        if info.field_name == "period" and number <= 0:
            raise Fault("not positive", "Give a positive period, like '720 deg'")
        return number

    @model_validator(mode="after")
    def _consistent(self) -> Load:
        kind = self.kind
        on = the_one_given(self, ("force_on", "torque_at", "spread_on"))
        if on != "torque_at" and self.direction is None:
            raise Fault("the force has no direction", _LIKE_DIRECTION, below="direction")
        if on == "torque_at":
            self.refuse(("direction", "axes"), "a torque has no direction")
        if on != "spread_on":
            self.refuse(("profile",), "belongs to a distributed load")
        if not any(self.profile):
            raise Fault("the load is zero at both ends", "Give two numbers, at least one not zero", below="profile")
        if kind == "table" and self.against is None:
            cure = "Give against: 't', a joint's name, or NAME_speed for its speed"
            raise Fault("the table's abscissa is not given", cure)
        if kind != "table":
            of_tables = ("column", "unit", "area", "bore", "against", "period", "offset", "closing", "interpolation")
            self.refuse(of_tables, f"belongs to a table; this load has a {kind}")
        if on != "force_on":
            self.refuse(("area", "bore"), "belongs to a point force with a table of pressure")
        if self.area is not None and self.bore is not None:
            raise Fault("area and bore exclude each other", "Give one of them", below="bore")
        return self

    @property
    def si_unit(self) -> str:
        return "N m" if self.torque_at else "N/m" if self.spread_on else "N"

    @cached_property
    def kind(self) -> str:
        """Kind of magnitude: "value", "law" or "table"."""
        return the_one_given(self, ("value", "law", "table"))

    def read_table(self) -> Table:
        """Table of the load in N, N m or N/m over rad, m, their rates or s.

        Raises Fault as `kaneflex.scene.tables.read_table` does.
        """
        area = self.area if self.bore is None else math.pi * self.bore**2 / 4
        own = TORQUE if self.torque_at else FORCE_PER_LENGTH if self.spread_on else FORCE
        measured, assumed = (own, self.si_unit) if area is None else (PRESSURE, None)
        assert self.table is not None
        table = read_table(self.table, self.column, self.unit, abscissae(self.against), (measured,), assumed)
        table = table if area is None else replace(table, y=area * table.y, dimension=FORCE)
        return table if self.period is None else table.over_period(self.period, self.closing)

    def curve(self) -> np.ndarray:
        """Block (see `kaneflex.scene.tables`) of the load's table. Raises Fault as `read_table`."""
        return self.read_table().coefficients(self.period, self.interpolation)


def _above_rounding(tolerance: float) -> float:
    if not _TIGHTEST <= tolerance < 1:
        raise Fault(f"not between {_TIGHTEST:g} (rounding) and 1", "Give a number in this range, like 1e-9")
    return tolerance


Tolerance = Annotated[PositiveRatio, AfterValidator(_above_rounding)]


class Forward(SceneTable):
    """Integration of free joints of the rigid mechanism: relative `tolerance` of a step."""

    tolerance: Tolerance = 1e-9


def _start_of(value: object) -> object:
    if isinstance(value, str) and value in _STARTS:
        return value
    from kaneflex.scene.start import start_of

    return start_of(value)


class Solve(SceneTable):
    """Settings of the solution; every entry can also be set on the command line."""

    preset: str = "stiffened"
    start: Annotated[Literal["zero", "quasistatic", "periodic"] | Start, BeforeValidator(_start_of)] = "zero"
    steps: WholeNumber | None = Field(default=None, description="steps per cycle, or per run without a cycle")
    integrator: Literal["spectral", "radau", "newmark", "generalised-alpha", "gauss", "exact-modal"] | None = None
    duration: PositiveTime | None = None
    modes: CountOrAll = "all"
    reduction: Literal["none", "craig-bampton", "modal"] | None = None
    mode_angle: DriveCoordinate = 0.0
    terms: dict[str, StrictBool] = Field(default={})
    tolerance: Tolerance | None = Field(
        default=None,
        description="preset coupled (default 1e-8): error that ten periods of a vibration accumulate, as a share of "
        "the longest body; integrator spectral (default 1e-6): relative error of the motion",
    )
    bounded: tuple[Literal["speeds", "reactions"], ...] = Field(
        default=(),
        description="preset coupled: quantities that `tolerance` also bounds, relative to their largest value",
    )
    forward: Forward = Field(default=Forward.model_construct(), description="free joints, unless the preset is coupled")
    errors: Literal["quick", "total", "all", "none"] = Field(
        default="quick",
        description="errors of the sensors to estimate; total also where that takes long, all with its parts and the "
        "error of one-way coupling",
    )
    rho_infinity: NonNegativeRatio = Field(default=0.8, description="generalised-alpha's spectral radius, 0 to 1")

    @property
    def says_a_file(self) -> bool:
        return not isinstance(self.start, str) and self.start.file is not None

    @field_validator("preset")
    @classmethod
    def _known_preset(cls, preset: str) -> str:
        if preset not in PRESETS:
            raise Fault("unknown preset", nearest(preset, PRESETS))
        return preset

    @field_validator("terms")
    @classmethod
    def _known_terms(cls, terms: dict[str, bool]) -> dict[str, bool]:
        for name in terms:
            if name not in TERM_NAMES:
                raise Fault("unknown term", nearest(name, TERM_NAMES), below=name)
        return terms

    @field_validator("rho_infinity")
    @classmethod
    def _at_most_one(cls, radius: float) -> float:
        if radius > 1:
            raise Fault("above one the integrator would be unstable", "Give a number from 0 to 1")
        return radius
