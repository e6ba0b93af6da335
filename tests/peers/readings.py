"""Sensors of a scene from what Exudyn stores: nodal coordinates, section forces and multipliers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from kaneflex.mechanism.body_frame import acceleration, velocity
from kaneflex.mechanism.planar import Pose
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import Sensor

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex_peers.exudyn_spatial import Built as SpatialBuilt
    from kaneflex_peers.exudyn_system import Built

NO_COUNTERPART = "the other program has no such sensor"
NOT_SHARED = "the two programs have no common rigid motion"


def rotate(c: np.ndarray, s: np.ndarray, vector: Any) -> np.ndarray:
    """Global components of a vector given in axes rotated by an angle with cosine c and sine s."""
    return np.array(Pose(0.0, 0.0, c, s).turn(vector))


_RATES = ("Coordinates", "Coordinates_t", "Coordinates_tt")


class Recorder:
    """Adds sensors to Exudyn before a run and evaluates the scene's sensors after it.

    A subclass has a method ``_KIND`` for every kind of sensor that it reads: values (n_times,), or the reason why there
    are none.
    """

    def __init__(self, model: Model, built: Built | SpatialBuilt):
        import exudyn.itemInterface as items

        self.model, self.scene, self.items, self.system = model, model.scene, items, built.system
        self.variables, self.recorded = built.exudyn.OutputVariableType, list[int]()
        self.free = bool(self.scene.floating) or any(drive.kind == "free" for drive in self.scene.drives.values())
        self.times, self.window = np.zeros(0), slice(None)

    def _record(self, kind: type, variable: str, **where: object) -> int:
        quantity = getattr(self.variables, variable)
        item = kind(outputVariableType=quantity, storeInternal=True, writeToFile=False, **where)
        self.recorded.append(self.system.AddSensor(item))
        return self.recorded[-1]

    def read(self, since: float) -> tuple[dict[str, np.ndarray], dict[str, str]]:
        """Values of the sensors from the time ``since`` [s] on, which becomes 0, and what can't be read and why."""
        times = self.system.GetSensorStoredData(self.recorded[0])[:, 0]  # all are stored at the same instants
        self.window = times >= since - 0.5 * self.model.step
        self.times = times[self.window] - since
        self.rigid: RigidMotion = self.model.motion.at(self.times)
        values, missing = {}, {}
        for name, sensor in self.scene.sensors.items():
            found = self._read(sensor)
            if isinstance(found, str):
                missing[name] = found
            else:
                values[name] = found
        return values, missing

    def _read(self, sensor: Sensor) -> np.ndarray | str:
        method = getattr(self, f"_{sensor.kind}", None)
        return NO_COUNTERPART if method is None else cast("np.ndarray | str", method(sensor))

    def _stored(self, number: int) -> np.ndarray:
        return self.system.GetSensorStoredData(number)[self.window, 1:].T


class PlanarRecorder(Recorder):
    """Recorder of a planar scene."""

    def __init__(self, model: Model, built: Built):
        super().__init__(model, built)
        self.built, items = built, self.items
        kinds = {sensor.kind for sensor in self.scene.sensors.values()}
        rates = _RATES if kinds & {"velocity", "acceleration"} else _RATES[:1]
        cut = bool(kinds & {"axial_force", "bending_moment", "strain"})
        self.nodes = {
            (node, rate): self._record(items.SensorNode, rate, nodeNumber=node)
            for nodes in built.nodes.values()
            for node in nodes
            for rate in rates
        }
        self.sections = {
            (element, kind, share): self._record(
                items.SensorBody, kind, bodyNumber=element, localPosition=[share * self._size(name), 0.0, 0.0]
            )
            for name, elements in built.elements.items()
            if self.scene.bodies[name].elastic and cut
            for element in elements
            for kind in ("ForceLocal", "TorqueLocal")
            for share in _GAUSS
        }
        revolute = [item for name, item in built.joints.items() if self.scene.joints[name].kind == "revolute"]
        self.multipliers = {
            item: self._record(items.SensorObject, "Force", objectNumber=item)
            for item in (*built.drives.values(), *revolute)
        }

    def _size(self, link: str) -> float:
        return self._length(link) / len(self.built.elements[link])

    def _length(self, link: str) -> float:
        length = self.scene.bodies[link].length
        assert length is not None
        return length

    # ---- motion -----------------------------------------------------------------------------------------------

    def _coordinates(self, node: int, order: int) -> np.ndarray:
        """Coordinates with their reference values, or rates, of a node, (n, n_times)."""
        stored = self._stored(self.nodes[node, _RATES[order]])
        if order:
            return stored
        reference = self.system.GetNodeOutput(
            node, self.variables.Coordinates, self.built.exudyn.ConfigurationType.Reference
        )
        return stored + np.asarray(reference)[:, None]

    def _axes(self, body: str, way: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Cosine and sine of the angle of a rigid body, or of the rigid mechanism's link, (n_times,) each; ``way``: its
        sign."""
        if self.scene.bodies[body].elastic:
            return self.rigid[f"{body}.c"], way * self.rigid[f"{body}.s"]
        angle = self._coordinates(self.built.nodes[body][0], 0)[2]
        return np.cos(angle), way * np.sin(angle)

    def _point(self, address: Address, order: int = 0) -> np.ndarray:
        """Place, velocity or acceleration of a point, global, (2, n_times)."""
        x, y = self.scene.point(address)
        if address.body == "ground":
            return np.outer((x, y) if order == 0 else (0.0, 0.0), np.ones(len(self.times)))
        if self.scene.bodies[address.body].elastic:
            return self._along(address.body, x, order)[:2]
        (node,) = self.built.nodes[address.body]
        centre = self.built.centres[address.body]
        arm = rotate(*self._axes(address.body), (x - centre[0], y - centre[1]))
        q = self._coordinates(node, order)
        if order == 0:
            return q[:2] + arm
        if order == 1:
            return q[:2] + velocity(q[2], arm)
        return q[:2] + acceleration(self._coordinates(node, 1)[2], q[2], arm)

    def _along(self, link: str, x: float, order: int = 0) -> np.ndarray:
        """Place and slope vector of a link's axis, or their rates, (4, n_times), by cubic Hermite shapes."""
        nodes, h = self.built.nodes[link], self._size(link)
        index = min(int(x / h + 1e-9), len(nodes) - 2)
        s = x / h - index
        q, r = (self._coordinates(nodes[index + k], order) for k in (0, 1))
        shapes = (1 - 3 * s**2 + 2 * s**3, h * (s - 2 * s**2 + s**3), 3 * s**2 - 2 * s**3, h * (s**3 - s**2))
        slopes = ((6 * s**2 - 6 * s) / h, 1 - 4 * s + 3 * s**2, (6 * s - 6 * s**2) / h, 3 * s**2 - 2 * s)
        return np.vstack([
            part[0] * q[:2] + part[1] * q[2:] + part[2] * r[:2] + part[3] * r[2:] for part in (shapes, slopes)
        ])  # fmt: skip

    def _component(self, sensor: Sensor, vector: np.ndarray) -> np.ndarray:
        if sensor.axes == "body":
            vector = rotate(*self._axes(address_of(sensor).body, -1.0), vector)
        return vector["xy".index(sensor.component)]

    def _displacement(self, sensor: Sensor) -> np.ndarray | str:
        address = address_of(sensor)
        if sensor.component == "angle":
            return NO_COUNTERPART
        if self.free:
            return self._off_chord(sensor) if sensor.relative_to == "chord" and sensor.axes == "body" else NOT_SHARED
        gap = self._gap(address)
        if sensor.relative_to != "frame":
            start = self._gap(Address(address.body, "start"))
            share = self.scene.point(address)[0] / self._length(address.body) if sensor.relative_to == "chord" else 0.0
            gap = gap - start - share * (self._gap(Address(address.body, "end")) - start)
        return self._component(sensor, gap)

    def _off_chord(self, sensor: Sensor) -> np.ndarray:
        """Displacement of a link's point along and across its chord, relative to its position on a straight link."""
        address = address_of(sensor)
        start, end = (self._point(Address(address.body, point)) for point in ("start", "end"))
        length = np.hypot(*(end - start))
        c, s = (end - start) / length
        away = rotate(c, -s, self._point(address) - start)
        away[0] -= self.scene.point(address)[0] / self._length(address.body) * length
        return away["xy".index(sensor.component)]

    def _gap(self, address: Address) -> np.ndarray:
        """Position of a point relative to the rigid mechanism, global."""
        return self._point(address) - self.rigid.frame(address.body).place(self.scene.point(address))

    def _position(self, sensor: Sensor) -> np.ndarray | str:
        address = address_of(sensor)
        if address.body in self.scene.joints:
            joint = self.scene.joints[address.body]
            if joint.kind != "revolute":
                return NO_COUNTERPART
            first, second = (self._angle(side) for side in joint.addresses)
            return second - first
        return self._angle(address) if sensor.component == "angle" else self._component(sensor, self._point(address))

    def _angle(self, address: Address) -> np.ndarray:
        if address.body == "ground":
            return np.zeros(len(self.times))
        if self.scene.bodies[address.body].elastic:
            slope = self._along(address.body, self.scene.point(address)[0])[2:]
            return np.unwrap(np.arctan2(slope[1], slope[0]))
        return self._coordinates(self.built.nodes[address.body][0], 0)[2]

    def _turning(self, body: str, order: int) -> np.ndarray | str:
        """Angular velocity or acceleration of a rigid body."""
        if self.scene.bodies[body].elastic:
            return NO_COUNTERPART
        return self._coordinates(self.built.nodes[body][0], order)[2]

    def _velocity(self, sensor: Sensor) -> np.ndarray | str:
        if sensor.component == "angle":
            return self._turning(address_of(sensor).body, 1)
        return self._component(sensor, self._point(address_of(sensor), 1))

    def _acceleration(self, sensor: Sensor) -> np.ndarray | str:
        if sensor.component == "angle":
            return self._turning(address_of(sensor).body, 2)
        gravity = np.array(self.scene.gravity) if sensor.reading == "accelerometer" else np.zeros(2)
        return self._component(sensor, self._point(address_of(sensor), 2) - gravity[:, None])

    # ---- forces -----------------------------------------------------------------------------------------------

    def _section(self, sensor: Sensor, kind: str) -> np.ndarray:
        """A section force at X, linear between the means of neighbouring elements and beyond the last of them.

        An ANCF cable's axial strain varies within the element with the square of its slopes; its mean converges.
        """
        link, x = address_of(sensor).body, self.scene.point(address_of(sensor))[0]
        elements = self.built.elements[link]
        means = np.array([
            np.mean([self._stored(self.sections[element, kind, share])[0] for share in _GAUSS], axis=0)
            for element in elements
        ])  # fmt: skip
        if len(elements) == 1:
            return means[0]
        place = x / self._size(link) - 0.5
        index = min(max(int(np.floor(place)), 0), len(elements) - 2)
        return means[index] + (place - index) * (means[index + 1] - means[index])

    def _axial_force(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor, "ForceLocal")

    def _bending_moment(self, sensor: Sensor) -> np.ndarray:
        return self._section(sensor, "TorqueLocal")

    def _strain(self, sensor: Sensor) -> np.ndarray:
        body = self.scene.bodies[address_of(sensor).body]
        bent = sensor.fibre * self._section(sensor, "TorqueLocal") / body.E_I
        return self._section(sensor, "ForceLocal") / body.E_A - bent

    def _drive_torque(self, sensor: Sensor) -> np.ndarray:
        first, _ = self.scene.joints[sensor.target].addresses
        sign = 1.0 if first.body == "ground" else -1.0
        return -sign * self._stored(self.multipliers[self.built.drives[sensor.target]])[0]

    def _joint_force(self, sensor: Sensor) -> np.ndarray | str:
        """Exudyn's is on the first marker's body, in global axes."""
        joint = self.scene.joints[sensor.target]
        if joint.kind != "revolute" or sensor.component == "angle" or sensor.axes == "body":
            return NO_COUNTERPART
        sign = 1.0 if sensor.body == joint.addresses[0].body else -1.0
        force = self._stored(self.multipliers[self.built.joints[sensor.target]])
        return sign * force["xy".index(sensor.component)]


def address_of(sensor: Sensor) -> Address:
    """The point that a sensor reads."""
    assert isinstance(sensor.target, Address)
    return sensor.target


_GAUSS = (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5)
