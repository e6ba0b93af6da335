"""A scene's mechanism in symbols.

Built from `structure_of(scene)` alone, so that nothing can enter the equations that the structure hash
does not know: a number of the scene is here either a symbol (a run-time parameter) or exactly 0, 1 or -1. Bodies,
joints and the like are numbered, their names are kept beside them (see :mod:`kaneflex.derive.ir.names`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy as sm

from kaneflex.derive.ir.names import Names, numbered
from kaneflex.mechanism.contacts import Contact
from kaneflex.mechanism.mechanism import corner_of
from kaneflex.mechanism.parts import Body, Drive, Joint, Load, Mass, Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint, Number, Vector
from kaneflex.mechanism.springs import Spring
from kaneflex.scene.structure import ANY
from kaneflex.support.contract import COURSES

Numbers = Callable[[str, str, Any], Number]
"""Function from a number's dotted path, its unit and its structure (0, 1, -1 or "*") to the number."""


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
class SymbolicMechanism(Mechanism):
    """A mechanism whose numbers are symbols.

    ``parameters`` maps the dotted path of a scene's number to its symbol and unit; ``names`` has what the scene calls
    bodies, joints, masses, loads, springs and points, which are numbered everywhere else.
    """

    parameters: dict[str, tuple[sm.Symbol, str]]
    names: Names

    def symbol(self, path: str) -> sm.Symbol:
        return self.parameters[path][0]

    @property
    def tables(self) -> tuple[str, ...]:
        """Paths of the loads and drives that are tables."""
        readers = {"loads": self.loads, "drives": self.drives}
        return tuple(
            f"{kind}.{name}" for kind, of in readers.items() for name, reader in of.items() if reader.kind == "table"
        )

    def parameter(self, path: str, unit: str) -> sm.Symbol:
        """The symbol of a number that no scene gives but the derivation needs; entered on first use."""
        return Parameters(self.parameters)(path, unit)


def read_structure(structure: Mapping[str, Any]) -> SymbolicMechanism:
    """Turn `structure_of(scene)` into symbols."""
    structure, names = numbered(structure)
    parameters = Parameters()

    def pattern(path: str, unit: str, entry: Any) -> sm.Expr:
        """An exact 0, 1, -1 stays a number; everything else is a parameter."""
        return sm.Integer(entry) if isinstance(entry, int) else parameters(path, unit)

    def each(table: str, make: Callable) -> dict[str, Any]:
        return {name: make(name, entry) for name, entry in structure.get(table, {}).items()}

    reader = _Reader(structure, pattern)
    bodies, joints = each("bodies", reader.body), each("joints", reader.joint)
    reader.joints = joints
    masses, drives, loads = each("masses", reader.mass), each("drives", reader.drive), each("loads", reader.load)
    acting = each("springs", reader.spring), each("contacts", reader.contact)
    gravity = tuple(pattern(f"gravity.{'xy'[k]}", "m/s^2", structure["gravity"][k]) for k in range(2))
    kinds = structure["frame"], structure["viscous"]
    observed = tuple(structure.get("observed", ()))
    parts = bodies, joints, masses, drives, loads, *acting, observed, gravity, *kinds
    return SymbolicMechanism(*parts, parameters=parameters.entries, names=names)


class _Reader:
    """Builder of parts from a structure's tables; ``joints`` are those with drives and springs."""

    def __init__(self, structure: Mapping[str, Any], numbers: Numbers) -> None:
        self.structure, self.numbers = structure, numbers
        self.joints: Mapping[str, Joint] = {}

    def vector(self, entries: Any, path: str, unit: str) -> Vector:
        """Vector of two components, at path_x and path_y, or path.x and path.y."""
        return tuple(self.numbers(f"{path}{'xy'[k]}", unit, entries[k]) for k in range(2))

    def point(self, address: str) -> BodyPoint:
        body, _, name = address.partition(".")
        name = name or "start"
        if name == "end":
            return BodyPoint(body, name, (self.numbers(f"bodies.{body}.length", "m", ANY), 0))
        if name == "mid":
            return BodyPoint(body, name, (self.numbers(f"bodies.{body}.length", "m", ANY) / 2, 0))
        owner = body if body == GROUND else f"bodies.{body}.points"
        entries = self.structure["points"].get(f"{body}.{name}", [0, 0])
        return BodyPoint(body, name, self.vector(entries, f"{owner}.{name}.", "m") if any(entries) else (0, 0))

    def body(self, name: str, body: Mapping[str, Any]) -> Body:
        centre = self.vector(body["centre"], f"bodies.{name}.centre_", "m")
        mass = self.numbers(f"bodies.{name}.mass", "kg", body["mass"])
        inertia = self.numbers(f"bodies.{name}.inertia", "kg m^2", body["inertia"])
        pose = None
        if self.structure["frame"]:
            units = {"x": "m", "y": "m", "angle": "rad"}
            pose = tuple(self.numbers(f"bodies.{name}.pose_{key}", unit, ANY) for key, unit in units.items())
        return Body(name, body["elastic"], mass, centre, inertia, pose)

    def joint(self, name: str, joint: Mapping[str, Any]) -> Joint:
        first, second = (self.point(address) for address in joint["between"])
        direction, branch, angle = (1, 0), 1, 0
        if "direction" in joint:
            direction = self.vector(joint["direction"], f"joints.{name}.direction_", "1")
        if joint["closes_loop"]:
            branch = self.numbers(f"joints.{name}.branch", "1", ANY)
        if "relative_angle" in joint:
            angle = self.numbers(f"joints.{name}.relative_angle", "rad", ANY)
        return Joint(name, joint["kind"], first, second, direction, joint["closes_loop"], branch, angle)

    def mass(self, name: str, mass: Mapping[str, Any]) -> Mass:
        inertia = self.numbers(f"masses.{name}.inertia", "kg m^2", mass["inertia"])
        weight = self.numbers(f"masses.{name}.mass", "kg", mass["mass"])
        return Mass(name, self.point(mass["at"]), weight, inertia)

    def drive(self, name: str, drive: Mapping[str, Any]) -> Drive:
        path, kind = f"drives.{name}", drive["kind"]
        if kind == "table":
            self.numbers(f"{path}.table", "1", ANY)
        elif kind == "free":
            for course in COURSES:
                self.numbers(f"{path}.{course}", "1", ANY)
        elif kind != "law":
            slides = self.joints[name].slides
            self.numbers(f"{path}.speed", "m/s" if slides else "rad/s", ANY)
            self.numbers(f"{path}.{self.joints[name].start_name}", "m" if slides else "rad", ANY)
        if kind == "spin up":
            self.numbers(f"{path}.spin_up", "s", ANY)
        return Drive(kind, drive.get("law"))

    def load(self, name: str, load: Mapping[str, Any]) -> Load:
        path = f"loads.{name}"
        found: dict[str, Any] = {"point": None, "direction": None, "spread": None}
        if "direction" in load:
            found["direction"] = self.vector(load["direction"], f"{path}.direction_", "1")
            if "spread_on" in load:
                ends = (self.point(f"{load['spread_on']}.{end}") for end in ("start", "end"))
                shares = zip(load["profile"], ("start", "end"), strict=True)
                profile = (self.numbers(f"{path}.profile_{end}", "1", share) for share, end in shares)
                found["spread"] = (*ends, *profile)
            else:
                found["point"] = self.point(load["on"])
        made = Load(
            name, found["point"], found["direction"], load.get("axes"), load.get("torque_at"),
            load["kind"], load.get("against"), load.get("law"), found["spread"],
        )  # fmt: skip
        if load["kind"] == "constant":
            self.numbers(f"{path}.value", made.unit, ANY)
        elif load["kind"] == "table":
            self.numbers(f"{path}.offset", self.unit_of(load["against"]), ANY)
            self.numbers(f"{path}.table", "1", ANY)
        return made

    def unit_of(self, against: str) -> str:
        """Unit of the time, of a joint's coordinate, or of its speed NAME_speed."""
        if against == "t":
            return "s"
        joint = against.removesuffix("_speed")
        return ("m" if self.joints[joint].slides else "rad") + ("" if joint == against else "/s")

    def spring(self, name: str, spring: Mapping[str, Any]) -> Spring:
        path, joint = f"springs.{name}", spring.get("torsional_at")
        if joint is None:
            first, second = (self.point(address) for address in spring["between"])
            free, unit = self.numbers(f"{path}.length", "m", spring["length"]), "N{}/m"
        else:
            first, second = self.joints[joint].sides
            free, unit = self.numbers(f"{path}.angle", "rad", spring["angle"]), "N m{}/rad"
        stiffness = self.numbers(f"{path}.stiffness", unit.format(""), spring["stiffness"])
        damping = self.numbers(f"{path}.damping", unit.format(" s"), spring["damping"])
        return Spring(name, first, second, joint, stiffness, damping, free)

    def contact(self, name: str, contact: Mapping[str, Any]) -> Contact:
        path, direction = f"contacts.{name}", (0, 0)

        def number(key: str, unit: str) -> Number:
            return self.numbers(f"{path}.{key}", unit, ANY)

        first, second = (self.point(address) for address in contact["between"])
        if contact["kind"] in ("point-line", "angle"):
            direction = self.vector(contact["direction"], f"{path}.direction_", "1")
        if "corner" in contact:
            second = corner_of(name, second, direction, contact["corner"], number("length", "m"), number("height", "m"))
        push = number("stiffness", "N/m^n"), number("exponent", "1"), number("damping", "N s/m")
        reach, radius = number("reach", "m"), number("radius", "m")
        return Contact(
            name, first, second, contact["kind"], direction, reach, radius, *push, number("restitution", "1")
        )
