"""Scene: the validated input of a mechanism, in SI."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field, PrivateAttr

from kaneflex.scene.beams import Damping
from kaneflex.scene.bodies import Body
from kaneflex.scene.drives import Drive
from kaneflex.scene.laws import Law
from kaneflex.scene.parts import Joint, Load, Mass, Solve
from kaneflex.scene.quantities import Acceleration, Address, Point, Vector, Words
from kaneflex.scene.sensors import Event, Sensor
from kaneflex.scene.table import SceneTable, late
from kaneflex.support.escaping import visible
from kaneflex.support.units import SENSED, to_si

if TYPE_CHECKING:
    from kaneflex.scene.clearances import LooseJoint
    from kaneflex.scene.contact_law import Friction
    from kaneflex.scene.contacts import Contact
    from kaneflex.scene.poses import Free
    from kaneflex.scene.springs import Spring
else:
    (Contact,), (Spring,) = late("kaneflex.scene.contacts", "Contact"), late("kaneflex.scene.springs", "Spring")


def given_value(raw: object, path: Sequence[str]) -> object:
    """Text that a user wrote at a path of keys; None for a table or a missing entry."""
    for part in path:
        if isinstance(raw, list) and part.isdigit():
            raw = raw[int(part)]
        elif isinstance(raw, dict):
            raw = raw.get(part)
        else:
            return None
    return None if isinstance(raw, dict) else raw


def given_vectors(scene: Scene) -> Iterator[tuple[str, tuple[float, ...]]]:
    """Path of each vector in a scene, and the vector; their number of components tells if the scene is planar."""
    tables: dict[str, SceneTable] = {"": scene}
    for table in ("bodies", "joints", "drives", "loads", "contacts"):
        tables |= {f"{table}.{name}.": entry for name, entry in getattr(scene, table).items()}
    for name, body in scene.bodies.items():
        inner: dict[str, SceneTable | None] = {"free": body.free, "pose": body.pose, "rotation": body.rotation}
        tables |= {f"bodies.{name}.{key}.": entry for key, entry in inner.items() if entry is not None}
    for path, entry in tables.items():
        for field in sorted(entry.model_fields_set & _VECTORS):
            value = getattr(entry, field)
            if isinstance(value, dict):
                yield from ((f"{path}{field}.{name}", point) for name, point in value.items())
            elif field == "axes" and isinstance(value, tuple):
                yield from ((f"{path}{field}", axis) for axis in value)
            elif isinstance(value, tuple):
                yield f"{path}{field}", value


_VECTORS = frozenset((
    "gravity", "ground", "centre", "points", "direction", "axis", "axes", "at", "velocity", "angular_velocity", "x",
    "y", "normal",
))  # fmt: skip
"""Fields that hold vectors, or named points."""


def _as_given(now: Any, read: Any, raw: Any) -> Any:
    """Changed table as file content: unchanged entries remain as the user wrote them."""
    if isinstance(now, dict):
        kept = read if isinstance(read, dict) else {}
        return {
            name: raw[name] if name in kept and kept[name] == value else _as_given(value, None, None)
            for name, value in now.items()
        }
    if isinstance(now, SceneTable):
        return now.model_dump(by_alias=True, exclude_unset=True, exclude_none=True)
    return now


def _if_same(now: Any, read: Any, before: Any, given: Any) -> Any:
    """Table of the scene if unchanged since it was read; else the given one."""
    same = isinstance(now, SceneTable) and given is before and now is read and not now.says_a_file
    return now if same else given


class Scene(SceneTable):
    """Mechanism with its drives, loads, sensors and settings, in SI. Made by `read_scene`.

    Tables keep the file's order. `ground` holds further named fixed points (m, global axes). When a scene is read, a
    joint with a clearance moves from `joints` to `contacts`.
    """

    schema_version: Literal[1] = Field(alias="schema")
    like: str | None = Field(default=None, description="a shipped scene, or a file in the same folder, to start from")
    name: Words = ""
    description: Words = ""
    assumptions: dict[Words, Words] = Field(default={}, description="assumptions, by topic")
    gravity: Acceleration = (0.0, 0.0)
    ground: dict[str, Point] = Field(default={})
    bodies: dict[str, Body] = Field(min_length=1)
    joints: dict[str, Joint] = Field(default={})
    masses: dict[str, Mass] = Field(default={})
    drives: dict[str, Drive] = Field(default={})
    loads: dict[str, Load] = Field(default={})
    springs: dict[str, Spring] = Field(default={})
    contacts: dict[str, Contact] = Field(default={})
    damping: Damping | None = None
    sensors: dict[str, Sensor] = Field(default={})
    events: dict[str, Event] = Field(default={})
    solve: Solve = Solve.model_construct()  # which builds no validators

    _raw: dict[str, Any] = PrivateAttr(default_factory=dict)
    _source: str = PrivateAttr("")
    _read: dict[str, Any] = PrivateAttr(default_factory=dict)

    def __repr__(self) -> str:
        counts = ", ".join(f"{table} {len(entries)}" for table, entries in self._tables().items())
        return f"Scene({visible(self.name)}, {self.solve.preset}: {counts})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """HTML view in a notebook: description and names of entries."""
        from kaneflex.support.html import shown

        rows = [(table, ", ".join(entries)) for table, entries in self._tables().items()]
        heading = f"{self.name}: {self.description}" if self.description else self.name
        return shown(heading, ("", ""), [*rows, ("preset", self.solve.preset)])

    def _tables(self) -> dict[str, dict[str, Any]]:
        """Non-empty tables of named entries."""
        return {name: value for name, value in self if isinstance(value, dict) and value and name != "assumptions"}

    @property
    def raw(self) -> dict[str, Any]:
        """Content of the file after merging `like`, before units are converted; `with_settings` starts here. Read only.

        Changes after reading, as by `model_copy`, are in SI.
        """
        raw, before, tables = self._raw, self._read, self.__dict__
        for name, field in type(self).model_fields.items():
            now, read, key = tables[name], before.get(name), field.alias or name
            if now is not read and now != read:
                raw = {k: value for k, value in raw.items() if k != key}
                raw |= {} if now is None else {key: self._written(name, now, read, self._raw.get(key))}
        return raw

    def known(self, raw: dict[str, Any]) -> dict[str, Any]:
        """Prepare other tables of a scene for the validator: entries shared with this scene's input are already valid.

        An entry that is the same object in both was validated when this scene was read, and is reused.
        """
        return {key: self._known(key, given) for key, given in raw.items()}

    def _known(self, key: str, given: Any) -> Any:
        now, read, before = self.__dict__.get(key), self._read.get(key), self._raw.get(key)
        if not (isinstance(now, dict) and isinstance(before, dict) and isinstance(given, dict)):
            return _if_same(now, read, before, given)
        return {name: _if_same(now.get(name), read.get(name), before.get(name), entry) for name, entry in given.items()}

    def _written(self, table: str, now: Any, read: Any, raw: Any) -> Any:
        """Changed table as file content, with joints with a clearance and without the contacts made of them."""
        if table == "contacts":
            now = {name: contact for name, contact in now.items() if contact.joint is None}
        found = _as_given(now, read, raw)
        loose = {contact.joint for contact in self.contacts.values()} if table == "joints" else ()
        return found | {name: entry for name, entry in raw.items() if name in loose} if loose else found

    def seen(self, **tables: Any) -> Scene:
        """Copy of the scene with other tables for some equations; settings still apply to the original input."""
        found = self.model_copy(update=tables)
        found.remember(self.raw, self._source)
        return found

    def with_clearances(self) -> Scene:
        """Scene with contacts in place of its joints with clearance; joints with backlash remain."""
        loose = {name: joint for name, joint in self.joints.items() if joint.clearance is not None}
        if not loose:
            return self
        from kaneflex.scene.clearances import contacts_of

        joints = {name: joint for name, joint in self.joints.items() if name not in loose or joint.has_backlash}
        made = {key: contact for name, joint in loose.items() for key, contact in contacts_of(name, joint).items()}
        return self.seen(joints=joints, contacts={**self.contacts, **made})

    @cached_property
    def frictions(self) -> dict[str, Friction]:
        """Friction by joint or contact."""
        found = {name: joint.friction for name, joint in self.joints.items()}
        found |= {name: contact.friction for name, contact in self.contacts.items()}
        return {name: friction for name, friction in found.items() if friction is not None}

    def turns_at(self, name: str) -> bool:
        """True if the joint of this name is a pin, so that its friction is a torque."""
        return name in self.joints and self.joints[name].kind == "revolute"

    def remember(self, raw: dict[str, Any], source: str) -> None:
        """Store the input of the scene, and its tables as they are now."""
        self._raw, self._source = raw, source
        self._read = {name: dict(v) if isinstance(v, dict) else v for name, v in self.__dict__.items()}

    @property
    def source(self) -> str:
        """Origin of the scene: a shipped scene's name, or the name of a file without its folder."""
        return self._source or self.name

    @cached_property
    def is_spatial(self) -> bool:
        """True if vectors have three components; a scene without vectors is planar."""
        return any(len(value) == 3 for _, value in given_vectors(self))

    def vector(self, given: Vector) -> Vector:
        """Vector with as many components as the scene has dimensions; defaults have no z."""
        return (*given, 0.0) if self.is_spatial and len(given) == 2 else tuple(given)

    def point(self, address: Address) -> Vector:
        """Position of a point in m, in its body's axes; for a fixed point in global axes."""
        if address.body == "ground":
            return self.vector((0.0, 0.0) if address.point == "origin" else self.ground[address.point])
        return self.vector(self.bodies[address.body].points_all[address.point])

    @property
    def acting(self) -> list[tuple[str, Address]]:
        """Points at which joints, springs, contacts, loads and lumped masses act, in that order, with their entries."""
        found = [(f"joints.{name}.{joint.kind}", side) for name, joint in self.joints.items()
                 for side in joint.addresses]  # fmt: skip
        found += [(f"springs.{name}.{'bushing' if spring.bushing else 'between'}", end)
                  for name, spring in self.springs.items() for end in spring.ends]  # fmt: skip
        found += [(contact.entry(name), side) for name, contact in self.contacts.items() for side in contact.sides]
        found += [(f"loads.{name}.force_on", load.force_on) for name, load in self.forces.items()]
        return found + [(f"masses.{name}.at", mass.at) for name, mass in self.masses.items()]

    def acting_on(self, body: str) -> list[Address]:
        """Addresses on one body."""
        return [address for _, address in self.acting if address.body == body]

    def acted_on(self, body: str) -> tuple[float, ...]:
        """Distances [m] from a link's start, between its ends, at which forces act and section forces jump."""
        places = {self.point(address)[0] for address in self.acting_on(body)}
        return tuple(sorted(x for x in places if 0.0 < x < (self.bodies[body].length or 0.0)))

    def loop_joints(self) -> tuple[str, ...]:
        """Joints that close a loop: earlier joints already connect their two bodies."""
        group = {name: name for name in ("ground", *self.bodies)}
        closing = []
        for name, joint in self.joints.items():
            first, second = (group[address.body] for address in joint.addresses)
            if first == second:
                closing.append(name)
            group = {body: first if root == second else root for body, root in group.items()}
        return tuple(closing)

    @property
    def period(self) -> float | None:
        """Duration of one cycle in s; None if no drive has a cycle."""
        return next((drive.period for drive in self.drives.values() if drive.period is not None), None)

    @property
    def horizon(self) -> float:
        """Duration of a run in s: `solve.duration`, else one cycle."""
        return self.solve.duration if self.solve.duration is not None else self.period

    @property
    def forces(self) -> dict[str, Load]:
        """Loads that are point forces."""
        return {name: load for name, load in self.loads.items() if load.force_on is not None}

    @property
    def spreads(self) -> dict[str, Load]:
        """Loads that are distributed along a body."""
        return {name: load for name, load in self.loads.items() if load.spread_on is not None}

    @property
    def torques(self) -> dict[str, Load]:
        """Loads that are torques between two bodies at a joint."""
        return {name: load for name, load in self.loads.items() if load.torque_at is not None}

    @property
    def loose(self) -> dict[str, LooseJoint]:
        """Joints with a clearance."""
        if not self.contacts:
            return {}
        from kaneflex.scene.clearances import loose_joints

        return loose_joints(self.contacts)

    def slides(self, drive: str) -> bool:
        """True if a drive's coordinate is that of a guide [m], not an angle [rad]."""
        return self.joints[drive].kind == "prismatic"

    def written_speed(self, drive: str, speed: float, digits: int = 6) -> str:
        """Text of a drive's speed [rad/s or m/s], like "6000 rpm" or "0.5 m/s"."""
        return f"{speed:.{digits}g} m/s" if self.slides(drive) else f"{speed * 30.0 / math.pi:.{digits}g} rpm"

    def meaning_of(self, sensor: Sensor) -> str:
        """Description of a sensor in one line; without axes for a joint's coordinate."""
        if isinstance(sensor.target, Address) and sensor.target.body in self.joints:
            motion = "rotation" if sensor.component == "angle" else "translation"
            return f"{sensor.kind} of joint {sensor.target.body}, {motion}"
        return sensor.meaning

    def joint_read(self, sensor: Sensor) -> str | None:
        """Joint whose coordinate, or in space one of its rates, a sensor measures."""
        kinds = ("position", "velocity", "acceleration") if self.is_spatial else ("position",)
        target = sensor.target
        if sensor.kind not in kinds or not isinstance(target, Address) or target.point != "start":
            return None
        return target.body if target.body in self.joints else None

    def level(self, event: Event) -> float:
        """Value of an event in its sensor's SI unit. Raises Fault for text in another unit."""
        unit = self.sensors[event.sensor].unit
        return to_si(event.value, next(dimension for dimension in SENSED if dimension.unit == unit))

    @property
    def is_frame(self) -> bool:
        """True for a fixed structure: its bodies have poses and there are no drives."""
        return any(body.pose is not None for body in self.bodies.values())

    @property
    def is_elastic(self) -> bool:
        """True if a body has finite elements."""
        return any(body.elastic for body in self.bodies.values())

    @property
    def free_joints(self) -> tuple[str, ...]:
        """Joints with a free drive."""
        return tuple(name for name, drive in self.drives.items() if drive.free)

    @property
    def floating(self) -> dict[str, Free]:
        """Free bodies, with their initial positions and speeds."""
        return {name: body.free for name, body in self.bodies.items() if body.free is not None}

    def law_names(self) -> tuple[str, ...]:
        """Names that a law may use besides pi: t, each joint's angle (rad; for a guide m) and speed (rad/s; m/s)."""
        joints = dict.fromkeys((*self.drives, *(name for name, joint in self.joints.items() if joint.kind != "weld")))
        return ("t", *joints, *(f"{name}_speed" for name in joints))

    def law(self, load: str) -> Law | None:
        """Law of a load that has one."""
        return self.argument(load) if self.loads[load].against is None else None

    def argument(self, load: str) -> Law | None:
        """Law of a load, or the abscissa of its table as a law; its magnitude depends on the names in it."""
        text, names = self.loads[load].against or self.loads[load].law, self.law_names()
        if text is None or text in names:
            return None if text is None else Law.of(text)
        from kaneflex.scene.law_parser import parse_law

        return parse_law(text, names)

    @property
    def observed(self) -> tuple[str, ...]:
        """Joints without a drive whose coordinates or speeds enter loads."""
        laws = [law for law in map(self.argument, self.loads) if law is not None]
        free = (name for name in self.joints if name not in self.drives)
        return tuple(name for name in free if any(law.uses_any([name]) for law in laws))
