"""Solution of a coupled model: initial state, integration, and the motion that sensors read."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.mechanism.closure import changed_speed
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import reference_instant
from kaneflex.multibody.model.computed_module import ComputedModule
from kaneflex.multibody.model.initial_state import choose_for_all
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.time.floating_motion import FloatingMotion
from kaneflex.multibody.time.harmonic_balance import HARMONICS, orbit_start
from kaneflex.multibody.time.linearisation import Equations, prepare
from kaneflex.multibody.time.rigid_reference import ReferenceKinematics, check_turns_kept, unwrapped
from kaneflex.multibody.time.run import Method, Run, integrate
from kaneflex.multibody.time.shooting import Cycles
from kaneflex.multibody.time.spatial_motion import SpatialKinematics
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.solve.events import happens, until_stop
from kaneflex.solve.initial import SavedState, closed_state, given_start, state_after, written_state
from kaneflex.solve.quasistatic import slow_state
from kaneflex.solve.run_checks import INSTANTS, UNREPEATED, check_directions, check_laws, refuse_unrepeated
from kaneflex.solve.run_result import RunResult
from kaneflex.support.errors import SceneError
from kaneflex.support.weak_cache import WeakCache

Share = Callable[[float], None]
_LATER = 1e-6
"""Share of a cycle after its ends at which drives and loads are compared, since laws may jump at the ends."""
_REPEATS = 1e-6
"""Change of a drive or load over a cycle, relative to the larger of it and one, that counts as periodic."""
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
    system, options = model.coupled_system, model.options
    near = None if after is None else state_after(system, after, system.engine.chosen_at)
    begin = 0.0 if after is None else after.t
    times = begin + model.step * np.arange(options.steps + 1)
    stops = [event for event in model.scene.events.values() if event.stop and model.coupled is not None]

    def stop(part: CoupledTrajectory) -> bool:
        return happens(result_of(model, part, 0.0), stops)

    if options.start == "periodic":
        trajectory = repeated(model, times, near and near[0], progress, closer)
    else:
        start = beginning(model) if near is None else near[0]
        trajectory = integrate(system, start, times, method_of(model), progress, stop if stops else None)
    if near is not None:
        trajectory.curve.turned = near[1]
    found = until_stop(result_of(model, trajectory, time.perf_counter() - started))
    if model.coupled is not None:
        check_directions(model.scene, found.times, found.motion.place, damped=False)  # force of dampers is continuous
    return found


def repeated(
    model: Model, times: np.ndarray, near: State | None, progress: Share | None = None, closer: float = 1.0
) -> CoupledTrajectory:
    """Periodic motion over ``times`` [s] near a state, by default that of its harmonics, else of an equilibrium.

    ``closer``: factor on the tolerance of its change over the cycle; other than 1 for a cycle near a known one, whose
    stability is then not judged, and which begins at the start.

    Raises SceneError if drives or loads are not periodic.
    """
    system, begin, period = model.coupled_system, float(times[0]), model.options.duration
    system.engine.compile()
    equations, first = _of_cycle(model, near)
    _check_repeats(system, period, [near or first])
    cycles = Cycles(equations, times, method_of(model), closer)
    if near is None and not cycles.touches:
        shapeless = partial(_undeformed, model, first, equations.choice)
        first = orbit_start(equations, shapeless, begin, period, HARMONICS) or equations.equilibrium(first) or first
    trajectory, verdict = cycles.repeated(near or first, progress)
    if verdict is not None and verdict.outcome is not Outcome.NO_PERIODIC_STATE:
        _check_repeats(system, period, [*cycles.along(trajectory, INSTANTS)], cycles.turns(trajectory))
    return trajectory if verdict is None else replace(trajectory, **verdict._asdict())


def _check_repeats(system: Any, period: float, states: Sequence[State], turns: np.ndarray | float = 0.0) -> None:
    """Raise SceneError unless courses of drives, up to full turns, sizes of loads and forces of springs at some states
    are the same a period [s] later, in the plane and in space; ``turns``: full turns of coordinates in a cycle [rad].
    """
    engine, mechanism, driven = system.engine, system.mechanism, system.engine.layout.driven
    springs = [name for name, spring in mechanism.springs.items() if not spring.is_bushing]

    def known(state: State, later: float) -> list[np.ndarray]:
        t = state.t + (_LATER + later) * period
        sizes = system.project(t, state.q + later * turns, state.u, state.choice).sizes
        tensions = engine.work.springs[: len(springs), 1].copy()
        return [*engine.courses(np.array([t])).reshape(-1, 3), *sizes[:, None], *tensions[:, None]]

    cycles = ([known(state, later) for state in states] for later in (0.0, 1.0))
    both = (map(np.stack, zip(*cycle, strict=True)) for cycle in cycles)
    for name, before, after in zip((*driven, *mechanism.loads, *springs), *both, strict=True):
        if name in driven and mechanism.joints[name].kind != "prismatic":
            after[:, 0] -= whole_turns(after[:, 0] - before[:, 0])
        change = abs(after - before)
        if change.max() > _REPEATS * max(1.0, abs(before).max()):
            k = np.unravel_index(change.argmax(), change.shape)
            refuse_unrepeated(UNREPEATED.format(name, before[k], after[k]))


def _of_cycle(model: Model, near: State | None) -> tuple[Equations, State]:
    """Equations of a cycle, and the state that it is searched from."""
    system, start = model.coupled_system, beginning(model) if near is None or model.scene.is_spatial else near
    equations, start = prepare(system, start)
    if model.coupled is not None or not equations.shapes.all():
        return equations, start
    times = (near or start).t + np.linspace(0.0, model.options.duration, _POSITIONS)
    choice = choose_for_all(system, np.array([state.q for state in undeformed(model, times)]))
    return Equations(system, choice), system.project(0.0, start.q, start.u, choice)


def motion_along_run(model: Model, run: Run) -> SpatialKinematics:
    """Motion of a mechanism in space along its run, with the checks that need it."""
    from kaneflex.solve.engine_loading import with_open_reactions

    module, coupled = ComputedModule(run.system), model.coupled_in_space
    motion = SpatialKinematics(module, run.system.parameters, run) if coupled is None else coupled.along(run)
    reached = model.options._replace(duration=float(run.state[0]) - run.start.t)
    if module.FREE:
        motion = with_open_reactions(motion, model.scene.sensors, reached)
        check_laws(replace(model, motion=motion, options=reached))
    return motion


def method_of(model: Model) -> Method:
    """Integration method of a model's options; without coupling that of the motion before anything deforms."""
    options, scene = model.options, model.scene
    size = model.motion.module.system.mechanism.size if scene.is_spatial else mechanism_size(model)
    if options.dynamics != "coupled":
        return Method("radau", options.forward_tolerance, size, entry="solve.forward.tolerance")
    return Method(options.integrator, options.tolerance, size, options.bounded)


def beginning(model: Model) -> State:
    """Initial state: of the rigid mechanism, of the quasi-static start, or as the scene gives it.

    It is computed once per model.
    """
    return _BEGINNINGS.of(model, lambda: _beginning(model))


_BEGINNINGS: WeakCache[Model, State] = WeakCache()


def _beginning(model: Model) -> State:
    asked, in_space = model.options.start, model.coupled_in_space
    if in_space is not None:
        start = in_space.first
    else:
        start = undeformed(model, np.zeros(1))[0]
        start = _given(model, start) if asked == "given" else start
        _check_turns(model, start)
        if asked == "quasistatic" and model.scene.free_joints:
            reason = f"{model.scene.free_joints[0]} is free and has no equilibrium"
            raise SceneError("solve.start", asked, reason, "Start from zero")
        if asked not in ("given", "quasistatic"):
            _check_speeds(model, start)
    if asked == "quasistatic":
        return slow_state(*prepare(model.coupled_system, start), model.options.duration)
    return start


def _given(model: Model, start: State) -> State:
    """Initial state with the coordinates and rates that the scene gives, the others of the start; with as many full
    turns as drives, welds and guides prescribe.

    Raises SceneError if springs or laws depend on others, and as :func:`kaneflex.solve.initial.closed_state`.
    """
    system, tables = model.coupled, given_start(model.scene.solve)
    assert system is not None
    laid, engine = written_state(tables, system, start), system.engine
    before = system.poses(laid)
    poses = unwrapped(system, before, cast(Any, model.motion).start.drives, before)
    laws = [law for law in map(model.scene.law, model.scene.loads) if law is not None]
    check_turns_kept(system, laws, before, poses)
    frames = np.array([np.concatenate([*each.values()]) for each in (before, poses)])
    was, now = system.undeformed(np.full(2, laid.t), frames, 0.0 * frames)
    given = replace(laid, q=laid.q + engine.turns * whole_turns(now.q - was.q))
    asked = [k for k, (name, _) in enumerate(system.engine.layout.positions)
             if name in (*tables.displacements, *tables.velocities) and not engine.shapes[k]]  # fmt: skip
    return closed_state(tables, system, given, engine.chosen_at(given, asked or engine.free_drives))


def result_of(model: Model, trajectory: CoupledTrajectory, seconds: float) -> RunResult:
    """Solution of a coupled trajectory; the free joints of its rigid mechanism follow the coupled motion."""
    system, rigid = model.coupled, model.motion
    if system is None:
        curve = trajectory.curve
        model = replace(model, motion=motion_along_run(model, curve))
        if curve.turned is not None:
            model = replace(model, reference_time=curve.start.t)
        elif model.module.FREE and len(trajectory.times) == len(curve.times):
            model = replace(model, reference_time=reference_instant(model)[0])
        return RunResult(model, trajectory, seconds)
    assert isinstance(rigid, ReferenceKinematics)
    moving = FloatingMotion.of(system, rigid.at(trajectory.times), trajectory.record)
    return RunResult(replace(model, motion=rigid.along(moving)), trajectory, seconds)


def mechanism_size(model: Model) -> float:
    """Size of the mechanism [m]: longest body, else farthest ground point, else that of the rigid mechanism."""
    scene = model.scene
    length = max((body.length or 0.0 for body in scene.bodies.values()), default=0.0)
    length = length or max((math.hypot(*at) for at in scene.ground.values()), default=0.0)
    return length or (1.0 if scene.is_spatial else mechanism_of(scene).size)


def _check_turns(model: Model, start: State) -> None:
    """Raise SceneError if the bodies of a joint with backlash start with different whole turns."""
    scene, system = model.scene, model.coupled
    assert system is not None
    if not any(joint.clearance is not None for joint in scene.joints.values()):
        return
    poses = system.poses(start)
    for name, joint in scene.joints.items():
        if joint.clearance is not None:
            first, second = (poses[a.body][2] if a.body != "ground" else 0.0 for a in joint.addresses)
            turns = round((second - first - joint.clearance.middle) / math.tau)
            if turns:
                raise SceneError(
                    f"joints.{name}.clearance", None,
                    f"at the start its angle is {turns} full turns from the middle of the backlash",
                    "Start the drives of its bodies without full turns, or add them to the middle",
                )  # fmt: skip


def _check_speeds(model: Model, start: State) -> None:
    """Check that free joints start with their given speeds, which locked loops may prevent."""
    scene, system = model.scene, model.coupled
    assert system is not None
    speeds = {name: drive.initial_speed for name, drive in scene.drives.items()
              if drive.kind == "free" and "initial_speed" in drive.model_fields_set}  # fmt: skip
    if not speeds or scene.contacts:  # sides that touch may change them at once
        return
    try:
        system.project(start.t, start.q, start.u, system.engine.chosen_at(start))
    except ArithmeticError:  # the run reports it
        return
    record = system.unfold(system.engine.row(start.t)[None])
    moved = FloatingMotion.of(system, model.motion.at(start.t), record)
    rates = {name: float(moved.coordinate(name)[1][0]) for name in speeds}
    for name, speed in speeds.items():
        if not abs(rates[name] - speed) <= _MISSED * abs(speed):
            raise changed_speed(f"drives.{name}.initial_speed", speed, rates[name])


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
