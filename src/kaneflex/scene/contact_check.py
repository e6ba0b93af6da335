"""Checks of contacts and clearances with other tables: addresses, names, and entries that need an ideal joint."""

from __future__ import annotations

from collections.abc import Iterator

from kaneflex.scene.bodies import Body
from kaneflex.scene.clearances import ClearanceContact, contacts_of
from kaneflex.scene.contacts import Contact
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene
from kaneflex.support.errors import Fault, Problem, taken

_OF_IMPACTS = ("begin", "end", "approach", "separation", "impulse", "peak", "lost")
CONTACT_RESULTS = (
    *(f"contact_{key}" for key in ("gap", "force", "lost")), *(f"flank_{key}" for key in ("gap", "torque", "lost")),
    *(f"impact_{key}" for key in ("contact", *_OF_IMPACTS, "x", "y")),
    *(f"flank_impact_{key}" for key in ("flank", *_OF_IMPACTS)),
    *(f"clearance_{key}" for key in ("x", "y", "angle")), "contact", "flank", "clearance", "eccentricity",
    "state", "last_state", "last_rate",
)  # fmt: skip
"""Names of further results of a scene with contacts, reserved there."""
_OF_FRICTION = ("speed", "pressed", "sticks", "lost", "bristles")
FRICTION_RESULTS = (
    "friction", *(f"friction_{key}" for key in ("force", *_OF_FRICTION)),
    "pin", *(f"pin_{key}" for key in ("torque", *_OF_FRICTION)),
)  # fmt: skip
"""Names of further results of a scene with friction, reserved there."""


def clearance_problems(scene: Scene) -> Iterator[Problem]:
    """Problems of entries that refer to a joint with a clearance, which has no drive and no reaction."""
    loose = {name: joint for name, joint in scene.joints.items() if joint.clearance is not None}
    for name, joint in loose.items():
        if joint.has_backlash and name in scene.drives and not scene.drives[name].free:
            reason = f"{name} has backlash, and its drive prescribes the same angle"
            yield Problem(f"drives.{name}", None, reason, "Make the drive free, or leave the clearance out")
    for name, joint in loose.items():
        for made in contacts_of(name, joint):
            table = "contacts" if made in scene.contacts else "joints"
            if made in scene.contacts or (made != name and made in scene.joints):
                yield taken(f"{table}.{made}", f"a contact of the clearance of joint {name} has this name")
    for key, name, verb in _counting_on(scene):
        if name in loose and not loose[name].has_backlash:
            reason, cure = f"{name} has a clearance: {verb}", "Leave out the clearance or this entry"
            yield Problem(key, None if key == f"drives.{name}" else name, reason, cure)


def _counting_on(scene: Scene) -> Iterator[tuple[str, str, str]]:
    """Key of every entry that names a joint, the joint, and the reason why it needs an ideal joint."""
    for name in scene.drives:
        yield f"drives.{name}", name, "it cannot be driven"
    for name, load in scene.torques.items():
        yield f"loads.{name}.torque_at", load.torque_at, "a torque needs a joint without clearance"
    for name in scene.loads:
        key = "law" if scene.loads[name].against is None else "against"
        yield from ((f"loads.{name}.{key}", joint, "it has no coordinate") for joint in _in_law(scene, name))
    for name, spring in scene.springs.items():
        yield f"springs.{name}.torsional_at", spring.torsional_at, "it has no angle"
    for name, sensor in scene.sensors.items():
        if sensor.kind == "joint_force":
            yield f"sensors.{name}.joint_force", sensor.target, "it has no reaction, but contacts with a contact_force"


def _in_law(scene: Scene, load: str) -> tuple[str, ...]:
    """Joints whose coordinates or speeds enter a load's law or table."""
    try:
        law = scene.argument(load)
    except Fault:
        return ()  # reported by the load's own check
    return tuple(name for name in scene.joints if law is not None and law.uses_any([name]))


def contact_problems(scene: Scene) -> Iterator[Problem]:
    """Problems of the contacts of a scene, including those of clearances."""
    seen = set()
    for name, contact in scene.contacts.items():
        key = contact.entry(name)
        for side in contact.sides:
            if (key, side) not in seen and side.body in scene.bodies:
                yield from _side(scene.bodies[side.body], key, contact, side)
            seen.add((key, side))
        if scene.is_frame:
            yield Problem(key, None, "bodies with poses don't move", "Leave out either the contact or the poses")


def result_problems(scene: Scene) -> Iterator[Problem]:
    """Problems of sensors with the name of a further result."""
    for name in scene.sensors:
        if scene.contacts and name in CONTACT_RESULTS:
            yield taken(f"sensors.{name}", "contacts have a result of this name")
        elif scene.frictions and name in FRICTION_RESULTS:
            yield taken(f"sensors.{name}", "friction has a result of this name")


def tilt_problems(scene: Scene) -> Iterator[Problem]:
    """Problems of blocks without moment of inertia, which can rotate in the clearance of their guide."""
    for name, loose in scene.loose.items():
        rider = loose.sides[1].body
        body = scene.bodies.get(rider)
        if loose.direction is None or body is None or body.elastic or body.modal is not None or body.inertia:
            continue
        held = [(joint.kind, side) for joint in scene.joints.values() for side in joint.addresses if side.body == rider]
        pins = {scene.point(side) for kind, side in held if kind == "revolute"}
        turns = all(kind == "revolute" for kind, _ in held) and len(pins) < 2
        if turns and pins <= {body.centre} and all(mass.at.body != rider for mass in scene.masses.values()):
            reason = f"it can rotate in the clearance of {name} but has no moment of inertia"
            yield Problem(f"bodies.{rider}.inertia", 0, reason, "Give its inertia")


def _side(body: Body, key: str, contact: Contact, side: Address) -> Iterator[Problem]:
    if body.modal_data is not None:
        reason = f"{side.body} has modal data: contacts on such bodies are not available in this version"
        yield Problem(key, str(side), reason, "Put the contact on a rigid body joined to it")
    elif body.elastic and isinstance(contact, ClearanceContact) and contact.of_kind == "prismatic":
        reason = f"{side.body} is elastic: a guide cannot hold a deforming body"
        yield Problem(key, str(side), reason, "Put a rigid body into the guide")
    elif body.elastic and body.beam.axially_rigid:
        reason = f"{side.body} is axially rigid"
        yield Problem(key, str(side), reason, "Leave axially_rigid out, or put the contact on another body")
