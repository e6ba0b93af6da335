"""Export of a scene as one readable Python module: rigid motion, elements, joints, modes, integration and sensors."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator

from kaneflex.export import standalone_text as parts
from kaneflex.export.standalone_numbers import ELSE, LINE, assigned, data, filled, functions, tables
from kaneflex.export.standalone_points import Points
from kaneflex.export.standalone_sensors import sensor_text
from kaneflex.integrate.system import Trajectory
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_bodies import carried_bodies
from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.support.errors import SceneError
from kaneflex.support.escaping import visible

MOST_LINES = 400
"""Largest number of lines of a readable file."""


def standalone(scene: Scene, progress: Callable[[str], None] = lambda stage: None) -> str:
    """Text of one module that solves a scene with numpy only.

    Raises
    ------
    SceneError
        For features that the file does not support; names the entry.
    """
    _check_scene(scene)
    model = load(scene, progress)
    _check_model(model)
    progress("solving")
    begun = solve(model).trajectory
    assert isinstance(begun, Trajectory)  # one-way preset
    from kaneflex.derive.standalone import element_text

    geometric = model.options.geometric
    progress("element matrices")
    points = Points(model)
    text = "".join([
        filled(parts.HEAD, title=_title(scene), plus=" + K_g" * geometric, tension=parts.TENSION * geometric),
        *tables(model),
        f"{data(points)}\n",
        *functions(model),
        f"\n\n{element_text()}",
        filled(parts.KINEMATICS, less=" - GRAVITY" * any(scene.gravity)),
        filled(parts.EQUATIONS, K_g=parts.K_G * geometric),
        *_integration(model, begun),
        _foreshortening(points) if model.options.foreshortening else "",
        sensor_text(points),
    ])  # fmt: skip
    lines = text.count("\n")
    if lines > MOST_LINES:
        reason = f"the file would have {lines} lines, the limit is {MOST_LINES}"
        raise SceneError("--standalone", visible(scene.name), reason, ELSE)
    return text


def _check_scene(scene: Scene) -> None:
    """Raise SceneError for features that the file does not support, before anything is computed."""
    options = resolve_options(scene)
    if scene.is_spatial:
        raise SceneError("--standalone", "a mechanism in space", "only planar mechanisms are supported", ELSE)
    if options.dynamics != "dynamic":
        what = "no body is elastic" if options.dynamics == "rigid" else f"its equations are {options.dynamics}"
        raise SceneError("solve.preset", options.preset, f"{what}: the file needs linear, integrated equations",
                         f"Use --preset stiffened or linear with an elastic body. {ELSE}")  # fmt: skip
    left_out = [name for name in ("spin", "gyroscopic", "euler", "convective") if not getattr(options, name)]
    kinds = {"revolute", "prismatic", "weld"}
    damping = None if scene.damping is None else scene.damping.kind
    refused: list[tuple[object, str, object, str]] = [
        (options.reduction != "none", "solve.reduction", options.reduction, "the file does not support reductions"),
        (options.integrator not in ("radau", "spectral"), "solve.integrator", options.integrator,
         "the file supports radau and spectral only"),
        (left_out, "solve.terms", ", ".join(left_out), "the file needs all terms"),
        (damping not in (None, "rayleigh"), f"damping.{damping}", None, "the file supports Rayleigh damping only"),
        (damping and not options.damping, "solve.terms.damping", False, "the file needs the scene's damping"),
        (scene.springs, f"springs.{next(iter(scene.springs), '')}", None, "the file does not support springs"),
        (scene.torques, f"loads.{next(iter(scene.torques), '')}.torque_at", None, "the file does not support torques"),
        (scene.spreads, f"loads.{next(iter(scene.spreads), '')}.spread_on", None, "the file has no distributed loads"),
        (scene.contacts, f"contacts.{next(iter(scene.contacts), '')}", None, "the file does not support contacts"),
        (scene.events, f"events.{next(iter(scene.events), '')}", None, "the file does not support events"),
    ]  # fmt: skip
    refused += [(joint.kind not in kinds or joint.friction is not None, f"joints.{name}", joint.kind,
                 "the file has pins, guides and welds without friction only") for name, joint in scene.joints.items()]
    refused += [(drive.kind == "free", f"drives.{name}", "free", "the file does not support free drives")
                for name, drive in scene.drives.items()]
    beams = {name: body.beam for name, body in scene.bodies.items() if body.elastic and body.beam}
    refused += [((options.rotary and beam.rotary) or beam.shear, f"bodies.{name}.beam.theory", beam.theory,
                 "the file supports Euler-Bernoulli beams only") for name, beam in beams.items()]
    refused += [(body.beam and body.beam.axially_rigid, f"bodies.{name}.beam.axially_rigid", True,
                 "the file does not support axially rigid links") for name, body in scene.bodies.items()]
    for wrong, key, value, reason in refused:
        if wrong:
            raise SceneError(key, value, reason, ELSE)


def _check_model(model: Model) -> None:
    """Raise SceneError for unsupported features of the assembled model."""
    from kaneflex.derive.standalone import BEAM

    beam = getattr(model.module, "beam", None)
    if beam is None or not beam.__name__.endswith(f".{BEAM}"):
        raise SceneError("bodies", None, "the file does not support tapered beams", ELSE)
    if getattr(model.module, "LOOPS", ()):
        raise SceneError("joints", None, "the file does not support loops closed by Newton's method", ELSE)
    known = {monomial for affine in model.kept.values() for each in affine.terms for monomial in each}
    jumps = sorted(name for name in known if ".link.jump_" in name)
    if jumps:
        raise SceneError("loads", jumps[0], "the file does not support axial forces between a link's ends", ELSE)
    for (body, _), joint, _ in carried_bodies(mechanism_of(model.scene)):
        if not joint or model.scene.joints[joint].kind != "prismatic":
            raise SceneError(f"bodies.{body}", None, "the file has no rigid bodies carried without guide", ELSE)


def _title(scene: Scene) -> str:
    """Name and description as text within triple quotes, with quotes and backslashes replaced."""
    lines = textwrap.wrap(f"{visible(scene.name)}: {visible(scene.description)}", LINE - 6)
    return "\n".join(lines).replace("\\", "/").replace('"', "'")


def _foreshortening(points: Points) -> str:
    """Rows of each link at joints, and the functions that keep joints closed when bent links shorten."""
    held = {name: sorted(points.interfaces.held_rows(link.part)) for name, link in points.links.items()}
    return filled(parts.FORESHORTENING, held=assigned("HELD", held, "rows of each link at joints"))


# ---- integration ----


def _integration(model: Model, begun: Trajectory) -> Iterator[str]:
    """Text of the time steps or harmonics of the run."""
    if begun.solver.startswith("spectral"):
        from kaneflex.integrate.grid import MODES, SPARE
        from kaneflex.integrate.spectral import periodic_orbit

        options = model.options
        orbit = periodic_orbit(model.system, model.scalars, 0.0, options.duration, options.tolerance)
        yield filled(parts.SPECTRAL, grids=repr(orbit.grids), vectors=MODES + SPARE, modes=MODES)
        return
    yield parts.RADAU
    if model.options.start == "periodic":
        yield parts.REPEATED
        return
    z, v = (tuple(map(float, part[0])) for part in (begun.z, begun.v))
    start = "np.zeros((2, N))" if not any((*z, *v)) else None
    yield filled(parts.FROM_STATE, start=start or repr((z, v)))
