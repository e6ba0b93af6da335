"""Evaluate a scene's sensors on a motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.response.deformation import Deformation, follow
from kaneflex.response.foreshortening import Displaced, displaced
from kaneflex.response.reactions import consistent_reactions
from kaneflex.response.section_forces import LinkForces
from kaneflex.response.spring_forces import spring_tension
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import DRIVE_KINDS, RIGID_COMPANIONS, SPRING_KINDS, Sensor

if TYPE_CHECKING:
    from kaneflex.response.dalembert import Balanced
    from kaneflex.response.motion import Motion


Moved = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Displacement of a point and its rates."""


@dataclass(frozen=True, eq=False)
class Series:
    """A sensor's values (n_times,) in ``unit`` (SI) and what they mean, in words."""

    values: np.ndarray
    unit: str
    meaning: str


def measure(motion: Motion) -> dict[str, Series]:
    """Every sensor of the scene, and the rigid value of every force beside it as ``NAME_rigid``."""
    reader = _Reader(motion)
    measured = {}
    for name, sensor in motion.model.scene.sensors.items():
        measured[name] = Series(reader.read(sensor), sensor.unit, describe(sensor))
        if sensor.kind in RIGID_COMPANIONS and reader.has_rigid_forces:
            meaning = f"{describe(sensor)}, of the rigid mechanism"
            measured[f"{name}_rigid"] = Series(reader.read_rigid(sensor), sensor.unit, meaning)
    return measured


def sensor_values(motion: Motion, sensor: Sensor) -> np.ndarray:
    """Values of one sensor (n_times,) in its SI unit."""
    return _Reader(motion).read(sensor)


def describe(sensor: Sensor) -> str:
    """One line for people: kind, place, component, axes."""
    kind = sensor.kind.replace("_", " ")
    text = f"{kind} of {sensor.target}"
    if sensor.kind in ("displacement", "velocity", "acceleration", "position", "joint_force"):
        text += f", {sensor.component}" + ("" if sensor.component == "angle" else f" in {sensor.axes} axes")
    if sensor.kind == "displacement":
        text += f", relative to {sensor.relative_to}"
    if sensor.kind == "acceleration" and sensor.reading == "accelerometer":
        text += ", as an accelerometer reads (a - g)"
    if sensor.kind == "strain":
        text += f", fibre {sensor.fibre:g} m above the axis"
    return text


class _Reader(LinkForces):
    """Series of one motion; what several sensors share is computed once."""

    def __init__(self, motion: Motion):
        super().__init__(motion.model.scene, motion.rigid)
        self.motion, self.model = motion, motion.model
        self._moved: dict[Address, Moved] = {}

    @property
    def has_rigid_forces(self) -> bool:
        """Whether there are forces of the rigid mechanism beside those of the deforming one.

        Not where free joints follow the latter: a rigid mechanism would have to vibrate with them. Nor in a structure
        that stands still, whose supports may be redundant.
        """
        return not (self.scene.is_frame or (self.motion.coupled is not None and self.model.module.FREE))

    @cached_property
    def deformed(self) -> Mapping[str, Deformation]:
        return self._displaced.links

    @cached_property
    def _displaced(self) -> Displaced:
        return displaced(self.model, self.rigid, self.motion.coordinates)

    @cached_property
    def reactions(self) -> dict[str, np.ndarray]:
        if self.motion.coupled is not None:
            return self.motion.coupled.reactions
        if not self.model.links:
            return {}
        return consistent_reactions(self.model, self.rigid, self.motion.coordinates, self.deformed)

    def read(self, sensor: Sensor) -> np.ndarray:
        if self.steps == 0:  # a run that stopped before its first instant
            return np.zeros(0)
        if sensor.kind in ("joint_force", *DRIVE_KINDS) and not self.model.balances:
            return self.read_rigid(sensor)
        return getattr(self, f"_{sensor.kind}")(sensor)

    def read_rigid(self, sensor: Sensor) -> np.ndarray:
        """The value of the rigid mechanism."""
        if sensor.kind == "axial_force":
            return self.rigid_section(sensor.target)[0]
        if sensor.kind in DRIVE_KINDS:
            return self.rigid[f"{sensor.target}.drive"]
        if sensor.kind in SPRING_KINDS:
            return self.rigid[f"{sensor.target}.{'tension' if sensor.kind == 'spring_force' else 'torque'}"]
        return self._joint_component(sensor, lambda name: self.rigid[name])

    # ---- motion of points -------------------------------------------------------------------------------------

    def _elastic(self, address: Address) -> Moved:
        """Displacement (x, y, angle) of a point in its body's axes and its first and second rates, (3, n_times)."""
        if address not in self._moved:
            self._moved[address] = self._elastic_motion(address)
        return self._moved[address]

    def _elastic_motion(self, address: Address) -> Moved:
        still = np.zeros((3, self.steps))
        if self.motion.coupled is not None and not self.model.links:  # links by modal data have no coordinates z
            coupled = self.motion.coupled
            moved = coupled.displacement(address.body, self.scene.point(address), coupled.node(address))
            return coupled.in_body_axes(address.body, moved)
        if address.body in self.model.links:
            x, y = self.scene.point(address)
            d, d_rate, d_accel = self.deformed[address.body].at(x)
            if y:  # a point off the axis moves with its section
                offset = np.array([[-y], [0.0], [0.0]])
                d, d_rate, d_accel = (
                    d + offset * d[2],
                    d_rate + offset * d_rate[2],
                    d_accel + offset * d_accel[2],
                )
            return d, d_rate, d_accel
        if self.model.frame is not None and address.body in self.model.frame.bodies:
            L = self.model.frame.body_point(address.body, self.scene.point(address))
            d, d_rate, d_accel = follow(self.model, self.rigid, self._displaced.coordinates, L)
            omega, epsilon = self.rigid[f"{address.body}.omega"], self.rigid[f"{address.body}.epsilon"]
            # Rates in the body's axes: R^T (d' - omega S d), R^T (d'' - 2 omega S d' - epsilon S d - omega^2 d).
            rate = np.array([d_rate[0] + omega * d[1], d_rate[1] - omega * d[0]])
            accel = np.array([
                d_accel[0] + 2 * omega * d_rate[1] + epsilon * d[1] - omega**2 * d[0],
                d_accel[1] - 2 * omega * d_rate[0] - epsilon * d[0] - omega**2 * d[1],
            ])  # fmt: skip
            turned = [self.turn_back(address.body, part) for part in (d, rate, accel)]
            return tuple(np.vstack([part, turn[2]]) for part, turn in zip(turned, (d, d_rate, d_accel), strict=True))
        return still, still, still

    def _component(self, sensor: Sensor, body_axes: np.ndarray, angle: np.ndarray) -> np.ndarray:
        if sensor.component == "angle":
            return angle
        vector = body_axes if sensor.axes == "body" else self.turn(sensor.target.body, body_axes)
        return vector["xy".index(sensor.component)]

    def _displacement(self, sensor: Sensor) -> np.ndarray:
        address = sensor.target
        d = self._elastic(address)[0].copy()
        if sensor.relative_to != "frame":
            start = self._elastic(Address(address.body, "start"))[0]
            if sensor.relative_to == "start":
                d -= start
            else:
                end = self._elastic(Address(address.body, "end"))[0]
                length = self.scene.bodies[address.body].length
                share = self.scene.point(address)[0] / length
                chord = start + share * (end - start)
                chord[2] = (end[1] - start[1]) / length
                d -= chord
        return self._component(sensor, d[:2], d[2])

    def _position(self, sensor: Sensor) -> np.ndarray:
        address = sensor.target
        if address.body in self.scene.joints:
            return self._joint_coordinate(address.body)
        if sensor.component == "angle":
            return self._angle(address)
        place = self._place(address)
        vector = place if sensor.axes == "global" else self.turn_back(address.body, place)
        return vector["xy".index(sensor.component)]

    def _joint_coordinate(self, name: str) -> np.ndarray:
        """Angle of a joint's second body relative to its first [rad], or its slide along a guide [m]."""
        joint = self.scene.joints[name]
        first, second = joint.addresses
        if joint.kind != "prismatic":
            return self._angle(second) - self._angle(first)
        gap = self._place(second) - self._place(first)
        t = self.guide(joint)
        return t[0] * gap[0] + t[1] * gap[1]

    def _angle(self, address: Address) -> np.ndarray:
        """Angle of a body at a point, elastic rotation included [rad]."""
        if address.body == "ground":
            return np.zeros(self.steps)
        return self.motion.turned(address.body) + self._elastic(address)[0][2]

    def _place(self, address: Address) -> np.ndarray:
        """Global position of a point, its elastic displacement included, (2, n_times) [m]."""
        x, y = self.scene.point(address)
        if address.body == "ground":
            return np.outer((x, y), np.ones(self.steps))
        d = self._elastic(address)[0]
        turned = self.turn(address.body, (x + d[0], y + d[1]))
        return np.array([self.rigid[f"{address.body}.x"] + turned[0], self.rigid[f"{address.body}.y"] + turned[1]])

    def _velocity(self, sensor: Sensor) -> np.ndarray:
        body = sensor.target.body
        x, y = self.scene.point(sensor.target)
        d, d_rate, _ = self._elastic(sensor.target)
        omega = self.rigid[f"{body}.omega"]
        origin = self.turn_back(body, (self.rigid[f"{body}.v_x"], self.rigid[f"{body}.v_y"]))
        vector = np.array([
            origin[0] - omega * (y + d[1]) + d_rate[0],
            origin[1] + omega * (x + d[0]) + d_rate[1],
        ])  # fmt: skip
        return self._component(sensor, vector, omega + d_rate[2])

    def _acceleration(self, sensor: Sensor) -> np.ndarray:
        """a = a_O + epsilon S p - omega^2 p + 2 omega S d' + d'', p = r + d; an accelerometer reads a - g."""
        body = sensor.target.body
        x, y = self.scene.point(sensor.target)
        d, d_rate, d_accel = self._elastic(sensor.target)
        omega, epsilon = self.rigid[f"{body}.omega"], self.rigid[f"{body}.epsilon"]
        gravity = self.scene.gravity if sensor.reading == "accelerometer" else (0.0, 0.0)
        origin = self.turn_back(body, (self.rigid[f"{body}.a_x"] - gravity[0], self.rigid[f"{body}.a_y"] - gravity[1]))
        p_x, p_y = x + d[0], y + d[1]
        vector = np.array([
            origin[0] - epsilon * p_y - omega**2 * p_x - 2 * omega * d_rate[1] + d_accel[0],
            origin[1] + epsilon * p_x - omega**2 * p_y + 2 * omega * d_rate[0] + d_accel[1],
        ])  # fmt: skip
        return self._component(sensor, vector, epsilon + d_accel[2])

    # ---- forces -----------------------------------------------------------------------------------------------

    def _axial_force(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor)[0]

    def _shear_force(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor)[1]

    def _bending_moment(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor)[2]

    def _strain(self, sensor: Sensor) -> np.ndarray:
        """N / (E A) - fibre M / (E I)."""
        N, _, M = self._section(sensor)
        here = self.scene.bodies[sensor.target.body].profile.at(self.scene.point(sensor.target)[0])
        return N / here.E_A - sensor.fibre * M / here.E_I

    def _section(self, sensor: Sensor) -> tuple[np.ndarray, ...]:
        if not self.model.links:
            return self.rigid_section(sensor.target)
        found = self.deformed if self.motion.coupled is None else self._balances
        return found[sensor.target.body].section(self.scene.point(sensor.target)[0])

    @cached_property
    def _balances(self) -> dict[str, Balanced]:
        from kaneflex.response.dalembert import balanced  # only coupled runs pay for it

        return balanced(self.motion.coupled)

    def _joint_force(self, sensor: Sensor) -> np.ndarray:
        return self._joint_component(sensor, lambda name: self.reactions[name])

    def _drive_torque(self, sensor: Sensor) -> np.ndarray:
        return self.reactions[f"{sensor.target}.drive"]

    _drive_force = _drive_torque

    def _spring_force(self, sensor: Sensor) -> np.ndarray:
        if self.motion.coupled is not None:
            return self.motion.coupled.spring(sensor.target)
        return spring_tension(self.model, self.rigid, self.motion.coordinates, sensor.target)

    _spring_torque = _spring_force

    def _joint_component(self, sensor: Sensor, reaction: Callable[[str], np.ndarray]) -> np.ndarray:
        """Force of a joint on ``sensor.body`` (by default the second), or its moment."""
        name = sensor.joint_force
        joint = self.scene.joints[name]
        first, second = (address.body for address in joint.addresses)
        sign = -1.0 if sensor.body == first else 1.0
        if sensor.component == "angle":
            return sign * reaction(f"{name}.moment") if joint.kind != "revolute" else np.zeros(self.steps)
        force = self.joint_vector(name, reaction)
        if sensor.axes == "body":
            force = self.turn_back(sensor.body or second, force)
        return sign * force["xy".index(sensor.component)]
