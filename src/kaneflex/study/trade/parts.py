"""Clearances and friction of a scene, and the same scene without them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations, product
from typing import Any

from kaneflex.fem.mobility import check_determined
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.mechanism.tight_start import tight_start
from kaneflex.scene import Scene, with_settings
from kaneflex.scene.clearances import ClearanceContact
from kaneflex.scene.contacts import Contact
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import CONTACT_KINDS, DRIVE_KINDS, FRICTION_KINDS, Event, Sensor
from kaneflex.support.errors import SceneError

_ALIKE = 0.2
"""Angle [rad] up to which bodies of the tight mechanism count as in the same position as with clearances."""


def _loose(contacts: Iterable[Contact]) -> tuple[str, ...]:
    """Joints with a clearance, backlash included."""
    made = (contact for contact in contacts if isinstance(contact, ClearanceContact))
    return tuple(dict.fromkeys(contact.of for contact in made))


def _rubbing(raw: Mapping[str, Any]) -> dict[str, str]:
    """Joints and contacts with friction -> path of its entry."""
    found = {}
    for table in ("joints", "contacts"):
        for name, entry in raw.get(table, {}).items():
            for path, owner in (("friction", entry), ("clearance.friction", entry.get("clearance"))):
                if isinstance(owner, dict) and owner.get("friction") is not None:
                    found[name] = f"{table}.{name}.{path}"
    return found


def parts(scene: Scene) -> tuple[dict[str, tuple[str, ...]], dict[str, str]]:
    """Settings that remove each clearance, each friction, and all of a kind together, by name; reasons of those that
    can't be removed."""
    found, left_out = dict[str, tuple[str, ...]](), dict[str, str]()
    loose, rubbing = _loose(scene.contacts.values()), tuple(_rubbing(scene.raw))
    for kind, without, names in (("clearance", tightened, loose), ("friction", smooth, rubbing)):
        for those in (*((name,) for name in names), *([names] if len(names) > 1 else [])):
            part = f"{kind} {' and '.join(those)}"
            try:
                found[part] = without(scene, those)
            except SceneError as error:
                left_out[part] = str(error)
    return found, left_out


def smooth(scene: Scene, names: Sequence[str]) -> tuple[str, ...]:
    """Settings that remove the friction of joints and contacts, and the sensors of it."""
    paths = _rubbing(scene.raw)
    owners = {name: contact.joint for name, contact in scene.contacts.items()}
    gone = tuple(
        name for name, sensor in scene.sensors.items()
        if sensor.kind in FRICTION_KINDS and (str(sensor.target) in names or owners.get(str(sensor.target)) in names)
    )  # fmt: skip
    return (*(f"{paths[name]}=none" for name in names), *_left_out(scene.events, gone))


def _left_out(events: Mapping[str, Event], sensors: Sequence[str]) -> Iterator[str]:
    """Settings that remove sensors, and the events that use them."""
    yield from (f"sensors.{sensor}=none" for sensor in sensors)
    yield from (f"events.{name}=none" for name, event in events.items() if event.sensor in sensors)


def tightened(scene: Scene, names: Sequence[str]) -> tuple[str, ...]:
    """Settings that remove the clearances of joints, and the sensors of them.

    A tight joint removes freedoms: as many free drives are removed, the last ones first, such that the mechanism is
    statically determinate. Loops of tight pins close near the initial position; flanks without play are welds.
    """
    poses, settings = place(mechanism_of(tight_start(scene))).poses, list[str]()
    held, welded = 0, list[str]()
    for name in names:
        made = next(c for c in scene.contacts.values() if isinstance(c, ClearanceContact) and c.of == name)
        settings.append(f"joints.{name}.clearance=none")
        if not made.flank:
            held += 2
            continue
        addresses = ", ".join(f"'{address}'" for address in scene.joints[name].addresses)
        angle = made.clearance.middle
        settings += [f"joints.{name}={{weld=[{addresses}], relative_angle={angle!r}, revolute='none'}}"]
        settings += [f"drives.{name}=none"] * (name in scene.drives)
        held += name not in scene.drives
        welded.append(name)
    settings += _left_out(scene.events, _without_their_joint(scene, names, welded))
    free = [name for name in reversed(scene.drives) if scene.drives[name].free and name not in welded]
    reason = "the scene has too few free drives that could be left out"
    closed = [name for name in names if name not in welded]
    for dropped, ways in product(combinations(free, held), _ways(scene, closed)):
        found = (*settings, *ways, *(f"drives.{name}=none" for name in dropped))
        try:
            tight = with_settings(scene, found)
            mechanism = mechanism_of(tight)
            check_determined(mechanism, twice=True)
            found_poses = place(mechanism).poses.items()
            turned = max(abs(math.remainder(pose[2] - poses[k][2], math.tau)) for k, pose in found_poses)
            if turned < _ALIKE:
                return found
            reason = "its loops close in another position"
        except SceneError as error:
            reason = str(error)
    raise SceneError("joints", ", ".join(names), f"without clearance: {reason}", "Write a scene without the clearance")


def _ways(scene: Scene, names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Settings that close the loops of tight joints near the initial position, if they close any."""
    poses = place(mechanism_of(tight_start(scene))).poses
    angles = {body: f"{body}={float(pose[2])!r}" for body, pose in poses.items()}
    sides = {name: [side.body for side in scene.loose[name].sides if side.body in angles] for name in names}
    for bodies in ({name: list(angles) for name in names}, sides):
        yield tuple(f"joints.{name}.near={{{', '.join(angles[body] for body in bodies[name])}}}" for name in names)
    yield ()


def _without_their_joint(scene: Scene, names: Sequence[str], welded: Sequence[str]) -> tuple[str, ...]:
    """Sensors that don't exist without the clearances: of their contacts, of places in them, of welded joints."""

    def is_gone(sensor: Sensor) -> bool:
        target, contact = sensor.target, scene.contacts.get(str(sensor.target))
        joint = target.body if isinstance(target, Address) else target
        if sensor.kind in (*CONTACT_KINDS, *FRICTION_KINDS):
            return isinstance(contact, ClearanceContact) and contact.of in names
        return (sensor.kind == "position" and joint in names) or (sensor.kind in DRIVE_KINDS and joint in welded)

    return tuple(name for name, sensor in scene.sensors.items() if is_gone(sensor))
