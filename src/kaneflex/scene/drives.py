"""Drives: motion of joints, prescribed or free."""

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
    LawText,
    Length,
    NonNegativeRatio,
    PositiveAngle,
    PositiveTime,
)
from kaneflex.scene.table import SceneTable, first_given, the_one_given
from kaneflex.scene.tables import Table, evaluate_block, read_table
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
    within that time. A `law` in t gives the joint's angle in rad; a `table` (CSV) gives it over time as its `column`,
    in `unit`, else in that of its heading, else in degrees; `interpolation` connects its rows. Everything repeats after
    `cycle` (rad), the angle of a constant speed, or `period` (s), the time of a law or table. A `free` joint follows
    the forces (forward dynamics), from `angle` and `initial_speed` (rad/s) at t = 0; its motor is a load. `rotation`
    is the elastic rotation at the driven joint: held by the drive, or free. A guide's drive prescribes its coordinate
    in m: `position` (m) replaces `angle`, speeds are in m/s, a table's `unit` is a length, and there is no `cycle`. In
    space a joint with several degrees of freedom may be `free`, too: a spherical one from an `angular_velocity` (rad/s)
    of its second body relative to the first, in the second's axes; a cylindrical one from `initial_speeds` along (m/s)
    and about its axis (rad/s), a universal one from those about its two axes.
    """

    speed: DriveSpeed | None = None
    law: LawText | None = None
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
        default="spline", description="between the rows of a table; linear is not possible, since the speed would jump"
    )
    repeat: PositiveTime | None = Field(default=None, alias="period", description="time in which a law repeats, s")
    rotation: Literal["held", "free"] = "held"

    @field_validator("speed", "angle", "position", mode="before")
    @classmethod
    def _no_law(cls, value: object) -> object:
        if isinstance(value, str) and re.search(r"\bt\b", value) and not re.fullmatch(r"\S+ t", value):
            raise Fault("not a plain number", "Write functions of t as law, in rad or m, like law = '0.5*sin(t)'")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Drive:
        given = the_one_given(self, _KINDS)
        if given not in ("speed", "free"):
            self.refuse(("angle", "position"), f"the {given} already gives the joint's start")
        for owner, fields in _OWN.items():
            if given != owner:
                self.refuse(fields, f"belongs to a {owner}; this drive has a {given}")
        if self.repeat is not None and given not in ("law", "table"):
            raise Fault(f"a drive by {given} repeats after a cycle, not a period", "Leave period out", below="period")
        if self.spin_up is not None and self.cycle is not None:
            raise Fault("a drive that spins up does not repeat", "Leave it out", below="cycle")
        return self

    @property
    def kind(self) -> str:
        """Kind of drive: "constant speed", "spin up", "law", "table" or "free"."""
        given = first_given(self, _KINDS)
        if given == "speed":
            return "constant speed" if self.spin_up is None else "spin up"
        return given

    @property
    def period(self) -> float | None:
        """Duration of a cycle in s; None without a cycle."""
        if self.repeat is not None:
            return self.repeat
        return self.cycle / abs(self.speed) if self.cycle is not None and self.speed else None

    @property
    def start(self) -> float:
        """Coordinate at t = 0 of a joint with a speed or a free joint, in rad, or m for a guide."""
        return self.angle if self.position is None else self.position

    def coordinate(self, t: np.ndarray | float) -> np.ndarray | float:
        """Coordinate at times t [s], in rad, or m for a guide; for a free joint that at t = 0.

        Raises Fault for a law or a table that can't be read.
        """
        if self.law is not None:
            from kaneflex.scene.law_parser import parse_law

            return parse_law(self.law, ("t",)).on_arrays({"t": t})
        if self.table is not None:
            return evaluate_block(self.curve(), t)
        if self.speed is None or self.spin_up is None:
            return self.start + (self.speed or 0.0) * t
        T = self.spin_up  # speed (t / T - sin(2 pi t / T) / 2 pi) until T, integrated
        inside = np.minimum(t, T)
        course = inside**2 / (2 * T) + T / (2 * np.pi) ** 2 * (np.cos(2 * np.pi * inside / T) - 1.0)
        return self.start + self.speed * (course + np.maximum(t - T, 0.0))

    def curve(self) -> np.ndarray:
        """Block (see `kaneflex.scene.tables`) of the drive's table. Raises Fault as `read_table`."""
        return self.read_table().coefficients(self.period, self.interpolation)

    def read_table(self) -> Table:
        """Table of the drive, in rad or m over s. Raises Fault as `kaneflex.scene.tables.read_table` does."""
        table = read_table(self.table, self.column, self.unit, (TIME,), (ANGLE, LENGTH), "deg")
        return table if self.repeat is None else table.over_period(self.repeat, self.closing)
