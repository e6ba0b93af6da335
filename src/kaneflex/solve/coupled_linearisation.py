"""State space and modes of a coupled model: what `linearise` and `modes` show of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from scipy.linalg import eigh

from kaneflex.fem.links import spread_sums
from kaneflex.mechanism.body_frame import rotate, rotate_back
from kaneflex.multibody.linearisation import Linear, kernels, linear, probes, reduction, settled
from kaneflex.multibody.model import Model
from kaneflex.multibody.run import rigid_state
from kaneflex.response.coupled_motion import CoupledMotion
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import Sensor
from kaneflex.solve.coupled import as_solution, longest, still_trajectory, unwrapped
from kaneflex.support.errors import SceneError

_STEP = 1e-6
"""Step of the differences of places, in sizes of the mechanism and rad."""


def linear_about(model: Model, t: float) -> Linear:
    """The linear equations about the steady deformation at the time t [s].

    Raises SceneError where the deformed mechanism finds no balance.
    """
    rigid = model.motion.at(t)
    q = unwrapped(model.scene, model.coupled, rigid_state(model.coupled, rigid)[0], rigid)
    found = settled(model.coupled, rigid, q, longest(model.scene))
    if found is None:
        raise SceneError(
            "solve.preset", model.options.preset, f"the deformed mechanism finds no balance at t = {t:.6g} s",
            "Take another configuration",
        )  # fmt: skip
    return linear(model.coupled, found)


def inputs(model: Model, found: Linear) -> dict[str, np.ndarray]:
    """Every load by its name and every prescribed acceleration, as (generalised force, constraints' accelerations)."""
    system, scene = model.coupled, model.scene
    n, m = system.size, len(system.constraints)
    places = _Places(model, found.instant.t, found.instant.q)
    pushes = {}
    for name, load in scene.loads.items():
        if load.torque_at is not None:
            first, second = (places.by(address) for address in scene.joints[load.torque_at].addresses)
            force = second[2] - first[2]
        else:
            body = load.force_on.body if load.force_on is not None else load.spread_on
            force = sum(
                (places.push(at, load.direction, load.axes) * share for at, share in _points(model, name, body)),
                np.zeros(n),
            )
            if load.spread_on in system.links:
                force = _spread(model, name, places)
        pushes[name] = np.concatenate([force, np.zeros(m)])
    for name, drive in scene.drives.items():
        if drive.kind != "free":
            row = np.zeros(n + m)
            row[n + system.constraints.index(f"{name}.drive")] = 1.0
            pushes[f"{name}.acceleration"] = row
    return pushes


def _points(model: Model, name: str, body: str) -> list[tuple[Address, float]]:
    if body in model.coupled.links:
        load = model.scene.loads[name]
        return [] if load.force_on is None else [(load.force_on, 1.0)]
    return [(at, share) for other, _, at, share in model.scene.pushes(body) if other == name]


def _spread(model: Model, name: str, places: _Places) -> np.ndarray:
    """Generalised force of a load of unit size that is spread along an elastic link."""
    load, link = model.scene.loads[name], model.coupled.links[model.scene.loads[name].spread_on]
    along, across, _ = spread_sums(model.scene, name, link.nodes, link.parameters)
    nodal = np.zeros((2, 3 * len(link.nodes)))
    for e in range(len(along)):
        nodal[:, 3 * e : 3 * e + 6] += np.array([along[e, :, 0], across[e, :, 0]])
    phi = places.q[model.coupled.start[link.name] + 2]
    c, s = np.cos(phi), np.sin(phi)
    d = load.direction if load.axes == "body" else rotate_back(c, s, load.direction)
    force = np.zeros(len(places.q))
    for node in range(len(link.nodes)):
        u, v, moment = (d[0] * nodal[0] + d[1] * nodal[1])[3 * node : 3 * node + 3]
        by = places.by_node(link.name, node)
        force += np.array([*rotate(c, s, (u, v)), moment]) @ by
    return force


class _Places:
    """Derivatives of points' places by all coordinates, by central differences of what the sensors read."""

    def __init__(self, model: Model, t: float, q: np.ndarray) -> None:
        self.model, self.q = model, q
        self.step = _STEP * model.coupled.measure(longest(model.scene))
        moved = np.concatenate([q + np.diag(self.step), q - np.diag(self.step)])
        trajectory = still_trajectory(model.coupled, t, moved)
        self.motion = CoupledMotion(model, model.motion.at(trajectory.times), trajectory)

    def _difference(self, place: np.ndarray) -> np.ndarray:
        count = len(self.q)
        return (place[:, :count] - place[:, count:]) / (2 * self.step)

    def by(self, address: Address) -> np.ndarray:
        """Of x, y and the section's angle of a point, (3, n)."""
        return self._difference(self.motion.joined(address)[0])

    def by_node(self, link: str, node: int) -> np.ndarray:
        at = (self.model.coupled.links[link].nodes[node], 0.0)
        return self._difference(self.motion.moving_place(link, at)[0])

    def push(self, at: Address, direction: tuple[float, float], axes: str) -> np.ndarray:
        """Generalised force of a unit force."""
        angle = 0.0
        if axes == "body":
            place = self.motion.joined(at)[0][2]
            angle = float(place.mean())
        return rotate(np.cos(angle), np.sin(angle), direction) @ self.by(at)[:2]


def loads_of(model: Model, found: Linear, pushes: Mapping[str, np.ndarray]) -> np.ndarray:
    """What every input does to the independent coordinates' balance, (n_y, n_inputs)."""
    system, instant, basis = model.coupled, found.instant, found.basis
    n = system.size
    M = kernels(system, instant.t, instant.q, instant.v, instant.a, instant.multipliers).M
    columns = []
    for push in pushes.values():
        accelerated = np.zeros(n)
        accelerated[basis.dependent] = basis.inverse @ push[n:]
        columns.append(basis.N.T @ (push[:n] - M @ accelerated))
    return np.array(columns).reshape(len(pushes), len(found.names)).T


def readings(
    model: Model, found: Linear, pushes: Mapping[str, np.ndarray], sensors: Mapping[str, Sensor]
) -> np.ndarray:
    """Derivatives of the sensors by coordinates, their rates and the inputs, (n_sensors, 2 n_y + n_inputs)."""
    trajectory, amounts = probes(model.coupled, found, pushes, longest(model.scene))
    states, shift = 4 * len(found.names), {}
    for k, name in enumerate(pushes):
        shift[name] = np.zeros(len(trajectory.times))
        shift[name][states + 2 * k : states + 2 * k + 2] = 1.0, -1.0
    motion = replace(as_solution(model, trajectory, 0.0).motion, shift=shift)
    rows = []
    for sensor in sensors.values():
        values = sensor_values(motion, sensor)
        rows.append((values[::2] - values[1::2]) / amounts)
    return np.array(rows).reshape(len(sensors), len(amounts))


def modes_at_rest(model: Model) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Undamped modes at the reference configuration, from strain and mass alone: coordinates, omega [rad/s], shapes.

    Free joints take part, so that a mechanism that turns freely has modes of zero frequency.
    """
    system, scene = model.coupled, model.scene
    rigid = model.motion.at(model.reference_time)
    q = unwrapped(scene, system, rigid_state(system, rigid)[0], rigid)
    n, m = system.size, len(system.constraints)
    at = kernels(system, model.reference_time, q, np.zeros(n), np.zeros(n), np.zeros(m))
    basis = reduction(system, replace(at, C=np.zeros_like(at.C), K=np.zeros_like(at.K)))
    numbers = {path: system.parameters[k] for k, (path, _) in enumerate(system.module.PARAMETERS)}
    stiffness = np.zeros((n, n))
    for body in system.start:
        for k, row in enumerate(range(system.modal(body).start, system.modal(body).stop)):
            stiffness[row, row] = numbers[f"bodies.{body}.stiffness_{k}"]
    places = _Places(model, model.reference_time, q)
    for spring in scene.springs.values():
        if spring.torsional_at is not None:
            first, second = (places.by(address)[2] for address in scene.joints[spring.torsional_at].addresses)
            stiffness += spring.stiffness * np.outer(second - first, second - first)
            continue
        first, second = (places.by(address)[:2] for address in spring.between)
        ends = [places.motion.joined(address)[0][:2].mean(axis=1) for address in spring.between]
        gap = ends[1] - ends[0]
        apart = second - first
        if spring.length or spring.damping:
            apart = (gap / np.hypot(*gap))[None] @ apart
        stiffness += spring.stiffness * apart.T @ apart
    squares, shapes = eigh(basis.N.T @ stiffness @ basis.N, basis.N.T @ at.M @ basis.N)
    largest = shapes[abs(shapes).argmax(axis=0), np.arange(shapes.shape[1])]
    names = tuple(system.module.COORDINATES[row][0] for row in basis.rows)
    return names, np.sqrt(np.maximum(squares, 0.0)), shapes * np.sign(largest)
