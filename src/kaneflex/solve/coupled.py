"""Solution of a coupled model: initial state, integration, and the motion that sensors read; in space also of a motion
of free joints that no elastic equations act on."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from kaneflex.mechanism.closure import changed_speed
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import moving, reference_instant
from kaneflex.multibody.model.independent_speeds import choose, choose_for_all
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.model.system import BODY, CoupledSystem
from kaneflex.multibody.time.cycles import PlanarCycles, SpatialCycles
from kaneflex.multibody.time.harmonic_balance import HARMONICS, orbit_start
from kaneflex.multibody.time.linearisation import Equations, prepare
from kaneflex.multibody.time.revolutions import check_turns_kept, unwrapped
from kaneflex.multibody.time.rigid_reference import Courses, ReferenceKinematics
from kaneflex.multibody.time.run import Method, integrate
from kaneflex.multibody.time.shooting import COMPLETED, Verdict
from kaneflex.multibody.time.spatial_forward import SpatialRun
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.response.floating_motion import FloatingMotion
from kaneflex.scene import Scene
from kaneflex.solve.coupled_state import SavedState, closed_state, laid_state, state_after
from kaneflex.solve.events import happens, until_stop
from kaneflex.solve.initial import given_start
from kaneflex.solve.law_checks import check_laws, check_repeats
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.slow_start import slow_state
from kaneflex.support.errors import SceneError
from kaneflex.support.kept import Kept

Share = Callable[[float], None]
_POSITIONS = 200
"""Positions in a cycle at which independent shapes must not become dependent."""
_MISSED = 1e-3
"""Largest change of a free joint's initial speed by loops, as a share of it."""


def simulate_coupled(
    model: Model, progress: Share | None = None, after: SavedState | None = None, closer: float = 1.0
) -> RunResult:
    """Integrate the coupled equations over the model's duration, from the state ``after`` if given; ``closer``: see
    :func:`repeated`."""
    started = time.perf_counter()
    system, options = model.coupled, model.options
    assert system is not None
    method = method_of(model)
    times = (after.t if after is not None else 0.0) + model.step * np.arange(options.steps + 1)
    start = beginning(model) if after is None else state_after(system, after, system.choose)[0]
    stops = [event for event in model.scene.events.values() if event.stop]

    def stop(part: CoupledTrajectory) -> bool:
        return happens(as_result(model, part, 0.0), stops)

    if options.start == "periodic":
        trajectory = repeated(model, times, start, progress, closer)
    else:
        trajectory = integrate(system, start, times, method, progress, stop if stops else None)
    return until_stop(as_result(model, trajectory, time.perf_counter() - started))


def repeated(
    model: Model, times: np.ndarray, near: State, progress: Share | None = None, closer: float = 1.0
) -> CoupledTrajectory:
    """Periodic motion over ``times`` [s] near a start, or by harmonics if these find one.

    ``closer``: factor on the tolerance of its change over the cycle; other than 1 for a cycle near a known one, whose
    stability is then not judged, and which begins at the start.
    """
    system, start = model.coupled, None
    assert system is not None
    system.compile()
    equations, first = prepare(system, near)
    cycles = PlanarCycles(equations, times, method_of(model), closer)
    check_repeats(system, system.engine.layout.driven, first, cycles.period)
    if closer == 1.0 and not cycles.touches:
        bare = partial(_undeformed, model, near, equations.choice)
        start = orbit_start(equations, bare, near.t, cycles.period, HARMONICS)
    trajectory, verdict = cycles.repeated(start or first, progress)
    return trajectory if verdict is None else replace(trajectory, **verdict._asdict())


def integrated_in_space(model: Model, share: Share, after: SavedState | None = None, closer: float = 1.0) -> Model:
    """Variant of :func:`kaneflex.solve.free_motion.integrated` for mechanisms in space."""
    begun, coupled, options = model.in_space, model.coupled_in_space, model.options
    assert begun is not None
    system, verdict = begun.module.system, COMPLETED
    near, turned = (None, None) if after is None else state_after(system, after, lambda given: choose(system, given.q))
    if coupled is not None and options.start == "periodic":
        run, verdict = _cycle(model, system, near, share, closer)
    else:
        start = near or (begun.curve.start if coupled is None else beginning(model))
        run = SpatialRun(system, start, start.t + model.step * np.arange(options.steps + 1), method_of(model))
        run.go(share)
    run.turned = turned
    return with_run(model, run, verdict)


def with_run(model: Model, run: SpatialRun, verdict: Verdict = COMPLETED) -> Model:
    """Model in space along an integrated motion, with the warnings of its run."""
    from kaneflex.solve.spatial_loading import check_stage, with_open_reactions

    scene, options, system, coupled = model.scene, model.options, run.system, model.coupled_in_space
    motion = SpatialKinematics(SpatialModule(system), system.parameters, run)
    energy = run.energy(motion)
    if coupled is not None:
        motion = replace(coupled.along(run), verdict=verdict)
    if model.motion.is_start:
        motion = with_open_reactions(motion, options)
        check_laws(scene, motion, options)
    if coupled is not None:
        reference = model.reference_time
        if run.turned is not None:
            reference = run.start.t
        elif model.motion.is_start:
            reference = reference_instant(scene, options, motion)[0]
        found = replace(model, motion=motion, reference_time=reference, energy=energy)
    else:
        found = moving(model, motion, energy)
        check_stage(found)
    return found


def _cycle(
    model: Model, system: SpatialSystem, near: State | None, share: Share, closer: float
) -> tuple[SpatialRun, Verdict]:
    """Periodic motion near a state, by default that of its harmonics or an equilibrium, and the verdict on it.

    Raises SceneError if drives or loads are not periodic, or the motion can't continue.
    """
    start, period = start_of(system), model.options.duration
    begin = (near or start).t
    check_repeats(system, system.driven, near or start, period)
    equations = Equations(system, start.choice)
    if equations.shapes.all():
        times = begin + np.linspace(0.0, period, _POSITIONS)
        choice = choose_for_all(system, np.array([state.q for state in undeformed(model, times)]))
        equations, start = Equations(system, choice), system.project(0.0, start.q, start.u, choice)
        bare = partial(_undeformed, model, start, choice)
        near = near or orbit_start(equations, bare, begin, period, HARMONICS)
    # fast motion may have no equilibrium nearby
    start = near or equations.equilibrium(start) or start
    instants = begin + model.step * np.arange(model.options.steps + 1)
    run, verdict = SpatialCycles(equations, instants, method_of(model), closer).repeated(start, share)
    if verdict is None:
        assert run.stopped is not None
        raise run.stopped
    return run, verdict


def method_of(model: Model) -> Method:
    """Integration method of a model's options; in space without coupling that of the motion before anything deforms."""
    options, scene = model.options, model.scene
    size = model.motion.module.system.mechanism.size if scene.is_spatial else longest(scene)
    if options.dynamics != "coupled":
        return Method(options.forward_method, options.forward_tolerance, size)
    return Method(options.integrator, options.tolerance, size, options.bounded)


def beginning(model: Model) -> State:
    """Initial state: of the rigid mechanism, of the quasi-static start, or as the scene gives it.

    It is computed once per model.
    """
    return _BEGINNINGS.of(model, lambda: _beginning(model))


_BEGINNINGS: Kept[Model, State] = Kept()


def _beginning(model: Model) -> State:
    if model.coupled is None:
        return _beginning_in_space(model)
    system, start = model.coupled, undeformed(model, np.zeros(1))[0]
    if model.options.start == "given":
        start = _given(model, start)
    _check_turns(model.scene, system, start)
    if model.options.start == "quasistatic":
        return _slow(model, start)
    if model.options.start != "given":
        _check_speeds(model.scene, system, start)
    return start


def _beginning_in_space(model: Model) -> State:
    from kaneflex.solve.spatial_loading import given_state

    system, options = model.motion.module.system, model.options
    start = start_of(system)
    if options.start == "quasistatic":
        return slow_state(Equations(system, start.choice), start, options.duration)
    return given_state(system, start) if options.start == "given" else start


def _given(model: Model, start: State) -> State:
    """Initial state with the coordinates and rates that the scene gives, the others of the start; with as many full
    turns as drives, welds and guides prescribe.

    Raises SceneError if springs or laws depend on others, and as :func:`kaneflex.solve.coupled_state.closed_state`.
    """
    scene, system, tables = model.scene, model.coupled, given_start(model.scene)
    assert system is not None
    laid, engine = laid_state(scene, system, start), system.engine
    before, _ = system.frames(laid)
    q = unwrapped(scene, system, before, model.module.start.drives, system.start)
    check_turns_kept(scene, system, before, q)
    frames = np.array([before, q])[:, [k + j for k in system.start.values() for j in range(BODY)]]
    was, now = system.undeformed(np.full(2, laid.t), frames, 0.0 * frames)
    given = replace(laid, q=laid.q + engine.turns * whole_turns(now.q - was.q))
    asked = [k for k, (name, _) in enumerate(system.state_coordinates)
             if name in (*tables.displacements, *tables.velocities) and not engine.shapes[k]]  # fmt: skip
    return closed_state(scene, system, given, system.choose(given, asked or engine.free_drives))


def as_result(model: Model, trajectory: CoupledTrajectory, seconds: float) -> RunResult:
    """Solution of a coupled trajectory; the free joints of its rigid mechanism follow the coupled motion."""
    system, rigid = model.coupled, model.motion
    assert system is not None and isinstance(rigid, ReferenceKinematics)
    bare = FloatingMotion.of(model, rigid.at(trajectory.times), trajectory)
    moved = [bare.coordinate(name) for name in rigid.module.FREE]
    free = Courses(trajectory.times, *np.array(moved).reshape(-1, 3, len(trajectory.times)).transpose(1, 2, 0))
    run = None if system.engine.shapes.any() else trajectory
    return RunResult(replace(model, motion=replace(rigid, free=free, run=run)), trajectory, seconds)


def longest(scene: Scene) -> float:
    """Size of the mechanism [m]: longest body, else farthest ground point, else that of the rigid mechanism."""
    length = max((body.length or 0.0 for body in scene.bodies.values()), default=0.0)
    length = length or max((math.hypot(*at) for at in scene.ground.values()), default=0.0)
    return length or (1.0 if scene.is_spatial else mechanism_of(scene).size)


def _check_turns(scene: Scene, system: CoupledSystem, start: State) -> None:
    """Raise SceneError if the bodies of a joint with backlash start with different whole turns."""
    if not any(joint.clearance is not None for joint in scene.joints.values()):
        return
    q, _ = system.frames(start)
    for name, joint in scene.joints.items():
        if joint.clearance is not None:
            first, second = (q[system.start[a.body] + 2] if a.body != "ground" else 0.0 for a in joint.addresses)
            turns = round((second - first - joint.clearance.middle) / math.tau)
            if turns:
                raise SceneError(
                    f"joints.{name}.clearance", None,
                    f"at the start its angle is {turns} full turns from the middle of the backlash",
                    "Start the drives of its bodies without full turns, or add them to the middle",
                )  # fmt: skip


def _check_speeds(scene: Scene, system: CoupledSystem, start: State) -> None:
    """Check that free joints start with their given speeds, which locked loops may prevent."""
    speeds = {name: drive.initial_speed for name, drive in scene.drives.items()
              if drive.kind == "free" and "initial_speed" in drive.model_fields_set}  # fmt: skip
    if not speeds or scene.contacts:  # sides that touch may change them at once
        return
    try:
        system.project(start.t, start.q, start.u, system.choose(start))
    except ArithmeticError:  # the run reports it
        return
    for name, speed in speeds.items():
        if not abs(system.rate(name) - speed) <= _MISSED * abs(speed):
            raise changed_speed(f"drives.{name}.initial_speed", speed, system.rate(name))


def _slow(model: Model, start: State) -> State:
    """State of a quasi-static start (:mod:`kaneflex.solve.slow_start`), from that of undeformed bodies."""
    free = [name for name, drive in model.scene.drives.items() if drive.kind == "free"]
    if free:
        raise SceneError(
            "solve.start", model.options.start, f"{free[0]} is free and has no equilibrium",
            "Start from zero",
        )  # fmt: skip
    assert model.coupled is not None
    return slow_state(*prepare(model.coupled, start), model.options.duration)


def undeformed(model: Model, times: np.ndarray) -> list[State]:
    """States of a coupled system with undeformed bodies, which move as the rigid reference, at ``times`` [s]."""
    motion: Any = model.motion
    found: list[State] = motion.states(model.coupled_system, times)
    return found


def _undeformed(model: Model, first: State, choice: Choice, times: np.ndarray) -> list[State]:
    """The same with as many full turns as at first, by the independent speeds of a choice."""
    found, engine = undeformed(model, times), model.coupled_system.engine
    own, speeds = engine.own.T
    turning, missing = own[(engine.turns & ~engine.shapes)[speeds]], 0.0 * first.q
    missing[turning] = whole_turns((first.q - found[0].q)[turning])
    return [replace(state, q=state.q + missing, choice=choice) for state in found]
