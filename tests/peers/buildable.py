"""Check of a scene's features that another program supports, and their parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from kaneflex import Scene, SceneError
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.parts import CIRCLES
from kaneflex.scene.options import Options
from kaneflex.scene.start import Start
from kaneflex.support.errors import Problem

_LEFT_OF_TRANSIENT = 1e-4
"""Share of the initial free vibration that may remain in a periodic cycle."""
_MOST_CYCLES = 60


def check_buildable(scene: Scene) -> None:
    """Raise SceneError with everything in a scene that the peer does not support; in space it supports all rigid
    scenes without friction whose contacts are of spheres."""
    planar = (_bodies, _joints, _drives, _forces, _damping, _solving)
    elastic = (_held_drives, _moving_guides, _spread, _damping, _solving)
    parts = planar if not scene.is_spatial else (*elastic, _touching) if has_elastic(scene) else (_touching,)
    problems = [problem for part in parts for problem in part(scene)]
    if problems:
        raise SceneError.gather(problems)


def has_elastic(scene: Scene) -> bool:
    """True if any of a scene's bodies is elastic."""
    return any(body.elastic for body in scene.bodies.values())


def touches(scene: Scene) -> bool:
    """True if a scene has contacts or clearances."""
    return bool(scene.contacts) or any(joint.clearance is not None for joint in scene.joints.values())


def _problem(key: str, value: object, reason: str) -> Problem:
    reason = f"{reason} is not supported by the other program"
    return Problem(key, value, reason, "Compare presets instead, or leave it out")


def _bodies(scene: Scene) -> Iterator[Problem]:
    if scene.is_frame:
        yield _problem("bodies", None, "a fixed structure")
    for name in scene.floating:
        yield _problem(f"bodies.{name}.free", None, "a free body")
    for name, body in scene.bodies.items():
        if not body.elastic:
            continue
        if body.beam.theory != "euler-bernoulli":
            yield _problem(f"bodies.{name}.beam.theory", body.beam.theory, "shear or rotary inertia")
        if body.profile.varying:
            yield _problem(f"bodies.{name}.beam", None, "a section that varies")
        if body.beam.axially_rigid:
            yield _problem(f"bodies.{name}.beam.axially_rigid", True, "an axially rigid beam")
        for point, (_, y) in body.points_all.items():
            if y:
                yield _problem(f"bodies.{name}.points.{point}", None, "a point off the axis of an elastic link")
    for name, mass in scene.masses.items():
        if mass.inertia and mass.at.body != "ground" and scene.bodies[mass.at.body].elastic:
            yield _problem(f"masses.{name}.inertia", mass.inertia, "a lumped inertia on an elastic link")


def _spread(scene: Scene) -> Iterator[Problem]:
    for name, load in scene.spreads.items():
        if scene.bodies[str(load.spread_on)].elastic:
            yield _problem(f"loads.{name}.spread_on", load.spread_on, "a load spread along an elastic link in space")


def _joints(scene: Scene) -> Iterator[Problem]:
    for name, joint in scene.joints.items():
        elastic = [side.body for side in joint.addresses if side.body != "ground" and scene.bodies[side.body].elastic]
        if joint.kind == "weld":
            yield _problem(f"joints.{name}", "weld", "a weld")
        elif joint.kind == "prismatic" and elastic:
            yield _problem(f"joints.{name}", "prismatic", "a guide on an elastic link")
        elif joint.rotation == "shared":
            yield _problem(f"joints.{name}.rotation", "shared", "an elastic rotation shared at a pin")


def _drives(scene: Scene) -> Iterator[Problem]:
    for name, drive in scene.drives.items():
        joint = scene.joints[name]
        if drive.kind == "free":
            continue
        if joint.kind != "revolute" or "ground" not in [side.body for side in joint.addresses]:
            yield _problem(f"drives.{name}", drive.kind, "a drive that does not rotate a body relative to the ground")
    yield from _held_drives(scene)


def _held_drives(scene: Scene) -> Iterator[Problem]:
    for name, drive in scene.drives.items():
        if drive.kind != "free" and drive.rotation == "free":
            yield _problem(f"drives.{name}.rotation", "free", "a drive that leaves the elastic rotation free")


def _moving_guides(scene: Scene) -> Iterator[Problem]:
    for name, drive in scene.drives.items():
        joint = scene.joints[name]
        carrier = joint.addresses[0].body
        if drive.kind != "free" and joint.kind == "prismatic" and carrier != "ground" and scene.bodies[carrier].elastic:
            yield _problem(f"drives.{name}", drive.kind, "a drive along a guide on an elastic link")


def _forces(scene: Scene) -> Iterator[Problem]:
    free = any(drive.kind == "free" for drive in scene.drives.values())
    for name, load in scene.loads.items():
        if load.torque_at is not None:
            if torque_by_speed(scene, name) is None:
                what = "a torque at a joint that is not linear in the speed of that joint alone"
                yield _problem(f"loads.{name}", "torque_at", what)
        elif load.axes == "body":
            yield _problem(f"loads.{name}.axes", "body", "a force that turns with its body")
        elif free and load.kind != "value":
            yield _problem(f"loads.{name}", load.kind, "a force that depends on the motion of a free joint")
    for name in scene.springs:
        yield _problem(f"springs.{name}", None, "a spring")
    for name in scene.contacts:
        yield _problem(f"contacts.{name}", None, "a contact")


def _touching(scene: Scene) -> Iterator[Problem]:
    mechanism = mechanism_of(scene)
    keys = {name: f"contacts.{name}" if contact.joint is None else f"joints.{contact.joint}.clearance"
            for name, contact in mechanism.contacts.items()}  # fmt: skip
    for name, contact in mechanism.contacts.items():
        if contact.kind not in CIRCLES or any(contact.direction):
            yield _problem(keys[name], None, "a contact of other shapes than spheres")
        elif contact.law not in ("hertz", "hunt-crossley"):
            yield _problem(f"{keys[name]}.contact.law", contact.law, "this law")
    for name in mechanism.frictions:
        yield _problem(f"{keys.get(name, f'joints.{name}')}.friction", None, "friction")


def _damping(scene: Scene) -> Iterator[Problem]:
    if scene.damping is not None and scene.damping.kind != "rayleigh":
        yield _problem("damping", scene.damping.kind, "damping other than Rayleigh's")


def torque_by_speed(scene: Scene, name: str) -> tuple[float, float] | None:
    """Constants T_0 [N m] and c [N m s/rad] of a load T_0 + c omega with its joint's speed omega; None for others."""
    load, law = scene.loads[name], scene.law(name)
    if law is None:
        return None if load.value is None else (load.value, 0.0)
    own = f"{load.torque_at}_speed"
    if law.kinks() or any(law.uses(other) for other in scene.law_names() if other != own):
        return None
    speeds = np.array([0.0, 1.0, -100.0, 1e4])
    sizes = law.on_arrays({own: speeds, "t": np.zeros(4)})
    at_rest, slope = sizes[0], sizes[1] - sizes[0]
    straight = at_rest + slope * speeds
    return (float(at_rest), float(slope)) if np.allclose(sizes, straight, rtol=1e-9, atol=1e-12) else None


def _solving(scene: Scene) -> Iterator[Problem]:
    if scene.solve.start == "quasistatic":
        yield Problem(
            "solve.start", "quasistatic", "the other program starts from the undeformed state", "Set solve.start=zero"
        )
    if isinstance(scene.solve.start, Start):
        yield _problem("solve.start", None, "a state to start from")
    if scene.solve.start == "periodic" and (scene.damping is None or not scene.damping.rayleigh):
        yield Problem(
            "solve.start", "periodic", "the other program runs until transients decay, which needs Rayleigh damping",
            "Set solve.start=zero and a duration, or give damping",
        )  # fmt: skip


def stiffness_damping(scene: Scene) -> float:
    """Coefficient beta [s] of damping proportional to the stiffness alone, with the ratio at the lower of Rayleigh's
    frequencies."""
    # ratio = pi f beta where stiffness alone damps a vibration of frequency f
    damping = scene.damping
    return 0.0 if damping is None else damping.rayleigh.ratio / (math.pi * min(damping.rayleigh.at))


def cycles_to_steady_state(scene: Scene, options: Options) -> int:
    """Number of cycles from the undeformed state until the last one is periodic; 1 for a run without repetition.

    The slowest vibration decays with exp(-ratio omega t), omega at the lower of Rayleigh's two frequencies.

    Raises
    ------
    SceneError
        Where that takes too many.
    """
    if options.start != "periodic" or not options.cycles:
        return 1
    rayleigh = scene.damping.rayleigh
    decay = rayleigh.ratio * 2.0 * math.pi * min(rayleigh.at) * scene.period
    cycles = 1 + math.ceil(-math.log(_LEFT_OF_TRANSIENT) / decay) if decay else math.inf
    if cycles > _MOST_CYCLES:
        raise SceneError(
            "damping.rayleigh.ratio", rayleigh.ratio, f"the other program needs {cycles} cycles until transients decay",
            "Set solve.start=zero",
        )  # fmt: skip
    return cycles


def lumped(scene: Scene, name: str) -> tuple[float, tuple[float, float], float]:
    """Mass [kg], centre in the body's axes [m] and inertia about it [kg m^2] of a rigid body with its lumped masses."""
    body = scene.bodies[name]
    parts = [(body.mass, body.centre, body.inertia)]
    parts += [(mass.mass, scene.point(mass.at), mass.inertia) for mass in scene.masses.values() if mass.at.body == name]
    total = sum(mass for mass, *_ in parts)
    if total == 0.0:
        return 0.0, body.centre, sum(inertia for *_, inertia in parts)
    centre = tuple(sum(mass * at[k] for mass, at, _ in parts) / total for k in (0, 1))
    inertia = sum(J + mass * math.dist(at, centre) ** 2 for mass, at, J in parts)
    return total, centre, inertia
