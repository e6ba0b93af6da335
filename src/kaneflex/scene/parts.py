"""Joints, drives, loads, damping, sensors and the solve table of a scene."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import Annotated, Literal

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

from kaneflex.scene.contacts import Clearance, contacts_of
from kaneflex.scene.friction import Friction, friction_in
from kaneflex.scene.headings import SPEEDS, abscissae
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
    FrequencyPair,
    NonNegativeMass,
    NonNegativeRatio,
    NonNegativeViscosity,
    NumberPair,
    PositiveArea,
    PositiveLength,
    PositiveRatio,
    PositiveTime,
    Ratios,
    WholeNumber,
    either,
)
from kaneflex.scene.start import Start, start_of
from kaneflex.scene.table import SceneTable, first_given, the_one_given
from kaneflex.scene.tables import Table, read_table
from kaneflex.support.errors import Fault, nearest, within
from kaneflex.support.interpolation import Interpolation
from kaneflex.support.units import FORCE, FORCE_PER_LENGTH, PRESSURE, TORQUE, to_si

PRESETS = {
    "rigid": "kinematics, inverse dynamics and joint reactions; nothing deforms",
    "quasistatic": "(K_s + K_d + K_g) z = F at each instant, without damping",
    "paper": "the paper's choices: one element a link, welded pin, frozen decoupled modes, from rest, 0.04 s",
    "linear": "time-varying M, C, K of the released joints, without K_g",
    "stiffened": "linear, with K_g from the joint reactions and foreshortening in the displacements",
    "coupled": "motion and deformation together, nonlinear; shapes of each link, error-controlled steps",
}
_TIGHTEST = 1e-13
"""Tolerance below which rounding would stand in its way."""
_LIKE_DIRECTION = "Give it, like direction = [1, 0], in space [1, 0, 0]"
TERM_NAMES = ("spin", "gyroscopic", "euler", "geometric", "damping", "rotary", "shear", "gravity")


JOINT_KINDS = ("revolute", "prismatic", "weld", "cylindrical", "universal", "spherical")


class Joint(SceneTable):
    """A joint between two points: `revolute`, `prismatic` (along `direction`, in the first body's axes) or
    `weld`; in space a revolute one has an `axis`, and there are `cylindrical` (turns about an `axis` and slides along
    it), `universal` (turns about two `axes`, the first of the first body, the second of the second one) and
    `spherical` ones. Axes are given in the first body's axes, where all joint coordinates are zero.

    `branch` chooses between the two ways in which a loop of two bodies closes and stands at the joint that closes
    it; a larger loop may close in more ways. `near` names rough angles of its bodies at the start instead.
    `rotation` is that of elastic bodies that meet in a revolute joint: released (each its own) or shared (the
    paper's welded pin). `relative_angle` (rad) turns the second body against the first in a weld. A `clearance` leaves
    room in a pin or a guide: the joint then holds nothing, its sides touch at times. One in an angle is backlash of a
    pin, which stays. `friction` resists its motion.
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
                raise Fault(f"a {kind} joint has none", "Leave it out", below=field)
        if kind != "weld" and self.relative_angle:
            raise Fault(f"a {kind} joint has no angle of its own", "Leave it out", below="relative_angle")
        if self.addresses[0].body == self.addresses[1].body:
            raise Fault("both sides are on the same body", "Join two bodies", below=kind)
        if self.near and "branch" in self.model_fields_set:
            raise Fault("branch says already which way the loop closes", "Leave branch or near out", below="near")
        if self.clearance is not None:
            self._check_clearance(kind, self.clearance)
        if self.friction is not None:
            self._check_friction(kind, self.friction)
        return self

    @property
    def given_axes(self) -> tuple[tuple[float, ...], ...]:
        """Its axes or its direction in the first body's axes, as many as its kind has in space."""
        return self.axes or tuple(axis for axis in (self.axis, self.direction) if axis is not None)

    @property
    def has_backlash(self) -> bool:
        """Whether its clearance is in its angle alone: it holds its two points together all the same."""
        return self.clearance is not None and self.clearance.angle is not None

    @property
    def keeps_together(self) -> bool:
        """Whether its two points are one."""
        return self.kind not in ("prismatic", "cylindrical") and (self.clearance is None or self.has_backlash)

    def _check_friction(self, kind: str, friction: Friction) -> None:
        if self.clearance is not None and not self.has_backlash:
            raise Fault("a joint with a clearance has no force of its own", "Give clearance.friction", below="friction")
        with within("friction"):
            friction.check_at(kind)

    def _check_clearance(self, kind: str, room: Clearance) -> None:
        wanted = {"revolute": ("radial", "angle"), "prismatic": ("gap",)}.get(kind, ())
        if all(getattr(room, key) is None for key in wanted):
            cure = f"Give {' or '.join(wanted)}" if wanted else "Leave it out"
            raise Fault(f"a {kind} joint has no such clearance", cure, below="clearance")
        if room.angle is None:
            self.refuse(("branch", "near", "rotation"), "a joint with a clearance holds nothing")
        with within("clearance"):
            for contact in contacts_of("", self).values():
                _ = contact.pushing

    @cached_property
    def kind(self) -> str:
        return first_given(self, JOINT_KINDS)

    @cached_property
    def addresses(self) -> tuple[Address, Address]:
        return getattr(self, self.kind)


class Mass(SceneTable):
    """A lumped `mass` (kg) with its `inertia` (kg m^2), fixed to the point `at` of a body.

    In space the inertia is that about the body's axes through the point, as a body's own.
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
    """A point force along `direction`, in fixed (`global`) or `body` axes, in N; one spread along a body, in N/m;
    or a torque in N m at a joint.

    `torque_at` names a revolute joint, in space or a cylindrical one: the torque acts on its second body, and its
    opposite on the first. What is `spread_on` a body acts per length from its start to its end, times a factor that
    changes linearly between the two numbers of its `profile`.
    Its size is a constant `value`, a `law` in t, joints' coordinates (NAME) and speeds (NAME_speed), or a
    `table` (CSV) of its `column` in `unit`, else in that of its heading, `against` any one of these names. The table
    is read at x - `offset`; with a `period` it repeats, and its ends may differ by `closing` of its largest value;
    `interpolation` joins its rows. A force's table may be one of the gauge pressure on an `area` (m^2), or on the
    circle of a `bore` (m).
    """

    force_on: AddressField | None = None
    torque_at: str | None = None
    spread_on: str | None = None
    profile: NumberPair = (1.0, 1.0)
    direction: Direction | None = None
    axes: Literal["global", "body"] = "global"
    value: ForceOrTorque | None = None
    law: str | None = None
    table: str | None = None
    column: str | None = None
    unit: str | None = None
    area: PositiveArea | None = None
    bore: PositiveLength | None = None
    against: str | None = None
    period: Abscissa | None = None
    offset: Abscissa = 0.0
    closing: NonNegativeRatio = 0.01
    interpolation: Interpolation = Field(default="pchip", description="of a table, between its rows")

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
            raise Fault("a speed does not repeat", "Leave it out")
        number = either(value, *dimensions)
        if info.field_name == "period" and number <= 0:
            raise Fault("not positive", "Give a positive period, like '720 deg'")
        return number

    @model_validator(mode="after")
    def _consistent(self) -> Load:
        kind = self.kind
        on = the_one_given(self, ("force_on", "torque_at", "spread_on"))
        if on != "torque_at" and self.direction is None:
            raise Fault("a force without direction", _LIKE_DIRECTION, below="direction")
        if on == "torque_at":
            self.refuse(("direction", "axes"), "a torque has none")
        if on != "spread_on":
            self.refuse(("profile",), "belongs to a load that is spread along a body")
        if not any(self.profile):
            raise Fault("no load at either end", "Give two numbers, at least one of them not zero", below="profile")
        if kind == "table" and self.against is None:
            cure = "Give against: 't', a joint's name, or NAME_speed for its speed"
            raise Fault("a table without what it is read against", cure)
        if kind != "table":
            of_tables = ("column", "unit", "area", "bore", "against", "period", "offset", "closing", "interpolation")
            self.refuse(of_tables, f"belongs to a table; this load has a {kind}")
        if on != "force_on":
            self.refuse(("area", "bore"), "belongs to a force on a point: a table of a pressure times an area")
        if self.area is not None and self.bore is not None:
            raise Fault("area and bore exclude each other", "Give one of them", below="bore")
        return self

    @property
    def si_unit(self) -> str:
        return "N m" if self.torque_at else "N/m" if self.spread_on else "N"

    @cached_property
    def kind(self) -> str:
        """Which of "value", "law" and "table" gives the size."""
        return the_one_given(self, ("value", "law", "table"))

    def read_table(self) -> Table:
        """The load's table in N, N m or N/m over rad, m, their rates or s.

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
        """The block (see `kaneflex.scene.tables`) of the load's table. Raises Fault as `read_table`."""
        return self.read_table().coefficients(self.period, self.interpolation)


class Rayleigh(SceneTable):
    """C = alpha M + beta K with the same damping `ratio` at the two frequencies `at` (Hz)."""

    ratio: NonNegativeRatio
    at: FrequencyPair


class ModalDamping(SceneTable):
    """One damping ratio for all modes, or one for each, the last one for the rest; or those of Adams, by frequency."""

    ratio: Ratios


class Viscous(SceneTable):
    """The paper's damping: a force of `mu` per length and velocity, N s/m^2."""

    mu: NonNegativeViscosity


class Damping(SceneTable):
    """Damping of the elastic bodies: exactly one of the three."""

    rayleigh: Rayleigh | None = None
    modal: ModalDamping | None = None
    viscous: Viscous | None = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Damping:
        the_one_given(self, ("rayleigh", "modal", "viscous"))
        return self

    @cached_property
    def kind(self) -> str:
        return first_given(self, ("rayleigh", "modal", "viscous"))


def _above_rounding(tolerance: float) -> float:
    if not _TIGHTEST <= tolerance < 1:
        raise Fault(f"not from {_TIGHTEST:g}, where rounding begins, to 1", "Give a number between, like 1e-9")
    return tolerance


Tolerance = Annotated[PositiveRatio, AfterValidator(_above_rounding)]


class Forward(SceneTable):
    """How the motion of free joints is integrated, before anything deforms: `method` of scipy's `solve_ivp` and
    relative `tolerance` of a step.
    """

    method: Literal["DOP853", "RK45", "Radau", "LSODA"] = "DOP853"
    tolerance: Tolerance = 1e-9


class Solve(SceneTable):
    """How the scene is solved; every entry can also be set from the command line."""

    preset: str = "stiffened"
    start: Annotated[Start | Literal["zero", "quasistatic", "periodic"], BeforeValidator(start_of)] = "zero"
    steps: WholeNumber | None = Field(
        default=None, description="per cycle, or per run where there is no cycle"
    )
    integrator: (
        Literal["spectral", "radau", "newmark", "generalised-alpha", "gauss", "exact-modal", "scipy"] | None
    ) = None
    duration: PositiveTime | None = None
    modes: CountOrAll = "all"
    reduction: Literal["none", "craig-bampton", "modal"] | None = None
    mode_angle: DriveCoordinate = 0.0
    terms: dict[str, StrictBool] = Field(default={})
    tolerance: Tolerance | None = Field(
        default=None,
        description="1e-8 under preset coupled: error that ten periods of a vibration accumulate, as a share of the "
        "longest body; 1e-6 of integrator spectral: error of the motion, as a share of it",
    )
    bounded: tuple[Literal["speeds", "reactions"], ...] = Field(
        default=(),
        description="preset coupled: what else `tolerance` bounds, as a share of its largest value so far",
    )
    forward: Forward = Field(default=Forward(), description="free joints, unless the preset is coupled")
    errors: Literal["quick", "all", "none"] = Field(
        default="quick",
        description="which errors of the sensors are estimated: all of them include that of the one-way coupling, and "
        "those of coupled runs that take long",
    )
    rho_infinity: NonNegativeRatio = Field(
        default=0.8, description="generalised-alpha's spectral radius, 0 to 1"
    )

    @property
    def says_a_file(self) -> bool:
        return isinstance(self.start, Start) and self.start.file is not None

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
            raise Fault("above one, the integrator would amplify", "Give a number from 0 to 1")
        return radius
