"""Checks of spatial scenes, and of entries that only planar scenes have."""

from __future__ import annotations

import math
from collections.abc import Iterator

from kaneflex.scene.load_check import Rule, broken, given, is_tuple
from kaneflex.scene.parts import SEVERAL_FREEDOMS, START_SPEEDS
from kaneflex.scene.scene import Scene
from kaneflex.support.errors import Fault, Problem, taken

_ALONG = math.cos(math.radians(10.0))
"""Smallest cosine of the angle to a body's x axis at which a sliding direction is along the body."""
_SO_FAR = "only planar scenes have this so far"


def _is_number(value: object) -> bool:
    return bool(value) and not is_tuple(value)


_PLANAR_ONLY: tuple[Rule, ...] = (
    ("bodies", "pose", given, _SO_FAR, "Leave it out"),
    *(("joints", field, given, _SO_FAR, "Give the bodies' rotation instead")
      for field in ("branch", "near", "relative_angle")),
    ("contacts", "point_on_line", given, _SO_FAR, "Use point_on_plane in a scene in space"),
    ("contacts", "width", given, "only planar cylinders have a width so far", "Leave it out: circles are spheres"),
    ("bodies", "free.angle", given, "only planar bodies have it", "Give the body's rotation"),
    ("bodies", "free.angular_speed", given, "only planar bodies have it", "Give angular_velocity"),
    *((table, "inertia", test, "a body in space has three principal moments of inertia", "Give [J_x, J_y, J_z]")
      for table, test in (("bodies", lambda value: not is_tuple(value)), ("masses", _is_number))),
    ("bodies", "beam.axially_rigid", bool, "only planar beams support this so far", "Leave it out"),
    ("sensors", "fibre", lambda value: not is_tuple(value), "a fibre in space needs y and z of the section",
     "Give both, like ['10 mm', 0]"),
    ("events", "sensor", given, _SO_FAR, "Leave the event out"),
)  # fmt: skip
"""Entries that only planar scenes support."""


def spatial_problems(scene: Scene) -> list[Problem]:
    """Problems of a spatial scene that a planar one can't have."""
    parts = lambda of: broken(of, _PLANAR_ONLY), _planar_only, _joints, _laws, _beams, _drives, _sensors
    return [problem for part in parts for problem in part(scene)]


def _planar_only(scene: Scene) -> Iterator[Problem]:
    """Further problems of entries that only planar scenes support so far."""
    for name, body in scene.bodies.items():
        if body.modal is not None and body.modal.dimension != 3:
            right = "Import its finite elements with --space, or export it from a scene in space"
            yield Problem(f"bodies.{name}.modal_data", body.modal_data, "the file describes a planar link", right)
    for name in scene.joints:
        yield from _friction(scene, name)
    for name, contact in scene.with_clearances().contacts.items():
        if contact.friction is not None and contact.friction.law == "lugre":
            key, reason = f"{contact.table_key(name)}.friction.law", "in space contacts don't have this law so far"
            yield Problem(key, "lugre", reason, "Use coulomb or stribeck")
        base = scene.bodies.get(contact.sides[0].body)
        if contact.joint is None and contact.kind == "point-plane" and base is not None and base.deforms:
            right = "Weld a rigid body to it that has the plane"
            yield Problem(contact.entry(name), str(contact.sides[0]), "the plane's body deforms", right)
    for name in scene.masses:
        for table in ("bodies", "joints", "loads"):
            if name in getattr(scene, table):
                yield taken(f"masses.{name}", f"{table} has an entry of this name")
    if scene.solve.preset == "paper":
        cure = "Choose rigid, quasistatic, linear, stiffened or coupled"
        yield Problem("solve.preset", scene.solve.preset, "only planar scenes have this preset so far", cure)


def _friction(scene: Scene, name: str) -> Iterator[Problem]:
    """Problems of friction in space: its joint closes a loop, so nothing else may need its coordinate."""
    joint = scene.joints[name]
    if joint.friction is None:
        return
    key, drive = f"joints.{name}.friction", scene.drives.get(name)
    if joint.kind not in ("revolute", "prismatic"):
        yield Problem(key, None, f"a {joint.kind} joint has none in space so far", "Leave it out")
    elif drive is not None and drive.kind != "free":
        yield Problem(key, None, "in space its drive prescribes the motion of the joint", "Make the drive free")
    elif joint.has_backlash or any(spring.torsional_at == name for spring in scene.springs.values()):
        reason = "in space a joint with a torsional spring or backlash has none so far"
        yield Problem(key, None, reason, "Leave it out, or add a joint")


def _laws(scene: Scene) -> Iterator[Problem]:
    """Problems of laws of loads in space: they must use joints with one coordinate."""
    several = [name for name, joint in scene.joints.items() if joint.kind in SEVERAL_FREEDOMS]
    rubbing = [name for name, joint in scene.joints.items() if joint.friction is not None]
    for name, load in scene.loads.items():
        try:
            law = scene.argument(name)
        except Fault:
            continue  # reported by the check of loads
        key, given = f"loads.{name}.{'law' if load.law else 'against'}", load.law or load.against
        if law is not None and law.uses_any(several):
            known = next(joint for joint in several if law.uses_any([joint]))
            reason = f"{known} has several degrees of freedom, so no single coordinate"
            yield Problem(key, given, reason, "Use a joint with one coordinate, or t")
        elif law is not None and law.uses_any(rubbing):
            reason = "in space laws can't use the coordinate of a joint with friction so far"
            yield Problem(key, given, reason, "Use another joint, or t")


def _joints(scene: Scene) -> Iterator[Problem]:
    for name, joint in scene.joints.items():
        if joint.kind in ("revolute", "cylindrical") and joint.axis is None:
            reason = f"in space a {joint.kind} joint needs an axis"
            yield Problem(f"joints.{name}", None, reason, "Give it, like axis = [0, 0, 1]")
        elif joint.kind == "universal" and joint.axes is None:
            reason = "a universal joint needs two axes"
            yield Problem(f"joints.{name}", None, reason, "Give them, like axes = [[0, 1, 0], [0, 0, 1]]")
        rail = scene.bodies.get(joint.addresses[0].body)
        way = joint.direction or joint.axis
        slides = joint.kind in ("prismatic", "cylindrical") and scene.solve.preset != "rigid"
        along = way is not None and abs(way[0]) > _ALONG * math.hypot(*way)
        if slides and along and rail is not None and rail.deforms:
            reason = "the body is elastic, but its sliding line would stay straight"
            cure = "Swap the two addresses, so that the other body has the line, or weld a rigid slider to this one"
            yield Problem(f"joints.{name}.{joint.kind}", str(joint.addresses[0]), reason, cure)


def _beams(scene: Scene) -> Iterator[Problem]:
    """Problems of sections in space, which bend in two planes and twist."""
    for name, body in scene.bodies.items():
        if body.beam is None:
            continue
        if body.beam.shear and not body.beam.rotary:
            reason = "only planar beams support shear without rotary inertia so far"
            yield Problem(f"bodies.{name}.beam.theory", body.beam.theory, reason, "Use timoshenko")
        for part, sectioned in body.beam.sections.items():
            part_key, made_of = f"bodies.{name}.{part}", body.beam.made_of(sectioned)
            if sectioned.section is None and sectioned.J is None:
                cure = "Give section by its shape, or A, I_y, I_z and J"
                yield Problem(f"{part_key}.I", sectioned.I, "a beam in space bends about two axes and twists", cure)
            for field in ("A_end", "I_end"):
                if getattr(sectioned, field) is not None:
                    cure = "Give section and taper by their shapes"
                    yield Problem(f"{part_key}.{field}", getattr(sectioned, field), "only planar beams use it", cure)
            if made_of.G is None:
                yield Problem(part_key, None, "a beam in space twists, and needs a shear modulus", "Give nu or G")
        for by, at in scene.acting:
            off = at.body == name and at.point in body.points_all and any(scene.point(at)[1:])
            if off and by.startswith(("loads.", "springs.", "contacts.")):
                reason = f"{by.rpartition('.')[0]} acts off the axis of an elastic body"
                key = f"bodies.{name}.points.{at.point}"
                yield Problem(key, scene.point(at), reason, "Move the point onto the axis")


def _drives(scene: Scene) -> Iterator[Problem]:
    for name, drive in scene.drives.items():
        joint = scene.joints.get(name)
        if joint is None:
            continue
        if joint.kind in SEVERAL_FREEDOMS and drive.kind != "free":
            reason = f"a {joint.kind} joint has more than one degree of freedom"
            yield Problem(f"drives.{name}", None, reason, "Drive a revolute or a prismatic joint, or make it free")
        for field in ("angle", "position") if joint.kind in SEVERAL_FREEDOMS else ():
            if field in drive.model_fields_set:
                yield Problem(f"drives.{name}.{field}", None, "this joint has several coordinates", "Leave it out")
        right = START_SPEEDS.get(joint.kind, "initial_speed")
        for field in ("initial_speed", "initial_speeds", "angular_velocity"):
            if field != right and field in drive.model_fields_set:
                yield Problem(f"drives.{name}.{field}", None, f"this is a {joint.kind} joint", f"Give {right}")


def _sensors(scene: Scene) -> Iterator[Problem]:
    scene = scene.with_clearances()
    for name, sensor in scene.sensors.items():
        key = f"sensors.{name}"
        if sensor.kind in ("shear_force", "bending_moment") and sensor.component not in ("y", "z"):
            what = "bends about" if sensor.kind == "bending_moment" else "is sheared along"
            yield Problem(f"{key}.component", sensor.component, f"a link in space {what} its y or z", "Give y or z")
        elif sensor.component == "angle" and scene.joint_read(sensor) is None:
            yield Problem(f"{key}.component", "angle", "a rotation in space needs an axis", "Write it like angle_z")
        elif sensor.component.startswith("angle_") and sensor.kind == "position":
            cure = "Measure a velocity or an acceleration, or the position of a joint"
            yield Problem(f"{key}.component", sensor.component, "no single angle gives an orientation in space", cure)
        elif (joint := scene.joint_read(sensor)) is not None:
            kind = scene.joints[joint].kind
            if kind in ("universal", "spherical", "weld"):
                reason = f"a {kind} joint has no single coordinate to measure"
                yield Problem(f"{key}.{sensor.kind}", joint, reason, "Measure points of its bodies")


