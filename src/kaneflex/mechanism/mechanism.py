"""Builder of the mechanism from a scene's structure and numbers, for symbols and for floats."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from kaneflex.mechanism.parts import Body, Drive, Joint, Load, Mass, Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint, Number, Vector, quarter_turn
from kaneflex.scene.scene import Scene
from kaneflex.scene.structure import ANY, number_at, share_structure, structure_of
from kaneflex.support.contract import COURSES
from kaneflex.support.kept import Kept

if TYPE_CHECKING:
    from kaneflex.mechanism.force_parts import Contact, Friction, Spring

Numbers = Callable[[str, str, Any], Number]
"""Function from a number's dotted path, its unit and its structure (0, 1, -1 or "*") to the number."""


@dataclass(frozen=True)
class NumericMechanism(Mechanism):
    """Mechanism with floats in SI; ``size`` [m] is its longest reach from a body's start, to compare lengths with;
    ``frictions`` holds those of its joints and contacts by name."""

    size: float
    frictions: Mapping[str, Friction] = field(default_factory=dict)

    def exerting(self, joint: str) -> list[str]:
        """Names of the reactions along a joint's freedom."""
        return ["friction"] * (joint in self.frictions) + ["drive"] * (joint in self.drives)


def mechanism_of(scene: Scene) -> NumericMechanism:
    """Mechanism of a scene; made once, since scenes are immutable."""
    return _MADE.of(scene, lambda: _made(scene))


_MADE: Kept[Scene, NumericMechanism] = Kept()


def same_mechanism(scene: Scene, like: Scene) -> bool:
    """Reuse the mechanism of another scene if only speeds of drives differ; return True if so.

    Settings and sensors may differ, too, since the mechanism does not depend on them.
    """
    if not _differ_by_speed(scene.drives, like.drives) or any(
        getattr(scene, table) != getattr(like, table) for table in _TABLES
    ):
        return False
    _MADE.of(scene, lambda: mechanism_of(like))
    share_structure(scene, like)
    return True


_TABLES = ("gravity", "ground", "bodies", "joints", "masses", "loads", "springs", "contacts", "damping")
"""Tables of a scene, besides drives, on which its mechanism and equations depend."""


def _differ_by_speed(drives: Mapping[str, Any], like: Mapping[str, Any]) -> bool:
    """True if drives differ only in their speeds."""
    return drives.keys() == like.keys() and all(
        drive is like[name]
        or (drive == like[name].model_copy(update={"speed": drive.speed}) and drive.kind == like[name].kind)
        for name, drive in drives.items()
    )


def _made(scene: Scene) -> NumericMechanism:
    held = ("table", *COURSES)  # the place of a table in a module is not a number of the mechanism
    found = read(
        structure_of(scene), lambda path, *_: None if path.rpartition(".")[2] in held else number_at(scene, path)
    )
    joints = {name: replace(joint, near=scene.joints[name].near) for name, joint in found.joints.items()}
    bodies = {name: body._replace(free=scene.floating[name].place) if name in scene.floating else body
              for name, body in found.bodies.items()}  # fmt: skip
    contacts = {
        name: contact._replace(law=scene.contacts[name].law, joint=scene.contacts[name].joint)
        for name, contact in found.contacts.items()
    }
    reach = [math.hypot(*side.at) for joint in joints.values() for side in joint.sides]
    size = max([*reach, *(body.length or 0.0 for body in scene.bodies.values())]) or way_of(scene) or 1.0
    tables = vars(found) | {"bodies": bodies, "joints": joints, "contacts": contacts}
    return NumericMechanism(**tables, size=size, frictions=frictions_of(scene))


def way_of(scene: Scene) -> float:
    """Size [m] of a mechanism whose bodies have no lengths.

    It is the largest distance between bodies and contacts of the ground at the start, and of contacts on their bodies;
    the position of the scene does not matter.
    """
    places = [body.free.at for body in scene.bodies.values() if body.free is not None]
    found = [abs(drive.start) for name, drive in scene.drives.items() if name in scene.joints and scene.slides(name)]
    for contact in scene.contacts.values():
        if contact.kind != "angle":
            found.append(abs(contact.reach))
            for side in contact.sides:
                if side.body == GROUND:
                    places.append(scene.point(side))
                else:
                    found.append(math.hypot(*scene.point(side)))
    return max([*found, *(math.dist(place, places[0]) for place in places)], default=0.0)


def frictions_of(scene: Scene) -> dict[str, Friction]:
    """Frictions of joints and contacts by name."""
    return {name: _friction(held) for name, held in scene.frictions.items()}


def _friction(held: Any) -> Friction:
    """Parameters of a friction; the default of its static coefficient is the kinetic one."""
    from kaneflex.mechanism.force_parts import Friction

    static = held.mu if held.mu_static is None else held.mu_static
    dry = held.mu, static, held.stribeck_speed or 0.0, held.stribeck_exponent, held.viscous, held.preload
    return Friction(held.law, *dry, held.arm, held.bristle_stiffness or 0.0, held.bristle_damping)


def read(structure: Mapping[str, Any], numbers: Numbers) -> Mechanism:
    """Mechanism of `structure_of(scene)`; its numbers are requested by their paths."""
    reader = _Reader(structure, numbers)

    def each(table: str, make: Callable) -> dict[str, Any]:
        return {name: make(name, entry) for name, entry in structure.get(table, {}).items()}

    bodies, joints = each("bodies", reader.body), each("joints", reader.joint)
    reader.joints = joints
    masses, drives, loads = each("masses", reader.mass), each("drives", reader.drive), each("loads", reader.load)
    acting = each("springs", reader.spring), each("contacts", reader.contact)
    gravity = tuple(numbers(f"gravity.{'xy'[k]}", "m/s^2", structure["gravity"][k]) for k in range(2))
    kinds = structure["frame"], structure["viscous"]
    observed = tuple(structure.get("observed", ()))
    return Mechanism(bodies, joints, masses, drives, loads, *acting, observed, gravity, *kinds)


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
        from kaneflex.mechanism.force_parts import Spring

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
        from kaneflex.mechanism.force_parts import Contact

        path, direction = f"contacts.{name}", (0, 0)

        def number(key: str, unit: str) -> Number:
            return self.numbers(f"{path}.{key}", unit, ANY)

        first, second = (self.point(address) for address in contact["between"])
        if contact["kind"] in ("point-line", "angle"):
            direction = self.vector(contact["direction"], f"{path}.direction_", "1")
        if "corner" in contact:
            second = _corner(name, second, direction, contact["corner"], number("length", "m"), number("height", "m"))
        push = number("stiffness", "N/m^n"), number("exponent", "1"), number("damping", "N s/m")
        reach, radius = number("reach", "m"), number("radius", "m")
        return Contact(
            name, first, second, contact["kind"], direction, reach, radius, *push, number("restitution", "1")
        )


def _corner(name: str, middle: BodyPoint, inward: Vector, corner: int, length: Number, height: Number) -> BodyPoint:
    """Corner of a block at a face with this inward normal, along the normal turned by 90 deg, or back."""
    x, y = quarter_turn(inward)
    along, out = corner * length / 2, height / 2
    at = middle.at[0] + along * x - out * inward[0], middle.at[1] + along * y - out * inward[1]
    return BodyPoint(middle.body, f"contacts.{name}", at)
