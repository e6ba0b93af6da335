"""Sensors of a scene in space from what Exudyn stores: motions of bodies' points, and what its joints exert."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.spatial.transform import Rotation

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import GROUND, whole_turns
from kaneflex.mechanism.spatial_frame import SpatialFrame, slide_of, turn_of
from kaneflex.response.sensors import displacement_of, strain_of
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import SECTION_KINDS, Sensor
from kaneflex_peers.exudyn_spatial import OF_BODIES, Bodies
from kaneflex_peers.readings import NOT_SHARED, Recorder, address_of

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex_peers.exudyn_spatial import Built


class SpatialRecorder(Recorder):
    """Recorder of a scene in space."""

    def __init__(self, model: Model, built: Built):
        super().__init__(model, built)
        self.built, items = built, self.items
        self.mechanism, self.start = mechanism_of(model.scene), model.motion.at(0.0)
        self.bodies = {
            (name, variable): self._record(
                items.SensorBody, variable, bodyNumber=number, localPosition=-self.mechanism.bodies[name].centre
            )
            for name, number in built.bodies.items() if name != GROUND for variable in OF_BODIES.values()
        }  # fmt: skip
        points = {(link, chain.node_at(at[0])) for link, chain in built.links.items()
                  for at in self.scene.bodies[link].points_all.values()}  # fmt: skip
        self.nodes = {
            (link, node, variable): self._record(items.SensorNode, variable, nodeNumber=built.links[link].nodes[node])
            for link, node in sorted(points) for variable in OF_BODIES.values()
        }  # fmt: skip
        self.sections = {
            (element, kind): self._record(items.SensorBody, kind, bodyNumber=element, localPosition=[0.0, 0.0, 0.0])
            for link in {address_of(each).body for each in self.scene.sensors.values() if each.kind in SECTION_KINDS}
            for element in built.links[link].elements for kind in ("ForceLocal", "TorqueLocal")
        }  # fmt: skip
        self.joints = {
            (name, quantity): self._record(items.SensorObject, quantity, objectNumber=number)
            for name, number in built.joints.items() for quantity in ("ForceLocal", "TorqueLocal")
        }  # fmt: skip
        self.springs = {
            (name, quantity): self._record(items.SensorObject, quantity, objectNumber=built.springs[name])
            for name, spring in self.mechanism.springs.items()
            for quantity, there in (("ForceLocal", spring.joint is None), ("TorqueLocal", spring.joint is not None))
            if there or spring.is_bushing
        }

    @cached_property
    def moved(self) -> Bodies:
        """Motions of Exudyn's bodies."""
        moved = Bodies(self.times)
        for body in self.built.bodies:
            if body != GROUND:
                moved.put(body, self._of(self.bodies, body))
        for link, node in {key[:2] for key in self.nodes}:
            moved.put(f"{link}@{node}", self._of(self.nodes, link, node), self.built.links[link].places[node])
        return moved

    def _of(self, numbers: Mapping[tuple, int], *what: object) -> Callable[[str], np.ndarray]:
        return lambda variable: self._stored(numbers[*what, variable])

    def _read(self, sensor: Sensor) -> np.ndarray | str:
        unknown = sensor.kind == "displacement" or self._axes_of(sensor) in self.built.links
        return NOT_SHARED if self.free and unknown and hasattr(self, f"_{sensor.kind}") else super()._read(sensor)

    def _axes_of(self, sensor: Sensor) -> str | None:
        """The body whose axes a vector is read in."""
        if sensor.axes != "body" or sensor.kind in SECTION_KINDS:
            return None
        if sensor.kind == "joint_force":
            return sensor.body or self.scene.joints[str(sensor.target)].addresses[1].body
        return sensor.target.body if isinstance(sensor.target, Address) else None

    def _frame(self, body: str, at: Sequence[float]) -> SpatialFrame:
        """The axes that carry a point of a body."""
        return SpatialFrame(self.moved, self.built.carrier(body, at))

    def _component(self, sensor: Sensor, vector: np.ndarray, body: str) -> np.ndarray:
        """In a body's axes; of an elastic one those of the rigid mechanism's link, as its displacements have them."""
        if sensor.axes == "body":
            vector = SpatialFrame(self.rigid if body in self.built.links else self.moved, body).to_body(vector)
        return vector["xyz".index(sensor.component[-1])]

    def _point(self, sensor: Sensor, order: int) -> np.ndarray:
        """Place of a point or a joint, or one of its rates, by the component of a sensor."""
        address = address_of(sensor)
        if address.body in self.scene.joints:
            return self._coordinate(address.body, sensor.component == "angle")[order]
        at = self.scene.point(address)
        frame = self._frame(address.body, at)
        if sensor.component.startswith("angle"):
            return self._component(sensor, (frame.omega, frame.epsilon)[order - 1], address.body)
        vector = (frame.place, frame.velocity, frame.acceleration)[order](at)
        if sensor.kind == "acceleration" and sensor.reading == "accelerometer":
            vector = vector - self.mechanism.gravity[:, None]
        return self._component(sensor, vector, address.body)

    def _displacement(self, sensor: Sensor) -> np.ndarray:
        rigid = SpatialFrame(self.rigid, address_of(sensor).body)
        return displacement_of(self.scene, sensor, rigid, self._moved)

    def _moved(self, address: Address) -> np.ndarray:
        """Displacement and rotation of a point relative to the rigid mechanism, in the rigid link's axes, (6,
        n_times)."""
        at, rigid = self.scene.point(address), SpatialFrame(self.rigid, address.body)
        frame = self._frame(address.body, at)
        turned = np.einsum("jit,jkt->tik", rigid.axes, frame.axes)
        away = rigid.to_body(frame.place(at) - rigid.place(at))
        return np.vstack([away, Rotation.from_matrix(turned).as_rotvec().T])

    def _section(self, sensor: Sensor, kind: str) -> np.ndarray:
        """N, V_y, V_z or T, M_y, M_z at a node, (3, n_times): constant within an element, and so linear through the
        middles of the two that are nearest, the mean of both sides, as a joint there makes a jump or a kink."""
        address = address_of(sensor)
        chain, x = self.built.links[address.body], self.scene.point(address)[0]
        values = np.array([self._stored(self.sections[element, kind]) for element in chain.elements])
        middles, node = 0.5 * (chain.places[1:] + chain.places[:-1]), chain.node_at(x)
        pairs = [(k, beyond) for k, beyond in ((node - 1, node - 2), (node, node + 1)) if 0 <= beyond < len(values)]
        if not pairs:
            return values.mean(axis=0)
        slopes = [(values[m] - values[k]) / (middles[m] - middles[k]) for k, m in pairs]
        sides = [values[k] + (x - middles[k]) * slope for (k, _), slope in zip(pairs, slopes, strict=True)]
        return cast(np.ndarray, np.mean(sides, axis=0))

    def _axial_force(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor, "ForceLocal")[0]

    def _shear_force(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor, "ForceLocal")["xyz".index(sensor.component)]

    def _torsional_moment(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor, "TorqueLocal")[0]

    def _bending_moment(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor, "TorqueLocal")["xyz".index(sensor.component)]

    def _strain(self, sensor: Sensor) -> np.ndarray:
        _, M_y, M_z = self._section(sensor, "TorqueLocal")
        return strain_of(self.scene, sensor, self._section(sensor, "ForceLocal")[0], M_y, M_z)

    def _coordinate(self, name: str, turns: bool) -> Rates:
        """Angle of a joint, continuous from its start, or its slide, and its rates."""
        joint = self.mechanism.joints[name]
        first, second = (self._frame(side.body, side.at) for side in joint.sides)
        if not turns:
            return slide_of(joint, first, second)
        angle, rate, accel = turn_of(joint, first, second, self.mechanism.relative(joint))
        angle = np.unwrap(angle)
        return angle + whole_turns(self.start[f"{name}.angle"][0] - angle[0]), rate, accel

    def _position(self, sensor: Sensor) -> np.ndarray:
        return self._point(sensor, 0)

    def _velocity(self, sensor: Sensor) -> np.ndarray:
        return self._point(sensor, 1)

    def _acceleration(self, sensor: Sensor) -> np.ndarray:
        return self._point(sensor, 2)

    def _joint_axes(self, name: str) -> list[np.ndarray]:
        """Axes of a joint's frame as its first and its second body carry them, columns of (3, 3, n_times)."""
        sides = self.mechanism.joints[name].sides
        return [np.einsum("ijt,jk->ikt", self._frame(side.body, side.at).axes,
                          SpatialFrame(self.start, side.body).axes[..., 0].T @ self.built.frames[name])
                for side in sides]  # fmt: skip

    def _drive_torque(self, sensor: Sensor) -> np.ndarray:
        return -self._stored(self.joints[str(sensor.target), "TorqueLocal"])[0]

    def _drive_force(self, sensor: Sensor) -> np.ndarray:
        return -self._stored(self.joints[str(sensor.target), "ForceLocal"])[0]

    def _spring_force(self, sensor: Sensor) -> np.ndarray:
        return self._stored(self.springs[str(sensor.target), "ForceLocal"])["xyz".index(sensor.component)]

    def _spring_torque(self, sensor: Sensor) -> np.ndarray:
        return self._stored(self.springs[str(sensor.target), "TorqueLocal"])["xyz".index(sensor.component)]

    def _joint_force(self, sensor: Sensor) -> np.ndarray:
        """Force on the second body, or moment about its point, or their opposites."""
        name = str(sensor.target)
        first, second = (side.body for side in self.scene.joints[name].addresses)
        exerted = self._moment(name) if sensor.component.startswith("angle") else self._force(name)
        sign = -1.0 if sensor.body == first else 1.0
        return sign * self._component(sensor, exerted, sensor.body or second)

    def _force(self, name: str) -> np.ndarray:
        """Force from Exudyn's, which is in the axes of the joint's frame on the first body, and acts on that."""
        return -np.einsum("ijt,jt->it", self._joint_axes(name)[0], self._stored(self.joints[name, "ForceLocal"]))

    def _moment(self, name: str) -> np.ndarray:
        """Moment from Exudyn's multipliers of products of the frame's axes on the two bodies that stay zero.

        The products, and so the axes of rotation, depend on the constrained rotations.
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
