"""Structure of a scene, on which its equations depend: topology, and numbers that are exactly zero (or +-1 in a
direction).

Lengths, masses, tables, numbers of elements or modes, integrators, sensors and damping matter only at run time;
:func:`number_at` reads those that are parameters of the equations.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from kaneflex.scene.bodies import Body
from kaneflex.scene.drives import Drive
from kaneflex.scene.laws import Law
from kaneflex.scene.parts import Joint, Load, Mass
from kaneflex.scene.scene import Scene
from kaneflex.support.contract import FORMAT
from kaneflex.support.weak_cache import WeakCache

if TYPE_CHECKING:
    from kaneflex.scene.contacts import Contact
    from kaneflex.scene.springs import Spring

ANY = "*"
"""Mark of a number that is a parameter of the equations."""


_HASHES: WeakCache[Scene, str] = WeakCache()


def structure_of(scene: Scene) -> dict[str, Any]:
    """Structure as plain data, every table in the scene's order, which is also the order of derivation.

    Numbers that are exactly 0 (in directions also 1 and -1) remain, all others become "*".
    """
    if scene.is_spatial:
        return laws_of(scene)
    acting = {"springs": {name: _spring(spring) for name, spring in scene.springs.items()},
              "contacts": {name: _contact(contact) for name, contact in scene.contacts.items()}}  # fmt: skip
    closing = scene.loop_joints()
    observed = {"observed": list(scene.observed)} if scene.observed else {}
    return {key: table for key, table in acting.items() if table} | observed | {
        "bodies": {name: _body(body) for name, body in scene.bodies.items()},
        "points": _points(scene),
        "joints": {name: _joint(joint) | {"closes_loop": name in closing}
                   for name, joint in scene.joints.items()},
        "masses": {name: _mass(mass) for name, mass in scene.masses.items()},
        "drives": {name: _drive(drive) for name, drive in scene.drives.items()},
        "loads": {name: _load(load, _size(load, scene.law(name))) for name, load in scene.loads.items()},
        "gravity": _zeros(scene.gravity),
        "frame": scene.is_frame,
        "viscous": scene.damping is not None and scene.damping.kind == "viscous",
    }  # fmt: skip


def laws_of(scene: Scene) -> dict[str, Any]:
    """Structure of a scene's laws, on which alone its module depends in space and under preset coupled: kinds of its
    drives and loads."""
    observed = {"observed": list(scene.observed)} if scene.observed else {}
    named = {*scene.drives, *scene.observed, *(load.torque_at for load in scene.torques.values())}
    joints = {name: {"kind": joint.kind, "between": ["ground", "ground"], "closes_loop": False}
              for name, joint in scene.joints.items() if name in named}  # fmt: skip
    drives = {name: _drive(drive) for name, drive in scene.drives.items()}
    loads = {name: _size(load, scene.law(name)) for name, load in scene.loads.items()}
    return observed | {
        "bodies": {}, "points": {}, "joints": joints, "masses": {}, "drives": drives, "loads": loads,
        "gravity": [0, 0], "frame": False, "viscous": False,
    }  # fmt: skip


def structure_hash(scene: Scene) -> str:
    """Name of the structure: hash of sixteen hexadecimal digits of the structure and the format of generated modules.

    Equal structures share one generated module.
    """
    return _HASHES.of(scene, lambda: _digits({"format": FORMAT, **structure_of(scene)}))


def share_structure(scene: Scene, other: Scene) -> None:
    """Copy the structure's name from another scene with the same structure."""
    _HASHES.of(scene, lambda: structure_hash(other))


def laws_hash(scene: Scene) -> str:
    """Hash of the structure of the laws."""
    return _digits({"format": FORMAT, **laws_of(scene)})


def pruned_hash(scene: Scene, without: Sequence[str]) -> str:
    """Hash of the structure without some groups of terms."""
    return _digits({"format": FORMAT, "without": sorted(without), **structure_of(scene)})


def _digits(content: Mapping[str, Any]) -> str:
    text = json.dumps(content, separators=(",", ":"))  # the order of the tables matters
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _body(body: Body) -> dict[str, Any]:
    mass, inertia = _zeros((body.mass, body.inertia))
    entry = {"elastic": body.elastic, "mass": mass, "inertia": inertia, "centre": _zeros(body.centre)}
    if body.modal is not None and body.modal.rotary:
        entry["theory"] = "rayleigh"
    return entry | (body.beam.structure() if body.elastic else {})


def _points(scene: Scene) -> dict[str, list[Any]]:
    """Coordinates of the scene's own named points that joints or loads use."""
    named = {name: body.points_named for name, body in scene.bodies.items()} | {"ground": scene.ground}
    used = (address for _, address in scene.acting if address.point in named[address.body])
    return {str(address): _zeros(scene.point(address)) for address in used}


def _joint(joint: Joint) -> dict[str, Any]:
    entry = {"kind": joint.kind, "between": [str(address) for address in joint.addresses]}
    if joint.direction is not None:
        entry["direction"] = _direction(joint.direction)
    if joint.relative_angle:
        entry["relative_angle"] = ANY
    return entry


def _mass(mass: Mass) -> dict[str, Any]:
    weight, inertia = _zeros((mass.mass, mass.inertia))
    return {"at": str(mass.at), "mass": weight, "inertia": inertia}


def _drive(drive: Drive) -> dict[str, Any]:
    if drive.kind == "law":
        from kaneflex.scene.law_parser import parse_law

        return {"kind": "law", "law": parse_law(drive.law, ("t",)).text}
    return {"kind": drive.kind}


def _load(load: Load, size: Mapping[str, Any]) -> dict[str, Any]:
    if load.torque_at is not None:
        entry = {}
    elif load.spread_on is not None:
        entry = {"spread_on": load.spread_on, "axes": load.axes, "direction": _direction(load.direction)}
        entry["profile"] = _direction(load.profile)
    else:
        entry = {"on": str(load.force_on), "axes": load.axes, "direction": _direction(load.direction)}
    return entry | size


def _size(load: Load, law: Law | None) -> dict[str, Any]:
    """Magnitude of a load."""
    entry = {} if load.torque_at is None else {"torque_at": load.torque_at}
    if load.kind == "table":
        return entry | {"kind": "table", "against": load.against}
    if law is not None:
        return entry | {"kind": "law", "law": law.text}
    return entry | {"kind": "constant"}


def _spring(spring: Spring) -> dict[str, Any]:
    if spring.bushing is not None:  # only in space, where a module has no springs
        return {"bushing": [str(end) for end in spring.ends]}
    stiffness, damping = _zeros((spring.stiffness, spring.damping))
    entry = {"stiffness": stiffness, "damping": damping}
    if spring.torsional_at is not None:
        return entry | {"torsional_at": spring.torsional_at, "angle": _zeros((spring.angle,))[0]}
    return entry | {"between": [str(end) for end in spring.ends], "length": _zeros((spring.length,))[0]}


def _contact(contact: Contact) -> dict[str, Any]:
    entry: dict[str, Any] = {"kind": contact.kind, "between": [str(side) for side in contact.sides]}
    if contact.kind in ("point-line", "angle"):
        entry["direction"] = _direction(contact.direction)
    if contact.corner:
        entry["corner"] = contact.corner
    return entry


def _zeros(numbers: tuple[float, ...]) -> list[Any]:
    return [0 if number == 0 else ANY for number in numbers]


def _direction(direction: tuple[float, float]) -> list[Any]:
    return [int(component) if component in (0, 1, -1) else ANY for component in direction]


def number_at(scene: Scene, path: str) -> float:
    """Number of the scene at a path TABLE.OWNER.NAME, or gravity.AXIS, in SI."""
    table, owner, name = (*path.split(".", 2), "")[:3]
    if table == "gravity":
        return scene.gravity["xy".index(owner)]
    if table == "ground":
        return scene.ground[owner]["xy".index(name)]
    if table == "bodies":
        return _of_body(scene.bodies[owner], name)
    entry = getattr(scene, table)[owner]
    if name.startswith("direction_"):
        return entry.direction["xy".index(name[-1])]
    if table == "contacts":
        return entry.number(name)
    if table == "drives" and name in ("angle", "position"):
        return entry.start
    if table == "joints" and name == "branch":
        return 1.0 if entry.branch == "+" else -1.0
    if table == "loads" and name.startswith("profile_"):
        return entry.profile[name == "profile_end"]
    return getattr(entry, name)


def _of_body(body: Body, name: str) -> float:
    field, _, inner = name.partition(".")
    if field == "points":
        point, _, axis = inner.partition(".")
        return body.points_all[point]["xy".index(axis)]
    if field == "element":
        return body.first_element[inner]
    if field.startswith("pose_"):
        assert body.pose is not None  # each body of a fixed frame has a pose
        return body.pose.angle if field == "pose_angle" else body.pose.at["xy".index(field[-1])]
    if field.startswith("centre_"):
        return body.centre["xy".index(field[-1])]
    return getattr(body, field)
