"""Drives: the motion of joints, prescribed or left to the forces."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np
from pydantic import Field, field_validator, model_validator

from kaneflex.scene.quantities import (
    Angle,
    AngularVelocity,
    DriveSpeed,
    DriveSpeeds,
    Length,
    NonNegativeRatio,
    PositiveAngle,
    PositiveTime,
)
from kaneflex.scene.table import SceneTable, first_given, the_one_given
from kaneflex.scene.tables import Table, read_table
from kaneflex.support.errors import Fault
from kaneflex.support.units import ANGLE, LENGTH, TIME

_KINDS = ("speed", "law", "table", "free")
_OWN = {
    "free": ("initial_speed", "initial_speeds", "angular_velocity"),
    "speed": ("spin_up", "cycle"),
    "table": ("column", "unit", "closing", "interpolation"),
}


class Drive(SceneTable):
    """Motion of the joint of the same name: prescribed by exactly one of `speed`, `law` and `table`, or `free`.

    A constant `speed` (rad/s) starts from `angle` (rad) at t = 0; with `spin_up` (s) it is reached smoothly from rest
    within that time. A `law` in t gives the joint's angle in rad; a `table` (CSV) gives it as its `column`, in `unit`,
    else in that of its heading, else in degrees, over the time; its rows are joined by `interpolation`. `cycle` (rad)
    is the angle of a constant speed, `period` (s) the time of a law or table, in which everything repeats. A `free`
    joint follows the forces (forward dynamics), from `angle` and `initial_speed` (rad/s) at t = 0; its motor is a load.
    `rotation` is the elastic rotation at the driven joint: held by the drive, or free. A guide's drive prescribes its
    coordinate in m: `position` (m) stands in the place of `angle`, speeds are in m/s, a table's `unit` is one of
    length, and there is no `cycle`. In space a joint with several freedoms may be `free`, too: a spherical one from an
    `angular_velocity` (rad/s) of its second body against the first, in the second's axes; a cylindrical one from
    `initial_speeds` along (m/s) and about its axis (rad/s), a universal one from those about its two.
    """

    speed: DriveSpeed | None = None
    law: str | None = None
    table: str | None = None
    free: Literal[True] | None = None
    initial_speed: DriveSpeed = 0.0
    initial_speeds: DriveSpeeds | None = None
    angular_velocity: AngularVelocity | None = None
    angle: Angle = 0.0
    position: Length | None = None
    spin_up: PositiveTime | None = None
    cycle: PositiveAngle | None = None
    column: str | None = None
    unit: str | None = None
    closing: NonNegativeRatio = 0.01
    interpolation: Literal["pchip", "akima", "spline"] = Field(
        default="spline", description="of a table, between its rows; with a linear one the speed would jump there"
    )
    repeat: PositiveTime | None = Field(default=None, alias="period", description="time in which a law repeats, s")
    rotation: Literal["held", "free"] = "held"

    @field_validator("speed", "angle", "position", mode="before")
    @classmethod
    def _no_law(cls, value: object) -> object:
        if isinstance(value, str) and re.search(r"\bt\b", value) and not re.fullmatch(r"\S+ t", value):
            raise Fault("this is one number", "Write what changes with t as law, in rad or m, like law = '0.5*sin(t)'")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Drive:
        given = the_one_given(self, _KINDS)
        if given not in ("speed", "free"):
            self.refuse(("angle", "position"), f"a {given} says where the joint starts")
        for owner, fields in _OWN.items():
            if given != owner:
                self.refuse(fields, f"belongs to a {owner}; this drive has a {given}")
        if self.repeat is not None and given not in ("law", "table"):
            raise Fault(f"a drive by {given} repeats after an angle or never", "Leave period out", below="period")
        if self.spin_up is not None and self.cycle is not None:
            raise Fault("a drive that spins up does not repeat", "Leave it out", below="cycle")
        return self

    @property
    def kind(self) -> str:
        """Which of "constant speed", "spin up", "law", "table" and "free" moves the joint."""
        given = first_given(self, _KINDS)
        if given == "speed":
            return "constant speed" if self.spin_up is None else "spin up"
        return given

    @property
    def period(self) -> float | None:
        """Duration of a cycle in s, where there is one."""
        if self.repeat is not None:
            return self.repeat
        return self.cycle / abs(self.speed) if self.cycle is not None and self.speed else None

    @property
    def start(self) -> float:
        """Coordinate at t = 0 of a joint with a speed or a free one, in rad, or in m where it slides."""
        return self.angle if self.position is None else self.position

    def curve(self) -> np.ndarray:
        """The block (see `kaneflex.scene.tables`) of the drive's table. Raises Fault as `read_table`."""
        return self.read_table().coefficients(self.period, self.interpolation)

    def read_table(self) -> Table:
        """The drive's table, in rad or m over s. Raises Fault as `kaneflex.scene.tables.read_table` does."""
        table = read_table(self.table, self.column, self.unit, (TIME,), (ANGLE, LENGTH), "deg")
        return table if self.repeat is None else table.over_period(self.repeat, self.closing)
