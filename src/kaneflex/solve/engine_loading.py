"""Binding of mechanisms whose motion the engine computes: in space, and under preset coupled.

Drives and loads are derived, everything else is numbers; also the initial state, and which reactions are statically
indeterminate because of redundant constraints.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from kaneflex.fem.freedom import check_held_twice
from kaneflex.fem.mobility import check_determined, check_free
from kaneflex.mechanism.closure import SWEEP, drive_positions
from kaneflex.mechanism.floating_frames import link_modes
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.position_analysis import Placement, place
from kaneflex.mechanism.rigid_bodies import check_elastic, check_on_axes
from kaneflex.mechanism.tight_start import as_it_starts
from kaneflex.multibody.model.assembly import bound_system, build_system, rigid_system
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model, reference_instant
from kaneflex.multibody.model.computed_module import ComputedModule
from kaneflex.multibody.model.determinacy import check_bearings, check_freedoms, check_sensors, undetermined
from kaneflex.multibody.model.initial_state import choose, start_of
from kaneflex.multibody.model.module_loading import bind_parameters
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.model.tree_layout import COORDINATE
from kaneflex.multibody.time.curves import AtStart, DrivenCurve
from kaneflex.multibody.time.rigid_reference import ReferenceKinematics, rigid_reference
from kaneflex.multibody.time.spatial_motion import CoupledKinematics, SpatialKinematics, SpatialMotion, before_run
from kaneflex.multibody.time.spring_displacements import overturned
from kaneflex.scene import Scene
from kaneflex.scene.bodies import Body
from kaneflex.scene.options import Options, acting, limits_modes, modes_of, without_poses
from kaneflex.scene.parts import Solve
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import Sensor
from kaneflex.scene.start import Start
from kaneflex.solve.initial import closed_state, given_start, written_state
from kaneflex.solve.run_checks import check_laws, check_memory
from kaneflex.solve.touching import check_lines
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import compiled_by

Progress = Callable[[str], None]
Moving = TypeVar("Moving", bound=SpatialKinematics)
_POSED = 1e-6
"""Share of a structure's size by which welds may move a body from its pose."""
_ELSEWHERE = np.concatenate([[0.0], (np.arange(8) + 0.381966) / 8.0])
"""Shares of a run at which reactions are checked: its start, and others away from aligned positions."""


def bind(scene: Scene, options: Options, progress: Progress) -> tuple[Model, tuple[str, ...], dict[str, float]]:
    """Model of a mechanism, notes on its scene, and the seconds of derivation and compilation."""
    return (_in_space if scene.is_spatial else _in_the_plane)(scene, options, progress)


def _in_space(scene: Scene, options: Options, progress: Progress) -> tuple[Model, tuple[str, ...], dict[str, float]]:
    scene, coupled = acting(scene, options), options.dynamics == "coupled"
    system, derived = _system(scene, options, progress)
    compiled = compiled_by(progress, system.engine.compile)
    motion = _bound(system, scene, options)
    if not motion.is_start:
        rigid = motion.rigid if isinstance(motion, CoupledKinematics) else motion
        check_laws(Model(scene, options, rigid))
    model = _coupled_model(scene, options, motion) if coupled else build_model(scene, options, motion)
    check_stage(model)
    beyond = _too_many_modes(system, modes_of(scene.solve)) if coupled and not limits_modes(scene.solve) else []
    return model, tuple(beyond), {"derive": derived, "compile": compiled}


def _in_the_plane(
    posed: Scene, options: Options, progress: Progress
) -> tuple[Model, tuple[str, ...], dict[str, float]]:
    scene = without_poses(posed)
    spare = check_determined(mechanism_of(scene), twice=True)
    check_on_axes(scene)
    without_linear, scene = not has_elastic_stage(scene), acting(as_it_starts(scene), options)
    mechanism = mechanism_of(scene)
    placement = place(mechanism)
    _check_poses(posed.bodies, mechanism.size, placement)
    if spare:
        check_held_twice(mechanism, placement, spare)
    coupled, derived = _system(scene, options, progress)
    compiled = compiled_by(progress, coupled.engine.compile)
    check_freedoms(coupled, placement)
    motion = rigid_reference(coupled, placement)  # with the same library
    check_reference(motion, options)
    bound = Model(scene, options, motion)
    check_laws(bound)
    check_lines(bound)
    model = build_model(scene, options, motion, without_linear=without_linear)
    if spare:
        open_rows = undetermined(coupled, motion.states(coupled, np.zeros(1)))
        check_sensors(coupled, scene.sensors, open_rows)
        coupled = replace(coupled, undetermined=open_rows)
    seconds = {"derive": derived, "compile": compiled}
    return replace(model, coupled=coupled), tuple(_all_modes(mechanism, scene.solve)), seconds


def _system(scene: Scene, options: Options, progress: Progress) -> tuple[System, float]:
    """System, of deforming bodies under preset coupled, and the seconds of derivation."""
    if options.dynamics == "coupled":  # memory is checked before shapes are computed
        check_memory(mechanism_of(scene), options, len(scene.drives) + len(scene.loads) + 10 * len(scene.bodies))
        return build_system(scene, progress, int(options.modes), options.elements)
    found = build_system(scene, progress)
    check_memory(mechanism_of(scene), options, len(ComputedModule(found[0]).SCALARS))
    return found


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


def _check_poses(bodies: Mapping[str, Body], size: float, placement: Placement) -> None:
    """Raise SceneError if a structure's welds contradict the pose of a body."""
    for name, body in bodies.items():
        x, y, _ = placement.poses[name]
        if body.pose is not None and math.hypot(x - body.pose.at[0], y - body.pose.at[1]) > _POSED * size:
            held = f"the welds put its start at [{x:.6g} m, {y:.6g} m]"
            raise SceneError(f"bodies.{name}.pose.at", list(body.pose.at), held, "Give that position, or other lengths")


def _all_modes(mechanism: NumericMechanism, solve: Solve) -> list[str]:
    """Notes on links whose elements have fewer modes than the default number."""
    most = modes_of(solve)
    links = [name for name, body in mechanism.deforming.items() if body.elastic]
    return [
        f"{name} has only {count} of the default's {most} modes; more elements give more"
        for name, count in ((each, link_modes(mechanism, each, most, limits_modes(solve))) for each in links)
        if count < most
    ]  # fmt: skip


def check_reference(motion: ReferenceKinematics, options: Options) -> None:
    """Check that prescribed drives can move the rigid mechanism through their range, as far as it is known."""
    reference, mechanism, of = motion.module, motion.module.system.mechanism, motion.module.system.record
    rigid: Any = motion.at(np.zeros(1) if reference.FREE else np.linspace(0.0, options.duration, SWEEP + 1))
    if not np.isfinite(rigid.record[:, [*of.q, *of.v, *of.a]]).all() and np.isfinite([*rigid.known.values()]).all():
        raise SceneError(
            "joints", ", ".join(dict.fromkeys(reference.system.layout.cuts)),
            f"the loop cannot close at {drive_positions(mechanism, rigid)}, or is in a singular position there",
            "Change the lengths, or limit the drive's range",
        )  # fmt: skip


def _too_many_modes(system: System, asked: int) -> list[str]:
    """Warning for each link whose elements have fewer modes than the scene requests."""
    return [
        f"{name} has only {each.most} bending modes per plane, fewer than solve.modes = {asked}: "
        "more elements give more"
        for name, each in system.shapes.items() if asked > each.most
    ]  # fmt: skip


def _coupled_model(scene: Scene, options: Options, motion: SpatialKinematics) -> Model:
    """Model of deforming bodies in space, without linear equations."""
    rigid = motion.rigid if isinstance(motion, CoupledKinematics) and not motion.is_start else motion
    model = Model(scene, options, motion)
    return replace(model, reference_time=reference_instant(replace(model, motion=rigid))[0])


def neighbour_of(model: Model, scene: Scene, options: Options, alike: bool, frozen: bool) -> Model:
    """Variant of :func:`kaneflex.solve.loading.neighbour` for these mechanisms; ``alike``: with its shapes' signs and
    scales. Else elements and numbers of modes alone differ, and the model is for its own equations only."""
    own, fixed = model.coupled_system, model if frozen else None
    scene = acting(scene if scene.is_spatial else as_it_starts(without_poses(scene)), options)
    mechanism, p = mechanism_of(scene), bind_parameters(scene, own.module)
    if options.dynamics != "coupled":
        motion = _bound(rigid_system(mechanism, own.module, p), scene, options)
        return build_model(scene, options, motion, fixed)
    modes, like = (int(options.modes), limits_modes(scene.solve)), own if alike else None
    system = bound_system(mechanism, own.module, p, *modes, options.elements, like, frozen)
    if scene.is_spatial:
        return _coupled_model(scene, options, _bound(system, scene, options))
    start = place(mechanism) if alike else cast(Any, model.motion).start
    without_linear = model.without_linear or not alike
    found = build_model(scene, options, rigid_reference(system, start), fixed, without_linear=without_linear)
    return replace(found, coupled=replace(system, undetermined=own.undetermined))


def _bound(system: System, scene: Scene, options: Options) -> SpatialKinematics:
    """Motion of a system before a run: as the drives prescribe it, else its start."""
    module, start = ComputedModule(system), start_of(system)
    check_bearings(system, start)
    if options.dynamics == "coupled":
        first = _given_state(system, given_start(scene.solve), start) if options.start == "given" else start
        return with_open_reactions(before_run(module, start, first), scene.sensors, options)
    if module.FREE:
        return with_open_reactions(_kinematics_at_rest(module, start), scene.sensors, options)
    motion = SpatialKinematics(module, system.parameters, DrivenCurve(system, start))
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
    system, _ = build_system(scene, progress)
    start = start_of(system)
    return system, start, _kinematics_at_rest(ComputedModule(system), start).at(0.0)


def _kinematics_at_rest(module: ComputedModule, start: State) -> SpatialKinematics:
    """Kinematics of a mechanism in space that stays in its initial state."""
    system = module.system
    return SpatialKinematics(module, system.parameters, AtStart(system, start))


def with_open_reactions(motion: Moving, sensors: Mapping[str, Sensor], options: Options) -> Moving:
    """Motion that knows its statically indeterminate reactions, at its start and elsewhere in the run.

    Raises SceneError if bodies are rigid or coupled, and a sensor reads one.
    """
    times = motion.begin + options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE)
    lost = undetermined(motion.module.system, map(motion.curve, times.tolist()))
    if options.dynamics in ("rigid", "coupled"):
        check_sensors(motion.module.system, sensors, lost, _before if options.dynamics == "rigid" else None)
    return replace(motion, module=replace(motion.module, open_reactions=lost))


def check_stage(model: Model) -> None:
    """Raise SceneError if a sensor reads a reaction that is statically indeterminate with deforming links."""
    if not model.equations.size:
        return
    from kaneflex.multibody.model.spatial_elastic import DeformingKinematics  # few runs need it
    from kaneflex.multibody.model.spatial_elastic import undetermined as lost

    motion = model.motion
    if isinstance(motion, DeformingKinematics):
        instants = motion.at(model.options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE))
        check_sensors(motion.module.system, model.scene.sensors, lost(motion.deforming.map, instants), None)


def _before(system: System, sensor: Sensor) -> Iterator[str]:
    """Reactions of the joints before a section of a rigid link, which its forces balance."""
    assert isinstance(sensor.target, Address)
    x, after = system.mechanism.point(sensor.target)[0], sensor.cut == "after"
    for name, joint in system.mechanism.joints.items():
        on = [side.at[0] for side in joint.sides if side.body == sensor.target.body]
        if any(at < x or at == 0.0 or (after and at == x) for at in on):
            yield from (f"{name}.force", f"{name}.moment")


def _given_state(system: System, tables: Start, start: State) -> State:
    """Initial state with the coordinates and rates that the scene gives; whole turns of drives are removed.

    Raises SceneError as :func:`kaneflex.solve.initial.closed_state`.
    """
    driven = system.columns(system.driven, COORDINATE)
    given = written_state(tables, system, start)
    turns = system.engine.turns[system.engine.prescribed]
    given.q[driven] -= turns * whole_turns(given.q[driven] - system.courses(start.t)[:, 0])
    # a complete state may lie far from the start, where other speeds are independent
    complete = {name for name, _ in system.engine.layout.positions} <= set(tables.displacements)
    choice = choose(system, given.q, prefer=True) if complete else start.choice
    return closed_state(tables, system, given, choice)
