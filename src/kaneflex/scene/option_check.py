"""What the settings of a run may not ask for together: each error names both."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kaneflex.scene import Scene
from kaneflex.scene.contact_check import refuse_bristles, refuse_contacts
from kaneflex.scene.law_check import load_jump
from kaneflex.support.errors import SceneError, refuse

if TYPE_CHECKING:
    from kaneflex.scene.options import Options

COUPLED_INTEGRATORS = ("radau", "gauss", "scipy")
"""What preset coupled can be integrated by."""
_SMOOTH = "tanh(x / small) for sign(x), step(x, x_0, h_0, x_1, h_1) for step(x)"


def check_coupled(scene: Scene) -> None:
    """The coupled equations are one whole, with shapes and integrators of their own."""
    solve, known = scene.solve, COUPLED_INTEGRATORS
    off = next((name for name, on in solve.terms.items() if not on), None)
    rotations = {f"joints.{name}": joint.rotation for name, joint in scene.joints.items() if joint.rotation == "shared"}
    rotations |= {f"drives.{name}": drive.rotation for name, drive in scene.drives.items() if drive.rotation == "free"}
    at, rotation = next(iter(rotations.items()), (None, None))
    refuse(
        (solve.reduction is not None, "solve.reduction", solve.reduction,
         "preset coupled has shapes of each link", "Leave reduction out"),
        (solve.integrator not in (None, *known), "solve.integrator", solve.integrator,
         "integrates equations that are linear in the displacements",
         f"Use {', '.join(known[:-1])} or {known[-1]} under preset coupled"),
        (scene.is_spatial and solve.integrator not in (None, "radau"), "solve.integrator", solve.integrator,
         "under preset coupled bodies in space are integrated by radau alone", "Leave it out"),
        (scene.is_spatial and solve.bounded, "solve.bounded", list(solve.bounded),
         "in space solve.tolerance bounds displacements alone", "Leave it out, and give a smaller tolerance"),
        (off is not None, f"solve.terms.{off}", False,
         "the coupled equations are one whole", "Take preset stiffened to leave terms out"),
        (at is not None, f"{at}.rotation", rotation,
         "a choice of models with small displacements: here a joint is what it is",
         "Leave rotation out, or take preset stiffened"),
        (scene.is_frame and not _welded(scene), "solve.preset", "coupled",
         "it places bodies by their joints, and welds alone take their angles from poses",
         "Take preset stiffened, or leave the poses out and hold every body by joints and drives"),
    )  # fmt: skip


def _welded(scene: Scene) -> bool:
    """Whether welds hold all bodies to the ground, and nothing else joins them."""
    held, joints = {"ground"}, list(scene.joints.values())
    for _ in joints:  # each turn reaches one joint further at least
        held |= {side.body for joint in joints for side in joint.addresses if held & {a.body for a in joint.addresses}}
    return held >= set(scene.bodies) and all(joint.kind == "weld" for joint in joints)


def check_contacts(scene: Scene, dynamics: str) -> None:
    """Bodies that touch and part again, rub, or move freely, move by the coupled equations alone."""
    for name, contact in scene.contacts.items() if dynamics != "coupled" else ():
        what = "a contact" if contact.joint is None else "a joint with a clearance"
        reason = f"preset {scene.solve.preset} has no equations of {what}"
        raise SceneError(contact.stands(name), None, reason, "Take preset coupled")
    for name in scene.floating:
        if dynamics != "coupled":
            reason = f"preset {scene.solve.preset} has no equations of a body that moves freely"
            raise SceneError(f"bodies.{name}.free", None, reason, "Take preset coupled")
        if scene.solve.start in ("quasistatic", "periodic"):
            reason = f"bodies.{name} is free: nothing holds it in equilibrium or brings it back"
            raise SceneError("solve.start", scene.solve.start, reason, "Start from zero, or from a given state")
    for name in scene.frictions if dynamics != "coupled" else ():
        reason = f"preset {scene.solve.preset} has no equations of friction"
        raise SceneError(f"joints.{name}.friction", None, reason, "Take preset coupled")
    if scene.solve.integrator == "scipy":
        reason = "it would step over what changes there"
        refuse_contacts(scene, "solve.integrator", "scipy", reason, "Take radau or gauss")
    if scene.solve.start == "quasistatic":
        reason = "its equilibrium is not that of free bodies"
        refuse_contacts(scene, "solve.start", "quasistatic", reason, "Start from zero, or from a given state")
    if scene.solve.start == "periodic":
        refuse_bristles(scene, "solve.start", "periodic")


def check_laws(scene: Scene, dynamics: str) -> None:
    """Laws of loads in what only preset coupled computes, or that only its error control takes."""
    free = next((name for name, drive in scene.drives.items() if drive.free), None)
    for name, load in scene.loads.items():
        law, key = scene.argument(name), f"loads.{name}.{'law' if load.against is None else 'against'}"
        if law is None:
            continue
        given = load.law or load.against
        strange = next((joint for joint in scene.observed if law.uses_any([joint])), None)
        jump, preset = load_jump(scene, law), scene.solve.preset
        if strange is not None and dynamics != "coupled":
            reason = f"under preset {preset} laws and tables know the joints that have a drive: {strange} has none"
            raise SceneError(key, given, reason, "Take preset coupled, or a joint that has a drive")
        if jump is not None and free is not None and dynamics != "coupled":
            reason = f"{jump} jumps, which preset {preset} would step over as it integrates {free}"
            raise SceneError(key, load.law, reason, f"Take preset coupled, or a smooth law: {_SMOOTH}")
        if jump is not None and scene.solve.integrator == "scipy" and dynamics == "coupled":
            reason = f"{jump} jumps, which scipy's Radau would step over"
            raise SceneError(key, load.law, reason, "Take integrator radau or gauss, which end a step there")


_STATELESS = {
    "rigid": "nothing deforms: there is no state of deformation to start from",
    "quasistatic": "preset quasistatic solves each instant by itself, whatever went before",
    "frozen": "preset paper always starts from rest",
}
"""Why a kind of dynamics starts from no given state."""


def check_options(options: Options) -> None:
    """Start, reduction and integrator must fit each other and the kind of dynamics."""
    start, dynamics, integrator = options.start, options.dynamics, options.integrator
    exact = integrator == "exact-modal"
    refuse(
        (start == "given" and dynamics in _STATELESS, "solve.start", "a table of a state", _STATELESS.get(dynamics, ""),
         "Take preset linear, stiffened or coupled with an elastic body, or solve.start = zero"),
        (start == "periodic" and dynamics in ("dynamic", "coupled") and not options.cycles, "solve.start", "periodic",
         "there is no cycle to repeat: solve.duration sets a horizon of its own",
         "Give a drive a cycle and no duration, or start from zero or quasistatic"),
        (dynamics == "frozen" and options.reduction != "modal", "solve.reduction", options.reduction,
         f"preset {options.preset} superposes modes of the whole mechanism", "Leave the reduction out"),
        (start == "periodic" and dynamics == "dynamic" and integrator == "scipy", "solve.integrator", "scipy",
         "it finds no periodic state, and solve.start is periodic",
         "Start from zero or quasistatic, like --set solve.start=quasistatic, or take another integrator"),
        (start != "periodic" and dynamics == "dynamic" and integrator == "spectral", "solve.integrator", "spectral",
         f"it finds periodic motions, and solve.start is {start}",
         "Take radau, or start periodic, like --set solve.start=periodic"),
        (options.bounded and dynamics == "coupled" and integrator == "scipy", "solve.bounded", list(options.bounded),
         "scipy's Radau bounds what it integrates, by solve.tolerance",
         "Leave it out, or take the integrator radau or gauss"),
        (exact != (dynamics == "frozen") and dynamics in ("frozen", "dynamic"), "solve.integrator", integrator,
         f"the equations of preset {options.preset} are {'coupled' if exact else 'decoupled'}",
         "Use radau, generalised-alpha or newmark" if exact else "Leave the integrator out"),
    )  # fmt: skip
