"""Loading of a scene: find or derive its module, bind the numbers, check that it closes, build the model.

Loading knows a motion that the drives do not prescribe (of free joints, and of coupled mechanisms in space) at its
start only. A run integrates it, and whatever else reads the motion asks :func:`integrated` for it.
"""

from __future__ import annotations

import copyreg
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from kaneflex.fem.mobility import check_determined, check_free
from kaneflex.mechanism.closure import check_closure
from kaneflex.mechanism.mechanism import mechanism_of, same_mechanism
from kaneflex.mechanism.rigid_bodies import check_elastic
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model
from kaneflex.multibody.model.module_loading import bind_parameters, find_module
from kaneflex.scene import Scene
from kaneflex.scene.options import UNUSED_TERMS, Options, acting, has_term, resolve_options
from kaneflex.scene.parts import Solve
from kaneflex.scene.plausible import implausible
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.run_checks import MAX_STORED, check_laws, check_memory
from kaneflex.support.arguments import takes
from kaneflex.support.errors import counted
from kaneflex.support.terminal import compiled_by, silent
from kaneflex.support.weak_cache import WeakCache

Progress = Callable[[str], None]
Share = Callable[[float], None]
_INTEGRATED: WeakCache[Model, Model] = WeakCache()
ONE_WAY = "motion of {joints} as in the rigid mechanism: the deformation does not act back on it"
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
    if given.is_spatial or options.dynamics == "coupled":
        from kaneflex.solve.engine_loading import bind

        model, notes, seconds = bind(given, options, progress)
    else:
        (model, seconds), notes = _bind_one_way(given, options, progress, like), ()
    seconds["set_up"] = time.perf_counter() - started - sum(seconds.values())
    free = () if options.dynamics in ("rigid", "coupled") else model.module.FREE
    notes = (*ignored_of(given, options), *notes, *((ONE_WAY.format(joints=", ".join(free)),) if free else ()))
    known = () if model.motion.is_start else model.warnings  # those of the equations follow from the motion
    model = replace(model, warnings=(*known, *implausible(model.scene), *notes), seconds=seconds, given=given)
    _check_start(model)
    return model


def model_from(given: SceneLike) -> Model:
    """Model of a Model or a Solution; a Scene or a path is loaded."""
    found = getattr(given, "model", given)
    return found if isinstance(found, Model) else load(found)


def integrated(model: Model, share: Share = silent) -> Model:
    """The model with its motion over the run, integrated once per model; unchanged if the drives prescribe it.

    ``share`` is called with the finished share, 0 to 1.

    Raises SceneError if the motion can't continue; it names the time. That of a coupled mechanism then ends early.
    """
    if not model.awaits_run:
        return model
    if model.options.dynamics == "coupled":
        from kaneflex.solve.coupled import simulate_coupled

        return _INTEGRATED.of(model, lambda: simulate_coupled(model, share).model)
    from kaneflex.solve.forward import integrate_free_joints

    return _INTEGRATED.of(model, lambda: integrate_free_joints(model, share))


def uncoupled(model: Model, share: Share = silent) -> Model:
    """As :func:`integrated` for models without coupling, whose equations need the motion; others unchanged."""
    return model if model.options.dynamics == "coupled" else integrated(model, share)


def _bind_one_way(
    scene: Scene, options: Options, progress: Progress, like: Model | None
) -> tuple[Model, dict[str, float]]:
    """Model of a planar scene of a one-way preset, and the seconds of derivation and compilation."""
    if like is None or like.coupled is not None or not same_mechanism(scene, like.scene):  # coupled ones may have more
        check_determined(mechanism_of(scene))
        check_free(mechanism_of(scene))
    scene = _as_it_starts(scene)
    if options.dynamics != "rigid" and scene.is_elastic:
        check_elastic(scene)
    (module, derived), compiled = find_module(scene, progress), 0.0
    scene = acting(scene, options)
    mechanism = mechanism_of(scene)
    check_memory(mechanism, options, len(module.SCALARS))
    motion = RigidKinematics(module, bind_parameters(scene, module))
    if getattr(module, "LOOPS", ()):
        from kaneflex.mechanism.closure_continuation import seed_loops

        progress("following the linkage over its drive's range")
        motion = RigidKinematics(module, seed_loops(mechanism, module, motion.parameters, options.duration))
    if module.FREE:
        from kaneflex.multibody.model.assembly import build_system
        from kaneflex.solve.forward import at_start

        system, more = build_system(scene, progress)
        derived, compiled = derived + more, compiled_by(progress, system.engine.compile)
        motion = at_start(system, motion)
    else:
        check_closure(mechanism, motion, options.duration)
        check_laws(Model(scene, options, motion))
    return build_model(scene, options, motion, like=like), {"derive": derived, "compile": compiled}


def _as_it_starts(scene: Scene) -> Scene:
    """Scene with the start of its free joints, and branches, where other entries determine them."""
    if not (scene.loose or any(joint.near for joint in scene.joints.values())):
        return scene
    from kaneflex.mechanism.tight_start import as_it_starts

    return as_it_starts(scene)


def _check_start(model: Model) -> None:
    """Raise SceneError if the model can't start from the given state, or bodies penetrate each other at the start."""
    if model.options.start != "given" or model.coupled_in_space is not None:  # in space it is checked already
        if model.scene.contacts:
            from kaneflex.solve.initial import check_penetration

            check_penetration(model)
        return
    if model.coupled is None:
        from kaneflex.solve.initial import given_state

        given_state(model)
    else:
        from kaneflex.solve.coupled import beginning

        beginning(model)


def neighbour(model: Model, scene: Scene, frozen: bool = False, options: Options | None = None) -> Model:
    """Model of a scene that differs in numbers only, with the same module, options and number of steps.

    Parameters
    ----------
    model : Model
        Model of the scene before the change, without free joints unless its preset is coupled.
    frozen : bool
        Whether to keep the modal bases and the modes of the damping.
    options : Options, optional
        Other options of a coupled model, whose scene differs in elements and numbers of modes only.
    """
    alike = options is None
    if options is None:
        period = scene.period if model.options.cycles else None
        options = model.options._replace(duration=model.options.duration if period is None else period)
        if options.integrator == "spectral":  # its grid and its corrections may differ between neighbours
            options = options._replace(integrator="radau")
    if scene.is_spatial or model.coupled is not None:
        from kaneflex.solve.engine_loading import neighbour_of

        return neighbour_of(model, scene, options, alike, frozen)
    scene = acting(_as_it_starts(scene), options)
    return build_model(scene, options, _moved(model, scene, options.duration), model if frozen else None)


def _moved(model: Model, scene: Scene, duration: float) -> RigidKinematics:
    """Motion of a neighbour's scene; the model's own if the numbers are equal, since following loops takes long."""
    module, parameters = model.module, bind_parameters(scene, model.module)
    if duration == model.options.duration and np.array_equal(parameters, bind_parameters(model.scene, module)):
        return model.motion
    from kaneflex.mechanism.closure_continuation import seed_loops

    return RigidKinematics(module, seed_loops(mechanism_of(scene), module, parameters, duration))


def _idle_settings(solve: Solve, options: Options, free_joints: Sequence[str]) -> Iterator[str]:
    """Notes on ``solve`` entries for start, reduction and precision that have no effect."""
    given, dynamics = solve.model_fields_set, options.dynamics
    slow = dynamics == "quasistatic" and "start" in given and (solve.start == "zero" or not options.cycles)
    if slow and solve.start != "quasistatic":
        yield f"preset {solve.preset} has no initial state: solve.start = {solve.start} has no effect"
    if dynamics == "frozen" and solve.start != "zero":
        yield f"preset {solve.preset} starts from rest: solve.start = {solve.start} has no effect"
    if dynamics == "rigid" and solve.start != "zero" and free_joints:
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
    found += _idle_settings(solve, options, scene.free_joints)
    if solve.modes == "all" and "modes" in solve.model_fields_set and options.dynamics == "coupled":
        modes = counted(options.modes, "mode")
        found.append(f"preset coupled uses {modes} of each link for solve.modes = all: give a number")
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
        count = counted(options.elements, "element")
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
