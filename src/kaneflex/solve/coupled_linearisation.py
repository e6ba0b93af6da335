"""State space and modes of a coupled model: what `linearise` and `modes` show of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from kaneflex.multibody.linearisation import Linear, at_rest, linear, prepare, probes, settled
from kaneflex.multibody.model import Model
from kaneflex.multibody.run import rigid_state
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.contact_check import refuse_contacts
from kaneflex.scene.sensors import Sensor
from kaneflex.solve.coupled import as_solution, unwrapped
from kaneflex.support.errors import SceneError


def linear_about(model: Model, t: float) -> Linear:
    """The linear equations about the steady deformation at the time t [s].

    Raises SceneError where the deformed mechanism finds no balance, and where bodies touch at times.
    """
    reason = "the equations are others while bodies touch, and those are not linear"
    refuse_contacts(model.scene, "solve.preset", "coupled", reason, "Leave it out")
    rigid, system = model.motion.at(t), model.coupled
    q, v = rigid_state(system, rigid)
    engine = prepare(system, t, unwrapped(model.scene, system, q, rigid), v)
    found = settled(engine, t)
    if found is None:
        raise SceneError(
            "solve.preset", model.options.preset, f"the deformed mechanism finds no balance at t = {t:.6g} s",
            "Take another configuration",
        )  # fmt: skip
    return linear(engine, found)


def inputs(model: Model) -> tuple[str, ...]:
    """What moves the linear equations: every load, then every prescribed acceleration."""
    scene = model.scene
    return (*scene.loads, *(f"{name}.acceleration" for name, drive in scene.drives.items() if drive.kind != "free"))


def readings(model: Model, found: Linear, sensors: Mapping[str, Sensor]) -> np.ndarray:
    """Derivatives of the sensors by coordinates, their rates and the inputs, (n_sensors, 2 n_y + n_inputs)."""
    trajectory, away, weights = probes(model.coupled, found)
    shift = {}
    for k, name in enumerate(inputs(model), start=2 * len(found.names)):
        shift[name] = np.zeros(len(away))
        shift[name][4 * k : 4 * k + 4] = away[4 * k : 4 * k + 4]
    motion = replace(as_solution(model, trajectory, 0.0).motion, shift=shift)
    rows = [(sensor_values(motion, sensor) * weights).reshape(-1, 4).sum(axis=1) for sensor in sensors.values()]
    return np.array(rows).reshape(len(sensors), len(away) // 4)


def modes_at_rest(model: Model) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Undamped modes at the reference configuration, from strain and mass alone: coordinates, omega [rad/s], shapes.

    Free joints take part, so that a mechanism that turns freely has modes of zero frequency.
    """
    system, t = model.coupled, model.reference_time
    rigid = model.motion.at(t)
    q = unwrapped(model.scene, system, rigid_state(system, rigid)[0], rigid)
    engine = prepare(system, t, q, np.zeros(system.size))
    M, K = at_rest(engine, t)
    squares, shapes = eigh(K, (M + M.T) / 2.0)
    largest = shapes[abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])]
    return engine.names, np.sqrt(np.maximum(squares, 0.0)), shapes * np.sign(largest)
