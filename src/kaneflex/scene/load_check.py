"""Checks of loads, springs and events with other tables: addresses, names and laws."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from kaneflex.scene.drive_check import of_the_joint
from kaneflex.scene.headings import abscissae
from kaneflex.scene.law_check import check_load_law
from kaneflex.scene.quantities import Address
from kaneflex.scene.scene import Scene
from kaneflex.support.errors import Fault, Problem, nearest

_STILL = ("prismatic", "weld")
"""Joints without rotation."""


def address_problems(scene: Scene, key: str, address: Address, ground: bool) -> Iterator[Problem]:
    """Problems of an address of a body's point, or of a fixed point if `ground` is allowed."""
    if address.body == "ground":
        if not ground:
            yield Problem(key, str(address), "the ground does not move", "Name a point of a body")
        elif address.point != "origin" and address.point not in scene.ground:
            yield Problem(
                key, str(address), "no such fixed point", nearest(address.point, ["origin", *scene.ground])
            )
    elif address.body not in scene.bodies:
        cure = nearest(address.body, [*scene.bodies, *(["ground"] if ground else [])])
        yield Problem(key, str(address), f"there is no body {address.body!r}", cure)
    elif address.point not in scene.bodies[address.body].points_all:
        points = scene.bodies[address.body].points_all
        yield Problem(
            key,
            str(address),
            f"{address.body} has no point {address.point!r}",
            nearest(address.point, points),
        )


def load_problems(scene: Scene) -> Iterator[Problem]:
    for name, load in scene.loads.items():
        if load.force_on is not None:
            yield from address_problems(scene, f"loads.{name}.force_on", load.force_on, ground=False)
        elif load.spread_on is not None:
            yield from _distributed(scene, f"loads.{name}.spread_on", load.spread_on)
        elif load.torque_at not in scene.joints:
            cure = nearest(load.torque_at, scene.joints)
            yield Problem(f"loads.{name}.torque_at", load.torque_at, "no joint of that name", cure)
        elif (kind := scene.joints[load.torque_at].kind) not in ("revolute", "cylindrical"):
            reason = f"a {kind} joint {'does not turn' if kind in _STILL else 'turns about several axes'}"
            cure = "Name a revolute or a cylindrical joint" if scene.is_spatial else "Name a revolute joint"
            yield Problem(f"loads.{name}.torque_at", load.torque_at, reason, cure)
        if load.against not in (None, *scene.law_names()):
            cure = nearest(load.against, scene.law_names())
            yield Problem(f"loads.{name}.against", load.against, "no joint of that name, nor its speed", cure)
            continue
        try:
            if load.kind == "table":
                yield from _abscissa(scene, name)
            elif load.kind == "law":
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
        reason = f"{kind}; the first column of {Path(load.table).name} is of {measured.name}"
        cure = f"Write its unit in the heading, like '{load.against} ({dimension.unit})'"
        yield Problem(f"loads.{name}.table", load.table, reason, cure)
    for field in ("offset", "period"):
        yield from of_the_joint(scene, ("loads", name, field), kind, dimension)


def _distributed(scene: Scene, key: str, body: str) -> Iterator[Problem]:
    if body not in scene.bodies:
        yield Problem(key, body, "no body of that name", nearest(body, scene.bodies))
    elif scene.bodies[body].length is None:
        yield Problem(key, body, f"{body} has no length for a distributed load", "Give the body a length")
    elif scene.bodies[body].modal_data is not None:
        reason = f"the modal data of {body} contain only its points, not the line between them"
        yield Problem(key, body, reason, "Apply forces at its points, or give the body a beam")


def spring_problems(scene: Scene) -> Iterator[Problem]:
    joints = scene.joints.items()
    together = {frozenset(map(str, joint.addresses)): name for name, joint in joints if joint.keeps_together}
    for name, spring in scene.springs.items():
        key, kind = f"springs.{name}", "bushing" if spring.bushing else "between"
        for end in spring.ends:
            yield from address_problems(scene, f"{key}.{kind}", end, ground=True)
            body = scene.bodies.get(end.body)
            if body is not None and body.elastic and body.beam.axially_rigid:
                cure = "Leave axially_rigid out, or attach the spring elsewhere"
                yield Problem(f"{key}.{kind}", str(end), f"{end.body} is axially rigid", cure)
        held = together.get(frozenset(map(str, spring.between or ())))
        if held is not None and (spring.length or spring.damping):
            reason = f"joint {held} keeps its points together, so length and damping have no direction"
            cure = "Move one of the points, give only stiffness, or write torsional_at for a torsional spring"
            yield Problem(f"{key}.between", [*map(str, spring.ends)], reason, cure)
        if spring.torsional_at is not None:
            yield from _torsional(scene, f"{key}.torsional_at", spring.torsional_at)


def _torsional(scene: Scene, key: str, name: str) -> Iterator[Problem]:
    if name not in scene.joints:
        yield Problem(key, name, "no joint of that name", nearest(name, scene.joints))
    elif scene.joints[name].kind != "revolute":
        kind = scene.joints[name].kind
        reason = f"a {kind} joint {'does not turn' if kind in _STILL else 'has several degrees of freedom'}"
        yield Problem(key, name, reason, "Name a revolute joint")


def event_problems(scene: Scene) -> Iterator[Problem]:
    for name, event in scene.events.items():
        if event.sensor not in scene.sensors:
            cure = nearest(event.sensor, scene.sensors)
            yield Problem(f"events.{name}.sensor", event.sensor, "no sensor of that name", cure)
            continue
        try:
            scene.level(event)
        except Fault as fault:
            yield Problem(f"events.{name}.value", event.value, fault.reason, fault.cure)
