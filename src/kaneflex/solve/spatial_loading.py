"""Loading of a scene in space: drives and loads are derived, everything else is numbers; its initial state, and which
reactions are statically indeterminate because of redundant constraints."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from kaneflex.mechanism.closure import SWEEP
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.dynamics.spatial_bushings import overturned
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model, model_without_equations, reference_instant
from kaneflex.multibody.model.determinacy import check_sensors
from kaneflex.multibody.model.independent_speeds import choose
from kaneflex.multibody.model.module_loading import find_laws_module
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.spatial_coupled import CoupledKinematics, before_run, build_coupled_system
from kaneflex.multibody.model.spatial_elastic import DeformingKinematics, undetermined
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.spatial_layout import KIND, TURN
from kaneflex.multibody.model.spatial_rates import rates_of, speeds_of
from kaneflex.multibody.model.spatial_reactions import open_reactions
from kaneflex.multibody.model.spatial_system import SpatialSystem, build_spatial_system
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.spatial_curves import Followed, Standing
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule, SpatialMotion
from kaneflex.scene import Scene
from kaneflex.scene.options import Options, acting
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import Sensor
from kaneflex.solve.coupled_state import CONTINUE, OPEN, check_closed
from kaneflex.solve.coupled_state import State as Given
from kaneflex.solve.initial import dimensions_in_space, given_start, laid_over
from kaneflex.solve.law_checks import check_finite, check_springs
from kaneflex.solve.memory import check_memory
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import compiled_by
from kaneflex.support.units import ANGLE, LENGTH, Dimension

Progress = Callable[[str], None]
Moving = TypeVar("Moving", bound=SpatialKinematics)
_ELSEWHERE = np.concatenate([[0.0], (np.arange(8) + 0.381966) / 8.0])
"""Shares of a run at which reactions are checked: its start, and others away from aligned positions."""


def load_spatial(
    scene: Scene, options: Options, progress: Progress
) -> tuple[Model, tuple[str, ...], float, float]:
    """Model of a mechanism in space, notes on its scene, and the seconds of derivation and compilation."""
    generated, derived = find_laws_module(scene, progress)
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
    return model, tuple(_beyond(system, scene) if coupled else ()), derived, compiled


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
    return model_without_equations(scene, options, motion, reference_instant(scene, options, rigid)[0], {})


def neighbour_in_space(model: Model, scene: Scene, options: Options, frozen: bool) -> Model:
    """Variant of :func:`kaneflex.solve.loading.neighbour` for mechanisms in space, with options of the neighbour."""
    scene, system = acting(scene, options), model.module.system
    if options.dynamics == "coupled":
        found = build_coupled_system(scene, system.module, options, system, frozen)
        return _coupled_model(scene, options, _bound(found, options))
    motion = _bound(build_spatial_system(scene, system.module), options)
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
        far = overturned(system.mechanism, system.instants(motion.curve.rows(times)).springs)
        if far:
            cure = "Limit the rotation, or use loads with laws"
            raise SceneError(f"springs.{far[0]}.bushing", None, far[1], cure)


def spatial_start(scene: Scene, progress: Progress = lambda stage: None) -> tuple[SpatialSystem, State, SpatialMotion]:
    """Mechanism in space, its initial state, and its motion at that instant."""
    system = build_spatial_system(scene, find_laws_module(scene, progress)[0])
    start = start_of(system)
    return system, start, _standing(SpatialModule(system), start).at(0.0)


def _standing(module: SpatialModule, start: State) -> SpatialKinematics:
    """Kinematics of a mechanism in space that stays in its initial state."""
    system = module.system
    return SpatialKinematics(module, system.parameters, Standing(system, start))


def with_open_reactions(motion: Moving, options: Options) -> Moving:
    """Motion that knows its statically indeterminate reactions, at its start and elsewhere in the run.

    Raises SceneError if bodies are rigid or coupled, and a sensor reads one.
    """
    times = motion.begin + options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE)
    lost = open_reactions(motion.module.system, map(motion.curve, times.tolist()))
    if options.dynamics in ("rigid", "coupled"):
        check_sensors(motion.module.system.scene, lost, _before if options.dynamics == "rigid" else None)
    return replace(motion, module=replace(motion.module, open_reactions=lost))


def check_stage(model: Model) -> None:
    """Raise SceneError if a sensor reads a reaction that is statically indeterminate with deforming links."""
    motion = model.motion
    if isinstance(motion, DeformingKinematics):
        instants = motion.at(model.options.duration * (_ELSEWHERE[:1] if motion.is_start else _ELSEWHERE))
        check_sensors(model.scene, undetermined(motion.deforming.map, instants), None)


def _before(scene: Scene, sensor: Sensor) -> Iterator[str]:
    """Reactions of the joints before a section of a rigid link, which its forces balance."""
    assert isinstance(sensor.target, Address)
    x, after = scene.point(sensor.target)[0], sensor.cut == "after"
    for name, joint in scene.joints.items():
        on = [scene.point(side)[0] for side in joint.addresses if side.body == sensor.target.body]
        if any(at < x or at == 0.0 or (after and at == x) for at in on):
            yield from (f"{name}.force", f"{name}.moment")


def given_state(system: SpatialSystem, start: State) -> State:
    """Initial state with the coordinates and rates that the scene gives; whole turns of drives are removed.

    Raises SceneError as ``laid_over``, and for a state that the loops or drives change.
    """
    names, scene, key, source = dimensions_in_space(system), system.scene, "solve.start", "a table of a state"
    q = laid_over(scene, names, start.q, np.zeros(len(names)))[0]
    _normalise(system, q, key, source)
    driven, angles = system.driven_coordinates, system.courses(start.t)[:, 0]
    turns = np.isin(system.tables.nodes[[system.node(name) for name in system.driven], KIND], TURN)
    q[driven] -= turns * whole_turns(q[driven] - angles)
    v = laid_over(scene, names, q, rates_of(system, q[None], start.u[None])[0])[1]
    # a complete state may lie far from the start, where other speeds are independent
    choice = choose(system, q, prefer=True) if set(names) <= set(given_start(scene).displacements) else start.choice
    try:
        found = system.project(start.t, q, speeds_of(system, q[None], v[None])[0], choice)
        far = abs(found.q - q) / np.array([system.mechanism.size if kind is LENGTH else 1.0 for kind in names.values()])
        asked = [k for k, name in enumerate(names) if name in given_start(scene).displacements]
        off = far[[*asked, *system.modal_coordinates]].max(initial=0.0)
        reason = "joints or drives don't fit this state"
    except ArithmeticError as error:
        off, reason = np.inf, f"in this state {error}"
    if not off <= OPEN:
        cure = "Give coordinates that keep the joints closed, for example those of solution.state()"
        raise SceneError(key, source, reason, cure)
    _check_rates(system, names, v, rates_of(system, found.q[None], found.u[None])[0])
    return found


def _normalise(system: SpatialSystem, q: np.ndarray, key: str, source: str) -> None:
    """Scale the quaternions of a state to unit length, which it may miss by rounding.

    Raises SceneError (of ``key`` and ``source``) if one misses it by more.
    """
    names = list(dimensions_in_space(system))
    for k in system.engine.parts["balls"][:, 0].tolist():
        length = float(np.linalg.norm(q[k : k + 4]))
        if not abs(length - 1.0) <= OPEN:
            owner = names[k].rpartition(".")[0]
            raise SceneError(
                key, source, f"the quaternion of {owner} has length {length:.6g}, which is not 1",
                f"Give {owner}.quaternion_w, _x, _y and _z with w^2 + x^2 + y^2 + z^2 = 1",
            )  # fmt: skip
        q[k : k + 4] /= length


def _check_rates(system: SpatialSystem, names: Mapping[str, Dimension], asked: np.ndarray, found: np.ndarray) -> None:
    """Raise SceneError if joints or drives change a given rate."""
    given, size = given_start(system.scene).velocities, system.mechanism.size
    measure = np.array([size if dimension is LENGTH else 1.0 for dimension in names.values()])
    largest = abs(found / measure).max(initial=0.0)
    for k, (name, dimension) in enumerate(names.items()):
        if name in given and abs(found[k] - asked[k]) > OPEN * measure[k] * largest:
            unit = {LENGTH: "m/s", ANGLE: "rad/s"}.get(dimension, "1/s")
            raise SceneError(
                f"solve.start.velocities.{name}", given[name], f"joints and drives make it {found[k] + 0.0:.6g} {unit}",
                "Give rates consistent with the joints, for example those of solution.state()",
            )  # fmt: skip


def state_after(system: SpatialSystem, given: Given) -> tuple[State, dict[str, float]]:
    """Initial state of a run that continues another one, and the angles of joints that close loops, with whole turns.

    Raises SceneError if the state has other coordinates, opens joints, or has a quaternion that is not of unit length.
    """
    names, joints = list(dimensions_in_space(system)), {f"{name}.angle": name for name in system.mechanism.joints}
    q, v = given.ordered(names, joints)
    _normalise(system, q, "after", given.source)
    system.place(q)
    check_closed(_openings(system, given.t, q), "after", given.source, CONTINUE)
    u = speeds_of(system, q[None], v[None])[0]
    try:
        found = system.project(given.t, q, u, choose(system, q))
    except ArithmeticError as error:
        raise SceneError("after", given.source, f"in this state {error}", CONTINUE) from None
    known = zip(given.names, given.q.tolist(), strict=True)
    return found, {joints[name]: angle for name, angle in known if name in joints and name not in names}


def _openings(system: SpatialSystem, t: float, q: np.ndarray) -> Iterator[tuple[str, float, float]]:
    """Joints, by how much the coordinates q, which ``work`` has, open them at t [s] [m or rad], and its unit."""
    for name, rows in system.layout.cuts.items():
        for row in range(rows.start, rows.stop):
            yield name, float(system.work.rows[row, 0]), float(system.row_measure[row])
    for name, k, course in zip(system.driven, system.driven_coordinates, system.courses(t), strict=True):
        slides = system.mechanism.joints[name].kind == "prismatic"
        yield name, float(q[k] - course[0]), system.mechanism.size if slides else 1.0
