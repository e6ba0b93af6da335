"""From a scene to a model: find or derive its module, bind the numbers, check that it closes, build."""

from __future__ import annotations

import copyreg
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.fem.mobility import check_determined, check_held_twice
from kaneflex.mechanism.closure import SWEEP, check_closure, stand
from kaneflex.mechanism.closure_continuation import check_free, seed_loops
from kaneflex.mechanism.energy import Energy
from kaneflex.mechanism.mechanism import mechanism_of, same_mechanism
from kaneflex.mechanism.position_analysis import place, with_branches
from kaneflex.mechanism.rigid_bodies import check_elastic, check_on_axes
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.mechanism.springs import points_meet
from kaneflex.multibody.binding import bind_parameters, find_module, find_pruned_module
from kaneflex.multibody.building import build_model
from kaneflex.multibody.model import Model
from kaneflex.scene import Scene
from kaneflex.scene.options import UNUSED_TERMS, Options, acting, has_term, resolve_options
from kaneflex.scene.plausible import implausible
from kaneflex.solve.forward import at_initial_speed, integrate_free_joints
from kaneflex.solve.initial import check_start
from kaneflex.solve.memory import check_memory
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import share_of

if TYPE_CHECKING:
    from kaneflex.multibody.rigid_twin import RigidTwin, TwinKinematics
    from kaneflex.multibody.system import CoupledSystem

Progress = Callable[[str], None]
ONE_WAY = "{joints} moves as in the rigid mechanism: the deformation follows that motion and does not act back on it"
"""Said of every run with free joints."""
_ROUNDED = 1e-9  # share of a law's largest value by which rounding may part its values
_POLE_PARTS, _POLE_LEVELS = 64, 4
"""Into how many parts samples are taken nearer where a pole may lie between them, and how often: by 1e7 in all."""
_MEETING = 1e-3
"""Share of a spring's greatest length under which it has no direction."""
_MOST = 20_000
"""Instants at most at which laws must have values before anything is computed."""


def _pickled(model: Model) -> tuple[Callable[[Scene], Model], tuple[Scene]]:
    """A model is pickled as its scene, and loaded anew from it: kernels and addresses are a process's own."""
    return load, (model.scene if model.given is None else model.given,)


copyreg.pickle(Model, _pickled)


def load(
    scene: Scene, progress: Progress = lambda stage: None, like: Model | None = None, pruned: bool = False
) -> Model:
    """Bind a scene to its generated module.

    Parameters
    ----------
    scene : Scene
    progress : callable
        Called with the name of each stage that can take longer than a moment.
    like : Model, optional
        Of a similar scene: where the equations are the same they are taken from it, which gives the same model sooner.
    pruned : bool
        Whether the module is one without the terms that the options leave out, derived if there is none yet. By default
        it is the structure's, which serves all options.

    Returns
    -------
    Model

    Raises
    ------
    SceneError
        If the linkage can't close over the drives' range, or the scene asks for what is not available.
    """
    if not isinstance(scene, Scene):
        raise TypeError(f"load takes a Scene, not {type(scene).__name__}: read_scene(...) makes one")
    return replace(_load(scene, progress, like, pruned), given=scene)


def _load(scene: Scene, progress: Progress, like: Model | None, pruned: bool) -> Model:
    started = time.perf_counter()
    options = resolve_options(scene)
    if scene.is_spatial:
        from kaneflex.solve.spatial_loading import load_spatial

        return load_spatial(scene, options, progress, started)
    if options.dynamics == "coupled":
        return _load_coupled(scene, options, progress, started)
    if like is None or like.coupled is not None or not same_mechanism(scene, like.scene):  # coupled ones may have more
        check_determined(mechanism_of(scene))
        check_free(scene)
    scene = with_branches(scene)
    if options.dynamics != "rigid" and any(body.elastic for body in scene.bodies.values()):
        check_elastic(scene)
    module, derived = (find_pruned_module if pruned else find_module)(scene, progress)
    ignored, scene = ignored_of(scene, options), acting(scene, options)
    check_memory(scene, options, len(module.SCALARS))
    motion = RigidKinematics(module, bind_parameters(scene, module))
    # a kernel that every load needs is called once, so that compiling is seen and timed apart from computing
    compiled = compiled_by(progress, lambda: motion.table(np.zeros(1)))
    motion, energy = _moving(scene, motion, options, progress)
    check_closure(mechanism_of(scene), motion, options.duration)
    check_springs(scene, motion, options)
    check_finite(scene, motion, options)
    model = build_model(scene, options, motion, like=like)
    warnings = (*model.warnings, *implausible(scene), *ignored)
    if module.FREE and options.dynamics != "rigid":
        warnings = (*warnings, ONE_WAY.format(joints=", ".join(module.FREE)))
    model = replace(model, energy=energy, warnings=warnings)
    return timed(model, started, derived, compiled)


def _moving(
    scene: Scene, motion: RigidKinematics, options: Options, progress: Progress
) -> tuple[RigidKinematics, Energy | None]:
    """The rigid motion with its loops followed and its free joints moved, and the energy of these."""
    module, energy = motion.module, None
    if getattr(module, "LOOPS", ()):
        progress("following the linkage over its drive's range")
        motion = RigidKinematics(module, seed_loops(scene, module, motion.parameters, options.duration))
    if module.FREE:
        share = share_of(progress, "forward dynamics of the rigid mechanism")
        motion, energy = integrate_free_joints(scene, module, motion.parameters, options, share)
    return motion, energy


def compiled_by(progress: Progress, *compile: Callable[[], object]) -> float:
    """Seconds in which all is compiled that these calls need."""
    progress("compiling, first time only")
    started = time.perf_counter()
    for call in compile:
        call()
    return time.perf_counter() - started


def timed(model: Model, started: float, derived: float, compiled: float) -> Model:
    """The model with what its stages took [s], ready to start from where it asks for."""
    set_up = time.perf_counter() - started - derived - compiled
    model = replace(model, seconds={"derive": derived, "compile": compiled, "set_up": set_up})
    check_start(model)
    return model


def has_elastic_stage(scene: Scene) -> bool:
    """Whether linear equations can follow the rigid mechanism beside the coupled ones, for modes and coordinates.

    Where nothing deforms there are none; where bodies move freely, joints hold something twice, rigid bodies can't
    follow the links, or laws know joints without a drive, none can be formed.
    """
    deforms = any(body.deforms for body in scene.bodies.values())
    if scene.floating or scene.observed or not deforms or check_determined(mechanism_of(scene), twice=True):
        return False
    try:
        check_free(scene)
        check_elastic(scene)
    except SceneError:
        return False
    return True


def _load_coupled(scene: Scene, options: Options, progress: Progress, started: float) -> Model:
    """:func:`load` of preset coupled: the coupled module is all that is derived."""
    from kaneflex.multibody.held_twice import check_sensors, undetermined
    from kaneflex.multibody.rigid_twin import build_twin
    from kaneflex.multibody.run import rigid_state
    from kaneflex.multibody.system import build_system, with_stretch
    from kaneflex.multibody.weightless import check_weighty

    mechanism = mechanism_of(scene)
    spare = check_determined(mechanism, twice=True)
    check_on_axes(scene)
    bare, scene = not has_elastic_stage(scene), with_branches(scene)
    ignored, scene = ignored_of(scene, options), acting(scene, options)
    check_memory(scene, options, len(mechanism.drives) + len(mechanism.loads) + 10 * len(mechanism.bodies))
    placement = place(scene)
    if spare:
        check_held_twice(mechanism, placement, spare)
    coupled, derived = build_system(scene, progress)
    check_weighty(coupled, placement)
    scene = with_stretch(scene)
    twin = build_twin(scene, coupled, placement)
    compiled = compiled_by(progress, coupled.compile, twin.rigid.compile)
    motion = _twin(scene, twin, options)
    check_twin(scene, motion, options)
    check_springs(scene, motion, options)
    check_finite(scene, motion, options)
    model = build_model(scene, options, motion, bare=bare)
    if spare:
        open_rows = undetermined(coupled, rigid_state(coupled, motion.at(0.0))[0])
        check_sensors(scene, open_rows)
        coupled = replace(coupled, undetermined=open_rows)
    model = replace(model, coupled=coupled, warnings=(*model.warnings, *implausible(scene), *ignored))
    return timed(model, started, derived, compiled)


def check_twin(scene: Scene, motion: TwinKinematics, options: Options) -> None:
    """Prescribed drives must take the rigid mechanism through their range; where free joints go is not known yet."""
    mechanism, twin = mechanism_of(scene), motion.module
    rigid = motion.at(np.zeros(1) if twin.FREE else np.linspace(0.0, options.duration, SWEEP + 1))
    lost = np.flatnonzero(~np.all([np.isfinite(rigid[f"{name}.c"]) for name in mechanism.bodies], axis=0))
    if len(lost) and np.isfinite(rigid.said).all():
        # where they can't close at all, this says so
        place(scene, {name: float(rigid[f"{name}.angle"][lost[0]]) for name in mechanism.drives})
        joints = ", ".join(dict.fromkeys(twin.engine.layout.cuts))
        raise SceneError(
            "joints", joints, f"the loop can't close: at {stand(mechanism, rigid, int(lost[0]))} it does not, or it "
            "leaves open how it goes on",
            "Change the lengths, or limit the drive's range",
        )  # fmt: skip


def _twin(scene: Scene, twin: RigidTwin, options: Options) -> RigidKinematics:
    """The rigid motion of a twin, its free joints at their first speeds."""
    from kaneflex.multibody.rigid_twin import TwinKinematics

    parameters = np.zeros(len(twin.PARAMETERS))
    if twin.FREE:
        parameters = at_initial_speed(scene, twin, parameters, options.duration)
    return TwinKinematics(twin, parameters)


def neighbour(model: Model, scene: Scene, frozen: bool) -> Model:
    """A model of a scene that differs in numbers alone, with the same module, options and numbers of steps.

    Parameters
    ----------
    model : Model
        Of the scene before the change, with no free joints unless its preset is coupled.
    frozen : bool
        Whether the new one keeps the modal bases and the modes of the damping.
    """
    if scene.is_spatial:
        from kaneflex.solve.spatial_loading import neighbour_in_space

        return neighbour_in_space(model, scene, frozen)
    scene = with_branches(scene)
    options = neighbour_options(model, scene)
    scene = acting(scene, options)
    if model.coupled is not None:
        from kaneflex.multibody.system import neighbour_system

        return _beside(model, scene, neighbour_system(model.coupled, scene, frozen), options, frozen)
    return build_model(scene, options, _moved(model, scene, options.duration), model if frozen else None)


def _beside(model: Model, scene: Scene, system: CoupledSystem, options: Options, frozen: bool = False) -> Model:
    """A model by another system of the same mechanism."""
    from kaneflex.multibody.rigid_twin import build_twin
    from kaneflex.multibody.system import with_stretch

    assert model.coupled is not None
    system, scene = replace(system, undetermined=model.coupled.undetermined), with_stretch(scene)
    motion = _twin(scene, build_twin(scene, system, place(scene)), options)
    found = build_model(scene, options, motion, model if frozen else None, bare=model.bare)
    return replace(found, coupled=system)


def refined(model: Model, scene: Scene, options: Options, closer: float = 1.0) -> Model:
    """A coupled model by other options, of a scene that differs in links' elements and numbers of modes alone.

    By the same module: nothing is derived. ``closer``: what of a cycle's change may be left, as a share of what else
    may; in space, where the motion is found here.
    """
    if scene.is_spatial:
        from kaneflex.solve.spatial_loading import refined_in_space

        return refined_in_space(model, scene, options, closer)
    from kaneflex.multibody.system import refined_system

    assert model.coupled is not None
    scene = acting(with_branches(scene), options)
    return _beside(model, scene, refined_system(model.coupled, scene), options)


def neighbour_options(model: Model, scene: Scene) -> Options:
    """Of a model of a scene that differs in numbers alone, its period among them."""
    duration = model.options.duration if scene.period is None or not model.options.cycles else scene.period
    options = replace(model.options, duration=duration)
    # A spectral grid and its corrections may differ from neighbour to neighbour.
    return replace(options, integrator="radau") if options.integrator == "spectral" else options


def _moved(model: Model, scene: Scene, duration: float) -> RigidKinematics:
    """The motion of a neighbour's scene; the model's own where no number of it differs: loops are long to follow."""
    module, parameters = model.module, bind_parameters(scene, model.module)
    if duration == model.options.duration and np.array_equal(parameters, bind_parameters(model.scene, module)):
        return model.motion
    return RigidKinematics(module, seed_loops(scene, module, parameters, duration))


def ignored_of(scene: Scene, options: Options) -> tuple[str, ...]:
    """What the scene asks for and its preset overrules."""
    found = []
    solve, integrates = scene.solve, options.dynamics not in ("rigid", "quasistatic")
    if options.dynamics == "rigid" and "preset" in solve.model_fields_set and solve.preset != "rigid":
        found.append(f"no body is elastic: preset {solve.preset} solves the rigid mechanism, as preset rigid does")
    if solve.integrator is not None and not integrates:
        found.append(f"preset {solve.preset} integrates nothing: solve.integrator = {solve.integrator} is left out")
    if solve.modes == "all" and "modes" in solve.model_fields_set and options.dynamics == "coupled":
        found.append(f"preset coupled takes {options.modes} modes of each link where solve.modes is all: give a number")
    if "rho_infinity" in solve.model_fields_set and options.integrator != "generalised-alpha":
        found.append(f"solve.rho_infinity = {solve.rho_infinity:g} is of integrator generalised-alpha alone: left out")
    beams = {name: body.beam for name, body in scene.bodies.items() if body.elastic and body.beam is not None}
    found += [f"{name}.kappa = {beam.kappa:g} is left out: theory {beam.theory} knows no shear"
              for name, beam in beams.items() if beam.kappa is not None and not beam.shear]  # fmt: skip
    deforms = any(body.elastic or body.modal is not None for body in scene.bodies.values())
    if scene.damping is not None and scene.damping.kind == "modal" and not deforms:
        found.append("no body is elastic: damping.modal has no modes to damp")
    finer = [name for name, body in scene.bodies.items() if body.elastic and body.beam.elements != options.elements]
    if options.elements is not None and finer:
        count = "one element" if options.elements == 1 else f"{options.elements} elements"
        whatever = f"whatever the scene says of {', '.join(finer)}"
        found.append(f"preset {options.preset} takes {count} for each link, {whatever}")
    idle = [name for name, on in scene.solve.terms.items() if on and name in UNUSED_TERMS[options.dynamics]]
    if idle:
        found.append(f"preset {options.preset} has no use for solve.terms.{', solve.terms.'.join(idle)}: left out")
    idle = [name for name in scene.solve.terms if name not in idle and not has_term(scene, name)]
    if idle:
        found.append(f"the scene has no use for solve.terms.{', solve.terms.'.join(idle)}: it has no such terms")
    free = any(drive.free for drive in scene.drives.values())
    if "forward" in scene.solve.model_fields_set and (not free or options.dynamics == "coupled"):
        why = "preset coupled integrates them with the links" if free else "no joint is free"
        found.append(f"solve.forward is for free joints that move before anything deforms, and {why}: left out")
    return tuple(found)


def check_finite(scene: Scene, motion: RigidKinematics, options: Options) -> None:
    """Loads and prescribed motions must have a value at every step, or the error names the law and the time."""
    times = np.linspace(0.0, options.duration, min(options.steps, _MOST) + 1)
    rigid = motion.at(times)
    free = bool(scene.floating) or any(drive.free for drive in scene.drives.values())
    free_bodies = options.dynamics == "coupled" and free
    known = [name for name in motion.column if not free_bodies or name in scene.loads or name.endswith(".angle")]
    laws = {name: scene.law(name) for name in scene.loads} if scene.observed else {}
    elsewhere = {name for name, law in laws.items() if law is not None and law.uses_any(scene.observed)}
    elsewhere |= set(getattr(motion.module, "open_reactions", ()))  # which no equation determines
    known = [name for name in known if name not in elsewhere]  # they are known once the bodies are placed
    whole = len(known) == len(motion.column)  # else bodies need not be placed for it
    if np.isfinite(rigid.values).all() if whole else all(np.isfinite(rigid[name]).all() for name in known):
        _check_poles(scene, rigid, known)
        return
    for name in sorted(known, key=lambda name: name not in scene.loads):
        lost = ~np.isfinite(rigid[name])
        if not lost.any():
            continue
        t = times[int(np.argmax(lost))]
        if name in scene.loads:
            key, thing, given = f"loads.{name}", "it", scene.loads[name].law
        else:
            drive = min(scene.drives, key=lambda drive: scene.drives[drive].law is None)
            key, thing, given = f"drives.{drive}", "the motion or one of its rates", scene.drives[drive].law
        raise SceneError(
            key, given, f"{thing} has no finite value at t = {t:.6g} s",
            "Give a law that is smooth over the run, or another duration",
        )  # fmt: skip


def _check_poles(scene: Scene, rigid: RigidMotion, known: Sequence[str]) -> None:
    """Laws must not have a pole between two samples."""
    laws = {f"{name}.angle": ("drives", name, drive.law) for name, drive in scene.drives.items()}
    laws |= {name: ("loads", name, load.law) for name, load in scene.loads.items()}
    for scalar in sorted(laws.keys() & set(known)):
        table, name, law = laws[scalar]
        t = None if law is None else _pole(rigid, scalar)
        if t is not None:
            raise SceneError(
                f"{table}.{name}", law, f"it grows without bound at t = {t:.6g} s",
                "Give a law that is smooth over the run, or another duration",
            )  # fmt: skip


def _pole(rigid: RigidMotion, scalar: str) -> float | None:
    """Where a scalar has a pole [s], looked for where its neighbouring values part most.

    There they part the further, the nearer they lie, to the last; over a jump by as much, elsewhere by less.
    """
    times, values = rigid.times, rigid[scalar]
    parted = abs(np.diff(values))
    before = first = max(float(parted.max(initial=0.0)), _ROUNDED * float(abs(values).max()))
    for _ in range(_POLE_LEVELS if first else 0):
        k, before = int(parted.argmax()), max(first, float(parted.max()))
        low, high = max(k - 1, 0), min(k + 2, len(parted))  # an even pole is beside where they part
        times = np.linspace(times[low], times[high], _POLE_PARTS * (high - low) + 1)
        values = rigid.motion.at(times)[scalar]
        parted = abs(np.diff(values))
        if not np.isfinite(values).all():
            return float(times[np.isfinite(values).argmin()])
        if parted.max() < 2.0 / _POLE_PARTS * first:
            return None
    return float(times[parted.argmax()]) if first and parted.max() > 2.0 * before else None


def check_springs(scene: Scene, motion: RigidKinematics, options: Options) -> None:
    """Sweep as for the loops: a free length or a damper needs a direction, which points that meet don't have."""
    directed = {name: s for name, s in scene.springs.items() if s.between and (s.length or s.damping)}
    if not directed:
        return
    rigid = motion.at(np.linspace(0.0, options.duration, SWEEP + 1))

    for name, spring in directed.items():
        start, end = (rigid.frame(address.body).place(scene.point(address)) for address in spring.between)
        d = end - start
        step = np.diff(d)
        # The closest approach may lie between two samples: on the straight line from one to the other.
        share = np.clip(-(d[:, :-1] * step).sum(0) / np.maximum((step**2).sum(0), 1e-300), 0.0, 1.0)
        nearest = np.linalg.norm(d[:, :-1] + share * step, axis=0)
        if (nearest > _MEETING * np.linalg.norm(d, axis=0).max()).all():
            continue
        index = int(np.argmin(nearest))
        drive = next(iter(scene.drives), None)
        at = ""
        if drive is not None:
            at = f" at {drive} = {scene.written_coordinate(drive, float(rigid[f'{drive}.angle'][index]))}"
        raise points_meet(name, spring.between, at)
