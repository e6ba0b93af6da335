"""Loading of a scene in space: drives and loads are derived, everything else is numbers; its initial state, and which
reactions are statically indeterminate because of redundant constraints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from kaneflex.mechanism.closure import SWEEP
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.assembly import bound_system, rigid_system
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model, model_without_equations, reference_instant
from kaneflex.multibody.model.determinacy import check_bearings, check_sensors, open_reactions
from kaneflex.multibody.model.independent_speeds import choose
from kaneflex.multibody.model.module_loading import bind_parameters, find_laws_module
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.spatial_coupled import CoupledKinematics, before_run
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.model.tree_layout import COORDINATE
from kaneflex.multibody.time.curves import Followed, Standing
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule, SpatialMotion
from kaneflex.multibody.time.spring_displacements import overturned
from kaneflex.scene import Scene
from kaneflex.scene.options import Options, acting, limits_modes, modes_of
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import Sensor
from kaneflex.scene.start import Start
from kaneflex.solve.coupled_state import closed_state, laid_state
from kaneflex.solve.initial import given_start
from kaneflex.solve.run_checks import check_laws, check_memory
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import compiled_by

Progress = Callable[[str], None]
Moving = TypeVar("Moving", bound=SpatialKinematics)
_ELSEWHERE = np.concatenate([[0.0], (np.arange(8) + 0.381966) / 8.0])
"""Shares of a run at which reactions are checked: its start, and others away from aligned positions."""


def bind_in_space(
    scene: Scene, options: Options, progress: Progress
) -> tuple[Model, tuple[str, ...], dict[str, float]]:
    """Model of a mechanism in space, notes on its scene, and the seconds of derivation and compilation."""
    generated, derived = find_laws_module(scene, progress)
    mechanism, p, coupled = mechanism_of(scene), bind_parameters(scene, generated), options.dynamics == "coupled"
    if coupled:  # before its shapes are computed
        check_memory(mechanism, options, len(scene.drives) + len(scene.loads) + 10 * len(scene.bodies))
        system = bound_system(mechanism, generated, p, int(options.modes), elements=options.elements)
    else:
        system = rigid_system(mechanism, generated, p)
        check_memory(mechanism, options, len(SpatialModule(system).SCALARS))
    compiled = compiled_by(progress, system.engine.compile)
    motion = _bound(system, scene, options)
    if not motion.is_start:
        rigid = motion.rigid if isinstance(motion, CoupledKinematics) else motion
        check_laws(model_without_equations(scene, options, rigid))
    model = _coupled_model(scene, options, motion) if coupled else build_model(scene, options, motion)
    check_stage(model)
    beyond = _beyond(system, modes_of(scene.solve)) if coupled and not limits_modes(scene.solve) else []
    return model, tuple(beyond), {"derive": derived, "compile": compiled}


def _beyond(system: System, asked: int) -> list[str]:
    """Warning for each link whose elements have fewer modes than the scene requests."""
    links = {name: each for name, each in system.layout.shapes.items() if isinstance(each, Shapes)}
    return [
        f"{name} has only {each.most} bending modes per plane, fewer than solve.modes = {asked}: "
        "more elements give more"
        for name, each in links.items() if asked > each.most
    ]  # fmt: skip


def _coupled_model(scene: Scene, options: Options, motion: SpatialKinematics) -> Model:
    """Model of deforming bodies in space, without linear equations."""
    rigid = motion.rigid if isinstance(motion, CoupledKinematics) and not motion.is_start else motion
    model = model_without_equations(scene, options, motion)
    return replace(model, reference_time=reference_instant(replace(model, motion=rigid))[0])


def beside_in_space(
    model: Model, scene: Scene, options: Options, like: System | None = None, frozen: bool = False
) -> Model:
    """Variant of :func:`kaneflex.solve.loading.neighbour` for mechanisms in space, with a system that its own is
    like."""
    scene, module = acting(scene, options), model.module.system.module
    mechanism, p = mechanism_of(scene), bind_parameters(scene, module)
    if options.dynamics == "coupled":
        system = bound_system(mechanism, module, p, int(options.modes), False, options.elements, like, frozen)
        return _coupled_model(scene, options, _bound(system, scene, options))
    motion = _bound(rigid_system(mechanism, module, p), scene, options)
    return build_model(scene, options, motion, model if frozen else None)


def _bound(system: System, scene: Scene, options: Options) -> SpatialKinematics:
    """Motion of a system before a run: as the drives prescribe it, else its start."""
    module, start = SpatialModule(system), start_of(system)
    check_bearings(system, start)
    if options.dynamics == "coupled":
        start = given_state(system, given_start(scene), start) if options.start == "given" else start
        return with_open_reactions(before_run(module, start), scene.sensors, options)
    if module.FREE:
        return with_open_reactions(_standing(module, start), scene.sensors, options)
    motion = SpatialKinematics(module, system.parameters, Followed(system, start))
    _check_bushings(motion, options)
    return with_open_reactions(motion, scene.sensors, options)


def _check_bushings(motion: SpatialKinematics, options: Options) -> None:
    """Raise SceneError if a prescribed motion turns a bushing too far."""
    system = motion.module.system
    if any(spring.is_bushing for spring in system.mechanism.springs.values()):
        times = np.linspace(0.0, options.duration, SWEEP + 1)
        far = overturned(system.mechanism, system.engine.instants(motion.curve.rows(times)).springs)
        if far:
            cure = "Limit the rotation, or use loads with laws"
            raise SceneError(f"springs.{far[0]}.bushing", None, far[1], cure)


def spatial_start(scene: Scene, progress: Progress = lambda stage: None) -> tuple[System, State, SpatialMotion]:
    """Mechanism in space, its initial state, and its motion at that instant."""
    module = find_laws_module(scene, progress)[0]
    system = rigid_system(mechanism_of(scene), module, bind_parameters(scene, module))
    start = start_of(system)
    return system, start, _standing(SpatialModule(system), start).at(0.0)


def _standing(module: SpatialModule, start: State) -> SpatialKinematics:
    """Kinematics of a mechanism in space that stays in its initial state."""
    system = module.system
    return SpatialKinematics(module, system.parameters, Standing(system, start))


def with_open_reactions(motion: Moving, sensors: Mapping[str, Sensor], options: Options) -> Moving:
    """Motion that knows its statically indeterminate reactions, at its start and elsewhere in the run.

    Raises SceneError if bodies are rigid or coupled, and a sensor reads one.
    """
    times = motion.begin + options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE)
    lost = open_reactions(motion.module.system, map(motion.curve, times.tolist()))
    if options.dynamics in ("rigid", "coupled"):
        check_sensors(motion.module.system, sensors, lost, _before if options.dynamics == "rigid" else None)
    return replace(motion, module=replace(motion.module, open_reactions=lost))


def check_stage(model: Model) -> None:
    """Raise SceneError if a sensor reads a reaction that is statically indeterminate with deforming links."""
    if not model.equations.size:
        return
    from kaneflex.multibody.model.spatial_elastic import DeformingKinematics, undetermined  # few runs need it

    motion = model.motion
    if isinstance(motion, DeformingKinematics):
        instants = motion.at(model.options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE))
        check_sensors(motion.module.system, model.scene.sensors, undetermined(motion.deforming.map, instants), None)


def _before(system: System, sensor: Sensor) -> Iterator[str]:
    """Reactions of the joints before a section of a rigid link, which its forces balance."""
    assert isinstance(sensor.target, Address)
    x, after = system.mechanism.point(sensor.target)[0], sensor.cut == "after"
    for name, joint in system.mechanism.joints.items():
        on = [side.at[0] for side in joint.sides if side.body == sensor.target.body]
        if any(at < x or at == 0.0 or (after and at == x) for at in on):
            yield from (f"{name}.force", f"{name}.moment")


def given_state(system: System, tables: Start, start: State) -> State:
    """Initial state with the coordinates and rates that the scene gives; whole turns of drives are removed.

    Raises SceneError as :func:`kaneflex.solve.coupled_state.closed_state`.
    """
    driven = system.columns(system.driven, COORDINATE)
    given = laid_state(tables, system, start)
    turns = system.engine.turns[system.engine.prescribed]
    given.q[driven] -= turns * whole_turns(given.q[driven] - system.courses(start.t)[:, 0])
    # a complete state may lie far from the start, where other speeds are independent
    complete = {name for name, _ in system.engine.layout.positions} <= set(tables.displacements)
    choice = choose(system, given.q, prefer=True) if complete else start.choice
    return closed_state(tables, system, given, choice)
