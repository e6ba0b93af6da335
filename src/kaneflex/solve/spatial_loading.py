"""Loading of a scene in space: drives and loads are derived, everything else is numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import ModuleType

import numpy as np

from kaneflex.mechanism.closure import SWEEP
from kaneflex.multibody.dynamics.spatial_bushings import overturned
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model, reference_instant, rigid_model
from kaneflex.multibody.model.module_loading import find_spatial_module
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.spatial_coupled import CoupledKinematics, before_run, build_coupled_system
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.spatial_system import SpatialSystem, State, build_spatial_system
from kaneflex.multibody.time.spatial_curves import Followed, Standing
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule, SpatialMotion
from kaneflex.scene import Scene
from kaneflex.scene.options import Options, acting, moves_with_links
from kaneflex.solve.law_checks import check_finite, check_springs
from kaneflex.solve.memory import check_memory
from kaneflex.solve.spatial_checks import check_stage, with_open_reactions
from kaneflex.solve.spatial_initial import given_state
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import compiled_by

Progress = Callable[[str], None]


def load_spatial(
    scene: Scene, options: Options, progress: Progress
) -> tuple[Model, tuple[str, ...], float, float]:
    """Model of a mechanism in space, notes on its scene, and the seconds of derivation and compilation."""
    notes: tuple[str, ...] = ()
    if options.dynamics == "coupled" and not moves_with_links(scene, options.dynamics):
        notes = tuple(_idle_settings(scene))
        if "tolerance" not in scene.solve.forward.model_fields_set:
            options = replace(options, forward_tolerance=scene.solve.tolerance or options.forward_tolerance)
    generated, derived = find_spatial_module(scene, progress)
    coupled = options.dynamics == "coupled"
    if coupled:  # before its shapes are computed
        check_memory(scene, options, len(scene.drives) + len(scene.loads) + 10 * len(scene.bodies))
        system = build_coupled_system(scene, generated, options)
    else:
        system = build_spatial_system(scene, generated)
        check_memory(scene, options, len(SpatialModule(system).SCALARS))
    compiled = compiled_by(progress, system.compile)
    motion = _bound(system, options)
    if not motion.is_start:
        moved = motion.rigid if isinstance(motion, CoupledKinematics) else motion
        check_springs(scene, moved, options)
        check_finite(scene, moved, options)
    model = _coupled_model(scene, options, motion) if coupled else build_model(scene, options, motion)
    check_stage(model)
    return model, (*notes, *(_beyond(system, scene) if coupled else ())), derived, compiled


def _idle_settings(scene: Scene) -> Iterator[str]:
    """Notes on ``solve`` entries of the coupled equations that have no effect on rigid bodies."""
    solve = scene.solve
    if solve.tolerance is not None and "tolerance" in solve.forward.model_fields_set:
        used = f"rigid bodies in space use solve.forward.tolerance = {solve.forward.tolerance:g}"
        yield f"{used}: solve.tolerance = {solve.tolerance:g} has no effect"
    if solve.integrator is not None:
        used = f"rigid bodies in space are integrated by solve.forward.method = {solve.forward.method}"
        yield f"{used}: solve.integrator = {solve.integrator} has no effect"


def _beyond(system: SpatialSystem, scene: Scene) -> list[str]:
    """Warning for each link whose elements have fewer modes than the scene requests."""
    asked = scene.solve.modes
    if asked == "all" or "modes" not in scene.solve.model_fields_set:
        return []
    links = {name: each for name, each in system.layout.shapes.items() if isinstance(each, Shapes)}
    return [
        f"{name} has only {each.most} bending modes per plane, fewer than solve.modes = {asked}: "
        "more elements give more"
        for name, each in links.items() if int(asked) > each.most
    ]  # fmt: skip


def _coupled_model(scene: Scene, options: Options, motion: SpatialKinematics) -> Model:
    """Model of deforming bodies in space, without linear equations."""
    rigid = motion.rigid if isinstance(motion, CoupledKinematics) and not motion.is_start else motion
    return rigid_model(scene, options, motion, reference_instant(scene, options, rigid)[0])


def neighbour_in_space(model: Model, scene: Scene, options: Options, frozen: bool) -> Model:
    """Variant of :func:`kaneflex.solve.loading.neighbour` for mechanisms in space, with options of the neighbour."""
    if options.dynamics == "coupled":
        return refined_in_space(model, scene, options)
    scene = acting(scene, options)
    generated: ModuleType = model.module.system.module
    motion = _bound(build_spatial_system(scene, generated), options)
    return build_model(scene, options, motion, model if frozen else None)


def refined_in_space(model: Model, scene: Scene, options: Options) -> Model:
    """Variant of :func:`kaneflex.solve.loading.refined` for mechanisms in space."""
    scene = acting(scene, options)
    system = build_coupled_system(scene, model.module.system.module, options)
    return _coupled_model(scene, options, _bound(system, options))


def _bound(system: SpatialSystem, options: Options) -> SpatialKinematics:
    """Motion of a system before a run: as the drives prescribe it, else its start."""
    module, start = SpatialModule(system), start_of(system)
    if options.dynamics == "coupled":
        start = given_state(system, start) if options.start == "given" else start
        return with_open_reactions(before_run(module, start), options)
    if module.FREE:
        return with_open_reactions(_standing(module, start), options)
    motion = SpatialKinematics(module, system.parameters, Followed(system, start))
    _check_bushings(motion, options)
    return with_open_reactions(motion, options)


def _check_bushings(motion: SpatialKinematics, options: Options) -> None:
    """Raise SceneError if a prescribed motion turns a bushing too far."""
    system = motion.module.system
    if len(system.tables.bushings):
        times = np.linspace(0.0, options.duration, SWEEP + 1)
        far = overturned(system.mechanism, system.instants(motion.curve.rows(times)).bushings)
        if far:
            raise SceneError(f"springs.{far[0]}.bushing", None, far[1], "Turn it less, or use a load with a law")


def spatial_start(scene: Scene, progress: Progress = lambda stage: None) -> tuple[SpatialSystem, State, SpatialMotion]:
    """Mechanism in space, its initial state, and its motion at that instant."""
    system = build_spatial_system(scene, find_spatial_module(scene, progress)[0])
    start = start_of(system)
    return system, start, _standing(SpatialModule(system), start).at(0.0)


def _standing(module: SpatialModule, start: State) -> SpatialKinematics:
    """Kinematics of a mechanism in space that stays in its initial state."""
    system = module.system
    return SpatialKinematics(module, system.parameters, Standing(system, start))
