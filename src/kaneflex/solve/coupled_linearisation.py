"""State space and modes of a coupled model, in the plane and in space, and modes that a run does not resolve."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from kaneflex.fem.modes import symmetric_modes
from kaneflex.integrate.system import Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import no_modes
from kaneflex.multibody.model.initial_state import choose
from kaneflex.multibody.time.curves import Neighbours
from kaneflex.multibody.time.linearisation import Equations, Linear, prepare, state_matrix
from kaneflex.multibody.time.spatial_motion import CoupledKinematics
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves
from kaneflex.response.coupled_motion import CoupledMotion, coupled_motion
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.option_check import refuse_contacts
from kaneflex.scene.sensors import Sensor
from kaneflex.solve.coupled import result_of, undeformed
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.summary_tables import UnresolvedMode
from kaneflex.support.errors import SceneError

FASTEST_DECAY = 20.0
"""Step of Gauss's method over a time constant from which at least a third of a decaying part remains: its stability
function (1 + z/2 + z^2/10 + z^3/120)/(1 - z/2 + z^2/10 - z^3/120) is -0.30 at z = -20, and tends to -1."""
FEWEST_STEPS = 3
"""Steps per period below which Gauss-Legendre shifts a vibration's phase by 2 % or more."""


def linear_about(model: Model, t: float) -> Linear:
    """Linear equations about the steady deformation at the time t [s].

    Raises SceneError if there is no equilibrium, for contacts and friction, and in space if a motion of free joints is
    not known.
    """
    reason = "the equations are nonlinear"
    refuse_contacts(model.scene, "solve.preset", "coupled", reason, "Leave contacts and friction out")
    equations, base = _undeformed(model, t)
    try:
        found = equations.equilibrium(base)
        if found is not None:
            return equations.linear(found)
    except (ArithmeticError, np.linalg.LinAlgError):
        pass
    raise SceneError(
        "solve.preset", model.options.preset, f"the deformed mechanism has no equilibrium at t = {t:.6g} s",
        "Choose another configuration",
    )  # fmt: skip


def _undeformed(model: Model, t: float, moves: bool = True) -> tuple[Equations, Any]:
    """Equations of a mechanism and its undeformed state at t [s]; at rest unless it ``moves``."""
    system: Any = model.coupled_system
    free, end = model.module.FREE, model.options.duration
    if model.coupled is None and free and not 0.0 <= t <= end:
        reason = f"the motion of {free[0]} is computed from 0 to {end:.6g} s only"
        raise SceneError("t", t, reason, "Choose an instant of the run, or a longer solve.duration")
    state = undeformed(model, np.array([float(t)]))[0]
    state = replace(state, u=moves * state.u)
    if system.in_space and not moves:
        state = replace(state, choice=choose(system, state.q, prefer=True))
    return prepare(system, state)


def fastest_decay(model: Model, trajectory: CoupledTrajectory) -> float:
    """Largest decay rate [1/s] of an overdamped mode about the last state of a planar run; 0 if there is none."""
    system = model.coupled
    assert system is not None
    equations, state = prepare(system, next(trajectory.curve.states(trajectory.times[-1:])))
    try:
        values = np.linalg.eigvals(state_matrix(*equations.matrices(state)))
    except (ArithmeticError, np.linalg.LinAlgError):
        return 0.0
    return float(-values.real[abs(values.imag) < abs(values.real)].min(initial=0.0))


def inputs(model: Model) -> tuple[str, ...]:
    """Inputs of the linear equations: every load, then every prescribed acceleration."""
    scene = model.scene
    return (*scene.loads, *(f"{name}.acceleration" for name, drive in scene.drives.items() if drive.kind != "free"))


def readings(model: Model, found: Linear, sensors: Mapping[str, Sensor]) -> np.ndarray:
    """Derivatives of the sensors with respect to coordinates, rates and inputs, (n_sensors, 2 n_y + n_inputs)."""
    base, n, system = found.instant, len(found.names), model.coupled
    equations = Equations(model.coupled_system, base.choice)
    x, _, weights = equations.neighbours(base, np.r_[: 2 * n, 3 * n : 3 * n + found.B.shape[1]])
    engine, given = equations.engine, equations.given(base, x)
    near = Neighbours(equations.system, base, given)
    if system is None:
        moved = cast(CoupledKinematics, model.motion).along(near)
        beside = coupled_motion(replace(model, motion=moved), moved.at(near.times), None)
    else:
        near.states[:, 0] = near.times if system.mechanism.free else base.t  # free courses need ascending times
        found_there = by_themselves(system, near.states, near.records)
        beside = cast(CoupledMotion, result_of(model, found_there, 0.0).motion)
    values, still = np.zeros((len(sensors), len(x))), [slice(8 * n)] * bool(n)
    for part in (*still, *(slice(k, k + 1) for k in range(8 * n, len(x)))):  # section forces need inputs again
        engine.additions[:] = given[part, given.shape[1] - engine.inputs :].sum(axis=0)
        try:
            some = beside.taken(np.arange(len(x))[part])
            for row, each in zip(values, sensors.values(), strict=True):
                row[part] = sensor_values(some, each)
        finally:
            engine.additions[:] = 0.0
    return (values * weights.ravel()).reshape(len(sensors), len(weights), 4).sum(axis=2)


def modes_at_rest(model: Model) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Undamped modes at the reference configuration from K_s and M: coordinates, omega [rad/s], shapes.

    Free joints are included, so that a freely turning mechanism has modes of zero frequency. Raises SceneError at a
    dead centre.
    """
    try:
        equations, state = _undeformed(model, model.reference_time, moves=False)
        M, K = equations.at_rest(state)
    except ArithmeticError:
        raise no_modes(model) from None
    if not len(M):
        return equations.names, np.zeros(0), np.zeros((0, 0))
    squares, shapes = symmetric_modes(K, (M + M.T) / 2.0, len(M))
    largest = shapes[abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])]
    return equations.names, np.sqrt(np.maximum(squares, 0.0)), shapes * np.sign(largest)


def unresolved(solution: RunResult) -> list[UnresolvedMode]:
    """Modes with fewer than FEWEST_STEPS mean steps per period, by frequency; none without coupled equations.

    Under error control the vibration of these modes is below the tolerance, so displacements are correct within it.
    Forces and accelerations are static, except for such a vibration's contribution: omega^2 times the tolerance, which
    may exceed the accelerations of a slow mechanism.
    """
    model, trajectory = solution.model, solution.trajectory
    if model.coupled is None or isinstance(trajectory, Trajectory) or not model.coupled.engine.shapes.any():
        return []
    if trajectory.steps == 0:
        return []
    step = float(trajectory.times[-1] - trajectory.times[0]) / trajectory.steps
    try:
        names, omega, shapes = modes_at_rest(model)
    except SceneError:  # dead centre, of which the model warns
        return []
    deforming = [k for k, name in enumerate(names) if name.split(".")[1].startswith(("axial", "transverse"))]
    found = []
    for mode in np.flatnonzero(omega * step * FEWEST_STEPS > 2.0 * math.pi):
        body, coordinate = names[max(deforming, key=lambda k: abs(shapes[k, mode]))].split(".")
        shape = f"{'stretch' if coordinate.startswith('axial') else 'bending'} of {body}"
        frequency = float(omega[mode]) / (2.0 * math.pi)
        found.append(UnresolvedMode(frequency_hz=frequency, shape=shape, steps_per_period=1.0 / (frequency * step)))
    return found


def left_by_gauss(solution: RunResult) -> list[str]:
    """Warning if damping is faster than a step of Gauss's method, which is A-stable, but not L-stable.

    Steps with damping laws, or dampers between points, use Radau.
    """
    model, trajectory = solution.model, solution.trajectory
    damped = model.scene.damping is not None
    damped |= any(spring.between is None and any(spring.dampings) for spring in model.scene.springs.values())
    if isinstance(trajectory, Trajectory) or model.options.integrator != "gauss" or not damped or trajectory.steps == 0:
        return []
    step = float(trajectory.times[-1] - trajectory.times[0]) / trajectory.steps
    fastest = fastest_decay(model, trajectory)
    if fastest * step < FASTEST_DECAY:
        return []
    return [
        f"steps of {step:.2g} s do not resolve the fastest decay, which takes {1.0 / fastest:.2g} s: with "
        "solve.integrator = 'gauss' overdamped modes oscillate within the tolerance; use 'radau'"
    ]
