"""Checks of contradicting settings of a run; each error names both."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from kaneflex.scene import Scene
from kaneflex.scene.parts import Joint
from kaneflex.support.errors import SceneError, refuse

COUPLED_INTEGRATORS = ("radau", "gauss")
"""Integrators of preset coupled."""
_SMOOTH = "tanh(x / small) for sign(x), step(x, x_0, h_0, x_1, h_1) for step(x)"


def check_coupled(scene: Scene) -> None:
    """Raise SceneError for settings that preset coupled does not support."""
    solve, known = scene.solve, COUPLED_INTEGRATORS
    off = next((name for name, on in solve.terms.items() if not on), None)
    rotations = {f"joints.{name}": joint.rotation for name, joint in scene.joints.items() if joint.rotation == "shared"}
    rotations |= {f"drives.{name}": drive.rotation for name, drive in scene.drives.items() if drive.rotation == "free"}
    at, rotation = next(iter(rotations.items()), (None, None))
    refuse(
        (solve.reduction is not None, "solve.reduction", solve.reduction,
         "preset coupled uses shapes of each link", "Leave reduction out"),
        (solve.integrator not in (None, *known), "solve.integrator", solve.integrator,
         "this integrator is for equations that are linear in the displacements",
         f"Use {' or '.join(known)} under preset coupled"),
        (off is not None, f"solve.terms.{off}", False,
         "preset coupled cannot leave terms out", "Use preset stiffened"),
        (at is not None, f"{at}.rotation", rotation,
         "only one-way presets have this choice",
         "Leave rotation out, or use preset stiffened"),
        (scene.is_frame and not _welded(scene.bodies, scene.joints), "solve.preset", "coupled",
         "preset coupled supports poses only if all joints are welds",
         "Use preset stiffened, or leave the poses out and hold every body by joints and drives"),
    )  # fmt: skip


def _welded(bodies: Collection[str], of: Mapping[str, Joint]) -> bool:
    """True if welds connect all bodies to the ground, and there are no other joints."""
    held, joints = {"ground"}, list(of.values())
    for _ in joints:  # each pass reaches at least one further joint
        held |= {side.body for joint in joints for side in joint.addresses if held & {a.body for a in joint.addresses}}
    return held >= set(bodies) and all(joint.kind == "weld" for joint in joints)


def check_contacts(scene: Scene, dynamics: str) -> None:
    """Raise SceneError for contacts, friction or free bodies without preset coupled."""
    of_contacts = {contact.table_key(name): "a contact" if contact.joint is None else "a joint with a clearance"
                   for name, contact in scene.contacts.items()}  # fmt: skip
    floating = [] if scene.is_spatial else [f"bodies.{name}" for name in scene.floating]
    coupled = of_contacts | {f"{body}.free": "a free body" for body in floating}
    coupled |= {f"joints.{name}.friction": "friction" for name in scene.frictions}
    for key, what in coupled.items() if dynamics != "coupled" else ():
        raise SceneError(key, None, f"preset {scene.solve.preset} does not support {what}", "Use preset coupled")
    if floating and scene.solve.start in ("quasistatic", "periodic"):
        reason = f"{floating[0]} is free, so there is no equilibrium or periodic motion"
        raise SceneError("solve.start", scene.solve.start, reason, "Start from zero, or from a given state")
    if scene.solve.start == "periodic" and scene.is_spatial:
        reason = "only planar scenes have periodic motions so far"
        refuse_contacts(scene, "solve.start", "periodic", reason, "Start from zero and run long enough")
    if scene.solve.start == "quasistatic":
        reason = "free bodies have no equilibrium"
        refuse_contacts(scene, "solve.start", "quasistatic", reason, "Start from zero, or from a given state")
    if scene.solve.start == "periodic":
        refuse_bristles(scene, "solve.start", "periodic")


def check_laws(scene: Scene, dynamics: str) -> None:
    """Raise SceneError for laws of loads that need preset coupled, or its error control."""
    free = next(iter([*scene.free_joints, *scene.floating]), None)
    for name, load in scene.loads.items():
        law, key = scene.argument(name), f"loads.{name}.{'law' if load.against is None else 'against'}"
        if law is None:
            continue
        given = load.law or load.against
        strange = next((joint for joint in scene.observed if law.uses_any([joint])), None)
        preset = scene.solve.preset
        if strange is not None and dynamics != "coupled" and not scene.is_spatial:
            reason = f"under preset {preset} laws and tables can use joints with a drive only: {strange} has none"
            raise SceneError(key, given, reason, "Use preset coupled, or a joint with a drive")
        if load.law is None or free is None or dynamics == "coupled":
            continue
        from kaneflex.scene.law_check import load_jump

        if (jump := load_jump(law, scene.law_names(), scene.horizon)) is not None:
            reason = f"{jump} jumps, and preset {preset} would step over the jump as it integrates {free}"
            raise SceneError(key, load.law, reason, f"Use preset coupled, or a smooth law: {_SMOOTH}")


def refuse_in_space(scene: Scene, key: str, what: str) -> None:
    """Raise SceneError for a spatial scene where only planar scenes are supported."""
    if scene.is_spatial:
        raise SceneError(key, scene.name, f"{what} only planar scenes so far", "Use a planar scene")


def refuse_contacts(scene: Scene, key: str, value: object, reason: str, cure: str) -> None:
    """Raise SceneError for contacts or friction in a scene where a smooth motion is required."""
    if scene.contacts:
        name, contact = next(iter(scene.contacts.items()))
        raise SceneError(key, value, f"with {contact.table_key(name)} {reason}", cure)
    for name in scene.frictions:
        raise SceneError(key, value, f"with joints.{name}.friction {reason}", cure)


def refuse_bristles(scene: Scene, key: str, value: object) -> None:
    """Raise SceneError for bristle friction: a cycle would start without the bristle states of the previous cycle."""
    for name, friction in scene.frictions.items():
        if friction.law != "lugre":
            continue
        owner = scene.contacts[name].table_key(name) if name in scene.contacts else f"joints.{name}"
        reason = f"with {owner}.friction a cycle would start without the bristle states of the previous cycle"
        raise SceneError(key, value, reason, "Start from zero and run long enough, or use law stribeck")
