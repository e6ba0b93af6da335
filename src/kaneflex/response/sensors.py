"""Evaluation of a scene's sensors on a motion."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from kaneflex.mechanism.body_frame import BodyFrame, Rates, applied, turning
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.wrenches import joint_force, joint_moment
from kaneflex.response.motion import Motion
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import (
    CONTACT_KINDS,
    DRIVE_KINDS,
    FRICTION_KINDS,
    RIGID_COMPANIONS,
    SECTION_KINDS,
    SPRING_KINDS,
    Sensor,
)

if TYPE_CHECKING:
    from kaneflex.multibody.time.spatial_motion import SpatialMotion
    from kaneflex.response.elastic_motion import ElasticMotion


class Series(NamedTuple):
    """Values (n_times,) of a sensor in ``unit`` (SI), and their meaning."""

    values: np.ndarray
    unit: str
    meaning: str


class Read(NamedTuple):
    """Name, unit (SI), meaning and function for the values (n_times,) of a series."""

    name: str
    unit: str
    meaning: str
    values: Callable[[], np.ndarray]


OF_RIGID = ", of the rigid mechanism"
"""Ending of the meaning of values that ignore the deformation."""


def reads(motion: Motion, only: Container[str] | None = None) -> Iterator[Read]:
    """Every sensor of the scene, and the rigid value ``NAME_rigid`` of every force.

    ``only``: names of sensors to include.
    """
    reader = Reader(motion)
    for name, sensor in motion.model.scene.sensors.items():
        if only is not None and name not in only:
            continue
        meaning = reader.scene.meaning_of(sensor)
        reaction, frozen = sensor.kind in ("joint_force", *DRIVE_KINDS), motion.model.options.dynamics == "frozen"
        yield Read(name, sensor.unit, meaning + OF_RIGID * (reaction and frozen), partial(reader.read, sensor))
        if sensor.kind in RIGID_COMPANIONS and motion.has_rigid_forces and reader.is_rigid_known(sensor):
            of_rigid = partial(sensor_values, motion.of_rigid, sensor)
            yield Read(f"{name}_rigid", sensor.unit, meaning + OF_RIGID, of_rigid)


def measure(motion: Motion, only: Container[str] | None = None) -> dict[str, Series]:
    """Values of :func:`reads`."""
    return {each.name: Series(each.values(), each.unit, each.meaning) for each in reads(motion, only)}


def sensor_values(motion: Motion, sensor: Sensor) -> np.ndarray:
    """Values of one sensor (n_times,) in its SI unit."""
    return Reader(motion).read(sensor)


def address_of(sensor: Sensor) -> Address:
    """Point of a sensor of a body's motion or section."""
    return cast(Address, sensor.target)


def displacement_of(
    scene: Scene, sensor: Sensor, frame: BodyFrame, moved: Callable[[Address], np.ndarray]
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


def strain_of(scene: Scene, sensor: Sensor, N: np.ndarray, M_y: np.ndarray, M_z: np.ndarray) -> np.ndarray:
    """Strain u' - y v'' - z w'' of a fibre along a link, from the force N and moments E I_z v'' = M_z, -E I_y w'' =
    M_y; in the plane z = 0."""
    address, after = address_of(sensor), sensor.cut == "after"
    section = scene.bodies[address.body].profile.at(scene.point(address)[0], after)
    y, z = sensor.fibre if isinstance(sensor.fibre, tuple) else (sensor.fibre, 0.0)
    strain = N / section.E_A - y * M_z / section.E_I_z
    return strain + z * M_y / section.E_I_y if z else strain


class Reader:
    """Series of one motion, with a cache of shared values.

    Displacements are x, y and an angle in the body's axes, in space u, v, w and three rotations, there with rotations,
    angular velocities and accelerations as vectors with components ``angle_x`` etc.
    """

    def __init__(self, motion: Motion):
        self.motion, self.rigid, self.scene = motion, motion.rigid, motion.model.scene
        self.steps = len(motion.times)
        self._displaced: Callable[[Address], np.ndarray] = cache(
            lambda address: motion.displacement(*self._at(address))[0]
        )

    def read(self, sensor: Sensor) -> np.ndarray:
        if self.steps == 0:  # the run stopped before its first instant
            return np.zeros(0)
        motion, target = self.motion, str(sensor.target)
        if sensor.kind in SECTION_KINDS:
            return self._of_section(sensor)
        if sensor.kind == "joint_force":
            return self._joint_component(sensor)
        if sensor.kind in DRIVE_KINDS:
            return motion.reaction(f"{target}.drive")
        if sensor.kind in SPRING_KINDS and self.scene.springs[target].bushing:
            part = "force" if sensor.kind == "spring_force" else "moment"
            return motion.scalars[f"{target}.{part}_{sensor.component}"]
        if sensor.kind in SPRING_KINDS:
            return motion.spring_tension(target)
        if sensor.kind in CONTACT_KINDS:
            return motion.contact(target)[sensor.kind in ("contact_force", "contact_torque")]
        if sensor.kind in FRICTION_KINDS:
            return motion.friction(target)
        return getattr(self, f"_{sensor.kind}")(sensor)

    def is_rigid_known(self, sensor: Sensor) -> bool:
        """True if the rigid mechanism determines a reading: not for sections of bodies with modal data, and not if it
        is statically indeterminate."""
        joints = {str(sensor.target)}
        if sensor.kind in SECTION_KINDS:
            body, of = address_of(sensor).body, self.scene.joints.items()
            if self.scene.bodies[body].modal is not None:
                return False
            joints = {name for name, joint in of if body in {side.body for side in joint.addresses}}
        lost = getattr(self.motion.model.module, "open_reactions", ())  # in the plane `load` refuses such mechanisms
        return not any(each.rpartition(".")[0] in joints for each in lost)

    # ---- motion of points -------------------------------------------------------------------------------------

    def _component(self, sensor: Sensor, vector: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Component of a global vector, or of an angle or a global rotation vector, that a sensor reads."""
        if sensor.component == "angle":
            return angle
        if sensor.component.startswith("angle"):
            vector = angle
        if sensor.axes == "body":
            vector = self.motion.seen_from(address_of(sensor).body, vector)
        return vector["xyz".index(sensor.component[-1])]

    def _at(self, address: Address) -> tuple[str, tuple[float, ...]]:
        """Body of a point, and its place there."""
        return address.body, self.scene.point(address)

    def _displacement(self, sensor: Sensor) -> np.ndarray:
        return displacement_of(self.scene, sensor, self.rigid.frame(address_of(sensor).body), self._displaced)

    def _position(self, sensor: Sensor) -> np.ndarray:
        address = address_of(sensor)
        if address.body in self.scene.loose:
            return self._clearance(sensor, address.body)
        if address.body in self.scene.joints:
            return self._joint(sensor)[0] if self.rigid.freedoms == 6 else self._joint_coordinate(address.body)
        if sensor.component == "angle":
            return self.motion.angle(*self._at(address))
        return self._component(sensor, self.motion.place(*self._at(address)), np.zeros((3, self.steps)))

    def _joint_coordinate(self, name: str) -> np.ndarray:
        """Angle of a joint's second body relative to its first [rad], or its slide along a guide [m]."""
        joint = self.scene.joints[name]
        first, second = joint.addresses
        if joint.kind != "prismatic":
            return self.motion.angle(*self._at(second)) - self.motion.angle(*self._at(first))
        return self.motion.slide(name)

    def _joint(self, sensor: Sensor) -> Rates:
        """Angle of a joint in space, continuous over turns [rad], or its slide [m], with its rates."""
        from kaneflex.mechanism.spatial_frame import slide_of, turn_rates

        name = address_of(sensor).body
        joint = mechanism_of(self.scene).joints[name]
        scalars = cast("SpatialMotion", self.motion.scalars)
        joint, first, second = scalars.joined_frames(joint)
        if sensor.component != "angle":
            rigid = slide_of(joint, first, second)
        else:
            rigid = scalars[f"{name}.angle"], *turn_rates(joint, first, second)
        if not self.motion.model.links:
            return rigid
        freedom = "angle" if sensor.component == "angle" else "position"
        change = cast("ElasticMotion", self.motion).change_of(name, freedom)
        return rigid[0] + change[0], rigid[1] + change[1], rigid[2] + change[2]

    def _clearance(self, sensor: Sensor, name: str) -> np.ndarray:
        """Position of a pin in its bearing, of a ball in its socket, or of a block in its guide."""
        loose, (x, y, last) = self.scene.loose[name], self.motion.clearance(name)
        if sensor.axes == "body" and self.rigid.freedoms == 6:
            x, y, last = self.motion.seen_from(loose.sides[0].body, np.array([x, y, last]))
        elif sensor.axes == "body" and loose.direction is None:
            x, y = applied(turning(-self.motion.angle(*self._at(loose.sides[0]))), (x, y))
        return {"x": x, "y": y}.get(sensor.component, last)

    def _velocity(self, sensor: Sensor) -> np.ndarray:
        if address_of(sensor).body in self.scene.joints:
            return self._joint(sensor)[1]
        return self._component(sensor, *self.motion.rate(*self._at(address_of(sensor)), 1))

    def _acceleration(self, sensor: Sensor) -> np.ndarray:
        """Acceleration of the displaced point; a - g for an accelerometer."""
        if address_of(sensor).body in self.scene.joints:
            return self._joint(sensor)[2]
        acceleration, turning = self.motion.rate(*self._at(address_of(sensor)), 2)
        if sensor.reading == "accelerometer":
            acceleration = acceleration - np.reshape(self.scene.vector(self.scene.gravity), (-1, 1))
        return self._component(sensor, acceleration, turning)

    # ---- forces -----------------------------------------------------------------------------------------------

    def _of_section(self, sensor: Sensor) -> np.ndarray:
        """Reading of a sensor from N, V, M, or in space N, V_y, V_z, T, M_y, M_z; a planar strain is N / (E A) - fibre
        M / (E I)."""
        body, point = address_of(sensor)
        if (data := self.scene.bodies[body].modal) is not None:
            section = data.sections.at(point, self.motion.modal(body)[0])
        else:
            x = self.scene.point(address_of(sensor))[0]
            section = self.motion.section(body, x, sensor.cut == "after")
        if sensor.kind == "axial_force":
            return section[0]
        if sensor.kind == "strain":
            return strain_of(self.scene, sensor, section[0], section[-2], section[-1])
        if len(section) == 6:
            first = {"shear_force": 0, "torsional_moment": 3, "bending_moment": 3}[sensor.kind]
            return section[first + max(0, "xyz".find(sensor.component))]
        return section[1 + (sensor.kind == "bending_moment")]

    def _stress(self, sensor: Sensor) -> np.ndarray:
        body, point = address_of(sensor)
        data = self.scene.bodies[body].modal
        assert data is not None  # checked with the scene
        return data.stresses.stresses_at(point, self.motion.modal(body)[0])[sensor.component]

    def _joint_component(self, sensor: Sensor) -> np.ndarray:
        """Component of a joint's force or moment on ``sensor.body`` (by default the second), in space about the joint's
        second point."""
        name, mechanism, motion = str(sensor.joint_force), mechanism_of(self.scene), self.motion
        first, second = (address.body for address in self.scene.joints[name].addresses)
        if sensor.component.startswith("angle"):
            exerted = joint_moment(mechanism, name, motion.reaction)
        else:
            exerted = joint_force(mechanism, motion.scalars, name, motion.reaction)
        exerted = (-1.0 if sensor.body == first else 1.0) * exerted
        if sensor.component == "angle":
            return exerted
        if sensor.axes == "body":
            exerted = motion.seen_from(sensor.body or second, exerted)
        return exerted["xyz".index(sensor.component[-1])]
