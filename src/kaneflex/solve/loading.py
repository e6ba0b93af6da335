"""Loading of a scene: find or derive its module, bind the numbers, check that it closes, build the model."""

from __future__ import annotations

import copyreg
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.fem.mobility import check_determined, check_free
from kaneflex.mechanism.closure import SWEEP, check_closure, drive_positions
from kaneflex.mechanism.mechanism import mechanism_of, same_mechanism
from kaneflex.mechanism.rigid_bodies import check_elastic, check_on_axes
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model, model_without_equations
from kaneflex.multibody.model.module_loading import bind_parameters, find_laws_module, find_module
from kaneflex.scene import Scene
from kaneflex.scene.options import (
    UNUSED_TERMS,
    Options,
    acting,
    has_term,
    limits_modes,
    modes_of,
    resolve_options,
    without_poses,
)
from kaneflex.scene.plausible import implausible
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.run_checks import MAX_STORED, check_laws, check_memory
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import compiled_by, silent

if TYPE_CHECKING:
    from kaneflex.mechanism.position_analysis import Placement
    from kaneflex.multibody.time.rigid_reference import ReferenceKinematics

Progress = Callable[[str], None]
_POSED = 1e-6
"""Share of a structure's size by which welds may move a body from its pose."""
ONE_WAY = "{joints} moves as in the rigid mechanism: the deformation does not act back on its motion"
"""Note of every run with free joints."""


def _pickled(model: Model) -> tuple[Callable[[Scene], Model], tuple[Scene]]:
    """Pickle a model as its scene and load it again: kernels and addresses belong to one process."""
    return load, (model.scene if model.given is None else model.given,)


copyreg.pickle(Model, _pickled)


@takes(scene="scene", progress="function", like="loaded")
def load(scene: SceneLike, progress: Progress | None = None, like: Model | None = None) -> Model:
    """Bind a scene to its generated module.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
    progress : callable, optional
        Called with the name of each stage that can take longer than a moment.
    like : Model, optional
        Model of a similar scene, whose equations are reused if they are the same; saves time only.

    Returns
    -------
    Model

    Raises
    ------
    SceneError
        If the linkage can't close over the drives' range, or the scene uses a feature that its preset lacks.
    """
    given, progress = scene_from(scene), progress or silent
    started, options = time.perf_counter(), resolve_options(given)
    if given.is_spatial:
        from kaneflex.solve.spatial_loading import bind_in_space

        model, notes, seconds = bind_in_space(acting(given, options), options, progress)
        notes = (*ignored_of(given, options), *notes)
    elif options.dynamics == "coupled":
        model, notes, seconds = _bind_coupled(given, options, progress)
    else:
        model, notes, seconds = _bind_one_way(given, options, progress, like)
    seconds["set_up"] = time.perf_counter() - started - sum(seconds.values())
    model = replace(model, warnings=(*_warnings(model), *notes, *_one_way_joints(model)), seconds=seconds, given=given)
    _check_start(model)
    return model


def model_from(given: SceneLike) -> Model:
    """Model of a Model or a Solution; a Scene or a path is loaded."""
    found = getattr(given, "model", given)
    return found if isinstance(found, Model) else load(found)


def _bind_one_way(
    scene: Scene, options: Options, progress: Progress, like: Model | None
) -> tuple[Model, tuple[str, ...], dict[str, float]]:
    """Model of a planar scene of a one-way preset, notes on entries without effect, and the seconds of derivation and
    compilation."""
    if like is None or like.coupled is not None or not same_mechanism(scene, like.scene):  # coupled ones may have more
        check_determined(mechanism_of(scene))
        check_free(mechanism_of(scene))
    scene = _as_it_starts(scene)
    if options.dynamics != "rigid" and scene.is_elastic:
        check_elastic(scene)
    (module, derived), compiled = find_module(scene, progress), 0.0
    ignored, scene = ignored_of(scene, options), acting(scene, options)
    check_memory(mechanism_of(scene), options, len(module.SCALARS))
    motion = RigidKinematics(module, bind_parameters(scene, module))
    if getattr(module, "LOOPS", ()):
        from kaneflex.mechanism.closure_continuation import seed_loops

        progress("following the linkage over its drive's range")
        motion = RigidKinematics(module, seed_loops(mechanism_of(scene), module, motion.parameters, options.duration))
    if module.FREE:
        from kaneflex.multibody.model.assembly import rigid_system
        from kaneflex.solve.forward import at_start

        laws, more = find_laws_module(scene, progress)
        system = rigid_system(mechanism_of(scene), laws, bind_parameters(scene, laws))
        derived, compiled = derived + more, compiled_by(progress, system.engine.compile)
        motion = at_start(system, motion)
    else:
        check_closure(mechanism_of(scene), motion, options.duration)
        check_laws(model_without_equations(scene, options, motion))
    return build_model(scene, options, motion, like=like), ignored, {"derive": derived, "compile": compiled}


def _as_it_starts(scene: Scene) -> Scene:
    """Scene with the start of its free joints, and branches, where other entries determine them."""
    if not (scene.loose or any(joint.near for joint in scene.joints.values())):
        return scene
    from kaneflex.mechanism.tight_start import as_it_starts

    return as_it_starts(scene)


def _warnings(model: Model) -> tuple[str, ...]:
    """Warnings of a model and its scene; those of its equations follow from the motion, which may not be known yet."""
    return (*(() if model.motion.is_start else model.warnings), *implausible(model.scene))


def _one_way_joints(model: Model) -> tuple[str, ...]:
    """Note on free joints that don't follow the deformation."""
    free = () if model.options.dynamics in ("rigid", "coupled") else model.module.FREE
    return (ONE_WAY.format(joints=", ".join(free)),) if free else ()


def _check_start(model: Model) -> None:
    """Raise SceneError if the model can't start from the given state, or bodies penetrate each other at the start."""
    if model.options.start != "given" or model.coupled_in_space is not None:  # in space it is checked already
        if model.scene.contacts:
            from kaneflex.solve.initial import check_apart

            check_apart(model)
        return
    if model.coupled is None:
        from kaneflex.solve.initial import given_state

        given_state(model)
    else:
        from kaneflex.solve.coupled import beginning

        beginning(model)


def has_elastic_stage(scene: Scene) -> bool:
    """True if linear equations about the rigid mechanism exist besides the coupled ones, for modes and coordinates.

    They don't without elastic bodies, with freely moving or overconstrained bodies, with rigid bodies that can't follow
    the links, or with laws of joints without drive.
    """
    deforms = any(body.deforms for body in scene.bodies.values())
    if scene.floating or scene.observed or not deforms or check_determined(mechanism_of(scene), twice=True):
        return False
    try:
        check_free(mechanism_of(scene))
        check_elastic(scene)
    except SceneError:
        return False
    return True


def _bind_coupled(
    scene: Scene, options: Options, progress: Progress
) -> tuple[Model, tuple[str, ...], dict[str, float]]:
    """Variant of :func:`_bind_one_way` for preset coupled, which needs the laws of drives and loads only."""
    from kaneflex.mechanism.position_analysis import place
    from kaneflex.multibody.model.assembly import build_system
    from kaneflex.multibody.model.determinacy import check_freedoms, check_sensors, undetermined
    from kaneflex.multibody.time.rigid_reference import rigid_reference
    from kaneflex.solve.contact_lines import check_lines

    posed, scene = scene, without_poses(scene)
    mechanism = mechanism_of(scene)
    spare = check_determined(mechanism, twice=True)
    check_on_axes(scene)
    bare, scene = not has_elastic_stage(scene), _as_it_starts(scene)
    ignored, scene = ignored_of(scene, options), acting(scene, options)
    mechanism = mechanism_of(scene)
    check_memory(mechanism, options, len(mechanism.drives) + len(mechanism.loads) + 10 * len(mechanism.bodies))
    placement = place(mechanism)
    _check_poses(posed, mechanism.size, placement)
    if spare:
        from kaneflex.fem.freedom import check_held_twice

        check_held_twice(mechanism, placement, spare)
    coupled, derived = build_system(scene, progress, modes_of(scene.solve))
    motion = rigid_reference(coupled, placement)
    compiled = compiled_by(progress, coupled.engine.compile, motion.module.engine.compile)
    check_freedoms(coupled, placement)
    check_reference(motion, options)
    bound = model_without_equations(scene, options, motion)
    check_laws(bound)
    check_lines(bound)
    model = build_model(scene, options, motion, bare=bare)
    if spare:
        open_rows = undetermined(coupled, motion.states(coupled, np.zeros(1))[0])
        check_sensors(coupled, scene.sensors, open_rows)
        coupled = replace(coupled, undetermined=open_rows)
    seconds = {"derive": derived, "compile": compiled}
    return replace(model, coupled=coupled), (*ignored, *_all_modes(scene)), seconds


def _check_poses(scene: Scene, size: float, placement: Placement) -> None:
    """Raise SceneError if a structure's welds contradict the pose of a body."""
    for name, body in scene.bodies.items():
        x, y, _ = placement.poses[name]
        if body.pose is not None and math.hypot(x - body.pose.at[0], y - body.pose.at[1]) > _POSED * size:
            held = f"the welds put its start at [{x:.6g} m, {y:.6g} m]"
            raise SceneError(f"bodies.{name}.pose.at", list(body.pose.at), held, "Give that position, or other lengths")


def _all_modes(scene: Scene) -> list[str]:
    """Notes on links whose elements have fewer modes than the default number."""
    from kaneflex.mechanism.floating_frames import link_modes

    mechanism, most = mechanism_of(scene), modes_of(scene.solve)
    links = [name for name, body in mechanism.deforming.items() if body.elastic]
    return [
        f"{name} has only {count} of the default's {most} modes; more elements give more"
        for name, count in ((each, link_modes(mechanism, each, most, limits_modes(scene.solve))) for each in links)
        if count < most
    ]  # fmt: skip


def check_reference(motion: ReferenceKinematics, options: Options) -> None:
    """Check that prescribed drives can move the rigid mechanism through their range, as far as it is known."""
    reference, mechanism = motion.module, motion.module.system.mechanism
    rigid = motion.at(np.zeros(1) if reference.FREE else np.linspace(0.0, options.duration, SWEEP + 1))
    if not np.isfinite(rigid.values).all() and np.isfinite(rigid.known).all():
        raise SceneError(
            "joints", ", ".join(dict.fromkeys(reference.engine.layout.cuts)),
            f"the loop cannot close at {drive_positions(mechanism, rigid)}, or is in a singular position there",
            "Change the lengths, or limit the drive's range",
        )  # fmt: skip


def neighbour(model: Model, scene: Scene, frozen: bool = False, options: Options | None = None) -> Model:
    """Model of a scene that differs in numbers only, with the same module, options and number of steps.

    Parameters
    ----------
    model : Model
        Model of the scene before the change, without free joints unless its preset is coupled.
    frozen : bool
        Whether to keep the modal bases and the modes of the damping.
    options : Options, optional
        Other options of a coupled model, whose elements and numbers of modes may differ, too.
    """
    alike = options is None
    options = options or neighbour_options(model, scene)
    if scene.is_spatial:
        from kaneflex.solve.spatial_loading import beside_in_space

        return beside_in_space(model, scene, options, model.module.system if alike else None, frozen)
    scene, like = _as_it_starts(scene if model.coupled is None else without_poses(scene)), model if frozen else None
    scene = acting(scene, options)
    if model.coupled is None:
        return build_model(scene, options, _moved(model, scene, options.duration), like)
    from kaneflex.mechanism.position_analysis import place
    from kaneflex.multibody.model.assembly import bound_system
    from kaneflex.multibody.time.rigid_reference import rigid_reference

    own = model.coupled
    mechanism, p = mechanism_of(scene), bind_parameters(scene, own.module)
    modes, like_own = (modes_of(scene.solve), limits_modes(scene.solve)), own if alike else None
    system = bound_system(mechanism, own.module, p, *modes, None, like_own, frozen)
    motion = rigid_reference(system, place(mechanism))
    found = build_model(scene, options, motion, like, bare=model.bare)
    return replace(found, coupled=replace(system, undetermined=own.undetermined))


def neighbour_options(model: Model, scene: Scene) -> Options:
    """Options of a model of a scene that differs in numbers only, including its period."""
    duration = model.options.duration if scene.period is None or not model.options.cycles else scene.period
    options = model.options._replace(duration=duration)
    # a spectral grid and its corrections may differ between neighbours
    return options._replace(integrator="radau") if options.integrator == "spectral" else options


def _moved(model: Model, scene: Scene, duration: float) -> RigidKinematics:
    """Motion of a neighbour's scene; the model's own if the numbers are equal, since following loops takes long."""
    module, parameters = model.module, bind_parameters(scene, model.module)
    if duration == model.options.duration and np.array_equal(parameters, bind_parameters(model.scene, module)):
        return model.motion
    from kaneflex.mechanism.closure_continuation import seed_loops

    return RigidKinematics(module, seed_loops(mechanism_of(scene), module, parameters, duration))


def _idle_settings(scene: Scene, options: Options) -> Iterator[str]:
    """Notes on ``solve`` entries for start, reduction and precision that have no effect."""
    solve, given, dynamics = scene.solve, scene.solve.model_fields_set, options.dynamics
    slow = dynamics == "quasistatic" and "start" in given and (solve.start == "zero" or not options.cycles)
    if slow and solve.start != "quasistatic":
        yield f"preset {solve.preset} has no initial state: solve.start = {solve.start} has no effect"
    if dynamics == "frozen" and solve.start != "zero":
        yield f"preset {solve.preset} starts from rest: solve.start = {solve.start} has no effect"
    if dynamics == "rigid" and solve.start != "zero" and scene.free_joints:
        yield f"under preset rigid, free joints start as given in drives: solve.start = {solve.start} has no effect"
    kept = options.reduction == "none" and dynamics != "coupled"
    if kept and solve.reduction not in (None, "none"):
        yield f"no body is elastic: solve.reduction = {solve.reduction} has no effect"
    if kept and solve.modes != "all":
        why = "no body is elastic" if dynamics == "rigid" else "solve.reduction = none keeps all modes"
        yield f"{why}: solve.modes = {solve.modes} has no effect"
    if solve.tolerance is not None and dynamics != "coupled" and options.integrator != "spectral":
        yield f"solve.tolerance = {solve.tolerance:g} has no effect: only preset coupled and integrator spectral use it"
    if solve.bounded and dynamics != "coupled":
        yield f"solve.bounded = {', '.join(solve.bounded)} has no effect: only preset coupled uses it"


def ignored_of(scene: Scene, options: Options) -> tuple[str, ...]:
    """Notes on entries of the scene that its preset overrides."""
    found = []
    solve, integrates = scene.solve, options.dynamics not in ("rigid", "quasistatic")
    if options.dynamics == "rigid" and "preset" in solve.model_fields_set and solve.preset != "rigid":
        found.append(f"no body is elastic: preset {solve.preset} solves the rigid mechanism, like preset rigid")
    if solve.integrator is not None and not integrates:
        found.append(f"preset {solve.preset} integrates nothing: solve.integrator = {solve.integrator} has no effect")
    found += _idle_settings(scene, options)
    if solve.modes == "all" and "modes" in solve.model_fields_set and options.dynamics == "coupled":
        found.append(f"preset coupled uses {options.modes} modes of each link for solve.modes = all: give a number")
    if "rho_infinity" in solve.model_fields_set and options.integrator != "generalised-alpha":
        found.append(f"solve.rho_infinity = {solve.rho_infinity:g} has no effect: it belongs to generalised-alpha")
    beams = {name: body.beam for name, body in scene.bodies.items() if body.elastic and body.beam is not None}
    found += [f"{name}.kappa = {beam.kappa:g} has no effect: theory {beam.theory} has no shear deformation"
              for name, beam in beams.items() if beam.kappa is not None and not beam.shear]  # fmt: skip
    deforms = any(body.elastic or body.modal is not None for body in scene.bodies.values())
    if scene.damping is not None and scene.damping.kind == "modal" and not deforms:
        found.append("no body is elastic: damping.modal has no modes to damp")
    finer = [name for name, body in scene.bodies.items() if body.elastic and body.beam.elements != options.elements]
    if options.elements is not None and finer:
        count = "one element" if options.elements == 1 else f"{options.elements} elements"
        whatever = f"and ignores the elements of {', '.join(finer)}"
        found.append(f"preset {options.preset} uses {count} for each link {whatever}")
    idle = [name for name, on in scene.solve.terms.items() if on and name in UNUSED_TERMS[options.dynamics]]
    if idle:
        found.append(f"solve.terms.{', solve.terms.'.join(idle)} has no effect under preset {options.preset}")
    idle = [name for name in scene.solve.terms if name not in idle and not has_term(scene, name)]
    if idle:
        found.append(f"solve.terms.{', solve.terms.'.join(idle)} has no effect: the scene has no such terms")
    free = bool(scene.floating or scene.free_joints)
    if "forward" in scene.solve.model_fields_set and (not free or options.dynamics == "coupled"):
        why = "preset coupled integrates them with the links" if free else "no joint is free"
        found.append(f"solve.forward has no effect: {why}")
    every = -(-options.steps // MAX_STORED)
    if every > 1 and options.dynamics in ("dynamic", "frozen"):
        instants = options.steps // every + 1
        found.append(f"solve.steps = {options.steps}: one instant is stored every {every} steps, {instants} in all")
    return tuple(found)
