"""Checks of spatial scenes, and of entries that only planar scenes have."""

from __future__ import annotations

import math
from collections.abc import Iterator

from kaneflex.scene.parts import SEVERAL_FREEDOMS, START_SPEEDS
from kaneflex.scene.scene import Scene, given_value
from kaneflex.support.errors import Fault, Problem, taken

_SENSORS = (
    "displacement", "position", "velocity", "acceleration", "axial_force", "shear_force", "bending_moment",
    "torsional_moment", "strain", "stress", "joint_force", "drive_torque", "drive_force", "spring_force",
    "spring_torque", "contact_force", "contact_gap", "contact_torque", "contact_angle",
    "friction_force", "friction_torque",
)  # fmt: skip


_NO_BRISTLES = "only planar scenes have this law so far"


_ALONG = math.cos(math.radians(10.0))
"""Smallest cosine of the angle to a body's x axis at which a sliding direction is along the body."""
def spatial_problems(scene: Scene) -> list[Problem]:
    """Problems of a spatial scene that a planar one can't have."""
    parts = _planar_only, _joints, _laws, _bodies, _beams, _drives, _sensors
    return [problem for part in parts for problem in part(scene)]


def _planar_only(scene: Scene) -> Iterator[Problem]:
    """Problems of entries that only planar scenes support so far."""
    reason, cure = "only planar scenes have this so far", "Leave it out"
    for name, body in scene.bodies.items():
        if body.pose is not None:
            yield Problem(f"bodies.{name}.pose", None, reason, cure)
        if body.modal is not None and body.modal.dimension != 3:
            right = "Import its finite elements with --space, or export it from a scene in space"
            yield Problem(f"bodies.{name}.modal_data", body.modal_data, "the file describes a planar link", right)
    for name, joint in scene.joints.items():
        yield from _friction(scene, name)
        for field in ("branch", "near", "relative_angle"):
            if field in joint.model_fields_set:
                right = "Give the bodies' rotation instead" if field in ("near", "branch", "relative_angle") else cure
                yield Problem(f"joints.{name}.{field}", None, reason, right)
    for name, contact in scene.with_clearances().contacts.items():
        if contact.joint is None and contact.kind == "point-line":
            yield Problem(contact.entry(name), None, reason, "Use point_on_plane in a scene in space")
        elif contact.joint is None and contact.width is not None:
            cure = "Leave it out: circles are spheres"
            yield Problem(f"contacts.{name}.width", contact.width, "only planar cylinders have a width so far", cure)
        elif contact.friction is not None and contact.friction.law == "lugre":
            yield Problem(f"{contact.stands(name)}.friction.law", "lugre", _NO_BRISTLES, "Use coulomb or stribeck")
        elif contact.law == "newton":
            right = "Give a contact stiffness with a law such as exact"
            yield Problem(f"{contact.stands(name)}.contact.law", contact.law, reason, right)
        base = scene.bodies.get(contact.sides[0].body)
        if contact.joint is None and contact.kind == "point-plane" and base is not None and base.deforms:
            right = "Weld a rigid body to it that has the plane"
            yield Problem(contact.entry(name), str(contact.sides[0]), "the plane's body deforms", right)
    for name in scene.events:
        yield Problem(f"events.{name}", None, reason, cure)
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
    elif joint.friction.law == "lugre":
        yield Problem(f"{key}.law", "lugre", _NO_BRISTLES, "Use coulomb or stribeck")
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


def _bodies(scene: Scene) -> Iterator[Problem]:
    for name, body in scene.bodies.items():
        if body.free is not None:
            for field, right in (("angle", "the body's rotation"), ("angular_speed", "angular_velocity")):
                if field in body.free.model_fields_set:
                    yield Problem(f"bodies.{name}.free.{field}", None, "only planar bodies have it", f"Give {right}")
        if "inertia" in body.model_fields_set and not isinstance(body.inertia, tuple):
            reason = "a body in space has three principal moments of inertia"
            given = given_value(scene.raw, ("bodies", name, "inertia"))
            yield Problem(f"bodies.{name}.inertia", given, reason, "Give [J_x, J_y, J_z]")
    for name, mass in scene.masses.items():
        if mass.inertia and not isinstance(mass.inertia, tuple):
            reason = "a body in space has three principal moments of inertia"
            yield Problem(f"masses.{name}.inertia", mass.inertia, reason, "Give [J_x, J_y, J_z]")
        for table in ("bodies", "joints", "loads"):
            if name in getattr(scene, table):
                yield taken(f"masses.{name}", f"{table} has an entry of this name")


def _beams(scene: Scene) -> Iterator[Problem]:
    """Problems of sections in space, which bend in two planes and twist."""
    for name, body in scene.bodies.items():
        if body.beam is None:
            continue
        key = f"bodies.{name}.beam"
        if body.beam.axially_rigid:
            yield Problem(f"{key}.axially_rigid", True, "only planar beams support this so far", "Leave it out")
        if body.beam.shear and not body.beam.rotary:
            reason = "only planar beams support shear without rotary inertia so far"
            yield Problem(f"{key}.theory", body.beam.theory, reason, "Use timoshenko")
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
        acted = [(f"loads.{load}", each.force_on) for load, each in scene.forces.items()]
        acted += [(f"springs.{spring}", end) for spring, each in scene.springs.items() for end in each.ends]
        acted += [(f"contacts.{contact}", end) for contact, each in scene.contacts.items()
                  for end in each.sides if each.joint is None]  # fmt: skip
        for by, at in acted:
            if at is not None and at.body == name and at.point in body.points_all and any(scene.point(at)[1:]):
                reason = f"{by} acts off the axis of an elastic body"
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
        if sensor.kind not in _SENSORS:
            yield Problem(f"{key}.{sensor.kind}", None, "only planar scenes have this so far", "Leave it out")
        elif sensor.kind in ("shear_force", "bending_moment") and sensor.component not in ("y", "z"):
            what = "bends about" if sensor.kind == "bending_moment" else "is sheared along"
            yield Problem(f"{key}.component", sensor.component, f"a link in space {what} its y or z", "Give y or z")
        elif sensor.kind == "strain" and not isinstance(sensor.fibre, tuple):
            reason = "a fibre in space needs y and z of the section"
            yield Problem(f"{key}.fibre", sensor.fibre, reason, "Give both, like ['10 mm', 0]")
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


