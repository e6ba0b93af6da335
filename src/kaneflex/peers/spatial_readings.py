"""Sensors of a scene in space from what Exudyn stores: motions of bodies' points, and what its joints exert."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.mechanism.spatial_frame import SpatialFrame, slide_of, turn_of
from kaneflex.peers.exudyn_spatial import OF_BODIES, Bodies
from kaneflex.peers.readings import NO_COUNTERPART, address_of
from kaneflex.scene.sensors import Sensor

if TYPE_CHECKING:
    from kaneflex.multibody.model import Model
    from kaneflex.peers.exudyn_spatial import Built

class SpatialRecorder:
    """Puts Exudyn's sensors in before a run and evaluates the scene's sensors after it."""

    def __init__(self, model: Model, built: Built):
        import exudyn.itemInterface as items

        self.model, self.scene, self.built, self.items = model, model.scene, built, items
        self.mechanism, self.start = spatial_mechanism_of(model.scene), model.motion.at(0.0)
        self.bodies = {
            (name, variable): self._record(
                items.SensorBody, variable, bodyNumber=number, localPosition=-self.mechanism.bodies[name].centre
            )
            for name, number in built.bodies.items() if name != GROUND for variable in OF_BODIES.values()
        }  # fmt: skip
        self.joints = {
            (name, quantity): self._record(items.SensorObject, quantity, objectNumber=number)
            for name, number in built.joints.items() for quantity in ("ForceLocal", "TorqueLocal")
        }  # fmt: skip
        exerted = {name: "ForceLocal" if spring.joint is None else "TorqueLocal"
                   for name, spring in self.mechanism.springs.items()}  # fmt: skip
        self.springs = {
            name: self._record(items.SensorObject, exerted[name], objectNumber=number)
            for name, number in built.springs.items()
        }
        self.moved = Bodies(np.zeros(0))

    def _record(self, kind: type, variable: str, **where: object) -> int:
        quantity = getattr(self.built.exudyn.OutputVariableType, variable)
        item = kind(outputVariableType=quantity, storeInternal=True, writeToFile=False, **where)
        return self.built.system.AddSensor(item)

    def read(self) -> tuple[dict[str, np.ndarray], dict[str, str]]:
        """Values of the sensors, and what can't be read and why."""
        self.moved = Bodies(self.built.system.GetSensorStoredData(next(iter(self.bodies.values())))[:, 0])
        for body in self.mechanism.bodies:
            self.moved.put(body, partial(self._of_body, body))
        values, missing = {}, {}
        for name, sensor in self.scene.sensors.items():
            method = getattr(self, f"_{sensor.kind}", None)
            found = NO_COUNTERPART if method is None else method(sensor)
            if isinstance(found, str):
                missing[name] = found
            else:
                values[name] = found
        return values, missing

    def _of_body(self, body: str, variable: str) -> np.ndarray:
        return self._stored(self.bodies[body, variable])

    def _stored(self, number: int) -> np.ndarray:
        return self.built.system.GetSensorStoredData(number)[:, 1:].T

    @property
    def times(self) -> np.ndarray:
        """Instants [s], (n_times,)."""
        return self.moved.times

    def _frame(self, body: str) -> SpatialFrame:
        return SpatialFrame(self.moved, body)

    def _component(self, sensor: Sensor, vector: np.ndarray, body: str) -> np.ndarray:
        if sensor.axes == "body":
            vector = self._frame(body).to_body(vector)
        return vector["xyz".index(sensor.component[-1])]

    def _point(self, sensor: Sensor, order: int) -> np.ndarray:
        """Place of a point or a joint, or one of its rates, by the component of a sensor."""
        address = address_of(sensor)
        if address.body in self.scene.joints:
            return self._coordinate(address.body, sensor.component == "angle")[order]
        frame, at = self._frame(address.body), self.scene.point(address)
        if sensor.component.startswith("angle"):
            return self._component(sensor, (frame.omega, frame.epsilon)[order - 1], address.body)
        vector = (frame.place, frame.velocity, frame.acceleration)[order](at)
        if sensor.kind == "acceleration" and sensor.reading == "accelerometer":
            vector = vector - self.mechanism.gravity[:, None]
        return self._component(sensor, vector, address.body)

    def _coordinate(self, name: str, turns: bool) -> Rates:
        """Angle of a joint, counted on from where it starts, or its slide, and its rates."""
        joint = self.mechanism.joints[name]
        first, second = (self._frame(side.body) for side in joint.sides)
        if not turns:
            return slide_of(joint, first, second)
        angle, rate, accel = turn_of(joint, first, second, self.mechanism.relative(joint))
        angle = np.unwrap(angle)
        whole = np.round((float(self.start[f"{name}.angle"][0]) - angle[0]) / (2.0 * np.pi))
        return angle + 2.0 * np.pi * whole, rate, accel

    def _position(self, sensor: Sensor) -> np.ndarray:
        return self._point(sensor, 0)

    def _velocity(self, sensor: Sensor) -> np.ndarray:
        return self._point(sensor, 1)

    def _acceleration(self, sensor: Sensor) -> np.ndarray:
        return self._point(sensor, 2)

    def _joint_axes(self, name: str) -> list[np.ndarray]:
        """Axes of a joint's frame as its first and its second body carry them, columns of (3, 3, n_times)."""
        bodies = [side.body for side in self.scene.joints[name].addresses]
        return [np.einsum("ijt,jk->ikt", self._frame(body).axes, self._begins(body).T @ self.built.frames[name])
                for body in bodies]  # fmt: skip

    def _begins(self, body: str) -> np.ndarray:
        frame = self.start.frame(body)
        return np.column_stack([frame.to_global(axis)[:, 0] for axis in np.eye(3)])

    def _drive_torque(self, sensor: Sensor) -> np.ndarray:
        return -self._stored(self.joints[str(sensor.target), "TorqueLocal"])[0]

    def _drive_force(self, sensor: Sensor) -> np.ndarray:
        return -self._stored(self.joints[str(sensor.target), "ForceLocal"])[0]

    def _spring_force(self, sensor: Sensor) -> np.ndarray:
        return self._stored(self.springs[str(sensor.target)])[0]

    def _spring_torque(self, sensor: Sensor) -> np.ndarray:
        return self._stored(self.springs[str(sensor.target)])[0]

    def _joint_force(self, sensor: Sensor) -> np.ndarray:
        """Force on the second body, or moment about its point, or their opposites."""
        name = str(sensor.target)
        first, second = (side.body for side in self.scene.joints[name].addresses)
        exerted = self._moment(name) if sensor.component.startswith("angle") else self._force(name)
        sign = -1.0 if sensor.body == first else 1.0
        return sign * self._component(sensor, exerted, sensor.body or second)

    def _force(self, name: str) -> np.ndarray:
        """Exudyn's is in the axes of the joint's frame on the first body, and acts on that."""
        return -np.einsum("ijt,jt->it", self._joint_axes(name)[0], self._stored(self.joints[name, "ForceLocal"]))

    def _moment(self, name: str) -> np.ndarray:
        """Exudyn's are multipliers of products of the frame's axes on the two bodies that stay zero.

        Which products, and so which axes they turn about, differs with the rotations that are held.
        """
        (_, y, _), (x_2, y_2, z_2) = (axes.transpose(1, 0, 2) for axes in self._joint_axes(name))
        about = self._stored(self.joints[name, "TorqueLocal"])
        match self.built.held[name][3:]:
            case (1, 1, 1):
                return -about[0] * x_2 + about[1] * y_2 + about[2] * z_2
            case (0, 1, 1):
                return about[1] * z_2 - about[2] * y_2
            case (1, 0, 0):
                return about[0] * np.cross(y, z_2, axis=0)
        return np.zeros((3, len(self.times)))
