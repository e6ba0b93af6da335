"""Scenes under transformations that physics does not notice, and what these do to every sensor.

A scene is taken as its entries in SI (`in_si`), with sensors of every kind that it can have (`probed`). A
transformation gives other entries, and from the original's readings those to be expected. `Isometry` turns and mirrors
the whole mechanism and exchanges start and end of links; `Scaled` changes the units of length, mass and time;
`Reordered` shuffles the tables; `Backwards` lets the drives run the other way round.
"""

from __future__ import annotations

import ast
import copy
import math
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.read import _validated

Raw = dict[str, Any]
Readings = Mapping[str, np.ndarray]
VECTOR = ("x", "y")


def in_si(scene: Scene) -> Raw:
    """What the scene says, as plain numbers in SI; materials as their constants, loose guides as such."""
    raw = scene.model_dump(by_alias=True, exclude_unset=True, exclude={"description", "assumptions", "like", "events"})
    for name, loose in scene.loose.items():
        sides, clearance = loose.sides, loose.clearance.model_dump(by_alias=True, exclude_unset=True)
        raw["joints"][name] = {"prismatic": sides, "direction": loose.direction, "clearance": clearance}
        raw["contacts"] = {key: each for key, each in raw["contacts"].items() if key not in loose.contacts}
    for name, body in scene.bodies.items():
        if body.elastic:
            made_of = body.beam.constants()
            beam = raw["bodies"][name]["beam"]
            beam.pop("material", None)
            beam |= {key: value for key in ("E", "rho", "nu", "G") if (value := getattr(made_of, key)) is not None}
            if "nu" in beam:
                beam.pop("G", None)
    return raw


def validated(raw: Raw) -> Scene:
    return _validated(copy.deepcopy(raw), raw["name"])


def probed(scene: Scene) -> Raw:
    """The scene's entries with sensors of every kind instead of its own; those of a vector are NAME_x and NAME_y.

    On links they stand beside the nodes, since at a node much falls into place by itself.
    """
    raw, sensors = in_si(scene), {}

    def vector(name: str, sensor: Raw, components: tuple[str, ...] = (*VECTOR, "angle")) -> None:
        sensors.update({f"{name}_{part}": sensor | {"component": part} for part in components})

    for name, body in scene.bodies.items():
        length = body.length or 0.0
        raw["bodies"][name].setdefault("points", {})["probe"] = (0.37 * length, 0.0 if body.elastic else 0.11 * length)
        for point in ("probe", "end") if length else ("probe",):
            at, key = (name, point), f"{name}_{point}"
            vector(f"{key}_place", {"position": at})
            vector(f"{key}_velocity", {"velocity": at})
            vector(f"{key}_felt", {"acceleration": at})
            vector(f"{key}_acceleration", {"acceleration": at, "axes": "global"})
            vector(f"{key}_moved", {"displacement": at})
            if body.elastic:
                vector(f"{key}_bent", {"displacement": at, "relative_to": "chord"})
                sensors |= {f"{key}_{kind}": {kind: at} for kind in ("axial_force", "shear_force", "bending_moment")}
                sensors[f"{key}_strain"] = {"strain": at, "fibre": 0.013 * length}
    for name, joint in scene.joints.items():
        slides = joint.kind == "prismatic"
        vector(f"{name}_force", {"joint_force": name}, VECTOR if joint.kind == "revolute" else (*VECTOR, "angle"))
        first = joint.addresses[0].body
        if first != "ground":
            vector(f"{name}_push", {"joint_force": name, "body": first, "axes": "body"}, VECTOR)
        sensors[f"{name}_coordinate"] = {"position": name, "component": "x" if slides else "angle"}
    sensors |= {
        f"{name}_effort": {"drive_force" if scene.slides(name) else "drive_torque": name} for name in scene.drives
    }
    for name, spring in scene.springs.items():
        sensors[f"{name}_tension"] = {"spring_force" if spring.torsional_at is None else "spring_torque": name}
    return raw | {"sensors": sensors}


def vectors(scene: Scene, readings: Readings) -> Iterator[tuple[str, str]]:
    """Names of the readings that are x and y of one vector."""
    for name in readings:
        if name.removesuffix("_rigid").endswith("_x"):
            suffix = "_rigid" if name.endswith("_rigid") else ""
            other = f"{name.removesuffix(suffix)[:-2]}_y{suffix}"
            if other in readings:
                yield name, other


@dataclass(frozen=True)
class Isometry:
    """The mechanism with its gravity mirrored at the x axis, if `mirrored`, then turned by `angle` [rad] about (0, 0).

    Bodies that are `reversed` have their start where their end was. Coordinates x of a frame become R(b) F x + p, where
    F = diag(1, -1) mirrors or is 1, and b is `angle` for the ground and pi for what is reversed; the frame's angle
    phi becomes s phi + angle - b with s = det F. All that follows is this, for points, vectors and angles.
    """

    folder: Path
    angle: float = 0.0
    mirrored: bool = False
    reversed: frozenset[str] = frozenset()

    @property
    def sense(self) -> float:
        return -1.0 if self.mirrored else 1.0

    def turns(self, scene: Scene) -> dict[str, float]:
        """b of every frame; a guide keeps the frames of its two bodies parallel."""
        found = {"ground": self.angle} | {name: math.pi for name in self.reversed}
        for _ in scene.joints:
            for joint in scene.joints.values():
                first, second = (address.body for address in joint.addresses)
                if joint.kind == "prismatic":
                    for one, other in ((first, second), (second, first)):
                        if one in found:
                            assert found.setdefault(other, found[one]) == found[one], "a guide between them"
        return {name: found.get(name, 0.0) for name in ("ground", *scene.bodies)}

    def __call__(self, raw: Raw) -> Raw:
        scene, raw = validated(raw), copy.deepcopy(raw)
        return _Moved(self, scene, self.turns(scene)).entries(raw)

    def readings(self, raw: Raw, readings: Readings) -> dict[str, np.ndarray]:
        scene = validated(raw)
        return _Moved(self, scene, self.turns(scene)).readings(readings)


@dataclass(frozen=True)
class _Moved:
    """One scene under an isometry."""

    by: Isometry
    scene: Scene
    turns: Mapping[str, float]

    def vector(self, frame: str, vector) -> tuple[Any, Any]:
        x, y = vector[0], self.by.sense * vector[1]
        c, s = _cosine(self.turns[frame]), _cosine(self.turns[frame] - math.pi / 2)
        return c * x - s * y, s * x + c * y

    def point(self, frame: str, point) -> tuple[float, float]:
        x, y = self.vector(frame, point)
        return x + (self.scene.bodies[frame].length if frame in self.by.reversed else 0.0), y

    def absolute(self, body: str, angle):
        return self.by.sense * angle + self.by.angle - self.turns[body]

    def shift(self, joint: str) -> float:
        """What is added to a joint's coordinate beside its sign."""
        if self.scene.joints[joint].kind == "prismatic":
            return 0.0
        first, second = (address.body for address in self.scene.joints[joint].addresses)
        return self.turns[first] - self.turns[second]

    def sense(self, joint: str) -> float:
        return 1.0 if self.scene.joints[joint].kind == "prismatic" else self.by.sense

    def coordinate(self, joint: str, value):
        return self.sense(joint) * value + self.shift(joint)

    def address(self, address: Address) -> Address:
        exchanged = {"start": "end", "end": "start"} if address.body in self.by.reversed else {}
        return Address(address.body, exchanged.get(address.point, address.point))

    # ---- entries ----------------------------------------------------------------------------------------------

    def entries(self, raw: Raw) -> Raw:
        scene = self.scene
        raw["gravity"] = self.vector("ground", scene.gravity)
        raw["ground"] = {name: self.point("ground", point) for name, point in scene.ground.items()}
        for name, body in raw["bodies"].items():
            self._body(name, body)
        for name, joint in raw["joints"].items():
            self._joint(name, joint)
        for name, drive in raw.get("drives", {}).items():
            self._drive(name, drive)
        for name, load in raw.get("loads", {}).items():
            self._load(name, load)
        for mass in raw.get("masses", {}).values():
            mass["at"] = self.address(Address(*mass["at"]))
        for spring in raw.get("springs", {}).values():
            if "between" in spring:
                spring["between"] = [self.address(Address(*end)) for end in spring["between"]]
            elif "angle" in spring or self.shift(spring["torsional_at"]):
                spring["angle"] = self.coordinate(spring["torsional_at"], spring.get("angle", 0.0))
        first = next(iter(scene.drives), None)
        turns = first is not None and scene.drives[first].kind == "constant speed"  # and comes by its angle zero
        if "mode_angle" in raw["solve"] or (turns and self.shift(first)):
            raw["solve"]["mode_angle"] = self.coordinate(first, scene.solve.mode_angle)
        for sensor in raw["sensors"].values():
            self._sensor(sensor)
        return raw

    def _body(self, name: str, body: Raw) -> None:
        here = self.scene.bodies[name]
        body["points"] = {point: self.point(name, at) for point, at in here.points.items()}
        if "centre" in body:
            body["centre"] = self.point(name, here.centre)
        if "pose" in body:
            (x, y), angle, along = here.pose.at, here.pose.angle, here.length if name in self.by.reversed else 0.0
            start = (x + along * math.cos(angle), y + along * math.sin(angle))
            body["pose"] = {"at": self.point("ground", start), "angle": self.absolute(name, angle)}
        if name in self.by.reversed and here.elastic:
            beam = body["beam"]
            assert not here.beam.segments
            for near, far in (("A", "A_end"), ("I", "I_end"), ("section", "taper")):
                if far in beam:
                    beam[near], beam[far] = beam[far], beam[near]

    def _joint(self, name: str, joint: Raw) -> None:
        here = self.scene.joints[name]
        first, second = here.addresses
        joint[here.kind] = [self.address(address) for address in here.addresses]
        if here.kind == "prismatic":
            joint["direction"] = self.vector(first.body, here.direction)
        if here.kind == "weld":
            angle = self.coordinate(name, here.relative_angle)
            if angle % math.tau or "relative_angle" in joint:
                joint["relative_angle"] = angle
        guided = {a.body for other in self.scene.joints.values() if other.kind == "prismatic" for a in other.addresses}
        if self.by.mirrored and "branch" in joint and not {first.body, second.body} & guided - {"ground"}:
            joint["branch"] = {"+": "-", "-": "+"}[joint["branch"]]  # to the left becomes to the right
        if "near" in joint:
            joint["near"] = {body: self.absolute(body, angle) for body, angle in joint["near"].items()}

    def _drive(self, name: str, drive: Raw) -> None:
        sense, shift = self.sense(name), self.shift(name)
        for key in ("speed", "initial_speed"):
            if key in drive:
                drive[key] = sense * drive[key]
        if "law" in drive and (sense != 1 or shift):
            drive["law"] = f"{sense!r} * ({drive['law']}) + {shift!r}"
        if "table" in drive:
            raise NotImplementedError("no shipped scene has a drive by a table")
        if ("speed" in drive or "free" in drive) and ("angle" in drive or shift):
            drive["angle"] = self.coordinate(name, drive.get("angle", 0.0))

    def _load(self, name: str, load: Raw) -> None:
        here = self.scene.loads[name]
        factor = 1.0
        if here.torque_at is not None:
            factor = self.by.sense
        else:
            body = here.force_on.body if here.force_on is not None else here.spread_on
            load["direction"] = self.vector("ground" if here.axes == "global" else body, here.direction)
            if here.force_on is not None:
                load["force_on"] = self.address(here.force_on)
            if body in self.by.reversed and "profile" in load:
                load["profile"] = here.profile[::-1]
        if "value" in load:
            load["value"] *= factor
        if "law" in load:
            load["law"] = self._law(load["law"], factor)
        if "table" in load:
            drive = here.against
            x_sense = 1.0 if drive == "t" else self.sense(drive)
            if factor != 1 or x_sense != 1:
                load |= _written(self.by.folder, here, x=x_sense, y=factor)
            if drive != "t":
                load["offset"] = self.coordinate(drive, here.offset)

    def _law(self, law: str, factor: float) -> str:
        """The law in the new drives' coordinates, with c = s (c' - shift)."""
        names = {}
        for drive in self.scene.drives:
            sense, shift = self.sense(drive), self.shift(drive)
            if sense != 1 or shift:
                names[drive] = f"({sense!r} * ({drive} - {shift!r}))"
                names[f"{drive}_speed"] = f"({sense!r} * {drive}_speed)"
        text = _substituted(law, names)
        return text if factor == 1 else f"{factor!r} * ({text})"

    def _sensor(self, sensor: Raw) -> None:
        kind = next(key for key in sensor if key not in ("component", "axes", "relative_to", "fibre", "body"))
        if isinstance(sensor[kind], tuple):
            sensor[kind] = self.address(Address(*sensor[kind]))
        if kind == "strain":
            sensor["fibre"] *= self._bending(sensor[kind].body)

    def _bending(self, link: str) -> float:
        """Sign of what is bent: it changes where the link's y axis, or its positive face, is the other one."""
        return self.by.sense * (-1.0 if link in self.by.reversed else 1.0)

    # ---- readings ---------------------------------------------------------------------------------------------

    def readings(self, readings: Readings) -> dict[str, np.ndarray]:
        found = {}
        for x, y in vectors(self.scene, readings):
            sensor = self.scene.sensors[x.removesuffix("_rigid")]
            found[x], found[y] = self.vector(self._frame(sensor), (readings[x], readings[y]))
        for name in readings:
            if name not in found:
                sensor = self.scene.sensors[name.removesuffix("_rigid")]
                found[name] = self._scalar(sensor, readings[name])
        return found

    def _frame(self, sensor) -> str:
        if sensor.axes == "global":
            return "ground"
        if sensor.kind != "joint_force":
            return sensor.target.body
        return sensor.body or self.scene.joints[sensor.target].addresses[1].body

    def _scalar(self, sensor, values: np.ndarray) -> np.ndarray:
        if sensor.kind == "position":
            joint = sensor.target.body
            return self.coordinate(joint, values) if joint in self.scene.joints else self.absolute(joint, values)
        if sensor.kind == "bending_moment":
            return self._bending(sensor.target.body) * values
        if sensor.kind in ("axial_force", "strain", "drive_force", "spring_force"):
            return values
        return self.by.sense * values  # shear forces, moments, torques, rotations and their rates


def _cosine(angle: float) -> float:
    """cos, exact at quarter turns: a component that is zero stays zero, and the structure the same."""
    quarters = angle / (math.pi / 2)
    return (1.0, 0.0, -1.0, 0.0)[round(quarters) % 4] if abs(quarters - round(quarters)) < 1e-12 else math.cos(angle)


def _substituted(law: str, names: Mapping[str, str]) -> str:
    class Substitute(ast.NodeTransformer):
        def visit_Name(self, node: ast.Name) -> ast.expr:
            return ast.parse(names[node.id], mode="eval").body if node.id in names else node

    return ast.unparse(Substitute().visit(ast.parse(law, mode="eval"))) if names else law


def _written(folder: Path, load: Any, x: float, y: float) -> Raw:
    """Keys of a load's table with abscissae and ordinates times these factors."""
    table = load.read_table()
    rows = sorted(zip(x * table.x, y * table.y, strict=True))
    per = 1.0 if load.against == "t" else math.degrees(1.0)
    file = folder / f"table_{abs(hash((load.table, load.column, x, y)))}.csv"
    file.write_text("x,y\n" + "".join(f"{per * float(a)!r},{float(b)!r}\n" for a, b in rows))
    return {"table": str(file), "column": "y", "unit": load.si_unit}


FORCE = (1, 1, -2)
_OF_UNIT = {
    "m": (1, 0, 0), "m/s": (1, 0, -1), "m/s^2": (1, 0, -2), "rad": (0, 0, 0), "rad/s": (0, 0, -1),
    "rad/s^2": (0, 0, -2), "N": FORCE, "N m": (2, 1, -2), "1": (0, 0, 0), "N/m": (0, 1, -2),
}  # fmt: skip
"""Unit -> powers of length, mass and time."""
_OF_KEY = {
    "length": (1, 0, 0), "mass": (0, 1, 0), "centre": (1, 0, 0), "inertia": (2, 1, 0), "points": (1, 0, 0),
    "at": (1, 0, 0), "gravity": (1, 0, -2), "ground": (1, 0, 0), "E": (-1, 1, -2), "G": (-1, 1, -2),
    "rho": (-3, 1, 0), "A": (2, 0, 0), "A_end": (2, 0, 0), "I": (4, 0, 0), "I_end": (4, 0, 0), "section": (1, 0, 0),
    "taper": (1, 0, 0), "to": (1, 0, 0), "spin_up": (0, 0, 1), "position": (1, 0, 0), "fibre": (1, 0, 0),
    "duration": (0, 0, 1), "mu": (-1, 1, -1),
}  # fmt: skip
"""Key of a scene -> powers of length, mass and time."""
_ONLY = {"springs": ("length",), "sensors": ("fibre",), "masses": ("mass", "inertia")}
"""Table -> those of its entries' keys for which this is true; others are addresses, or depend on more."""


@dataclass(frozen=True)
class Scaled:
    """All lengths, masses and times multiplied by a factor each, and with them every number that has a dimension.

    Laws of t, and laws at all where forces change, have numbers of unknown dimension: they are not scaled.
    """

    folder: Path
    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    def factor(self, powers: tuple[int, int, int]) -> float:
        return self.length ** powers[0] * self.mass ** powers[1] * self.time ** powers[2]

    def __call__(self, raw: Raw) -> Raw:
        scene, raw = validated(raw), copy.deepcopy(raw)
        assert self.factor(FORCE) == 1 or not any(load.kind == "law" for load in scene.loads.values())
        raw = {key: self._scaled(key, value) for key, value in raw.items()}
        for name, drive in raw.get("drives", {}).items():
            length = 1 if scene.slides(name) else 0
            assert "law" not in drive and "table" not in drive
            for key in ("speed", "initial_speed"):
                if key in drive:
                    drive[key] *= self.factor((length, 0, -1))
        for name, load in raw.get("loads", {}).items():
            here = scene.loads[name]
            if "value" in load:
                load["value"] *= self.factor(_OF_UNIT[here.si_unit])
            if "table" in load:
                assert here.against != "t"
                load |= _written(self.folder, here, 1.0, self.factor(_OF_UNIT[here.si_unit]))
        for name, spring in raw.get("springs", {}).items():
            stiffness = (0, 1, -2) if scene.springs[name].torsional_at is None else (2, 1, -2)
            for key, more in (("stiffness", 0), ("damping", 1)):
                if key in spring:
                    spring[key] *= self.factor((*stiffness[:2], stiffness[2] + more))
        if "rayleigh" in (raw.get("damping") or {}):
            raw["damping"]["rayleigh"]["at"] = tuple(f / self.time for f in scene.damping.rayleigh.at)
        return raw

    def _scaled(self, key: str, value: Any) -> Any:
        """An entry and all within it; numbers whose dimension depends on more than their key are left as they are."""
        if key in ("rayleigh", "joints"):
            return value
        if key in _ONLY:
            return {name: self._only(entry, _ONLY[key]) for name, entry in value.items()}
        if key in _OF_KEY and not (isinstance(value, Mapping) and key not in ("points", "ground", "section", "taper")):
            return _times(value, self.factor(_OF_KEY[key]))
        if isinstance(value, Mapping):
            return {name: self._scaled(name, entry) for name, entry in value.items()}
        return value

    def _only(self, entry: Raw, keys: tuple[str, ...]) -> Raw:
        return {key: _times(value, self.factor(_OF_KEY[key])) if key in keys else value for key, value in entry.items()}

    def readings(self, raw: Raw, readings: Readings) -> dict[str, np.ndarray]:
        sensors = validated(raw).sensors
        return {name: self.factor(_OF_UNIT[sensors[name.removesuffix("_rigid")].unit]) * values
                for name, values in readings.items()}  # fmt: skip


def _times(value: Any, factor: float) -> Any:
    if isinstance(value, Mapping):
        return {key: _times(entry, factor) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return tuple(_times(entry, factor) for entry in value)
    return value * factor


@dataclass(frozen=True)
class Reordered:
    """Every table's entries in another order; joints that close a loop stay behind the others, which they close."""

    folder: Path
    seed: int = 1
    tables: tuple[str, ...] = ("bodies", "ground", "masses", "loads", "springs", "sensors", "joints")

    def __call__(self, raw: Raw) -> Raw:
        shuffle = random.Random(self.seed).shuffle
        closing = validated(raw).loop_joints()
        raw = copy.deepcopy(raw)
        for table in self.tables:
            names = list(raw.get(table) or {})
            shuffle(names)
            if table == "joints":
                names = [name for name in names if name not in closing] + list(closing)
            if table in raw:
                raw[table] = {name: raw[table][name] for name in names}
        return raw

    def readings(self, raw: Raw, readings: Readings) -> dict[str, np.ndarray]:
        return dict(readings)


@dataclass(frozen=True)
class Backwards:
    """Drives of constant speed turn the other way round: without damping the same motion, read from its end.

    A velocity then has the opposite sign; displacements, accelerations and forces don't know which way time runs.
    """

    folder: Path

    def __call__(self, raw: Raw) -> Raw:
        raw = copy.deepcopy(raw)
        for drive in raw["drives"].values():
            drive["speed"] = -drive["speed"]
        return raw

    def readings(self, raw: Raw, readings: Readings) -> dict[str, np.ndarray]:
        sensors = validated(raw).sensors
        return {name: (-1.0 if sensors[name.removesuffix("_rigid")].kind == "velocity" else 1.0) * values[::-1]
                for name, values in readings.items()}  # fmt: skip
