"""State space and modes of a coupled model, in the plane and in space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np
from scipy.linalg import eigh

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import no_modes
from kaneflex.multibody.model.spatial_coupled import CoupledKinematics, balanced
from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.multibody.model.system import rigid_state
from kaneflex.multibody.time import spatial_linear
from kaneflex.multibody.time.linear_equations import Linear
from kaneflex.multibody.time.linearisation import Instant, at_rest, equilibrium, linear, prepare, probes
from kaneflex.multibody.time.revolutions import unwrapped
from kaneflex.multibody.time.trajectory import CoupledTrajectory
from kaneflex.response.coupled_motion import CoupledMotion
from kaneflex.response.motion import Motion
from kaneflex.response.sensors import sensor_values
from kaneflex.response.spatial_coupled_motion import SpatialCoupledMotion
from kaneflex.scene.contact_check import refuse_contacts
from kaneflex.scene.sensors import Sensor
from kaneflex.solve.coupled import as_result
from kaneflex.support.errors import SceneError


def linear_about(model: Model, t: float) -> Linear[Any]:
    """Linear equations about the steady deformation at the time t [s].

    Raises SceneError if there is no equilibrium, for contacts and friction, and in space if a motion of free joints is
    not known.
    """
    reason = "the equations are nonlinear"
    refuse_contacts(model.scene, "solve.preset", "coupled", reason, "Leave it out")
    found = (_linear_in_space if model.scene.is_spatial else _linear_in_plane)(model, t)
    if found is None:
        raise SceneError(
            "solve.preset", model.options.preset, f"the deformed mechanism has no equilibrium at t = {t:.6g} s",
            "Choose another configuration",
        )  # fmt: skip
    return found


def _linear_in_plane(model: Model, t: float) -> Linear[Instant] | None:
    rigid, system = model.motion.at(t), model.coupled
    assert system is not None
    q, v = rigid_state(system, rigid)
    engine = prepare(system, t, unwrapped(model.scene, system, q, rigid), v)
    found = equilibrium(engine, t)
    return None if found is None else linear(engine, found)


def _linear_in_space(model: Model, t: float) -> Linear[State] | None:
    system, state = _undeformed(model, t)
    try:
        return spatial_linear.linear(spatial_linear.neighbours(system, balanced(system, state)))
    except (ArithmeticError, np.linalg.LinAlgError):
        return None


def _undeformed(model: Model, t: float) -> tuple[SpatialSystem, State]:
    """A mechanism in space and its undeformed state at t [s]."""
    motion, end = cast(CoupledKinematics, model.motion), model.options.duration
    if motion.module.FREE and not 0.0 <= t <= end:
        reason = f"the motion of {motion.module.FREE[0]} is known from 0 to {end:.6g} s"
        raise SceneError("t", t, reason, "Choose an instant of the run, or a longer solve.duration")
    return motion.module.system, motion.undeformed(t)


def fastest_decay(model: Model, trajectory: CoupledTrajectory) -> float:
    """Largest decay rate [1/s] of an overdamped mode about the last state of a planar run; 0 if there is none."""
    system, t = model.coupled, float(trajectory.times[-1])
    assert system is not None
    engine = prepare(system, t, trajectory.q[-1], trajectory.v[-1])
    y, v, a = (part[engine.independent].copy() for part in engine.motion[:3])
    try:
        found = linear(engine, Instant(t, y, v, a))
        rates = np.linalg.solve(found.M, -np.hstack([found.K, found.C]))
    except (ArithmeticError, np.linalg.LinAlgError):
        return 0.0
    values = np.linalg.eigvals(np.vstack([np.eye(len(y), 2 * len(y), len(y)), rates]))
    return float(-values.real[abs(values.imag) < abs(values.real)].min(initial=0.0))


def inputs(model: Model) -> tuple[str, ...]:
    """Inputs of the linear equations: every load, then every prescribed acceleration."""
    scene = model.scene
    return (*scene.loads, *(f"{name}.acceleration" for name, drive in scene.drives.items() if drive.kind != "free"))


def readings(model: Model, found: Linear[Any], sensors: Mapping[str, Sensor]) -> np.ndarray:
    """Derivatives of the sensors with respect to coordinates, rates and inputs, (n_sensors, 2 n_y + n_inputs)."""
    motion, weights = (_beside_in_space if model.scene.is_spatial else _beside_in_plane)(model, found)
    rows = [(sensor_values(motion, sensor) * weights).reshape(-1, 4).sum(axis=1) for sensor in sensors.values()]
    return np.array(rows).reshape(len(sensors), len(weights) // 4)


def _beside_in_plane(model: Model, found: Linear[Instant]) -> tuple[Motion, np.ndarray]:
    """Motions near an instant, and the weights by which four of them make a central difference."""
    assert model.coupled is not None
    trajectory, away, weights = probes(model.coupled, found)
    shift = {}
    for k, name in enumerate(inputs(model), start=2 * len(found.names)):
        shift[name] = np.zeros(len(away))
        shift[name][4 * k : 4 * k + 4] = away[4 * k : 4 * k + 4]
    motion = cast(CoupledMotion, as_result(model, trajectory, 0.0).motion)
    return replace(motion, shift=shift), weights


def _beside_in_space(model: Model, found: Linear[State]) -> tuple[Motion, np.ndarray]:
    """Motions near an instant in space, and the weights of the differences."""
    motion = cast(CoupledKinematics, model.motion)
    beside = spatial_linear.neighbours(motion.module.system, found.instant)
    motion = motion.along(beside)
    return SpatialCoupledMotion(replace(model, motion=motion), motion.at(beside.times)), beside.weights


def modes_at_rest(model: Model) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Undamped modes at the reference configuration from K_s and M: coordinates, omega [rad/s], shapes.

    Free joints are included, so that a freely turning mechanism has modes of zero frequency. Raises SceneError at a
    dead centre.
    """
    try:
        names, M, K = (_at_rest_in_space if model.scene.is_spatial else _at_rest_in_plane)(model, model.reference_time)
    except ArithmeticError:
        raise no_modes(model) from None
    if not len(M):
        return names, np.zeros(0), np.zeros((0, 0))
    squares, shapes = eigh(K, (M + M.T) / 2.0)
    largest = shapes[abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])]
    return names, np.sqrt(np.maximum(squares, 0.0)), shapes * np.sign(largest)


def _at_rest_in_plane(model: Model, t: float) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    system, rigid = model.coupled, model.motion.at(t)
    assert system is not None
    q = unwrapped(model.scene, system, rigid_state(system, rigid)[0], rigid)
    engine = prepare(system, t, q, np.zeros(system.size))
    return engine.names, *at_rest(engine, t)


def _at_rest_in_space(model: Model, t: float) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    system, state = _undeformed(model, t)
    return spatial_linear.at_rest(system, t, state.q)
