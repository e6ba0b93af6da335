"""Checks of drives, loads, springs and events with other tables: addresses, names and laws."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from kaneflex.scene.bodies import Body
from kaneflex.scene.parts import Joint
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene, given_value
from kaneflex.scene.tables import abscissae
from kaneflex.support.errors import Fault, Problem, nearest, unknown
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension, to_si

_STILL = ("prismatic", "weld")
"""Joints without rotation."""


def address_problems(scene: Scene, key: str, address: Address, ground: bool) -> Iterator[Problem]:
    """Problems of an address of a body's point, or of a fixed point if `ground` is allowed."""
    if address.body == "ground":
        if not ground:
            yield Problem(key, str(address), "the ground does not move", "Name a point of a body")
        elif address.point != "origin" and address.point not in scene.ground:
            cure = nearest(address.point, ["origin", *scene.ground])
            yield Problem(key, str(address), "no such fixed point", cure)
    elif address.body not in scene.bodies:
        cure = nearest(address.body, [*scene.bodies, *(["ground"] if ground else [])])
        yield Problem(key, str(address), f"there is no body {address.body!r}", cure)
    elif address.point not in scene.bodies[address.body].points_all:
        cure = nearest(address.point, scene.bodies[address.body].points_all)
        yield Problem(key, str(address), f"{address.body} has no point {address.point!r}", cure)


Rule = tuple[str, str, Callable[[Any], bool], str, str]
"""Table and field of its entries, a test of the values that are given there, reason and advice of a problem."""


def broken(scene: Scene, rules: Iterable[Rule]) -> Iterator[Problem]:
    """Problems of given entries by some rules; a field with a dot lies in a table of the entry."""
    for table, path, applies, reason, cure in rules:
        inner, _, field = path.rpartition(".")
        for name, entry in getattr(scene, table).items():
            owner = getattr(entry, inner) if inner else entry
            if owner is not None and field in owner.model_fields_set and applies(getattr(owner, field)):
                key = (table, name, *path.split("."))
                yield Problem(".".join(key), given_value(scene.raw, key), reason, cure)


def given(value: object) -> bool:
    """True for every value that is given."""
    return value is not None


def is_tuple(value: object) -> bool:
    return isinstance(value, tuple)


def load_problems(scene: Scene) -> Iterator[Problem]:
    for name, load in scene.loads.items():
        if load.spread_on is not None:
            yield from _distributed(scene.bodies, f"loads.{name}.spread_on", load.spread_on)
        if load.torque_at is not None:
            turning = ("revolute", "cylindrical") if scene.is_spatial else ("revolute",)
            yield from _turning(scene.joints, f"loads.{name}.torque_at", load.torque_at, turning)
        if load.against not in (None, *scene.law_names()):
            yield unknown(f"loads.{name}.against", load.against, "joint or speed", scene.law_names())
            continue
        try:
            if load.kind == "table":
                yield from _abscissa(scene, name)
            elif load.kind == "law":
                from kaneflex.scene.law_check import check_load_law

                check_load_law(scene, load)
        except Fault as fault:
            field = fault.below or load.kind
            yield Problem(f"loads.{name}.{field}", getattr(load, field), fault.reason, fault.cure)


def _abscissa(scene: Scene, name: str) -> Iterator[Problem]:
    """Problems of a table, its offset and its period, whose dimension must fit a rotating or a sliding joint.
    """
    load = scene.loads[name]
    assert load.against is not None and load.table is not None
    joint = load.against.removesuffix("_speed")
    measured = load.read_table().x_dimension
    if load.against in scene.joints and joint != load.against:
        reason = f"{load.against} is both a joint and the speed of joint {joint}"
        yield Problem(f"loads.{name}.against", load.against, reason, "Give the joint another name")
    if joint not in scene.joints:
        return
    slides = scene.slides(joint)
    dimension = abscissae(load.against)[slides]
    kind = "a guide slides" if slides else f"a {scene.joints[joint].kind} joint turns"
    if measured is not dimension:
        reason = f"{kind}; the first column of {Path(load.table).name} is {measured.name}"
        cure = f"Write its unit in the heading, like '{load.against} ({dimension.unit})'"
        yield Problem(f"loads.{name}.table", load.table, reason, cure)
    for field in ("offset", "period"):
        yield from of_the_joint(scene.raw, ("loads", name, field), kind, dimension)


def _distributed(bodies: Mapping[str, Body], key: str, body: str) -> Iterator[Problem]:
    if body not in bodies:
        yield unknown(key, body, "body", bodies)
    elif bodies[body].length is None:
        yield Problem(key, body, f"{body} has no length for a distributed load", "Give the body a length")
    elif bodies[body].modal_data is not None:
        reason = f"the modal data of {body} contain only its points, not the line between them"
        yield Problem(key, body, reason, "Apply forces at its points, or give the body a beam")


def spring_problems(scene: Scene) -> Iterator[Problem]:
    held = {name: joint for name, joint in scene.joints.items() if joint.kind not in ("prismatic", "cylindrical")}
    together = {frozenset(map(str, joint.addresses)): name for name, joint in held.items()
                if joint.clearance is None or joint.has_backlash}  # fmt: skip
    for name, spring in scene.springs.items():
        key, kind = f"springs.{name}", "bushing" if spring.bushing else "between"
        for end in spring.ends:
            body = scene.bodies.get(end.body)
            if body is not None and body.elastic and body.beam.axially_rigid:
                cure = "Leave axially_rigid out, or attach the spring elsewhere"
                yield Problem(f"{key}.{kind}", str(end), f"{end.body} is axially rigid", cure)
        held = together.get(frozenset(map(str, spring.between or ())))
        if held is not None and (spring.length or spring.damping):
            reason = f"joint {held} keeps its points together, so forces by length or damping have no direction"
            cure = "Move one of the points, give only stiffness, or write torsional_at for a torsional spring"
            yield Problem(f"{key}.between", [*map(str, spring.ends)], reason, cure)
        if spring.torsional_at is not None:
            yield from _turning(scene.joints, f"{key}.torsional_at", spring.torsional_at, ("revolute",))


def _turning(joints: Mapping[str, Joint], key: str, name: str, kinds: Sequence[str]) -> Iterator[Problem]:
    """Problems of the name of a joint that must be of some kinds, to have one rotation."""
    if name not in joints:
        yield unknown(key, name, "joint", joints)
    elif (kind := joints[name].kind) not in kinds:
        reason = f"a {kind} joint {'does not turn' if kind in _STILL else 'turns about several axes'}"
        yield Problem(key, name, reason, f"Name a {' or a '.join(kinds)} joint")


def event_problems(scene: Scene) -> Iterator[Problem]:
    for name, event in scene.events.items():
        if event.sensor not in scene.sensors:
            yield unknown(f"events.{name}.sensor", event.sensor, "sensor", scene.sensors)
            continue
        try:
            scene.level(event)
        except Fault as fault:
            yield Problem(f"events.{name}.value", event.value, fault.reason, fault.cure)


_SPEEDS = {
    "cylindrical": (("along its axis", SPEED), ("a rotation", ANGULAR_SPEED)),
    "universal": (("about its first axis", ANGULAR_SPEED), ("a rotation", ANGULAR_SPEED)),
}
"""Motion of the two speeds of joints that have two."""


def drive_problems(scene: Scene) -> Iterator[Problem]:
    """Problems of the drives: their joints, and quantities that do not fit their joints."""
    for name in scene.drives:
        if name not in scene.joints:
            yield Problem(f"drives.{name}", None, "no joint of that name to drive", nearest(name, scene.joints))
        elif name.removesuffix("_speed") in scene.drives and name.endswith("_speed"):
            reason = "laws use this name for the speed of another drive"
            yield Problem(f"drives.{name}", None, reason, "Choose another name for the joint")
        elif scene.joints[name].kind == "weld":
            yield Problem(f"drives.{name}", None, "a weld does not move", "Drive a revolute or a prismatic joint")
        else:
            yield from _drive_quantities(scene, name)
        drive = scene.drives[name]
        try:
            if drive.kind == "law":
                from kaneflex.scene.law_check import check_drive_law

                check_drive_law(drive, scene.horizon)
            elif drive.kind == "table":
                measured = drive.read_table().dimension
                if name in scene.joints and (measured is LENGTH) != scene.slides(name):
                    kind = "a guide slides" if scene.slides(name) else "a revolute joint turns"
                    right = "length, like unit = 'mm'" if scene.slides(name) else "angle, like unit = 'deg'"
                    cure = f"Give a unit of {right}, or write it in the column's heading"
                    raise Fault(f"{kind}; the table contains {measured.name}", cure, below="unit")
        except Fault as fault:
            field = fault.below or drive.kind
            yield Problem(f"drives.{name}.{field}", getattr(drive, field), fault.reason, fault.cure)


def _drive_quantities(scene: Scene, name: str) -> Iterator[Problem]:
    """Problems of a drive's quantities, which must fit its rotating or sliding joint."""
    drive, slides, given = scene.drives[name], scene.slides(name), scene.raw["drives"][name]
    wrong, right = ("angle", "position") if slides else ("position", "angle")
    kind = "a guide slides" if slides else "a revolute joint turns"
    if wrong in drive.model_fields_set:
        yield Problem(f"drives.{name}.{wrong}", given[wrong], kind, f"Give {right}")
    if slides and drive.cycle is not None:
        reason, cure = "a guide at constant speed has no cycle", "Leave it out, or give a law with its period"
        yield Problem(f"drives.{name}.cycle", given["cycle"], reason, cure)
    for field in ("speed", "initial_speed"):
        yield from of_the_joint(scene.raw, ("drives", name, field), kind, SPEED if slides else ANGULAR_SPEED)
    joint = scene.joints[name].kind
    for k, (moves, dimension) in enumerate(_SPEEDS.get(joint, ()) if drive.initial_speeds is not None else ()):
        reason = f"the {('first', 'second')[k]} speed of a {joint} joint is {moves}"
        yield from of_the_joint(scene.raw, ("drives", name, "initial_speeds", str(k)), reason, dimension)
    if name == next(iter(scene.drives)):
        yield from of_the_joint(scene.raw, ("solve", "mode_angle"), kind, LENGTH if slides else ANGLE)


def of_the_joint(raw: Mapping[str, Any], path: tuple[str, ...], kind: str, dimension: Dimension) -> Iterator[Problem]:
    """Quantity of a joint that rotates or slides, converted now that the joint is known."""
    given = given_value(raw, path)
    try:
        if given is not None:
            to_si(given, dimension)
    except Fault as fault:
        yield Problem(".".join(path), given, f"{kind}; {fault.reason}", fault.cure)
