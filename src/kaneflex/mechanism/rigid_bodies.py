"""Rigid bodies in the elastic stage: those placed by drives, and those carried by elastic links."""

from __future__ import annotations

from dataclasses import dataclass

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.parts import Mechanism
from kaneflex.mechanism.planar import GROUND
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError


@dataclass(frozen=True)
class Carried:
    """Rigid body that moves with the deformation.

    Attributes
    ----------
    kind : str
        "guided" (a slide along the guide of a placed body), "hinged" (a turn about a point of another rigid body),
        "welded" (moves with another rigid body) or "free" (displacement of its start, and a turn).
    at : tuple of float
        Centre of its rotation, in its own axes [m].
    joint : str or None
        Joint to the rigid body that holds it.
    base : Address or None
        Point of the holding body.
    """

    kind: str
    at: tuple[float, float]
    joint: str | None = None
    base: Address | None = None


def prescribed_bodies(mechanism: Mechanism) -> set[str]:
    """Rigid bodies with prescribed or free motion, found group by group from joints between rigid bodies."""
    rigid = [name for name, body in mechanism.bodies.items() if not body.elastic]
    placed = {GROUND, *(name for name in mechanism.floating if name in rigid)}
    while group := mechanism.smallest_group(placed, [name for name in rigid if name not in placed]):
        placed |= {*group}
    return placed


def carried_bodies(scene: Scene) -> dict[str, Carried]:
    """Rigid bodies that move with the deformation; holding bodies come before those that they hold.

    Raises
    ------
    SceneError
        For a rigid body with redundant constraints by other rigid bodies, or on the guide of a carried body.
    """
    prescribed = prescribed_bodies(mechanism_of(scene))
    carried: dict[str, Carried] = {}
    waiting = [name for name, body in scene.bodies.items() if not body.elastic and name not in prescribed]
    while waiting:
        holders = {name: _holders(scene, name, prescribed | set(carried)) for name in waiting}
        name = next((name for name in waiting if holders[name]), waiting[0])
        waiting.remove(name)
        if len(holders[name]) > 1:
            joints = " and ".join(joint for joint, _, _ in holders[name])
            raise SceneError(
                f"bodies.{name}", "rigid", f"{joints} connect it to rigid bodies that move apart as links deform",
                "Use preset coupled or rigid, give one of these bodies a beam, or leave one of the joints out",
            )  # fmt: skip
        carried[name] = _carry(scene, holders[name][0], prescribed) if holders[name] else Carried("free", (0.0, 0.0))
    return carried


def _holders(scene: Scene, body: str, known: set[str]) -> list[tuple[str, Address, Address]]:
    """Joints to rigid bodies whose motion is known: (joint, own point, the other body's point)."""
    found = []
    for name, joint in scene.joints.items():
        first, second = joint.addresses
        for own, other in ((first, second), (second, first)):
            if own.body == body and other.body in known:
                found.append((name, own, other))
    return found


def _carry(scene: Scene, holder: tuple[str, Address, Address], prescribed: set[str]) -> Carried:
    name, own, other = holder
    joint = scene.joints[name]
    if joint.kind == "prismatic":
        if other.body not in prescribed:
            raise SceneError(
                f"joints.{name}", other.body, "the guide is on a body that the deformation of elastic links moves",
                "Use preset coupled or rigid, or put the guide on the ground or on a driven body",
            )  # fmt: skip
        return Carried("guided", scene.point(own), name, other)
    kind = "hinged" if joint.kind == "revolute" and name not in scene.drives else "welded"
    return Carried(kind, scene.point(own), name, other)


def check_elastic(scene: Scene) -> None:
    """Raise SceneError unless the elastic stage supports the scene, before anything is derived.

    A guide can hold rigid bodies only. Loads, springs and lumped masses on a link must lie on its axis, where its
    nodes are.
    """
    carried_bodies(scene)  # raises if they can't follow the links
    check_on_axes(scene)


def check_on_axes(scene: Scene) -> None:
    """Raise SceneError for elastic links on guides, and for points off their axes."""
    for name, spring in scene.springs.items():
        joined = scene.joints[spring.torsional_at].addresses if spring.torsional_at is not None else ()
        if scene.solve.preset == "paper" and any(a.body != "ground" and scene.bodies[a.body].elastic for a in joined):
            raise SceneError(
                f"springs.{name}", spring.torsional_at, "in preset paper elastic bodies rotate freely at a drive",
                "Use another preset, or leave the spring out",
            )  # fmt: skip
    for entry, address in scene.acting:
        body = scene.bodies.get(address.body)
        if body is None or not body.elastic:
            continue
        x, y = scene.point(address)
        if not (y == 0 and 0 <= x <= body.length):
            raise SceneError(
                entry, str(address), f"the point lies off the axis of {address.body}",
                "Move the point onto the axis, between start and end, or join a rigid body there",
            )  # fmt: skip
        if entry.endswith(".prismatic"):
            raise SceneError(
                entry, address.body, "an elastic body on a guide is not supported",
                "Join it to a guided rigid body by a revolute joint or a weld, or use preset rigid",
            )  # fmt: skip
