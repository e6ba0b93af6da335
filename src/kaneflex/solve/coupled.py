"""Solution of a coupled model: initial state, integration, and the motion that sensors read."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import initial_rates
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.rigid_reference import FollowedKinematics, TwinKinematics
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import CoupledSystem, rigid_state, rigid_states
from kaneflex.multibody.time.cycles import PlanarCycles
from kaneflex.multibody.time.harmonic_balance import HARMONICS, orbit_start
from kaneflex.multibody.time.planar_linear import PlanarEquations, prepare
from kaneflex.multibody.time.revolutions import check_turns_kept, unwrapped
from kaneflex.multibody.time.run import Method, integrate
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.response.coupled_motion import CoupledMotion
from kaneflex.scene import Scene
from kaneflex.solve.coupled_state import State as Given
from kaneflex.solve.coupled_state import check_closed, openings
from kaneflex.solve.events import happens, until_stop
from kaneflex.solve.forward import with_courses
from kaneflex.solve.initial import given_start, laid_over, start_dimensions
from kaneflex.solve.law_checks import check_repeats
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.slow_start import slow_state
from kaneflex.support.errors import SceneError
from kaneflex.support.kept import Kept

Start = tuple[np.ndarray, np.ndarray]
"""q and v (size,) of the bodies."""


def simulate_coupled(
    model: Model, progress: Callable[[float], None] | None = None, after: Given | None = None, closer: float = 1.0
) -> RunResult:
    """Integrate the coupled equations over the model's duration, from the state ``after`` if given; ``closer``: see
    :func:`repeated`."""
    started = time.perf_counter()
    system, options = model.coupled, model.options
    assert system is not None
    method = method_of(model)
    times = (after.t if after is not None else 0.0) + model.step * np.arange(options.steps + 1)
    q, v = beginning(model) if after is None else after.fitted(system, method.length)
    stops = [event for event in model.scene.events.values() if event.stop]

    def stop(part: CoupledTrajectory) -> bool:
        return happens(as_result(model, part, 0.0), stops)

    if options.start == "periodic":
        trajectory = repeated(model, times, (q, v), progress, closer, by_harmonics=closer == 1.0)
    else:
        trajectory = integrate(system, q, v, times, method, progress, stop if stops else None)
    return until_stop(as_result(model, trajectory, time.perf_counter() - started))


def repeated(
    model: Model, times: np.ndarray, near: Start, progress: Callable[[float], None] | None = None, closer: float = 1.0,
    by_harmonics: bool = False,
) -> CoupledTrajectory:  # fmt: skip
    """Periodic motion over ``times`` [s] near a start q, v, or ``by_harmonics`` if these find one.

    ``closer``: factor on the tolerance of its change over the cycle; other than 1 for a cycle near a known one, whose
    stability is then not judged.
    """
    system, t = model.coupled, float(times[0])
    assert system is not None
    system.compile()
    equations, start = prepare(system, t, *near), None
    cycles = PlanarCycles(equations, times, method_of(model), closer)
    first, engine = equations.at(t, *near), system.engine
    row = engine.row(t)

    def sizes(t: float) -> np.ndarray:  # where free joints start
        engine.stand(row)
        engine.project(t)
        return engine.sizes.copy()

    check_repeats(system, system.engine.layout.driven, sizes, t, cycles.period)
    if by_harmonics and not cycles.touches:
        bare = partial(_undeformed, model, equations, near[0])
        start = orbit_start(equations, bare, t, cycles.period, HARMONICS)
    trajectory, verdict = cycles.repeated(start or first, progress)
    return trajectory if verdict is None else replace(trajectory, **verdict._asdict())


def method_of(model: Model) -> Method:
    """Integration method of a model's options."""
    options = model.options
    return Method(options.integrator, options.tolerance, longest(model.scene), options.bounded)


def beginning(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Initial q and v: of the rigid mechanism, of the quasi-static start, or as the scene gives them.

    They are computed once per model.
    """
    q, v = _BEGINNINGS.of(model, lambda: _beginning(model))
    return q.copy(), v.copy()


_BEGINNINGS: Kept[Model, tuple[np.ndarray, np.ndarray]] = Kept()


def _beginning(model: Model) -> tuple[np.ndarray, np.ndarray]:
    system, first = model.coupled, model.motion.at(0.0)
    assert system is not None
    q, v = rigid_state(system, first)
    if model.options.start == "given":
        return _given(model, system, q, v)
    q = unwrapped(model.scene, system, q, first)
    _check_turns(model.scene, system, q)
    if model.options.start == "quasistatic":
        return _slow(model, q, first)
    initial_rates.check_kept(model.scene, system, q, v)
    return q, v


def _given(
    model: Model, system: CoupledSystem, rigid_q: np.ndarray, rigid_v: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Initial q and v as the scene gives them, completed by the rigid mechanism's; joints closed, rates included."""
    scene, tables = model.scene, given_start(model.scene)
    before, v = laid_over(scene, start_dimensions(model), rigid_q, rigid_v)
    given = [name for name in system.start if f"{name}.phi" in tables.displacements]
    q = unwrapped(scene, system, before, model.motion.at(0.0), given)
    check_closed(
        openings(system, 0.0, q, longest(scene)), "solve.start", "a table of a state",
        "Give the coordinates of all bodies, or shapes that leave the joints where they are",
    )  # fmt: skip
    check_turns_kept(scene, system, before, q, given)
    _check_turns(scene, system, q)
    found = initial_rates.closed(system, q, v)
    if found is None:  # the run reports it
        return q, v
    return found, initial_rates.fitted(scene, system, found, v, tables.velocities)


def as_result(model: Model, trajectory: CoupledTrajectory, seconds: float) -> RunResult:
    """Solution of a coupled trajectory; the free drives of its rigid mechanism follow the coupled motion."""
    free = model.module.FREE  # its order may differ from the scene's
    if free and len(trajectory.times) > 1:
        bare = CoupledMotion(model, model.motion.at(trajectory.times), trajectory)
        courses = [bare.coordinate(name) for name in free]
        states = np.array([[course[0] for course in courses], [course[1] for course in courses]])
        accelerations = np.array([course[2] for course in courses])
        states = states.reshape(2 * len(free), -1)
        p = with_courses(model.motion.module, model.motion.parameters, trajectory.times, states, accelerations)
        model = replace(model, motion=replace(model.motion, parameters=p))
    assert model.coupled is not None
    if isinstance(model.motion, TwinKinematics) and not model.coupled.shape_columns:
        motion = FollowedKinematics(model.motion.module, model.motion.parameters, trajectory)
        model = replace(model, motion=motion)
    return RunResult(model, trajectory, seconds)


def longest(scene: Scene) -> float:
    """Size of the mechanism [m]: longest body, else farthest ground point, else that of the rigid mechanism."""
    length = max((body.length or 0.0 for body in scene.bodies.values()), default=0.0)
    length = length or max((math.hypot(*at) for at in scene.ground.values()), default=0.0)
    return length or (1.0 if scene.is_spatial else mechanism_of(scene).size)


def _check_turns(scene: Scene, system: CoupledSystem, q: np.ndarray) -> None:
    """Raise SceneError if the bodies of a joint with backlash start with different whole turns."""
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


def _slow(model: Model, q: np.ndarray, rigid: RigidMotion) -> Start:
    """Initial q and v of a quasi-static start (:mod:`kaneflex.solve.slow_start`), from those of undeformed bodies."""
    free = [name for name, drive in model.scene.drives.items() if drive.kind == "free"]
    if free:
        raise SceneError(
            "solve.start", model.options.start, f"{free[0]} is free and has no equilibrium",
            "Start from zero",
        )  # fmt: skip
    system, t = model.coupled, float(rigid.times[0])
    assert system is not None
    equations = prepare(system, t, q, rigid_state(system, rigid)[1])
    return equations.bodies(slow_state(equations, equations.now(t), model.options.duration))


def _undeformed(model: Model, equations: PlanarEquations, first: np.ndarray, times: np.ndarray) -> list[State]:
    """Instants of the undeformed bodies, with as many full turns as in ``first`` (size,)."""
    system = equations.system
    q, v = rigid_states(system, model.motion.at(times))
    turns = [k + 2 for k in system.start.values()]
    q[:, turns] += whole_turns(first[turns] - q[0, turns])
    return [equations.at(*each) for each in zip(times.tolist(), q, v, strict=True)]
