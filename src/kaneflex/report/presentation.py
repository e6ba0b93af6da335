"""Description of a scene in words, for `kaneflex check` and `show`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.closure import courses_of, instants, reach_line, reach_lines
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.scene.options import has_term
from kaneflex.scene.parts import PRESETS, SEVERAL_FREEDOMS, TERM_NAMES
from kaneflex.support.errors import counted
from kaneflex.support.terminal import block

if TYPE_CHECKING:
    from kaneflex.fem.freedom import Freedom
    from kaneflex.mechanism.dead_centres import Closing
    from kaneflex.mechanism.rigid_motion import RigidMotion
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.multibody.model.state import Choice
    from kaneflex.multibody.model.system import System
    from kaneflex.scene import Scene
    from kaneflex.scene.bodies import Body
    from kaneflex.scene.contact_law import Friction
    from kaneflex.scene.contacts import Contact
    from kaneflex.scene.drives import Drive
    from kaneflex.scene.parts import Joint, Load, Mass
    from kaneflex.scene.sensors import Event
    from kaneflex.scene.springs import Spring

_LONGEST = 72
"""Largest number of characters of a law that are shown."""
Blocks = dict[str, Mapping[str, str]]
"""Texts by name, under titles."""


def printed(scene: Scene, blocks: Blocks) -> str:
    """A scene's name and description, and below them blocks."""
    below = (block(title, texts) for title, texts in blocks.items() if texts)
    return "\n".join([f"{scene.name}: {scene.description}", *below])


def as_json(scene: Scene, blocks: Blocks, **more: object) -> str:
    """The same as JSON."""
    plain = {title: {name: text.strip() for name, text in texts.items()} for title, texts in blocks.items() if texts}
    data = {"scene": scene.name, "description": scene.description, **plain, **more}
    return json.dumps(data, indent=2, ensure_ascii=False)


def modelled(model: Model) -> Blocks:
    """The mechanism and its options; the same on any machine."""
    return {
        **parts(model.scene),
        "assumptions": model.scene.assumptions,
        "over the run" if is_followed(model) else "at the start": _reach(model),
        "options": _options(model),
    }


def is_followed(model: Model) -> bool:
    """True if the rigid motion over the run is known: under preset coupled with free joints only its start is."""
    known = not model.motion.is_start and not (model.coupled is not None and model.module.FREE)
    return bool(model.scene.drives) and known


def _reach(model: Model) -> dict[str, str]:
    """Ranges of the joints in the rigid mechanism."""
    if model.scene.is_frame:
        return {}
    mechanism = mechanism_of(model.scene)
    times = model.motion.begin + (instants(mechanism) if is_followed(model) else np.zeros(1))
    if model.in_space is not None:
        return _ranges(model, model.in_space.rigid_only.at(times))
    return reach_lines(mechanism, courses_of(mechanism, model.motion.at(times)))


def _ranges(model: Model, rigid: RigidMotion) -> dict[str, str]:
    """Least and greatest coordinates of the joints in space that have one."""
    mechanism, joints = mechanism_of(model.scene), model.scene.joints
    return {name: reach_line(mechanism, rigid[f"{name}.angle"], joints[name].kind == "prismatic")
            for name in model.module.coordinates}  # fmt: skip


def spatial_mobility(system: System, choice: Choice) -> Blocks:
    """Degrees of freedom of a mechanism in space, by the rank of its joints' constraints."""
    left, tied = len(choice.independent), len(choice.dependent)
    rows, speeds = len(system.work.row_measure), system.engine.size
    spare = rows - tied
    free = ", ".join(system.mechanism.free_joints)
    return {"degrees of freedom": {
        "joints": f"{speeds} at {', '.join([*system.layout.tree, *system.mechanism.floating])}",
        **({"closing": f"{counted(rows, 'constraint')} at {', '.join(system.layout.cuts)}"
            + (f", {spare} of them redundant" if spare else "")} if rows else {}),
        "driven": f"{len(system.driven)}",
        "left": f"{left}" + (f", free: {free}" if free else ""),
    }}  # fmt: skip


def _options(model: Model) -> dict[str, str]:
    """Every option of a run in words, with its unit; options that the preset does not use are left out."""
    options, dynamics = model.options, model.options.dynamics
    per = "in a cycle" if options.cycles else "in the run"
    shown = {
        "preset": f"{options.preset}: {PRESETS[options.preset]}",
        "duration": f"{_time(options.duration)}{', one cycle' if options.cycles else ''}",
        "steps": f"{options.steps} {per}, {_time(model.step)} each",
    }
    if model.module.FREE and dynamics != "coupled":
        shown["forward"] = f"free joints, tolerance {options.forward_tolerance:g}"
    if dynamics == "rigid":
        return shown
    if dynamics == "coupled":
        error = f"tolerance {options.tolerance:g} of the longest body's length"
        bounded = f", for {' and '.join(options.bounded)} of their largest value" if options.bounded else ""
        shown["integrator"] = f"{options.integrator}, {error}{bounded}"
        shown["start"] = _STARTS[options.start]
        bodies = model.scene.bodies
        elements = {name: len(link.nodes) - 1 for name, link in model.links.items()}
        if model.in_space is not None:  # whose shapes are the motion's own
            elements = {name: options.elements or body.beam.elements for name, body in bodies.items() if body.beam}
        modal = any(body.modal is not None for body in bodies.values())
        shown["shapes"] = "those of the modal data" if modal else "none: all bodies are rigid"
        if elements:
            shown["shapes"] = f"static ones and {counted(options.modes, 'mode')} of each link"
            shown["elements"] = ", ".join(f"{name} {count}" for name, count in elements.items())
        return shown
    if options.integrator == "spectral":  # which chooses its own instants
        shown["steps"] = f"{counted(options.steps, 'stored instant')} {per}, {_time(model.step)} apart"
    if dynamics in ("dynamic", "frozen"):
        own = f", spectral radius {options.rho_infinity:g} at infinite frequency"
        shown["integrator"] = options.integrator + (own if options.integrator == "generalised-alpha" else "")
        shown["start"] = _STARTS[options.start]
    terms = [name for name in TERM_NAMES if getattr(options, name) and has_term(model.scene, name)]
    turning = ["rotation of the joint axes"] if options.convective and dynamics != "quasistatic" else []
    shown["terms"] = ", ".join([*terms, *turning]) or "none"
    shown["elements"] = ", ".join(f"{name} {len(link.nodes) - 1}" for name, link in model.links.items())
    shown["pins"] = "elastic rotation shared" if options.weld_pins else "elastic rotation released unless shared"
    shown["drives"] = "elastic rotation free" if options.free_drives else "elastic rotation held unless free"
    shown["shortening"] = "included in the displacements" if options.foreshortening else "left out"
    kept = counted(options.modes, "mode")
    of = {"craig-bampton": f", {kept} of each link", "modal": f", {kept} of the mechanism", "none": ""}
    shown["reduction"] = options.reduction + of[options.reduction]
    shown["mode angle"] = model.reference_position or "none: nothing is driven"
    return shown


_STARTS = {
    "zero": "undeformed", "quasistatic": "quasi-static deformation", "periodic": "periodic",
    "given": "state given in the scene",
}  # fmt: skip


def _time(seconds: float) -> str:
    for unit, factor in (("s", 1.0), ("ms", 1e3)):
        if seconds * factor >= 1.0:
            return f"{seconds * factor:.6g} {unit}"
    return f"{1e6 * seconds:.6g} us"


def parts(scene: Scene) -> Blocks:
    """Bodies, joints, loads, sensors and all other parts of a mechanism."""
    in_space = scene.is_spatial
    closing = () if in_space else scene.loop_joints()
    return {
        "bodies": {name: _body(body) for name, body in scene.bodies.items()},
        "joints": {name: _joint(joint, name in closing) for name, joint in scene.joints.items()},
        "masses": {name: _mass(mass) for name, mass in scene.masses.items()},
        "drives": {name: _drive(scene, name) for name in scene.drives},
        "loads": {name: _load(load) for name, load in scene.loads.items()},
        "springs": {name: _spring(spring) for name, spring in scene.springs.items()},
        "contacts": {name: contact_line(contact, in_space) for name, contact in scene.contacts.items()},
        "friction": {name: friction_line(friction) for name, friction in scene.frictions.items()},
        "sensors": {name: scene.meaning_of(sensor) for name, sensor in scene.sensors.items()},
        "events": {name: _event(scene, event) for name, event in scene.events.items()},
    }


def mobility(count: Freedom, elastic: int | None, by_rank: int | None = None) -> Blocks:
    """The count of the degrees of freedom; ``elastic`` and ``by_rank``, what the joints leave where the bodies stand,
    are None where that is not known."""
    taken = ", ".join(f"{name} {number}" for name, number in count.constraints.items())
    rows = {
        "bodies": (3 * count.bodies, f"{count.bodies} with 3 each"),
        "joints": (-sum(count.constraints.values()), taken),
        "drives": (-len(count.prescribed), ", ".join(count.prescribed)),
        **({"free joints": (-len(count.free), ", ".join(count.free))} if count.free else {}),
        **({"free bodies": (-3 * len(count.floating), ", ".join(count.floating))} if count.floating else {}),
        "left": (count.left, count.verdict),
    }
    if by_rank is not None and by_rank != count.mobility and not count.still:
        reason = "redundant for these lengths and angles, so reactions are statically indeterminate"
        words = f"without drives, by the rank of the constraints: {by_rank - count.mobility} {reason}"
        rows["by rank"] = (by_rank, f"{words}; preset coupled supports this")
    if elastic is not None:
        rows["elastic"] = (elastic, "displacements and rotations of the links, before any reduction to modes")
    return {"degrees of freedom": {name: f"{n:4d}  {text}".rstrip() for name, (n, text) in rows.items()}}


def closing_lines(found: Sequence[Closing]) -> dict[str, str]:
    """Distance of loops from dead centres, below what :func:`~kaneflex.mechanism.closure.reach_lines` has."""
    kinds = {"transmission angle": True, "smallest singular value": False}
    lines = {kind: "\n".join(each.text for each in found if each.is_angle is angle) for kind, angle in kinds.items()}
    return {kind: text for kind, text in lines.items() if text}


def _body(body: Body) -> str:
    kind = f"elastic, {counted(body.beam.elements, 'element')}" if body.elastic else "rigid"
    kind = kind if body.modal is None else "elastic by modal data"
    length = "" if body.length is None else f", {1e3 * body.length:.6g} mm"
    return f"{kind}{length}, {body.mass:.6g} kg"


def _mass(mass: Mass) -> str:
    inertia = np.atleast_1d(mass.inertia)
    about = f", {', '.join(f'{x:.6g}' for x in inertia)} kg m^2" if inertia.any() else ""
    return f"{mass.mass:.6g} kg{about} at {mass.at}"


def _joint(joint: Joint, closes: bool) -> str:
    near = " and ".join(f"{body} near {math.degrees(angle):.4g} deg" for body, angle in joint.near.items())
    closing = f", closes a loop, {near or f'branch {joint.branch}'}" if closes else ""
    return f"{joint.kind}, {joint.addresses[0]} to {joint.addresses[1]}{closing}"


def _load(load: Load) -> str:
    size = f"{load.value:.6g} {load.si_unit}" if load.kind == "value" else _course(load)
    if load.spread_on is not None:
        return f"{size} spread along {load.spread_on}, from {load.profile[0]:g} to {load.profile[1]:g} of its size"
    return f"{size} on {load.force_on}" if load.force_on is not None else f"{size} at {load.torque_at}"


def _course(given: Load | Drive) -> str:
    """Law of a load, or the file of its table."""
    if given.table is not None:
        return f"table {Path(given.table).name}"
    law = f"law {given.law}"
    return law if len(law) <= _LONGEST else f"{law[: _LONGEST - 3]}..."


def _spring(spring: Spring) -> str:
    if spring.bushing is not None:
        stiff, damped = (", ".join(f"{each:.6g}" for each in of) for of in (spring.stiffnesses, spring.dampings))
        first, second = spring.bushing
        return f"{first} to {second}: {stiff} N/m and N m/rad, {damped} N s/m and N m s/rad in {first.body}'s axes"
    per, where = ("N m{}/rad", f"at {spring.torsional_at}")
    if spring.ends:
        per, where = ("N{}/m", f"{spring.ends[0]} to {spring.ends[1]}, free length {1e3 * spring.length:.6g} mm")
    return f"{spring.stiffness:.6g} {per.format('')}, {spring.damping:.6g} {per.format(' s')}, {where}"


def _event(scene: Scene, event: Event) -> str:
    ways = {"up": "upwards", "down": "downwards", "both": "either way"}[event.direction]
    unit = scene.sensors[event.sensor].unit
    ending = ", which ends the run" if event.stop else ""
    return f"{event.sensor} passes {scene.level(event):.6g} {unit} {ways}{ending}"


def _drive(scene: Scene, name: str) -> str:
    drive = scene.drives[name]
    start = mechanism_of(scene).written_coordinate(name, drive.start)
    cycle = "" if drive.cycle is None else f", a cycle of {math.degrees(drive.cycle):.6g} deg"
    if drive.kind in ("law", "table"):
        return _course(drive)
    if drive.kind == "free" and scene.is_spatial and scene.joints[name].kind in SEVERAL_FREEDOMS:
        if drive.initial_speeds is not None:
            first, second = drive.initial_speeds
            unit = "m/s" if scene.joints[name].kind == "cylindrical" else "rad/s"
            return f"free, at {first:.6g} {unit}, {second:.6g} rad/s"
        turning = " ".join(f"{omega:.6g}" for omega in drive.angular_velocity or ())
        return f"free, at {turning} rad/s in its axes" if turning else "free"
    if drive.kind == "free":
        return f"free, from {start} at {scene.written_speed(name, drive.initial_speed)}"
    if drive.kind == "spin up":
        cycle = f", reached in {drive.spin_up:.6g} s"
    return f"{scene.written_speed(name, drive.speed)} from {start}{cycle}"


_SIDES = {
    "point-line": "{1} in front of the line through {0}",
    "point-plane": "{1} in front of the plane through {0}", "circle-circle": "circles about {1} and {0}",
    "circle-in-circle": "circle about {1} in the circle about {0}", "angle": "flank of {0} that turns {1} {way}",
}  # fmt: skip

_CORNERS = {
    (True, False): "corner of {1.body} at a face of {0}", (False, True): "end of {1} in the bearing {0}",
    (False, False): "{1} at a face beside {0}",
}  # fmt: skip
"""Sides of a clearance's contact, by whether the joint is a guide, and whether a bearing is touched."""


def contact_line(contact: Contact, in_space: bool = False) -> str:
    """Line of a contact: its two sides, stiffness and restitution."""
    from kaneflex.scene.clearances import ClearanceContact

    where = _SIDES[contact.kind].format(*contact.sides, way="forwards" if contact.direction[0] > 0 else "back")
    where = where.replace("circle", "sphere") if in_space else where
    if contact.axis is not None:
        where = f"sphere about {contact.sides[1]} {'in' if contact.kind == 'circle-in-circle' else 'on'} the cylinder"
        where += f" about {contact.sides[0]}"
    if isinstance(contact, ClearanceContact) and contact.corner:
        where = _CORNERS[contact.of_kind == "prismatic", contact.kind == "circle-in-circle"].format(*contact.sides)
    stiffness, exponent = contact.pushing
    if isinstance(contact, ClearanceContact) and contact.kind == "angle":
        law = f"{stiffness:.4g} N m/rad" + ("" if exponent == 1 else f"^{exponent:.4g}")
        law = "rigid" if contact.law == "newton" else law
        return f"{where}, {math.degrees(contact.room):.6g} deg from the middle, {law}, {restitution_line(contact)}"
    if isinstance(contact, ClearanceContact):
        where += f", clearance {1e3 * contact.room:.6g} mm"
    if contact.law == "newton":
        return f"{where}, rigid, {restitution_line(contact)}"
    unit = "N/m" if exponent == 1 else f"N/m^{exponent:.4g}"
    return f"{where}, {stiffness:.4g} {unit}, {restitution_line(contact)}"


def restitution_line(contact: Contact) -> str:
    """A contact law and the restitution of a single impact; the requested one if the law does not reach it."""
    law, asked = contact.law, contact.contact.restitution
    if law == "kelvin-voigt":
        unit = "N m s/rad" if contact.kind == "angle" else "N s/m"
        return f"law {law}, damping {contact.contact.damping:.6g} {unit}, its restitution depends on the masses"
    if law == "newton" or asked is None:
        return f"law {law}, restitution {1.0 if asked is None else asked:.3g}"
    from kaneflex.mechanism.contacts import hysteresis, restitution_of

    found = restitution_of(hysteresis(law, asked))
    return f"law {law}, restitution {found:.3g}" + ("" if law == "exact" else f", requested {asked:.3g}")


def friction_line(friction: Friction) -> str:
    """A friction's law with its numbers."""
    keys = ("mu", "mu_static", "preload", "viscous", "bristle_stiffness", "bristle_damping", "wear")
    found = {key: getattr(friction, key) for key in keys}
    numbers = ", ".join(f"{key} {value:.4g}" for key, value in found.items() if value)
    return f"{friction.law}, {numbers}" + " m^2/N" * (friction.wear is not None)
