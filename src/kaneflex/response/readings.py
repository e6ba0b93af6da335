"""Readings of a motion for each kind of sensor, in the plane and shared with space."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.mechanism.body_frame import BodyFrame, Rates, rotate_back
from kaneflex.response.motion import Motion, Section
from kaneflex.response.section_forces import joint_force
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import CONTACT_KINDS, DRIVE_KINDS, FRICTION_KINDS, SECTION_KINDS, SPRING_KINDS, Sensor

if TYPE_CHECKING:
    from kaneflex.mechanism.spatial_frame import SpatialFrame


def address_of(sensor: Sensor) -> Address:
    """Point of a sensor of a body's motion or section."""
    return cast(Address, sensor.target)


def displacement_of(
    scene: Scene, sensor: Sensor, frame: BodyFrame | SpatialFrame, moved: Callable[[Address], np.ndarray]
) -> np.ndarray:
    """Reading of a displacement or rotation of a body's point, (n_times,).

    ``frame``: the rigid body's; ``moved``: function of a point that returns its displacement and rotation in these
    axes: x, y, angle, or in space u, v, w and three rotations, (3 or 6, n_times).
    """
    address = address_of(sensor)
    d = moved(address).copy()
    if sensor.relative_to != "frame":
        start = moved(Address(address.body, "start"))
        if sensor.relative_to == "start":
            d -= start
        else:
            end, length = moved(Address(address.body, "end")), scene.bodies[address.body].length
            assert length is not None
            chord = start + scene.point(address)[0] / length * (end - start)
            chord[-1] = (end[1] - start[1]) / length
            if len(d) == 6:
                chord[3:5] = start[3], (start[2] - end[2]) / length
            d -= chord
    if sensor.component == "angle":
        return d[2]
    vector = np.split(d, [(len(d) + 1) // 2])[sensor.component.startswith("angle")]
    return (vector if sensor.axes == "body" else frame.to_global(vector))["xyz".index(sensor.component[-1])]


class Reader:
    """Series of one motion, with a cache of shared values."""

    def __init__(self, motion: Motion):
        self.motion, self.rigid, self.scene = motion, motion.rigid, motion.model.scene
        self.steps = len(motion.times)
        self._moved: dict[Address, Rates] = {}

    def read(self, sensor: Sensor) -> np.ndarray:
        if self.steps == 0:  # the run stopped before its first instant
            return np.zeros(0)
        motion, target = self.motion, str(sensor.target)
        if sensor.kind in SECTION_KINDS:
            return self._of_section(sensor, self._section(sensor))
        if sensor.kind == "joint_force":
            return self._joint_component(sensor, motion.reaction)
        if sensor.kind in DRIVE_KINDS:
            return motion.reaction(f"{target}.drive")
        if sensor.kind in SPRING_KINDS:
            return motion.spring_tension(target)
        if sensor.kind in CONTACT_KINDS:
            return motion.contact(target)[sensor.kind in ("contact_force", "contact_torque")]
        if sensor.kind in FRICTION_KINDS:
            return motion.friction(target)
        return getattr(self, f"_{sensor.kind}")(sensor)

    def is_rigid_known(self, sensor: Sensor) -> bool:
        """True if the rigid mechanism determines a reading: not for sections of bodies with modal data."""
        return sensor.kind not in SECTION_KINDS or self.scene.bodies[address_of(sensor).body].modal is None

    def read_rigid(self, sensor: Sensor) -> np.ndarray:
        """Value of the rigid mechanism."""
        if sensor.kind in SECTION_KINDS:
            return self._of_section(sensor, self.motion.rigid_section(*self._cut(sensor)))
        if sensor.kind in DRIVE_KINDS:
            return self.motion.rigid_forces[f"{sensor.target}.drive"]
        if sensor.kind in SPRING_KINDS:
            exerted = "tension" if sensor.kind == "spring_force" else "torque"
            return self.motion.rigid_forces[f"{sensor.target}.{exerted}"]
        return self._joint_component(sensor, self.motion.rigid_forces.__getitem__, True)

    # ---- motion of points -------------------------------------------------------------------------------------

    def _elastic(self, address: Address) -> Rates:
        """Displacement (x, y, angle) of a point in its body's axes and its first and second rates, (3, n_times)."""
        if address not in self._moved:
            self._moved[address] = self.motion.displacement(address.body, self.scene.point(address))
        return self._moved[address]

    def _point(self, address: Address) -> Rates:
        """Position of a displaced point in its body's axes with rates, (2 or 3, n_times) each."""
        at = self.scene.point(address)
        d, d_rate, d_accel = (part[: len(at)] for part in self._elastic(address))
        return np.reshape(at, (-1, 1)) + d, d_rate, d_accel

    def _turn(self, frame: BodyFrame, moved: np.ndarray) -> np.ndarray:
        """Contribution of a displacement, or of its rate, to a body's rotation, global."""
        return moved[2]

    def _component(self, sensor: Sensor, vector: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Component of a global vector, or of an angle or a global rotation vector, that a sensor reads."""
        if sensor.component == "angle":
            return angle
        if sensor.component.startswith("angle"):
            vector = angle
        if sensor.axes == "body":
            vector = self.motion.seen_from(address_of(sensor).body, vector)
        return vector["xyz".index(sensor.component[-1])]

    def _displacement(self, sensor: Sensor) -> np.ndarray:
        frame = self.rigid.frame(address_of(sensor).body)
        return displacement_of(self.scene, sensor, frame, lambda address: self._elastic(address)[0])

    def _position(self, sensor: Sensor) -> np.ndarray:
        address = address_of(sensor)
        if address.body in self.scene.loose:
            return self._clearance(sensor, address.body)
        if address.body in self.scene.joints:
            return self._joint_coordinate(address.body)
        if sensor.component == "angle":
            return self._angle(address)
        return self._component(sensor, self._place(address), np.zeros((3, self.steps)))

    def _joint_coordinate(self, name: str) -> np.ndarray:
        """Angle of a joint's second body relative to its first [rad], or its slide along a guide [m]."""
        joint = self.scene.joints[name]
        first, second = joint.addresses
        if joint.kind != "prismatic":
            return self._angle(second) - self._angle(first)
        return self.motion.slide(name)

    def _clearance(self, sensor: Sensor, name: str) -> np.ndarray:
        """Position of a pin in its bearing or of a block in its guide."""
        x, y, angle = self.motion.clearance(name)
        loose = self.scene.loose[name]
        if sensor.axes == "body" and loose.direction is None:
            turned = self._angle(loose.sides[0])
            x, y = rotate_back(np.cos(turned), np.sin(turned), (x, y))
        return {"x": x, "y": y, "angle": angle}[sensor.component]

    def _angle(self, address: Address) -> np.ndarray:
        return self.motion.angle(address.body, self.scene.point(address))

    def _place(self, address: Address) -> np.ndarray:
        return self.motion.place(address.body, self.scene.point(address))

    def _velocity(self, sensor: Sensor) -> np.ndarray:
        return self._component(sensor, *self._rate(address_of(sensor), 1))

    def _acceleration(self, sensor: Sensor) -> np.ndarray:
        """Acceleration of the displaced point; a - g for an accelerometer."""
        acceleration, turning = self._rate(address_of(sensor), 2)
        if sensor.reading == "accelerometer":
            acceleration = acceleration - np.reshape(self.scene.vector(self.scene.gravity), (-1, 1))
        return self._component(sensor, acceleration, turning)

    def _rate(self, address: Address, order: int) -> tuple[np.ndarray, np.ndarray]:
        """Global velocity (``order`` 1) or acceleration (2) of a displaced point, and that of its angle."""
        known = self.motion.point(address.body, self.scene.point(address))
        if known is not None:
            return known[order][:2], known[order][2]
        frame, turn = self.rigid.frame(address.body), self._elastic(address)[order]
        if order == 1:
            return frame.velocity(*self._point(address)[:2]), frame.omega + self._turn(frame, turn)
        return frame.acceleration(*self._point(address)), frame.epsilon + self._turn(frame, turn)

    # ---- forces -----------------------------------------------------------------------------------------------

    def _of_section(self, sensor: Sensor, section: Section) -> np.ndarray:
        """Reading of a sensor from N, V, M; a strain is N / (E A) - fibre M / (E I)."""
        N, V, M = section
        if sensor.kind == "strain":
            body, x, after = self._cut(sensor)
            here = self.scene.bodies[body].profile.at(x, after)
            return N / here.E_A - sensor.fibre * M / here.E_I_z
        return {"axial_force": N, "shear_force": V, "bending_moment": M}[sensor.kind]

    def _stress(self, sensor: Sensor) -> np.ndarray:
        body, point = address_of(sensor)
        data = self.scene.bodies[body].modal
        assert data is not None  # checked with the scene
        return data.stresses.stresses_at(point, self.motion.modal(body)[0])[sensor.component]

    def _section(self, sensor: Sensor) -> Section:
        body, point = address_of(sensor)
        if (data := self.scene.bodies[body].modal) is not None:
            return data.sections.at(point, self.motion.modal(body)[0])
        return self.motion.section(*self._cut(sensor))

    def _cut(self, sensor: Sensor) -> tuple[str, float, bool]:
        """Link, position [m from its start] and side of the section that a sensor reads."""
        address = address_of(sensor)
        return address.body, self.scene.point(address)[0], sensor.cut == "after"

    def _pin_moment(self, name: str, reaction: Callable[[str], np.ndarray]) -> np.ndarray:
        """Torque of a pin's drive and friction on the second body: the pin itself exerts no moment."""
        exerted = np.zeros(self.steps)
        if name in self.scene.drives:
            exerted = exerted + reaction(f"{name}.drive")
        if self.scene.joints[name].friction is not None:
            exerted = exerted + reaction(f"{name}.friction")
        return exerted

    def _joint_component(
        self, sensor: Sensor, reaction: Callable[[str], np.ndarray], of_rigid: bool = False
    ) -> np.ndarray:
        """Component of a joint's force or moment on ``sensor.body`` (by default the second), or that of the rigid
        mechanism."""
        first, second = (address.body for address in self.scene.joints[str(sensor.joint_force)].addresses)
        exerted = (-1.0 if sensor.body == first else 1.0) * self._exerted(sensor, reaction, of_rigid)
        if sensor.component == "angle":
            return exerted
        if sensor.axes == "body":
            on = sensor.body or second
            exerted = self.rigid.frame(on).to_body(exerted) if of_rigid else self.motion.seen_from(on, exerted)
        return exerted["xyz".index(sensor.component[-1])]

    def _exerted(self, sensor: Sensor, reaction: Callable[[str], np.ndarray], of_rigid: bool) -> np.ndarray:
        """Global force of a joint on its second body, or its moment."""
        name = str(sensor.joint_force)
        if sensor.component != "angle":
            return joint_force(self.scene, self.rigid if of_rigid else self.motion.scalars, name, reaction)
        pinned = self.scene.joints[name].kind == "revolute"
        return self._pin_moment(name, reaction) if pinned else reaction(f"{name}.moment")
