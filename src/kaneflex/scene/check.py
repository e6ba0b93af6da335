"""Checks between the tables of a scene: names, addresses and references."""

from __future__ import annotations

import keyword
import math
from collections.abc import Callable, Iterable, Iterator, Mapping

from kaneflex.scene.bodies import Body
from kaneflex.scene.load_check import (
    Rule,
    address_problems,
    broken,
    drive_problems,
    event_problems,
    given,
    is_tuple,
    load_problems,
    spring_problems,
)  # fmt: skip
from kaneflex.scene.parts import IN_THE_PLANE, SEVERAL_FREEDOMS, Joint
from kaneflex.scene.quantities import RESERVED_NAMES, RESULT_NAMES, Address
from kaneflex.scene.scene import Scene, given_value, given_vectors
from kaneflex.scene.sensors import (
    CONTACT_KINDS,
    DRIVE_KINDS,
    FLANK_KINDS,
    FRICTION_KINDS,
    MOTION_KINDS,
    POINT_KINDS,
    RIGID_COMPANIONS,
    SPRING_KINDS,
    Sensor,
)  # fmt: skip
from kaneflex.support.errors import LONGEST_NAME, Problem, nearest, taken, unknown


def problems_of(scene: Scene) -> list[Problem]:
    """Problems between the tables of a scene, in the file's order."""
    flat = _dimension_problems(scene)
    if flat:
        return flat
    whole = scene.with_clearances()
    if not whole.contacts:
        return _problems(scene) or list(_periods(scene))
    from kaneflex.scene.contact_check import clearance_problems, contact_problems, tilt_problems

    loose = list(clearance_problems(scene))
    known = {problem.key for problem in loose}
    found = _problems(whole, contact_problems) or [*_periods(whole), *tilt_problems(whole)]
    return loose + [problem for problem in found if problem.key not in known]


def _dimension_problems(scene: Scene) -> list[Problem]:
    """Problems of mixed vectors with two and three components, and of entries of the other kind of scene."""
    vectors = list(given_vectors(scene))
    flat, deep = ([key for key, value in vectors if len(value) == count] for count in (2, 3))
    if flat and deep:
        rare, usual = (deep, flat) if len(deep) <= len(flat) else (flat, deep)
        own, others = ("three", "two") if rare is deep else ("two", "three")
        reason = f"{own} components, where {usual[0]} has {others}"
        cure = "Give all vectors of a scene three components in space, two in the plane"
        return [Problem(rare[0], given_value(scene.raw, rare[0].split(".")), reason, cure)]
    if scene.is_spatial:
        from kaneflex.scene.spatial_check import spatial_problems

        return spatial_problems(scene)
    return list(_spatial_only(scene))


_CURE = "Give vectors three components, or leave it out"
_SPATIAL_ONLY: tuple[Rule, ...] = (
    ("bodies", "inertia", is_tuple, "a planar body turns about one axis", _CURE),
    ("bodies", "rotation", given, "joints give the angles of planar bodies", _CURE),
    ("bodies", "free.angular_velocity", given, "it turns about one axis", "Give angular_speed"),
    ("masses", "inertia", is_tuple, "a planar body turns about one axis", _CURE),
    *(("joints", kind, given, "a planar scene has no such joint", _CURE) for kind in SEVERAL_FREEDOMS),
    *(("joints", axis, given, "planar joints turn about the plane's normal", _CURE) for axis in ("axis", "axes")),
    ("springs", "bushing", given, "only scenes in space have bushings", IN_THE_PLANE),
    ("drives", "angular_velocity", given, "a planar joint has one speed", "Give initial_speed"),
    ("drives", "initial_speeds", given, "a planar joint has one speed", "Give initial_speed"),
    ("contacts", "point_on_plane", given, "planar bodies touch along lines and circles",
     "Use point_on_line in a planar scene"),
    ("sensors", "torsional_moment", given, "planar beams don't twist", "Leave it out"),
    ("sensors", "fibre", is_tuple, "a planar beam bends in one plane", "Give its height above the axis"),
    ("sensors", "component", ("z", "angle_x", "angle_y", "angle_z").__contains__,
     "a planar scene has no such component", "Write x, y or angle, or give vectors three components"),
)  # fmt: skip
"""Entries that only scenes in space have."""


def _spatial_only(scene: Scene) -> Iterator[Problem]:
    """Problems of entries that only spatial scenes have."""
    yield from broken(scene, _SPATIAL_ONLY)
    for name, body in scene.bodies.items():
        if body.modal is not None and body.modal.dimension == 3:
            cure = "Give vectors three components, or import the body without --space"
            yield Problem(f"bodies.{name}.modal_data", body.modal_data, "the file describes a body in space", cure)
        for part, sectioned in {} if body.beam is None else body.beam.sections.items():
            if sectioned.J is not None:
                cure = "Give I, or give vectors three components"
                yield Problem(f"bodies.{name}.{part}.J", sectioned.J, "planar beams don't twist", cure)
    for name, sensor in scene.sensors.items():
        if sensor.kind in ("shear_force", "bending_moment") and "component" in sensor.model_fields_set:
            yield Problem(f"sensors.{name}.component", sensor.component, "planar beams need none", "Leave it out")


_MOST_GRAVITY = 1e15
"""Largest acceleration of gravity [m/s^2], a thousand times a neutron star's; no integration step resolves more."""


def _gravity(scene: Scene) -> Iterator[Problem]:
    if math.hypot(*scene.gravity) > _MOST_GRAVITY:
        reason = f"beyond {_MOST_GRAVITY:g} m/s^2 the motion can't be integrated"
        yield Problem("gravity", given_value(scene.raw, ("gravity",)), reason, "Write it like [0, '-9.81 m/s^2']")


def _problems(scene: Scene, *more: Callable[[Scene], Iterable[Problem]]) -> list[Problem]:
    """Problems of the scene with contacts in place of its joints with clearance; ``more``: checks of these."""
    checks = (_gravity, _names, _addresses, lambda of: _beams(of.bodies, of.joints), _branches, _poses, drive_problems,
              load_problems, spring_problems, *more, _sensors, event_problems, _modal, _horizon)  # fmt: skip
    return [problem for check in checks for problem in check(scene)]


def _names(scene: Scene) -> Iterator[Problem]:
    tables = ("ground", "bodies", "joints", "masses", "drives", "loads", "springs", "contacts", "sensors", "events")
    for table in tables:
        for name in getattr(scene, table):
            key = f"{table}.{name}"
            reserved = RESULT_NAMES if table == "sensors" else RESERVED_NAMES
            if keyword.iskeyword(name):
                yield taken(key, "a keyword of Python, which generated modules can't use")
            elif not name.isidentifier() or not name.isascii():
                yield Problem(key, None, "not a name", "Use letters, digits and underscores, a letter first")
            elif len(name) > LONGEST_NAME:
                reason = f"a name of more than {LONGEST_NAME} characters"
                yield Problem(key[:LONGEST_NAME], None, reason, "Choose a shorter one")
            elif name in reserved:
                yield taken(key, f"a reserved name: {reserved[name]}")
    if scene.contacts or scene.frictions:
        from kaneflex.scene.contact_check import result_problems

        yield from result_problems(scene)
    yield from (taken(f"joints.{name}", "a body has the same name") for name in scene.joints if name in scene.bodies)
    tables = ("bodies", "joints", "masses", "loads", "springs")
    for own, others in {"springs": tables[:4], "contacts": tables}.items():
        for name in getattr(scene, own):
            yield from (taken(f"{own}.{name}", f"{table} has an entry of this name")
                        for table in others if name in getattr(scene, table))  # fmt: skip
    for name, body in scene.bodies.items():
        for point in body.points:
            if not point.isidentifier():
                key = f"bodies.{name}.points.{point}"
                yield Problem(key, None, "not a name", "Use letters, digits and underscores")


def _beams(bodies: Mapping[str, Body], joints: Mapping[str, Joint]) -> Iterator[Problem]:
    """An axially rigid beam may be joined at one point only: its length would couple the joints' displacements."""
    for name, body in bodies.items():
        if body.elastic and body.beam.axially_rigid:
            addresses = [address for joint in joints.values() for address in joint.addresses]
            held = sorted({address.point for address in addresses if address.body == name})
            if len(held) > 1:
                reason = f"the fixed length of {name} would couple the displacements of the joints at {', '.join(held)}"
                cure = "Leave axially_rigid out, or join the beam at one point only"
                yield Problem(f"bodies.{name}.beam.axially_rigid", True, reason, cure)


def _addresses(scene: Scene) -> Iterator[Problem]:
    """Problems of points at which joints, springs, contacts, loads and masses act."""
    for key, address in dict.fromkeys(scene.acting):
        yield from address_problems(scene, key, address, ground=not key.startswith(("loads.", "masses.")))


def _branches(scene: Scene) -> Iterator[Problem]:
    joined = {side.body for joint in scene.joints.values() for side in joint.addresses}
    closing = scene.loop_joints() if joined <= {"ground", *scene.bodies} else tuple(scene.joints)
    for name, joint in scene.joints.items():
        if "branch" in joint.model_fields_set and name not in closing:
            yield Problem(f"joints.{name}.branch", joint.branch, *_no_loop(scene.bodies, scene.joints, closing))


def _no_loop(
    bodies: Mapping[str, Body], joints: Mapping[str, Joint], closing: tuple[str, ...]
) -> tuple[str, str]:
    """Reason why a joint closes no loop, and what to do: the joints that close one, or bodies with one joint only."""
    if closing:
        return "this joint closes no loop", f"Give branch at {', '.join(closing)}"
    sides = {name: {side.body for side in joint.addresses} for name, joint in joints.items()}
    held = {name: [joint for joint, joined in sides.items() if name in joined] for name in bodies}
    hanging = [f"{name} has {f'only joint {at[0]}' if at else 'no joint'}" for name, at in held.items() if len(at) < 2]
    if not hanging:
        return "this joint closes no loop", "Leave branch out"
    free = [f'"{_free_point(bodies[name], name, joints)}"' for name, at in held.items() if len(at) < 2]
    missing = f", like pin = {{revolute = [{', '.join(free)}]}}" if len(free) == 2 else ""
    return f"no loop is closed: {', '.join(hanging)}", f"Add the missing joint{missing}, or leave branch out"


def _free_point(body: Body, name: str, joints: Mapping[str, Joint]) -> str:
    """Free end of a body, without a joint."""
    if body.length is None:
        return name
    used = {str(side) for joint in joints.values() for side in joint.addresses}
    return f"{name}.end" if f"{name}.start" in used else f"{name}.start"


def _poses(scene: Scene) -> Iterator[Problem]:
    """A fixed structure needs the pose of every body, and no drive."""
    still = "bodies with poses don't move"
    for name, body in scene.bodies.items() if scene.is_frame else ():
        if body.pose is None:
            yield Problem(f"bodies.{name}.pose", None, "other bodies have poses, this one has none", "Give its pose")
        if body.free is not None:
            yield Problem(f"bodies.{name}.free", None, still, "Leave free or the poses out")
    for name in scene.drives if scene.is_frame else ():
        yield Problem(f"drives.{name}", None, still, "Leave out either the drive or the poses")


def _modal(scene: Scene) -> Iterator[Problem]:
    if any(body.modal_data is not None for body in scene.bodies.values()):
        from kaneflex.scene.modal_check import modal_problems

        yield from modal_problems(scene)


def _sensors(scene: Scene) -> Iterator[Problem]:
    for name, sensor in scene.sensors.items():
        key = f"sensors.{name}"
        check, table, noun = _OF_SENSORS[sensor.kind]
        if table and str(sensor.target) not in (known := getattr(scene, table)):
            yield unknown(f"{key}.{sensor.kind}", str(sensor.target), noun, known)
        else:
            yield from check(scene, key, sensor)
        base = name.removesuffix("_rigid")
        if base != name and base in scene.sensors and scene.sensors[base].kind in RIGID_COMPANIONS:
            yield taken(key, f"the value of {base} in the rigid mechanism has this name")


def _point_sensor(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    address = sensor.target
    assert isinstance(address, Address)
    if sensor.kind == "position" and address.body in scene.loose and address.point == "start":
        return
    if (joint := scene.joint_read(sensor)) is not None:
        kind = scene.joints[joint].kind
        components = ["x", "angle"] if kind == "cylindrical" else ["x"] if kind == "prismatic" else ["angle"]
        if sensor.component not in components:
            cure = f"Give {' or '.join(map(repr, components))}"
            yield Problem(f"{key}.component", sensor.component, "not a coordinate of this joint", cure)
        return
    if address.body in scene.joints and address.body not in scene.bodies and sensor.kind in MOTION_KINDS:
        reason = f"a joint has no {sensor.kind}"
        cure = f"Read the position of {address.body}, or the {sensor.kind} of a body's point"
        yield Problem(f"{key}.{sensor.kind}", address.body, reason, cure)
        return
    yield from address_problems(scene, f"{key}.{sensor.kind}", address, ground=False)
    body = scene.bodies.get(address.body)
    if body is None:
        return
    if "cut" in sensor.model_fields_set and address.point in ("start", "end"):
        yield Problem(f"{key}.cut", sensor.cut, f"the {address.point} has a section on one side only", "Leave cut out")
    if "cut" in sensor.model_fields_set and body.modal is not None:
        yield Problem(f"{key}.cut", sensor.cut, f"{address.body} gets its sections from modal data", "Leave cut out")
    if body.elastic:
        return
    if sensor.kind not in MOTION_KINDS:
        if body.modal is not None:
            from kaneflex.scene.modal_check import section_problems

            yield from section_problems(scene, f"{key}.{sensor.kind}", sensor, body.modal)
        else:
            yield Problem(f"{key}.{sensor.kind}", str(address), f"{address.body} is rigid", "Give the body a beam")
    if sensor.relative_to == "chord" and body.length is None:
        yield Problem(f"{key}.relative_to", "chord", f"{address.body} has no length", "Give the body a length")


def _stress_sensor(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    from kaneflex.scene.modal_check import stress_problems

    return stress_problems(scene, key, sensor)


def _drive_sensor(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    target = str(sensor.target)
    if scene.is_spatial and scene.drives[target].free:
        reason = f"a free joint has no drive force: drives.{target} is free"
        yield Problem(f"{key}.{sensor.kind}", target, reason, "Measure joint_force, or the load that moves it")
    elif target in scene.joints:
        slides = scene.slides(target)
        what = f"that joint {'slides' if slides else 'turns'}"
        yield from _suits(key, sensor, "drive_force" if slides else "drive_torque", what)


def _spring_sensor(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    spring = scene.springs[str(sensor.target)]
    if spring.bushing is None:
        right, kind = ("spring_torque", "torsional") if spring.torsional_at else ("spring_force", "linear")
        yield from _suits(key, sensor, right, f"a {kind} spring has no {sensor.kind}")
        if sensor.kind == right and "component" in sensor.model_fields_set:
            yield Problem(f"{key}.component", sensor.component, "only a bushing has components", "Leave it out")
    elif sensor.component not in ("x", "y", "z"):
        reason = "a bushing acts along and about x, y, z of its first body"
        yield Problem(f"{key}.component", sensor.component, reason, "Give x, y or z")


def _contact_sensor(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    pairs, flank = [("contact_force", "contact_gap"), FLANK_KINDS], scene.contacts[str(sensor.target)].kind == "angle"
    right = pairs[flank][any(sensor.kind == second for _, second in pairs)]
    yield from _suits(key, sensor, right, "a flank has a torque and an angle" if flank else "it has a force and a gap")


def _friction_sensor(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    target, known = str(sensor.target), scene.frictions
    if target not in known:
        cure = nearest(target, known) if known else "Give a joint or a contact friction"
        yield Problem(f"{key}.{sensor.kind}", target, "no joint or contact of that name has friction", cure)
        return
    kind = "torque" if scene.turns_at(target) else "force"
    yield from _suits(key, sensor, f"friction_{kind}", f"the friction there is a {kind}")


def _suits(key: str, sensor: Sensor, right: str, reason: str) -> Iterator[Problem]:
    """Problem of a sensor whose target only has another kind of quantity."""
    if sensor.kind != right:
        yield Problem(f"{key}.{sensor.kind}", str(sensor.target), reason, f"Write {right}")


def _joint_sensor(scene: Scene, key: str, sensor: Sensor) -> Iterator[Problem]:
    target = str(sensor.target)
    bodies = [address.body for address in scene.joints[target].addresses]
    if sensor.body is not None and sensor.body not in bodies:
        yield Problem(f"{key}.body", sensor.body, f"{target} joins {' and '.join(bodies)}", "Name one of them")


_OF_SENSORS: dict[str, tuple[Callable[[Scene, str, Sensor], Iterator[Problem]], str, str]] = {
    **dict.fromkeys(POINT_KINDS, (_point_sensor, "", "")), "stress": (_stress_sensor, "", ""),
    **dict.fromkeys(DRIVE_KINDS, (_drive_sensor, "drives", "drive")),
    **dict.fromkeys(SPRING_KINDS, (_spring_sensor, "springs", "spring")),
    **dict.fromkeys(CONTACT_KINDS, (_contact_sensor, "contacts", "contact")),
    **dict.fromkeys(FRICTION_KINDS, (_friction_sensor, "", "")), "joint_force": (_joint_sensor, "joints", "joint"),
}  # fmt: skip
"""Check of a sensor by its kind; table that has its target, and what that is."""


def _horizon(scene: Scene) -> Iterator[Problem]:
    if scene.period is None and scene.solve.duration is None:
        reason = "no rotating drive has a cycle, and solve.duration is missing"
        cure = "Give solve.duration, or a cycle to the drive"
        if not scene.drives:
            reason = "the scene has no drive and no duration"
            cure = "Give a drive, like drives.main = {speed = '1500 rpm', cycle = '360 deg'}, or solve.duration"
        yield Problem("solve.duration", None, reason, cure)
    if scene.solve.start == "periodic" and scene.period is None:
        yield Problem("solve.start", "periodic", "no rotating drive has a cycle", "Give the drive a cycle")
    for name, drive in scene.drives.items():
        if drive.period is None:
            continue
        key = f"drives.{name}.{'cycle' if drive.cycle else 'period'}"
        cycle = given_value(scene.raw, key.split("."))
        if drive.cycle and not _is_multiple(drive.cycle, math.tau):
            reason = "the mechanism repeats only after whole turns"
            plain = "" if isinstance(cycle, str) else "; plain numbers are in rad"
            yield Problem(key, cycle, reason, f"Give a multiple of 360 deg{plain}")
        if not math.isclose(drive.period, scene.period, rel_tol=1e-9):
            reason = f"this cycle takes {drive.period:.6g} s, another drive's {scene.period:.6g} s"
            yield Problem(key, cycle, reason, "Give cycles that take the same time")


def _periods(scene: Scene) -> Iterator[Problem]:
    """A periodic start requires every table to repeat in a cycle."""
    if scene.solve.start != "periodic" or scene.period is None:
        return
    for name, load in scene.loads.items():
        turned = load.against in scene.drives and not scene.slides(load.against)
        if load.kind != "table" or not (load.against == "t" or turned):
            continue  # a guide's coordinate and a speed are periodic anyway
        key, speed = f"loads.{name}.period", 1.0 if load.against == "t" else scene.drives[load.against].speed
        if load.period is None:
            yield Problem(key, None, "a periodic start needs periodic tables", "Give the table's period")
        elif speed is not None and not _is_multiple(scene.period * abs(speed), load.period):
            reason = "the cycle is not a multiple of it, so there is no common period"
            yield Problem(key, given_value(scene.raw, key.split(".")), reason, "Give a period that divides the cycle")


def _is_multiple(whole: float, part: float) -> bool:
    count = round(whole / part)
    return count >= 1 and math.isclose(count * part, whole, rel_tol=1e-9)
