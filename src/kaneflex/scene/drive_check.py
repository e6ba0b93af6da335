"""Checks of a scene's drives: their joints, and quantities that fit rotating or sliding joints."""

from __future__ import annotations

from collections.abc import Iterator

from kaneflex.scene.law_check import check_drive_law
from kaneflex.scene.scene import Scene, given_value
from kaneflex.support.errors import Fault, Problem, nearest
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension, to_si

_SPEEDS = {"cylindrical": ("along its axis", SPEED), "universal": ("about its first axis", ANGULAR_SPEED)}
"""Motion of the first speed of joints with two speeds; the second is a rotation."""


def drive_problems(scene: Scene) -> Iterator[Problem]:
    """Problems of the drives: their joints, and quantities that do not fit their joints."""
    for name in scene.drives:
        if name not in scene.joints:
            yield Problem(
                f"drives.{name}", None, "no joint of that name to drive", nearest(name, scene.joints)
            )
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
                check_drive_law(scene, drive)
            elif drive.kind == "table":
                measured = drive.read_table().dimension
                if name in scene.joints and (measured is LENGTH) != scene.slides(name):
                    kind = "a guide slides" if scene.slides(name) else "a revolute joint turns"
                    right = "length, like unit = 'mm'" if scene.slides(name) else "angle, like unit = 'deg'"
                    cure = f"Give a unit of {right}, or write it in the column's heading"
                    raise Fault(f"{kind}; the table is of {measured.name}", cure, below="unit")
        except Fault as fault:
            field = fault.below or drive.kind
            yield Problem(f"drives.{name}.{field}", getattr(drive, field), fault.reason, fault.cure)


def _drive_quantities(scene: Scene, name: str) -> Iterator[Problem]:
    """Problems of a drive's quantities, which must fit its rotating or sliding joint."""
    drive, slides = scene.drives[name], scene.slides(name)
    wrong, right = ("angle", "position") if slides else ("position", "angle")
    kind = "a guide slides" if slides else "a revolute joint turns"
    if wrong in drive.model_fields_set:
        given = given_value(scene.raw, ("drives", name, wrong))
        yield Problem(f"drives.{name}.{wrong}", given, kind, f"Give {right}")
    if slides and drive.cycle is not None:
        given = given_value(scene.raw, ("drives", name, "cycle"))
        reason = "a guide at constant speed has no cycle"
        yield Problem(f"drives.{name}.cycle", given, reason, "Leave it out, or give a law with its period")
    for field in ("speed", "initial_speed"):
        yield from of_the_joint(scene, ("drives", name, field), kind, SPEED if slides else ANGULAR_SPEED)
    joint = scene.joints[name].kind
    if drive.initial_speeds is not None and joint in _SPEEDS:
        moves, dimension = _SPEEDS[joint]
        kind = f"the first speed of a {joint} joint is {moves}"
        yield from of_the_joint(scene, ("drives", name, "initial_speeds", "0"), kind, dimension)
        kind = f"the second speed of a {joint} joint is a rotation"
        yield from of_the_joint(scene, ("drives", name, "initial_speeds", "1"), kind, ANGULAR_SPEED)
    if name == next(iter(scene.drives)):
        yield from of_the_joint(scene, ("solve", "mode_angle"), kind, LENGTH if slides else ANGLE)


def of_the_joint(scene: Scene, path: tuple[str, ...], kind: str, dimension: Dimension) -> Iterator[Problem]:
    """Quantity of a joint that rotates or slides, converted now that the joint is known."""
    given = given_value(scene.raw, path)
    try:
        if given is not None:
            to_si(given, dimension)
    except Fault as fault:
        yield Problem(".".join(path), given, f"{kind}; {fault.reason}", fault.cure)
