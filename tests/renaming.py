"""A scene under other names: bodies, points, masses, joints with their drives, loads, springs, sensors and events."""

from __future__ import annotations

import random
import re
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from types import ModuleType

from kaneflex.scene import Scene
from kaneflex.scene.parts import JOINT_KINDS
from kaneflex.scene.read import _validated
from kaneflex.scene.sensors import CONTACT_KINDS, KINDS, POINT_KINDS

# Words of ours, of Python and of SymPy, and pairs that differ by where their dots are; points that NFKC makes equal.
_BODIES = ["arm", "arm_left", "I", "omega", "w0", "x_0", "rho_A", "S", "N", "c_arm", "math", "p", "out", "gravity_x"]
_JOINTS = ["arm_mass", "omega_arm", "s", "motion", "Q", "arm_link", "link", "arm_left_tip", "terms", "arm_phi", "e_1"]
_POINTS = ["tip", "left_tip", "centre", "in", "ﬁ", "fi", "mass", "element", "link", "x", "seed_c", "pose_x", "lambda"]
_SPRINGS = ["v_x_arm", "arm_d", "arm_d_x", "k"]
_WORDS = "{body} {body}_mass omega_{body} {joint}_drive {joint}_force_x {joint} crank_mass E gravity_load".split()
_WORDS += "{body}_link_P_0 size_{body} {joint}_coordinate {body}_length w1 table cos_{joint} {joint}_branch".split()


CONTACTS = ("point_on_line", "circle_on_circle", "circle_in_circle")


@dataclass(frozen=True)
class Renaming:
    """Old names to new ones by table; those of points by body ("ground" for fixed ones) and point."""

    of: Mapping[str, Mapping[str, str]]
    points: Mapping[tuple[str, str], str]

    def address(self, text: str) -> str:
        body, dot, point = text.partition(".")
        named = self.of["bodies"] | self.of["joints"]  # a position may be that of a joint
        return named.get(body, body) + dot + self.points.get((body, point), point)

    def law(self, text: str) -> str:
        def one(word: re.Match) -> str:
            drive = word[0].removesuffix("_speed")
            return self.of["joints"][drive] + word[0].removeprefix(drive) if drive in self.of["joints"] else word[0]

        return re.sub(r"[A-Za-z]\w*", one, text)

    def scalar(self, name: str) -> str:
        """A scalar of the motion, a coordinate or a multiplier of a module."""
        owner, dot, rest = name.partition(".")
        if ".link.jump_" in name:
            point = name.partition(".link.jump_")[2]
            rest = f"link.jump_{self.points.get((owner, point), point)}"
        return {**self.of["loads"], **self.of["springs"], **self.of["bodies"], **self.of["joints"]}[owner] + dot + rest

    def path(self, path: str) -> str:
        """A number of a scene in the PARAMETERS of a module."""
        table, owner, *rest = path.split(".")
        if table == "gravity":
            return path
        if table == "ground":
            return ".".join([table, self.points["ground", owner], *rest])
        if rest[:1] == ["points"]:
            rest[1] = self.points.get((owner, rest[1]), rest[1])
        return ".".join([table, self.of["joints" if table == "drives" else table][owner], *rest])


def drawn(scene: Scene, seed: int) -> Renaming:
    """New names for everything in a scene, drawn from those that are likely to meet."""
    draw = random.Random(seed)

    def names(pool: list[str], old: Mapping[str, object], prefix: str) -> dict[str, str]:
        pool = draw.sample(pool, len(pool)) + [f"{prefix}_{k}" for k in range(len(old))]
        return dict(zip(old, pool, strict=False))

    joints = dict(scene.raw.get("joints", {}))  # those with a clearance, too
    of = {"bodies": names(_BODIES, scene.bodies, "link"), "joints": names(_JOINTS, joints, "pin_mass")}
    named = [[*of["bodies"].values()], [*of["joints"].values()] or _JOINTS]
    words = [word.format(body=draw.choice(named[0]), joint=draw.choice(named[1])) for word in _WORDS]
    words = [*dict.fromkeys(word for word in words if word not in _SPRINGS)]
    of["masses"] = names([*of["bodies"].values(), *words], scene.masses, "m")
    of["loads"] = names(words, scene.loads, "f")
    of["contacts"] = names([f"{word}_stop" for word in _BODIES], scene.contacts, "contact")
    made = {name: contact.joint for name, contact in scene.contacts.items() if contact.joint is not None}
    of["contacts"] |= {name: of["joints"][joint] + name[len(joint) :] for name, joint in made.items()}
    of |= {"springs": names(_SPRINGS, scene.springs, "spring"), "events": names(words, scene.events, "event")}
    of["sensors"] = names(words, scene.sensors, "sensor")
    points = {}
    for body, given in {"ground": scene.ground, **{name: body.points for name, body in scene.bodies.items()}}.items():
        pool = _POINTS if body != "ground" else ["far", "pose_x", "mass", "element", "link"]
        points |= {(body, old): new for old, new in names(pool, given, "point").items()}
    return Renaming(of, points)


def renamed(scene: Scene, new: Renaming) -> Scene:
    """The scene under its new names, its tables in the same order."""
    raw = deepcopy(dict(scene.raw))
    raw.pop("like", None)
    raw["ground"] = {new.points["ground", name]: entry for name, entry in raw.get("ground", {}).items()}
    for table in ("bodies", "joints", "masses", "drives", "loads", "springs", "contacts", "sensors", "events"):
        found = {}
        for name, entry in raw.get(table, {}).items():
            found[new.of["joints" if table == "drives" else table][name]] = entry
            if table == "bodies" and "points" in entry:
                entry["points"] = {new.points[name, point]: at for point, at in entry["points"].items()}
            for key in (*JOINT_KINDS, "between", *CONTACTS):
                if key in entry:
                    entry[key] = [new.address(end) for end in entry[key]]
            for key in ("at", "force_on", *(POINT_KINDS if table == "sensors" else ())):
                if key in entry and isinstance(entry[key], str):
                    entry[key] = new.address(entry[key])
            targets = KINDS[len(POINT_KINDS) :]
            for key in ("torque_at", "torsional_at", "against", *targets, "sensor", "body", "spread_on"):
                if isinstance(entry.get(key), str):
                    tables = {"spring_force": "springs", "spring_torque": "springs", "sensor": "sensors"}
                    tables |= dict.fromkeys(CONTACT_KINDS, "contacts")
                    of = tables.get(key, "bodies" if key in ("body", "spread_on") else "joints")
                    entry[key] = new.of[of].get(entry[key], entry[key])
            if "near" in entry:
                entry["near"] = {new.of["bodies"][body]: angle for body, angle in entry["near"].items()}
            if "law" in entry:
                entry["law"] = new.law(entry["law"])
        if found:
            raw[table] = found
    return _validated(raw, scene.source)


def under_new_names(module: ModuleType, new: Renaming) -> ModuleType:
    """A module with new names in its tables, and the kernels that are compiled already."""
    found = ModuleType(module.__name__)
    found.__dict__.update(module.__dict__)
    found.PARAMETERS = tuple((new.path(path), unit) for path, unit in module.PARAMETERS)
    found.TABLES = tuple(map(new.path, module.TABLES))
    if hasattr(module, "LOADS"):  # laws alone
        found.DRIVES = {new.of["joints"][name]: kind for name, kind in module.DRIVES.items()}
        found.LOADS = tuple(new.of["loads"][name] for name in module.LOADS)
        return found
    found.SCALARS = tuple((new.scalar(name), *rest) for name, *rest in module.SCALARS)
    bodies, joints = new.of["bodies"], new.of["joints"]
    found.CONSTANTS = {new.scalar(name): value for name, value in module.CONSTANTS.items()}
    found.LINKS = {bodies[name]: first for name, first in module.LINKS.items()}
    found.FREE = tuple(joints[name] for name in module.FREE)
    if hasattr(module, "LOOPS"):
        found.LOOPS = tuple(
            (joints[closing], *(tuple(bodies[name] for name in names) for names in (held, turning)),
             tuple(joints[name] for name in sliding))
            for closing, held, turning, sliding in module.LOOPS
        )  # fmt: skip
    return found
