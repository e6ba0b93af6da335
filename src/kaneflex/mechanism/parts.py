"""Parts of a mechanism, for any kind of number: common to derivation and run.

In a derivation a number is a symbol, or exactly 0, 1 or -1; in a run it is a float in SI.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, NamedTuple

from kaneflex.mechanism.planar import GROUND, BodyPoint, Number, Vector

ROWS = {"revolute": ("force_x", "force_y"), "weld": ("force_x", "force_y", "moment"), "prismatic": ("normal", "moment")}
"""Kind of a joint -> its constraints in order, named by their multipliers."""
CIRCLES = {"circle-circle": 1.0, "circle-in-circle": -1.0}
"""Kinds of contacts of circles -> sign of the force on the second: away from the first centre (1) or towards it."""


def floating_coordinates(body: str) -> tuple[str, str, str]:
    """Names of a free body's coordinates."""
    return f"{body}.x", f"{body}.y", f"{body}.phi"


class Body(NamedTuple):
    """Body: mass [kg], mass centre [m], inertia about it [kg m^2]; a pose in a fixed structure."""

    name: str
    elastic: bool
    mass: Number
    centre: Vector
    inertia: Number
    pose: tuple[Number, Number, Number] | None = None


@dataclass(frozen=True)
class Joint:
    """Joint between a point of the first body and a point of the second.

    Attributes
    ----------
    direction : tuple
        Direction of a guide, fixed in the first body.
    closes_loop : bool
        True if earlier joints connect its bodies already.
    branch : number
        Sign of a dyad's closure, 1 or -1.
    angle : number
        Angle of a weld: second body relative to the first [rad].
    near : mapping
        Body -> approximate angle [rad], which selects the assembly of a loop; only for numerical values.
    """

    name: str
    kind: str
    first: BodyPoint
    second: BodyPoint
    direction: Vector = (1, 0)
    closes_loop: bool = False
    branch: Number = 1
    angle: Number = 0
    near: Mapping[str, float] = field(default_factory=dict)

    @property
    def sides(self) -> tuple[BodyPoint, BodyPoint]:
        return self.first, self.second

    @property
    def bodies(self) -> tuple[str, str]:
        return self.first.body, self.second.body

    @property
    def rows(self) -> tuple[str, ...]:
        """Constraints in the plane, named by their multipliers."""
        return ROWS[self.kind]

    @property
    def slides(self) -> bool:
        """True if the coordinate is that of a guide [m], not an angle [rad]."""
        return self.kind == "prismatic"

    @property
    def start_name(self) -> str:
        """Key of a drive's coordinate at t = 0 in the scene."""
        return "position" if self.slides else "angle"

    @property
    def written_branch(self) -> str:
        return "+" if self.branch > 0 else "-"


class Drive(NamedTuple):
    """Motion of a joint: "constant speed", "spin up", "law" (in t), "table" (against t), or "free": by the
    forces."""

    kind: str
    law: str | None

    @property
    def free(self) -> bool:
        return self.kind == "free"


class Mass(NamedTuple):
    """Lumped mass [kg] with its inertia [kg m^2], fixed to a point of a body."""

    name: str
    point: BodyPoint
    mass: Number
    inertia: Number


class Load(NamedTuple):
    """Load: force [N] on a point along a direction fixed in global or in body axes, or torque [N m] at a joint.

    A distributed force [N/m] has a ``spread`` instead of a point: the body's start and end, and the factors there,
    with linear variation in between.
    """

    name: str
    point: Any
    direction: Any
    axes: str | None
    joint: str | None
    kind: str
    against: str | None
    law: str | None
    spread: tuple[Any, Any, Number, Number] | None = None

    @property
    def unit(self) -> str:
        return "N m" if self.joint is not None else "N" if self.spread is None else "N/m"

    @property
    def in_body(self) -> bool:
        """True if its direction turns with the body."""
        return self.axes == "body"

    @property
    def parts(self) -> tuple[tuple[Any, Number], ...]:
        """Points of forces and shares of the magnitude, none for a torque; a distributed force has two parts, one that
        falls linearly to zero at the body's end, and one that rises from zero at its start."""
        if self.spread is None:
            return () if self.point is None else ((self.point, 1.0),)
        _, end, *factors = self.spread
        third, half = (tuple(part / n for part in end.at) for n in (3, 2))
        return tuple((replace(end, at=tuple(k * part for part in third)), factor * half[0])
                     for k, factor in enumerate(factors, start=1))  # fmt: skip

    @property
    def pushes(self) -> tuple[tuple[Any, Number], ...]:
        """Statically equivalent point forces: position and share of the magnitude; none for a torque.

        A linear distribution gives l (2 p_0 + p_1) / 6 and l (p_0 + 2 p_1) / 6 at the body's ends.
        """
        if self.spread is None:
            return () if self.point is None else ((self.point, 1),)
        start, end, first, last = self.spread
        return (start, end.at[0] * (2 * first + last) / 6), (end, end.at[0] * (first + 2 * last) / 6)


@dataclass(frozen=True)
class Mechanism:
    """Mechanism: bodies, joints and loads.

    Attributes
    ----------
    observed : tuple of str
        Joints without a drive whose coordinates or speeds enter laws of loads.
    gravity : tuple
        Acceleration [m/s^2], global.
    frame : bool
        True for a fixed structure: the bodies have given poses and only deform.
    viscous : bool
        True if a force per length and velocity damps the links.
    """

    bodies: Mapping[str, Body]
    joints: Mapping[str, Joint]
    masses: Mapping[str, Mass]
    drives: Mapping[str, Drive]
    loads: Mapping[str, Load]
    springs: Mapping[str, Any]
    contacts: Mapping[str, Any]
    observed: tuple[str, ...]
    gravity: Vector
    frame: bool
    viscous: bool

    @property
    def loop_joints(self) -> tuple[str, ...]:
        """Joints that close a loop: earlier joints already connect their two bodies."""
        return tuple(name for name, joint in self.joints.items() if joint.closes_loop)

    def joints_of(self, placed: Collection[str], group: Collection[str]) -> list[Joint]:
        """Joints between bodies of a group, or between the group and placed bodies or the ground."""
        known, own = {GROUND, *placed, *group}, {*group}
        return [joint for joint in self.joints.values() if {*joint.bodies} <= known and {*joint.bodies} & own]

    def smallest_group(
        self, placed: Collection[str], waiting: Sequence[str], joints_of: Callable[..., list[Joint]] = joints_of
    ) -> tuple[str, ...]:
        """Smallest group of waiting bodies with as many constraints by joints and drives as coordinates; empty if none.

        A driven body, a dyad (two bodies and three joints), a body raised by a cylinder (three bodies and five).
        ``joints_of``: as the method, or a function that gives fewer.
        """

        def is_determined(group: Sequence[str], others: Collection[str]) -> bool:
            joints = joints_of(self, others, group)
            return sum(len(joint.rows) + (joint.name in self.drives) for joint in joints) >= 3 * len(group)

        # Bodies with fewer than three constraints cannot belong to a group; few candidates remain without them.
        candidates, count = list(waiting), -1
        while count != len(candidates):
            count = len(candidates)
            candidates = [name for name in candidates if is_determined([name], {*placed, *candidates})]
        groups = (group for size in range(1, count + 1) for group in combinations(candidates, size))
        return next((group for group in groups if is_determined(group, placed)), ())
