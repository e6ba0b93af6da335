"""Sensors of a scene in space from what Exudyn stores: motions of bodies' points, and what its joints exert."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.peers.readings import NO_COUNTERPART, address_of
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import Sensor

if TYPE_CHECKING:
    from kaneflex.multibody.model import Model
    from kaneflex.peers.exudyn_spatial import Built

_MOTION = ("Position", "Velocity", "Acceleration")
_TURNING = ("RotationMatrix", "AngularVelocity", "AngularAcceleration")


class SpatialRecorder:
    """Puts Exudyn's sensors in before a run and evaluates the scene's sensors after it."""

    def __init__(self, model: Model, built: Built):
        import exudyn.itemInterface as items

        self.model, self.scene, self.built, self.items = model, model.scene, built, items
        self.mechanism, self.start = spatial_mechanism_of(model.scene), model.motion.at(0.0)
        self.bodies = {
            (name, quantity): self._record(items.SensorBody, quantity, bodyNumber=number)
            for name, number in built.bodies.items() if name != GROUND for quantity in _TURNING
        }  # fmt: skip
        self.points = {
            (address, quantity): self._record(
                items.SensorBody, quantity, bodyNumber=built.bodies[address.body],
                localPosition=np.array(self.scene.point(address)) - self.mechanism.bodies[address.body].centre,
            )
            for address in self._addresses() for quantity in _MOTION
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
        self.times = np.zeros(0)

    def _addresses(self) -> list[Address]:
        """Points that sensors read, and those of the joints."""
        read = [address_of(sensor) for sensor in self.scene.sensors.values() if isinstance(sensor.target, Address)]
        held = [side for joint in self.scene.joints.values() for side in joint.addresses]
        return [address for address in dict.fromkeys([*read, *held]) if address.body in self.mechanism.bodies]

    def _record(self, kind: type, variable: str, **where: object) -> int:
        quantity = getattr(self.built.exudyn.OutputVariableType, variable)
        item = kind(outputVariableType=quantity, storeInternal=True, writeToFile=False, **where)
        return self.built.system.AddSensor(item)

    def read(self) -> tuple[dict[str, np.ndarray], dict[str, str]]:
        """Values of the sensors, and what can't be read and why."""
        self.times = self.built.system.GetSensorStoredData(next(iter(self.bodies.values())))[:, 0]
        values, missing = {}, {}
        for name, sensor in self.scene.sensors.items():
            method = getattr(self, f"_{sensor.kind}", None)
            found = NO_COUNTERPART if method is None else method(sensor)
            if isinstance(found, str):
                missing[name] = found
            else:
                values[name] = found
        return values, missing

    def _stored(self, number: int) -> np.ndarray:
        return self.built.system.GetSensorStoredData(number)[:, 1:].T

    def _axes(self, body: str) -> np.ndarray:
        """Axes of a body as columns, (3, 3, n_times)."""
        if body == GROUND:
            return np.repeat(np.eye(3)[:, :, None], len(self.times), axis=2)
        return self._stored(self.bodies[body, "RotationMatrix"]).reshape(3, 3, -1)

    def _point(self, address: Address, order: int = 0) -> np.ndarray:
        """Place, velocity or acceleration of a point, global, (3, n_times)."""
        if address.body == GROUND:
            return np.outer(self.scene.point(address) if order == 0 else np.zeros(3), np.ones(len(self.times)))
        return self._stored(self.points[address, _MOTION[order]])

    def _component(self, sensor: Sensor, vector: np.ndarray, body: str) -> np.ndarray:
        if sensor.axes == "body":
            vector = np.einsum("ijt,it->jt", self._axes(body), vector)
        return vector["xyz".index(sensor.component[-1])]

    def _position(self, sensor: Sensor) -> np.ndarray:
        address = address_of(sensor)
        if address.body in self.scene.joints:
            return self._coordinate(address.body)
        return self._component(sensor, self._point(address), address.body)

    def _coordinate(self, name: str) -> np.ndarray:
        """Angle or slide of a joint, from where it starts."""
        first, second = self.scene.joints[name].addresses
        start, own = float(self.start[f"{name}.angle"][0]), self._joint_axes(name)
        if self.scene.joints[name].kind == "prismatic":
            slid = (own[0][:, 0] * (self._point(second) - self._point(first))).sum(axis=0)
            return start + slid - slid[0]
        (_, y, z), (_, turned, _) = (axes.transpose(1, 0, 2) for axes in own)
        return start + np.unwrap(np.arctan2((turned * z).sum(axis=0), (turned * y).sum(axis=0)))

    def _joint_axes(self, name: str) -> list[np.ndarray]:
        """Axes of a joint's frame as its first and its second body carry them, columns of (3, 3, n_times)."""
        bodies = [side.body for side in self.scene.joints[name].addresses]
        return [np.einsum("ijt,jk->ikt", self._axes(body), self._begins(body).T @ self.built.frames[name])
                for body in bodies]  # fmt: skip

    def _begins(self, body: str) -> np.ndarray:
        frame = self.start.frame(body)
        return np.column_stack([frame.to_global(axis)[:, 0] for axis in np.eye(3)])

    def _velocity(self, sensor: Sensor) -> np.ndarray:
        return self._rate(sensor, 1, np.zeros(3))

    def _acceleration(self, sensor: Sensor) -> np.ndarray:
        return self._rate(sensor, 2, self.mechanism.gravity if sensor.reading == "accelerometer" else np.zeros(3))

    def _rate(self, sensor: Sensor, order: int, less: np.ndarray) -> np.ndarray:
        address = address_of(sensor)
        if sensor.component.startswith("angle"):
            return self._component(sensor, self._stored(self.bodies[address.body, _TURNING[order]]), address.body)
        return self._component(sensor, self._point(address, order) - less[:, None], address.body)

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
