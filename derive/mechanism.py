"""A scene's structure in symbols: bodies, joints, drives and loads of a planar mechanism.

Built from ``Scene.structure()`` alone, so that nothing can enter the equations that the structure hash
does not know: a number of the scene is here either a symbol (a run-time parameter) or exactly 0, 1 or -1. Bodies,
joints and the like are numbered, their names are kept beside them (see :mod:`kaneflex.derive.names`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy as sm

from kaneflex.derive.names import Names, numbered
from kaneflex.support.contract import COURSES

Vector = tuple[sm.Expr, sm.Expr]
GROUND = "ground"


@dataclass(frozen=True)
class BodyPoint:
    """A point of a body: its coordinates [m] in the body's axes, from the body's start."""

    body: str
    name: str
    at: Vector


@dataclass(frozen=True)
class BodyModel:
    """A body as the rigid stage sees it: mass [kg], mass centre [m], inertia about the mass centre [kg m^2]."""

    name: str
    elastic: bool
    mass: sm.Expr
    centre: Vector
    inertia: sm.Expr


@dataclass(frozen=True)
class JointModel:
    """A joint between a point of the first body and a point of the second.

    ``direction`` is a guide's, fixed in the first body; ``angle`` a weld's, of the second against the first.
    """

    name: str
    kind: str
    first: BodyPoint
    second: BodyPoint
    direction: Vector = (sm.S.One, sm.S.Zero)
    closes_loop: bool = False
    branch: sm.Expr = sm.S.One
    angle: sm.Expr = sm.S.Zero

    @property
    def start_name(self) -> str:
        """What a drive's coordinate at t = 0 is called in the scene."""
        return "position" if self.kind == "prismatic" else "angle"


@dataclass(frozen=True)
class DriveModel:
    """Motion of a joint: "constant speed", "spin up", "law" (in t), "table" (against t), or "free": by the forces."""

    kind: str
    law: str | None


@dataclass(frozen=True)
class MassModel:
    """A lumped mass [kg] with its inertia [kg m^2], fixed to a point of a body."""

    name: str
    point: BodyPoint
    mass: sm.Expr
    inertia: sm.Expr


@dataclass(frozen=True)
class LoadModel:
    """A force [N] on a point along a direction fixed in global or in body axes, or a torque [N m] at a joint.

    One that is spread along a body [N/m] has a ``spread`` instead of a point: the body's start and end, and the factors
    there, between which it changes linearly.
    """

    name: str
    point: BodyPoint | None
    direction: Vector | None
    axes: str | None
    joint: str | None
    kind: str
    against: str | None
    law: str | None
    spread: tuple[BodyPoint, BodyPoint, sm.Expr, sm.Expr] | None = None

    @property
    def unit(self) -> str:
        return "N m" if self.joint is not None else "N" if self.spread is None else "N/m"

    def pushes(self) -> tuple[tuple[BodyPoint, sm.Expr], ...]:
        """The point forces that a force is statically the same as: where, and the share of its size."""
        if self.spread is None:
            return ((self.point, sm.S.One),)
        start, end, first, last = self.spread
        return (start, end.at[0] * (2 * first + last) / 6), (end, end.at[0] * (first + 2 * last) / 6)


@dataclass(frozen=True)
class SpringModel:
    """A spring with a damper between two points [N/m, N s/m] or at a revolute joint [N m/rad, N m s/rad].

    ``free`` is the free length [m], or the free angle [rad] of the joint's second body against the first.
    """

    name: str
    first: BodyPoint
    second: BodyPoint
    joint: str | None
    stiffness: sm.Expr
    damping: sm.Expr
    free: sm.Expr

    @property
    def ends(self) -> tuple[BodyPoint, ...]:
        """The two points that it joins; none where it is torsional."""
        return (self.first, self.second) if self.joint is None else ()


@dataclass
class Parameters:
    """Parameters in the order in which they are first used: path in the scene -> symbol, unit."""

    entries: dict[str, tuple[sm.Symbol, str]] = field(default_factory=dict)

    def __call__(self, path: str, unit: str) -> sm.Symbol:
        if path not in self.entries:
            self.entries[path] = (_symbol(path), unit)
        return self.entries[path][0]


def _symbol(path: str) -> sm.Symbol:
    """bodies.body@1.points.point@1.x is body@1_point@1_x: the numbers tell the tables."""
    table, _, inside = path.partition(".")
    words = path if table in (GROUND, "gravity") else inside.replace(".points.", ".")
    return sm.Symbol(words.replace(".", "_"))


@dataclass(frozen=True)
class Mechanism:
    """Everything that the rigid stage is derived from.

    ``parameters`` maps the dotted path of a scene's number to its symbol and unit; ``names`` has what the scene calls
    bodies, joints, masses, loads, springs and points, which are numbered everywhere else; ``frame`` says
    whether the bodies stand still in given poses, ``viscous`` whether a force per length and velocity damps the links.
    """

    bodies: dict[str, BodyModel]
    joints: dict[str, JointModel]
    masses: dict[str, MassModel]
    drives: dict[str, DriveModel]
    loads: dict[str, LoadModel]
    springs: dict[str, SpringModel]
    gravity: Vector
    frame: bool
    viscous: bool
    parameters: dict[str, tuple[sm.Symbol, str]]
    names: Names

    def symbol(self, path: str) -> sm.Symbol:
        return self.parameters[path][0]

    def parameter(self, path: str, unit: str) -> sm.Symbol:
        """The symbol of a number that no scene gives but the derivation needs; entered on first use."""
        return Parameters(self.parameters)(path, unit)


def read_structure(structure: Mapping[str, Any]) -> Mechanism:
    """Turn ``Scene.structure()`` into symbols."""
    structure, names = numbered(structure)
    number = Parameters()

    def pattern(entry: Any, path: str, unit: str) -> sm.Expr:
        """An exact 0, 1, -1 stays a number; everything else is a parameter."""
        return sm.Integer(entry) if isinstance(entry, int) else number(path, unit)

    def point(address: str) -> BodyPoint:
        body, _, name = address.partition(".")
        name = name or "start"
        entries = structure["points"].get(f"{body}.{name}", [0, 0])
        if name == "end":
            return BodyPoint(body, name, (number(f"bodies.{body}.length", "m"), sm.S.Zero))
        if name == "mid":
            return BodyPoint(body, name, (number(f"bodies.{body}.length", "m") / 2, sm.S.Zero))
        owner = body if body == GROUND else f"bodies.{body}.points"
        at = tuple(pattern(entries[k], f"{owner}.{name}.{'xy'[k]}", "m") for k in range(2))
        return BodyPoint(body, name, at)

    bodies = {}
    for name, body in structure["bodies"].items():
        centre = tuple(pattern(body["centre"][k], f"bodies.{name}.centre_{'xy'[k]}", "m") for k in range(2))
        mass = pattern(body["mass"], f"bodies.{name}.mass", "kg")
        inertia = pattern(body["inertia"], f"bodies.{name}.inertia", "kg m^2")
        if structure["frame"]:
            for coordinate, unit in (("x", "m"), ("y", "m"), ("angle", "rad")):
                number(f"bodies.{name}.pose_{coordinate}", unit)
        bodies[name] = BodyModel(name, body["elastic"], mass, centre, inertia)
    joints = {}
    for name, joint in structure["joints"].items():
        first, second = (point(address) for address in joint["between"])
        direction = (sm.S.One, sm.S.Zero)
        if joint["kind"] == "prismatic":
            direction = tuple(
                pattern(joint["direction"][k], f"joints.{name}.direction_{'xy'[k]}", "1") for k in range(2)
            )
        closes = joint["closes_loop"]
        branch = number(f"joints.{name}.branch", "1") if closes else sm.S.One
        angle = number(f"joints.{name}.relative_angle", "rad") if "relative_angle" in joint else sm.S.Zero
        joints[name] = JointModel(name, joint["kind"], first, second, direction, closes, branch, angle)
    masses = {}
    for name, mass in structure["masses"].items():
        inertia = pattern(mass["inertia"], f"masses.{name}.inertia", "kg m^2")
        weight = pattern(mass["mass"], f"masses.{name}.mass", "kg")
        masses[name] = MassModel(name, point(mass["at"]), weight, inertia)
    drives = {}
    for name, drive in structure["drives"].items():
        drives[name] = DriveModel(drive["kind"], drive.get("law"))
        if drive["kind"] == "table":
            number(f"drives.{name}.table", "1")
        elif drive["kind"] == "free":
            for course in COURSES:
                number(f"drives.{name}.{course}", "1")
        elif drive["kind"] != "law":
            slides = joints[name].kind == "prismatic"
            number(f"drives.{name}.speed", "m/s" if slides else "rad/s")
            number(f"drives.{name}.{joints[name].start_name}", "m" if slides else "rad")
        if drive["kind"] == "spin up":
            number(f"drives.{name}.spin_up", "s")
    loads = {}
    for name, load in structure["loads"].items():
        origin = (load["kind"], load.get("against"), load.get("law"))
        if "torque_at" in load:
            loads[name] = LoadModel(name, None, None, None, load["torque_at"], *origin)
        else:
            direction = tuple(
                pattern(load["direction"][k], f"loads.{name}.direction_{'xy'[k]}", "1") for k in range(2)
            )
            at, spread = None, None
            if "spread_on" in load:
                ends = (point(f"{load['spread_on']}.{end}") for end in ("start", "end"))
                shares = zip(load["profile"], ("start", "end"), strict=True)
                spread = (*ends, *(pattern(share, f"loads.{name}.profile_{end}", "1") for share, end in shares))
            else:
                at = point(load["on"])
            loads[name] = LoadModel(name, at, direction, load["axes"], None, *origin, spread)
        if load["kind"] == "constant":
            number(f"loads.{name}.value", loads[name].unit)
        elif load["kind"] == "table":
            number(f"loads.{name}.offset", "rad" if load["against"] in joints else "s")
            number(f"loads.{name}.table", "1")
    springs = {}
    for name, spring in structure.get("springs", {}).items():
        joint = spring.get("torsional_at")
        if joint is None:
            first, second = (point(address) for address in spring["between"])
            free, unit = pattern(spring["length"], f"springs.{name}.length", "m"), "N{}/m"
        else:
            first, second = joints[joint].first, joints[joint].second
            free, unit = pattern(spring["angle"], f"springs.{name}.angle", "rad"), "N m{}/rad"
        stiffness = pattern(spring["stiffness"], f"springs.{name}.stiffness", unit.format(""))
        damping = pattern(spring["damping"], f"springs.{name}.damping", unit.format(" s"))
        springs[name] = SpringModel(name, first, second, joint, stiffness, damping, free)
    gravity = tuple(pattern(structure["gravity"][k], f"gravity.{'xy'[k]}", "m/s^2") for k in range(2))
    switches = structure["frame"], structure["viscous"]
    return Mechanism(bodies, joints, masses, drives, loads, springs, gravity, *switches, number.entries, names)
