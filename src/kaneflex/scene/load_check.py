"""Checks of drives, loads, springs and events with other tables: addresses, names and laws."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kaneflex.scene.bodies import Body
from kaneflex.scene.drives import Drive
from kaneflex.scene.laws import Law, sample_times
from kaneflex.scene.parts import Joint, Load
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


def load_problems(scene: Scene) -> Iterator[Problem]:
    for name, load in scene.loads.items():
        if load.force_on is not None:
            yield from address_problems(scene, f"loads.{name}.force_on", load.force_on, ground=False)
        elif load.spread_on is not None:
            yield from _distributed(scene.bodies, f"loads.{name}.spread_on", load.spread_on)
        elif load.torque_at not in scene.joints:
            yield unknown(f"loads.{name}.torque_at", load.torque_at, "joint", scene.joints)
        elif (kind := scene.joints[load.torque_at].kind) not in ("revolute", "cylindrical"):
            reason = f"a {kind} joint {'does not turn' if kind in _STILL else 'turns about several axes'}"
            cure = "Name a revolute or a cylindrical joint" if scene.is_spatial else "Name a revolute joint"
            yield Problem(f"loads.{name}.torque_at", load.torque_at, reason, cure)
        if load.against not in (None, *scene.law_names()):
            yield unknown(f"loads.{name}.against", load.against, "joint or speed", scene.law_names())
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
            yield from address_problems(scene, f"{key}.{kind}", end, ground=True)
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
            yield from _torsional(scene.joints, f"{key}.torsional_at", spring.torsional_at)


def _torsional(joints: Mapping[str, Joint], key: str, name: str) -> Iterator[Problem]:
    if name not in joints:
        yield unknown(key, name, "joint", joints)
    elif joints[name].kind != "revolute":
        kind = joints[name].kind
        reason = f"a {kind} joint {'does not turn' if kind in _STILL else 'has several degrees of freedom'}"
        yield Problem(key, name, reason, "Name a revolute joint")


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
        told = f"the {('first', 'second')[k]} speed of a {joint} joint is {moves}"
        yield from of_the_joint(scene.raw, ("drives", name, "initial_speeds", str(k)), told, dimension)
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


_FINE = 20_000
"""Intervals of a run searched for jumps of atan2 and ends of asin, as many as laws are sampled at."""
_HALVINGS = 60
"""Bisections of an interval, more than double precision has binary digits."""
_ROUNDING = 1e-12
"""Distance below 1 at which the argument of asin counts as 1: the slope is then above 7e5."""


def check_drive_law(drive: Drive, horizon: float | None) -> None:
    """Raise Fault unless a drive's law is valid, without kinks, and finite over the run."""
    from kaneflex.scene.law_parser import parse_law

    law = parse_law(drive.law, ("t",))
    kink = law.kinks(smooth=("atan2",))
    if kink is not None:
        reason = f"{kink} has kinks, at which the speed would jump"
        raise Fault(reason, "Write a law whose speed is continuous, like sqrt(x**2 + small**2) for abs(x)")
    if horizon is not None:
        law.check_values({"t": sample_times(horizon)})
        _check_inverse_functions(law, np.linspace(0.0, horizon, _FINE + 1))


def _check_inverse_functions(law: Law, times: np.ndarray) -> None:
    """Raise Fault for a law in t whose atan2 jumps, or whose asin or acos has an infinite slope, at some time."""
    for _, call, _ in law.calls("atan2"):
        t = _first_jump(call, times)
        if t is not None:
            reason = f"{call.text} jumps where its point (x, y) crosses the negative x axis, "
            cure = "Write a law whose point does not cross the negative x axis"
            raise Fault(f"{reason}at t = {t:.6g} s", cure)
    for _, call, (argument,) in law.calls("asin", "acos"):
        t = _first_end(argument, times)
        if t is not None:
            reason = f"{call.text} has an infinite slope at t = {t:.6g} s, where its argument is 1 or -1"
            raise Fault(reason, "Write a law whose argument stays between -1 and 1, both excluded")


def load_jump(law: Law, names: Sequence[str], horizon: float | None) -> str | None:
    """Text of the first part of a load's law that jumps; atan2 of the time alone counts only if it jumps in the run."""
    found = law.jumps(smooth=("atan2",))
    moving = [name for name in names if name != "t"]
    for _, call, _ in law.calls("atan2") if found is None else ():
        known = horizon is not None and not call.uses_any(moving)
        if not known or _first_jump(call, np.linspace(0.0, horizon or 0.0, _FINE + 1)) is not None:
            return call.text
    return found


def _first_jump(angle: Law, times: np.ndarray) -> float | None:
    """First time between `times` at which an angle [rad] in t jumps; None without a jump.

    Between neighbours that differ by more than 1 rad, the half with the larger difference is bisected down to
    rounding: over a jump, of pi or more, the values remain different.
    """

    def values(at: np.ndarray) -> np.ndarray:
        return angle.on_arrays({"t": at})

    found = values(times)
    k = np.flatnonzero(abs(np.diff(found)) > 1.0)
    low, high = times[k], times[k + 1]
    for _ in range(_HALVINGS if len(k) else 0):
        middle = (low + high) / 2
        first = abs(values(middle) - values(low)) >= abs(values(high) - values(middle))
        low, high = np.where(first, low, middle), np.where(first, middle, high)
    jumps = abs(values(high) - values(low)) > 1.0
    return float(high[jumps][0]) if jumps.any() else None


def _first_end(argument: Law, times: np.ndarray) -> float | None:
    """First time at which the magnitude of an argument in t reaches 1, also between `times`; None if never."""

    def sizes(at: np.ndarray) -> np.ndarray:
        return abs(argument.on_arrays({"t": at}))

    found = sizes(times)
    k = np.arange(len(times))
    largest = (found >= np.roll(found, 1)) | (k == 0)
    largest &= (found >= np.roll(found, -1)) | (k == k[-1])
    k = np.flatnonzero(largest)
    low, high = times[np.maximum(k - 1, 0)], times[np.minimum(k + 1, len(times) - 1)]
    for _ in range(2 * _HALVINGS):  # each iteration keeps two thirds
        left, right = (2 * low + high) / 3, (low + 2 * high) / 3
        rises = sizes(left) < sizes(right)
        low, high = np.where(rises, left, low), np.where(rises, high, right)
    at = np.where(sizes(times[k]) >= sizes(low), times[k], low)
    ends = sizes(at) >= 1.0 - _ROUNDING
    return float(at[ends][0]) if ends.any() else None


def check_load_law(scene: Scene, load: Load) -> None:
    """Raise Fault unless a load's law is valid, and finite wherever its joints' motion is known before the run.

    A law of a free joint's motion is evaluated at the joint's start; laws in the speed of a spin-up, a law or a table
    are sampled with the derived motion (`kaneflex.solve.run_checks.check_laws`).
    """
    from kaneflex.scene.law_parser import parse_law

    law = parse_law(load.law, scene.law_names())
    for name in scene.joints:
        if f"{name}_speed" in scene.joints and law.uses(f"{name}_speed"):
            reason = f"{name}_speed is both a joint and the speed of joint {name}"
            raise Fault(reason, "Give the joint another name")
    free = law.uses_any(scene.free_joints)
    if scene.horizon is None and not free:
        return
    times = np.zeros(1) if free else sample_times(scene.horizon)
    known = {"t": times}
    for name, drive in scene.drives.items():
        known |= _motion(name, drive, times)
    if all(name in known for name in scene.law_names() if law.uses(name)):
        law.check_values(known)


def _motion(name: str, drive: Drive, times: np.ndarray) -> dict[str, np.ndarray | float]:
    """Coordinate [rad or m] and speed of a drive at `times` (n,), as far as known before the run, by a law's names."""
    speed = drive.initial_speed if drive.free else drive.speed if drive.spin_up is None else None
    try:
        return {name: drive.coordinate(times)} | ({} if speed is None else {f"{name}_speed": speed})
    except Fault:
        return {}  # reported by the drive's own check
