"""State space of the elastic equations at one instant, with named states, inputs and outputs.

    M z'' + C z' + K z = F_0 + F_u u                    x = (z, z'),   x' = A x + B u,   y = C x + D u

M, C, K hold the terms of the preset at that instant. An input u is the deviation of a load, or of a drive's
acceleration, from its value at the instant; an output y is the deviation of a sensor from its reading with z = z' = u
= 0 and the inertia of the rigid motion. The inputs' effect on K (a load's part of the axial forces in K_g) is that of
the instant, and foreshortening, of second order, is neglected.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from kaneflex.mechanism.affine import as_array
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import Placement, drive_rates
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.time.linearisation import state_matrix
from kaneflex.scene.read import SceneLike
from kaneflex.scene.sensors import DRIVE_KINDS, Sensor
from kaneflex.solve.loading import integrated, model_from
from kaneflex.solve.statespace import StateSpace
from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, nearest

FORCES = ("joint_force", *DRIVE_KINDS)
"""Sensors that need equations which balance at every instant, unlike those of a frozen model."""


@takes(model="model", t="number", sensors="texts")
def linearise(model: SceneLike, t: float | None = None, sensors: Sequence[str] | None = None) -> StateSpace:
    """State space of the elastic equations at one instant.

    Under preset ``coupled`` it describes all bodies about the steady deformation: states are the link shapes and the
    coordinates of the free joints, JOINT.angle or JOINT.position; output matrices are central differences.

    Parameters
    ----------
    model : Model, Solution, Scene or path
        Under preset ``paper`` the matrices are those of ``solve.mode_angle``.
    t : float, optional
        Instant [s]; by default the one at which the first drive is at ``solve.mode_angle``.
    sensors : sequence of str, optional
        Outputs; by default every sensor of the scene that `available_sensors` names. Every kind is linear in
        (z, z', z'', u): displacements, velocities, accelerations, positions, section forces, strains and, where the
        equations balance at every instant, joint forces and drive torques.

    Raises
    ------
    SceneError
        If the model is rigid or quasi-static, or a sensor is unknown or not available.
    """
    model = model_from(model)
    if model.options.dynamics in ("rigid", "quasistatic"):
        reason = f"a {model.options.dynamics} model has no states to linearise"
        cure = "Choose preset linear or stiffened, for a scene with an elastic body"
        raise SceneError("solve.preset", model.options.preset, reason, cure)
    if model.in_space is not None and model.options.dynamics != "coupled":
        reason = "in space only preset coupled can be linearised"
        raise SceneError("solve.preset", model.options.preset, reason, "Choose preset coupled")
    model = integrated(model) if model.motion.is_start else model
    t = model.reference_time if t is None else t
    chosen = _chosen(model, sensors)
    found = (_coupled if model.options.dynamics == "coupled" else _one_way)(model, t, chosen)
    scene, n = model.scene, len(found.names)
    A = state_matrix(found.M, found.C, found.K)
    inertia = np.linalg.solve(found.M, found.F_u)
    drives = [name.removesuffix(".acceleration") for name in found.inputs[len(scene.loads) :]]
    units = [load.si_unit for load in scene.loads.values()]
    units += ["m/s^2" if scene.slides(name) else "rad/s^2" for name in drives]
    return StateSpace(
        found.M, found.C, found.K, A, np.vstack([np.zeros_like(inertia), inertia]),
        found.by_state + found.by_acceleration @ A[n:], found.by_inputs + found.by_acceleration @ inertia,
        (*found.names, *(f"{name}'" for name in found.names)), found.inputs, tuple(chosen), tuple(units),
        tuple(sensor.unit for sensor in chosen.values()), float(t),
        {name: float(model.motion.at(t)[f"{name}.angle"][0]) for name in scene.drives},
    )  # fmt: skip


class _Frozen(NamedTuple):
    """Linear equations M z'' + C z' + K z = F_u u at one instant, and y = by_state x + by_acceleration z'' + by_inputs
    u."""

    names: tuple[str, ...]
    inputs: tuple[str, ...]
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    F_u: np.ndarray
    by_state: np.ndarray
    by_acceleration: np.ndarray
    by_inputs: np.ndarray


def _one_way(model: Model, t: float, chosen: Mapping[str, Sensor]) -> _Frozen:
    """Equations of one instant; sensors, affine in z, z', z'' and the inputs, by their readings for a unit of each."""
    from kaneflex.response.elastic_motion import ElasticMotion
    from kaneflex.response.sensors import measure

    rigid, n = model.motion.at(t), model.reduced.size
    shifts, basis = _inputs(model, rigid), np.eye(n) if model.modal_basis is None else model.modal_basis
    moved = _shifted(model, t, [{}] * (1 + 3 * n) + [*shifts.values()])
    units = np.zeros((3, len(basis), len(moved.times)))
    for k in range(3):
        units[k, :, 1 + k * n : 1 + (k + 1) * n] = basis
    scene = model.scene.model_copy(update={"sensors": dict(chosen)})
    straight = replace(model, options=model.options._replace(foreshortening=False), scene=scene)
    series = measure(ElasticMotion(straight, moved, tuple(units)))
    read = np.array([series[name].values for name in chosen]).reshape(len(chosen), len(moved.times))
    by_state, by_a, by_inputs = np.split(read[:, 1:] - read[:, :1], [2 * n, 3 * n], axis=1)
    F = moved.column_of(model.reduced.F)
    M, C, K = (as_array(rigid.first(model.kept[name])) for name in "MCK")
    F_u = F[:, 1 + 3 * n :] - F[:, :1]
    return _Frozen(model.reduced.coordinates, tuple(shifts), M, C, K, F_u, by_state, by_a, by_inputs)


def _coupled(model: Model, t: float, chosen: Mapping[str, Sensor]) -> _Frozen:
    """Coupled equations about the steady deformation; sensors by central differences."""
    from kaneflex.solve.coupled_linearisation import inputs, linear_about, readings

    found = linear_about(model, t)
    n = len(found.names)
    by_state, by_inputs = np.split(readings(model, found, chosen), [2 * n], axis=1)
    by_acceleration = np.zeros((len(chosen), n))
    return _Frozen(
        found.names, inputs(model), found.M, found.C, found.K, found.B, by_state, by_acceleration, by_inputs
    )


def available_sensors(model: Model) -> dict[str, Sensor]:
    """Sensors that can be outputs of a model's state space."""
    return {
        name: sensor for name, sensor in model.scene.sensors.items() if model.balances or sensor.kind not in FORCES
    }


def _chosen(model: Model, names: Sequence[str] | None) -> dict[str, Sensor]:
    available = available_sensors(model)
    if names is None:
        return available
    for name in names:
        if name not in model.scene.sensors:
            raise SceneError("sensors", name, "the scene has no such sensor", nearest(name, model.scene.sensors))
        if name not in available:
            kind = model.scene.sensors[name].kind.replace("_", " ")
            reason = f"a {kind} can't be computed from frozen matrices"
            raise SceneError("sensors", name, reason, "Leave it out, or use preset linear or stiffened")
    return {name: available[name] for name in names}


_NO_RATE = 1e-9
"""Acceleration of a link per unit acceleration of a drive [m/s^2 or rad/s^2] that counts as none."""
Shift = dict[str, float]
"""Scalar of the motion -> its change per unit of an input."""


def _inputs(model: Model, rigid: RigidMotion) -> dict[str, Shift]:
    """Changes of the motion's scalars by every load's magnitude and every prescribed acceleration."""
    shifts: dict[str, Shift] = {name: {name: 1.0} for name in model.scene.loads}
    bodies = [*model.scene.bodies]
    angle = {name: np.arctan2(rigid[f"{name}.s"][0], rigid[f"{name}.c"][0]) for name in bodies}
    poses = {name: np.array([rigid[f"{name}.x"][0], rigid[f"{name}.y"][0], angle[name]]) for name in bodies}
    placement = Placement(poses, {name: float(rigid[f"{name}.angle"][0]) for name in model.scene.drives})
    for drive, rates in drive_rates(mechanism_of(model.scene), placement).items():
        if model.scene.drives[drive].kind == "free":  # its acceleration follows from the forces
            continue
        shift: Shift = {}
        for name, (x, y, turn) in rates.items():
            shift |= {f"{name}.a_x": x, f"{name}.a_y": y, f"{name}.epsilon": turn}
            along, across = rigid.frame(name).to_body((x, y))[:, 0]
            shift |= {f"{name}.link.a_x": along, f"{name}.link.a_y": across}
        if _has_terms(model, shift):
            shifts[f"{drive}.acceleration"] = shift
    return shifts


def _has_terms(model: Model, shift: Shift) -> bool:
    """True if the module has the inertia loads of an acceleration, which a steady motion does not need."""
    known = {factor for _, _, target, factors in model.motion.module.TERMS if target == "F" for factor in factors}
    keys = {"epsilon": "{}.epsilon", "a_x": "{}.link.a_x", "a_y": "{}.link.a_y"}
    return all(
        key in known or abs(shift.get(path.format(link), 0.0)) < _NO_RATE
        for link in model.links
        for key, path in keys.items()
    )


@dataclass(frozen=True, eq=False)
class _ShiftedMotion(RigidMotion):
    """Rigid motion with increments of some scalars, different at each time."""

    shift: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        return super().__getitem__(name) + self.shift.get(name, 0.0)


def _shifted(model: Model, t: float, shifts: Sequence[Shift]) -> _ShiftedMotion:
    """The instant once per shift, with that shift applied."""
    rigid = model.motion.at(np.full(len(shifts), t))
    names = set().union(*shifts)
    columns = {name: np.array([shift.get(name, 0.0) for shift in shifts]) for name in names}
    return _ShiftedMotion(model.motion, rigid.times, rigid.values, columns)
