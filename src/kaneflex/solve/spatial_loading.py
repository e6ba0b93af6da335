"""Loading of a scene in space: drives and loads are derived, everything else is numbers."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.binding import find_spatial_module
from kaneflex.multibody.building import build_model, reference_instant, rigid_model
from kaneflex.multibody.cycles import COMPLETED, Verdict
from kaneflex.multibody.model import Model
from kaneflex.multibody.spatial_bushings import overturned
from kaneflex.multibody.spatial_coupled import (
    balanced,
    beside,
    build_coupled_system,
    independent_shapes,
    taken_turns,
)
from kaneflex.multibody.spatial_curves import Followed, Standing
from kaneflex.multibody.spatial_cycles import SpatialCycles
from kaneflex.multibody.spatial_elastic import DeformingKinematics, undetermined
from kaneflex.multibody.spatial_forward import BENT_FAR, Run, integrate
from kaneflex.multibody.spatial_linear import neighbours
from kaneflex.multibody.spatial_motion import SpatialKinematics, SpatialModule, SpatialMotion
from kaneflex.multibody.spatial_reactions import open_reactions
from kaneflex.multibody.spatial_shapes import SpatialShapes
from kaneflex.multibody.spatial_start import start_of
from kaneflex.multibody.spatial_system import SpatialSystem, State, build_spatial_system
from kaneflex.multibody.spatial_tables import COORDINATE, SPEED
from kaneflex.scene import Scene
from kaneflex.scene.options import Options, acting, moves_with_links
from kaneflex.scene.plausible import implausible
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import DRIVE_KINDS, SECTION_KINDS, Sensor
from kaneflex.solve.initial import given_start, laid_over, shape_dimensions
from kaneflex.solve.law_checks import check_finite, check_springs
from kaneflex.solve.loading import ONE_WAY, SWEEP, Progress, compiled_by, ignored_of, neighbour_options, timed
from kaneflex.solve.memory import check_memory
from kaneflex.solve.slow_start import first_rates, followed
from kaneflex.support.errors import SceneError
from kaneflex.support.terminal import share_of
from kaneflex.support.units import ANGLE

if TYPE_CHECKING:
    from kaneflex.mechanism.energy import Energy

_ELSEWHERE = np.concatenate([[0.0], (np.arange(8) + 0.381966) / 8.0])
"""Shares of a run at which reactions are checked: its start, and others away from aligned positions."""


_LOOKED_AT = 200
"""Instants of a run at which the deformation is checked."""

_REPEATS = 1e-6
"""Change of a drive or load over a cycle, relative to the larger of it and one, that counts as periodic."""
_OPEN = 1e-3
"""Change of given shapes by closing the loops that is accepted, as a share of the mechanism's size."""


def load_spatial(scene: Scene, options: Options, progress: Progress, started: float) -> Model:
    """Variant of :func:`kaneflex.solve.loading.load` for mechanisms in space."""
    ignored, scene = ignored_of(scene, options), acting(scene, options)
    if options.dynamics == "coupled" and not moves_with_links(scene, options.dynamics):
        ignored += tuple(_idle_settings(scene))
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
    began = time.perf_counter()
    motion, energy = _moving(system, options, progress)
    integrated = 0.0 if energy is None else time.perf_counter() - began
    check_springs(scene, motion, options)
    check_finite(scene, motion, options)
    model = _coupled_model(scene, options, motion) if coupled else build_model(scene, options, motion)
    if isinstance(model.motion, DeformingKinematics):
        instants = model.motion.at(options.duration * _ELSEWHERE)
        check_spatial_sensors(scene, undetermined(model.motion.deforming.map, instants))
    warnings = (*model.warnings, *implausible(scene), *ignored)
    if motion.module.FREE and options.dynamics not in ("rigid", "coupled"):
        warnings = (*warnings, ONE_WAY.format(joints=", ".join(motion.module.FREE)))
    if isinstance(motion.curve, Run):
        warnings = (*warnings, *motion.curve.passing.warnings)
    if coupled:
        turns = taken_turns(motion, np.linspace(0.0, options.duration, _LOOKED_AT))
        warnings = (*warnings, *_beyond(system, scene), *turns)
    model = replace(model, energy=energy, warnings=warnings)
    return timed(model, started, derived, compiled, integrated)


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
    links = {name: each for name, each in system.layout.shapes.items() if isinstance(each, SpatialShapes)}
    return [
        f"{name} has only {each.most} bending modes per plane, fewer than solve.modes = {asked}: "
        "more elements give more"
        for name, each in links.items() if int(asked) > each.most
    ]  # fmt: skip


def _coupled_model(scene: Scene, options: Options, motion: SpatialKinematics) -> Model:
    """Model of deforming bodies in space, without linear equations."""
    return rigid_model(scene, options, motion, reference_instant(scene, options, motion)[0])


def neighbour_in_space(model: Model, scene: Scene, frozen: bool) -> Model:
    """Variant of :func:`kaneflex.solve.loading.neighbour` for mechanisms in space."""
    options = neighbour_options(model, scene)
    if options.dynamics == "coupled":
        return refined_in_space(model, scene, options)
    scene = acting(scene, options)
    generated: ModuleType = model.module.system.module
    motion, energy = _moving(build_spatial_system(scene, generated), options, lambda stage: None)
    return replace(build_model(scene, options, motion, model if frozen else None), energy=energy)


def refined_in_space(model: Model, scene: Scene, options: Options, closer: float = 1.0) -> Model:
    """Variant of :func:`kaneflex.solve.loading.refined` for mechanisms in space."""
    scene = acting(scene, options)
    system = build_coupled_system(scene, model.module.system.module, options)
    motion, energy = _moving(system, options, lambda stage: None, closer)
    return replace(_coupled_model(scene, options, motion), energy=energy)


def _moving(
    system: SpatialSystem, options: Options, progress: Progress, closer: float = 1.0
) -> tuple[SpatialKinematics, Energy | None]:
    """Motion of a system with integrated free joints, and the energy of these.

    ``closer``: factor on the tolerance of a cycle's change.
    """
    module, energy, start = SpatialModule(system), None, start_of(system)
    rigid = options.dynamics in ("rigid", "coupled")
    if rigid:
        check_spatial_sensors(system.scene, open_reactions(system, [start]), options.dynamics == "rigid")
    if options.dynamics == "coupled":
        share = share_of(progress, "coupled dynamics")
        if options.start == "quasistatic":
            start = _slow(system, start, options.duration)
        elif options.start == "given":
            start = _given(system, start)
        repeats = options.start == "periodic"
        run, verdict = _cycle(system, start, options, share, closer) if repeats else (None, COMPLETED)
        motion, energy = run.moving(module) if run else integrate(system, start, module, options, share)
        alone = build_spatial_system(system.scene, system.module, coupled=True, balls=system.layout.kept)
        motion = replace(beside(motion, start, alone, start_of(alone)), verdict=verdict)
    elif module.FREE:
        share = share_of(progress, "forward dynamics of the rigid mechanism")
        motion, energy = integrate(system, start, module, options, share)
    else:
        motion = SpatialKinematics(module, system.parameters, Followed(system, start))
        _check_bushings(motion, options)
    # a reaction that is determinate at the start may be indeterminate elsewhere
    lost = open_reactions(system, map(motion.curve, options.duration * _ELSEWHERE))
    if rigid:
        check_spatial_sensors(system.scene, lost, options.dynamics == "rigid")
    return replace(motion, module=replace(module, open_reactions=lost)), energy


def _check_bushings(motion: SpatialKinematics, options: Options) -> None:
    """Raise SceneError if a prescribed motion turns a bushing too far."""
    system = motion.module.system
    if len(system.tables.bushings):
        times = np.linspace(0.0, options.duration, SWEEP + 1)
        far = overturned(system.mechanism, system.instants(motion.curve.rows(times)).bushings)
        if far:
            raise SceneError(f"springs.{far[0]}.bushing", None, far[1], "Turn it less, or use a load with a law")


def _cycle(
    system: SpatialSystem, start: State, options: Options, share: Callable[[float], None], closer: float
) -> tuple[Run, Verdict]:
    """Periodic motion near a start, and the verdict on it.

    Raises SceneError if drives or loads are not periodic, or the motion can't continue.
    """
    _check_repeats(system, start, options.duration)
    try:
        start = balanced(system, start)
    except (ArithmeticError, np.linalg.LinAlgError):
        pass  # fast motion may have no equilibrium nearby
    run, verdict = SpatialCycles(system, options, start, closer).repeated(start, share)
    if verdict is None:
        assert run.stopped is not None
        raise run.stopped
    return run, verdict


def _check_repeats(system: SpatialSystem, start: State, duration: float) -> None:
    """Raise SceneError unless drives and loads are periodic, up to full turns."""
    courses = [system.courses(t) for t in (0.0, duration)]
    x = np.array([start.q[system.columns(system.told_joints, COORDINATE)],
                  start.u[system.columns(system.told_joints, SPEED)]])  # fmt: skip
    sizes = []
    for t, course in zip((0.0, duration), courses, strict=True):
        told = {name: row for name, row in zip(system.driven, course, strict=True)}
        known = [told.get(name, column)[:2] for name, column in zip(system.told_joints, x.T, strict=True)]
        sizes.append(system.magnitudes(t, *np.array(known).reshape(-1, 2).T))
    turns = [system.mechanism.joints[name].kind != "prismatic" for name in system.driven]
    change = courses[1] - courses[0]
    change[turns, 0] -= whole_turns(change[turns, 0])
    named = [*zip(system.driven, change, courses[0], strict=True)]
    named += zip(system.mechanism.loads, sizes[1] - sizes[0], sizes[0], strict=True)
    for name, changed, before in named:
        if (abs(changed) > _REPEATS * max(1.0, abs(before).max())).any():
            reason = f"{name} is not periodic"
            cure = "Make every drive, law and table periodic with the cycle, or start from zero or quasistatic"
            raise SceneError("solve.start", "periodic", reason, cure)


def _slow(system: SpatialSystem, start: State, duration: float) -> State:
    """Quasi-static initial state, see :mod:`kaneflex.solve.slow_start`.

    Free joints keep their initial speeds and accelerations. Raises SceneError if no equilibrium is found at the start.
    """
    try:
        still = balanced(system, start)
        columns = independent_shapes(system, still)
        beside, which = neighbours(system, still, columns), still.choice.independent[columns]
        slope = beside.slopes(system.instants(beside.found).du[:, which])
        system.project(still.t, still.q, still.u, still.choice)
        N = system.basis(still.choice)[columns]
        inertia = N @ system.mass(still.sizes) @ N.T

        def residual(times: np.ndarray, z: np.ndarray) -> np.ndarray:
            later = (times - still.t)[:, None]
            free = np.setdiff1d(still.choice.independent, which)
            u, moved = np.tile(still.u, (len(times), 1)), np.zeros((len(times), system.speeds))
            moved[:, free] = later * still.u[free] + 0.5 * later**2 * still.du[free]
            u[:, free] += later * still.du[free]
            moved[:, which] = z
            given, out = np.hstack([system.advanced(still.q, moved), u]), np.zeros((len(times), len(system.work.kept)))
            system.near(still.choice, times, given, out)
            return system.instants(out).du[:, which]

        path = followed(residual, np.zeros(len(which)), slope, system.measure[which])
        return balanced(system, start, first_rates(path, inertia, duration))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise SceneError("solve.start", "quasistatic", str(error), f"{BENT_FAR}, or start from zero") from None


def _given(system: SpatialSystem, start: State) -> State:
    """Initial state with the shapes and rates that the scene gives.

    Raises SceneError as ``laid_over``, and for shapes that the loops change.
    """
    q, u, at, rates = start.q.copy(), start.u.copy(), system.modal_coordinates, system.modal_speeds
    q[at], u[rates] = laid_over(system.scene, shape_dimensions(system), q[at], u[rates])
    try:
        found = system.project(start.t, q, u, start.choice)
        far, reason = abs(found.q - q)[at].max(initial=0.0), "the loops don't close with these shapes"
    except ArithmeticError as error:
        far, reason = np.inf, f"in this state {error}"
    if not far <= _OPEN * system.mechanism.size:
        cure = "Give shapes that keep the joints closed, for example those of solution.state()"
        raise SceneError("solve.start", "a table of a state", reason, cure)
    _check_rates(system, u, found.u)
    return found


def _check_rates(system: SpatialSystem, asked: np.ndarray, found: np.ndarray) -> None:
    """Raise SceneError if the loops change a given rate of a shape."""
    given, largest = given_start(system.scene).velocities, abs(found / system.measure).max(initial=0.0)
    for (name, dimension), k in zip(shape_dimensions(system).items(), system.modal_speeds, strict=True):
        if name in given and abs(found[k] - asked[k]) > _OPEN * system.measure[k] * largest:
            made = f"{found[k] + 0.0:.6g} {'rad/s' if dimension is ANGLE else 'm/s'}"
            raise SceneError(
                f"solve.start.velocities.{name}", given[name], f"joints and drives make it {made}",
                "Give rates consistent with the joints, for example those of solution.state()",
            )  # fmt: skip


def spatial_start(scene: Scene, progress: Progress = lambda stage: None) -> tuple[SpatialSystem, State, SpatialMotion]:
    """Mechanism in space, its initial state, and its motion at that instant."""
    system = build_spatial_system(scene, find_spatial_module(scene, progress)[0])
    start = start_of(system)
    return system, start, _standing(SpatialModule(system), start).at(0.0)


def _standing(module: SpatialModule, start: State) -> SpatialKinematics:
    """Kinematics of a mechanism in space that stays in its initial state."""
    system = module.system
    return SpatialKinematics(module, system.parameters, Standing(system, start))


def check_spatial_sensors(scene: Scene, open_reactions: Collection[str], rigid: bool = False) -> None:
    """Raise SceneError, which names sensor and joint, if a sensor reads a statically indeterminate reaction; ``rigid``:
    section forces are those of rigid links."""
    for name, sensor in scene.sensors.items():
        for part in _reactions_read(scene, sensor, rigid):
            if any(each.startswith(part) for each in open_reactions):
                joint, _, kind = part.rpartition(".")
                raise SceneError(
                    f"sensors.{name}.{sensor.kind}", str(sensor.target), f"the {kind} of joint {joint} is statically "
                    "indeterminate: constraints are redundant, and rigid bodies don't determine it",
                    "Choose another sensor, or a spherical joint instead of a revolute one",
                )  # fmt: skip


def _reactions_read(scene: Scene, sensor: Sensor, rigid: bool) -> Iterator[str]:
    """Reactions that a sensor reads, as JOINT.force, JOINT.moment or JOINT.drive; of the section of a rigid link those
    of the joints before it."""
    if sensor.kind in DRIVE_KINDS:
        yield f"{sensor.target}.drive"
    elif sensor.kind == "joint_force":
        yield f"{sensor.target}.{'moment' if sensor.component.startswith('angle') else 'force'}"
    elif rigid and sensor.kind in SECTION_KINDS and isinstance(link := sensor.target, Address):
        x, after = scene.point(link)[0], sensor.cut == "after"
        for name, joint in scene.joints.items():
            on = [scene.point(side)[0] for side in joint.addresses if side.body == link.body]
            if any(at < x or at == 0.0 or (after and at == x) for at in on):
                yield from (f"{name}.force", f"{name}.moment")
