"""Sensors of mechanisms in space, with three components."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np

from kaneflex.mechanism.body_frame import BodyFrame, Rates
from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.mechanism.spatial_frame import slide_of, turn_rates
from kaneflex.multibody.time.spatial_motion import SpatialMotion
from kaneflex.response.elastic_motion import SpatialElasticMotion
from kaneflex.response.motion import Section
from kaneflex.response.readings import Reader, address_of, displacement_of
from kaneflex.response.spatial_coupled_motion import SpatialCoupledMotion
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import SECTION_KINDS, SPRING_KINDS, Sensor

_RATES = ("position", "velocity", "acceleration")
"""Kinds of sensors of motion, by their order of differentiation."""


def strain_of(scene: Scene, sensor: Sensor, N: np.ndarray, M_y: np.ndarray, M_z: np.ndarray) -> np.ndarray:
    """Strain u' - y v'' - z w'' of a fibre along a link, from the force N and moments E I_z v'' = M_z, -E I_y w'' =
    M_y."""
    address, after = address_of(sensor), sensor.cut == "after"
    here = scene.bodies[address.body].profile.at(scene.point(address)[0], after)
    y, z = cast(tuple[float, float], sensor.fibre)
    return N / here.E_A + z * M_y / here.E_I_y - y * M_z / here.E_I_z


class SpatialReader(Reader):
    """Series of one motion in space.

    Displacements are u, v, w and three rotations in the body's axes; rotations, angular velocities and accelerations
    are vectors with components ``angle_x`` etc.
    """

    def read(self, sensor: Sensor) -> np.ndarray:
        if self.steps and sensor.kind in _RATES and address_of(sensor).body in self.scene.joints:
            return self._joint(sensor)[_RATES.index(sensor.kind)]
        return self._of_bushing(sensor) if self.steps and self._is_bushing(sensor) else super().read(sensor)

    def _turn(self, frame: BodyFrame, moved: np.ndarray) -> np.ndarray:
        return frame.to_global(moved[3:])

    def _displacement(self, sensor: Sensor) -> np.ndarray:
        motion = self.motion
        if not isinstance(motion, SpatialCoupledMotion):
            return super()._displacement(sensor)
        return displacement_of(self.scene, sensor, motion.beside.frame(address_of(sensor).body), self._from_rigid)

    def _from_rigid(self, address: Address) -> np.ndarray:
        return cast(SpatialCoupledMotion, self.motion).from_rigid(address.body, self.scene.point(address))

    def is_rigid_known(self, sensor: Sensor) -> bool:
        """True if the rigid mechanism determines a reading: not if it is statically indeterminate."""
        lost = self.motion.model.module.open_reactions
        if sensor.kind in SECTION_KINDS:
            of = self.scene.joints.items()
            joints = [name for name, joint in of if address_of(sensor).body in {side.body for side in joint.addresses}]
        else:
            joints = [str(sensor.target)]
        return super().is_rigid_known(sensor) and not any(each.rpartition(".")[0] in joints for each in lost)

    def read_rigid(self, sensor: Sensor) -> np.ndarray:
        return self._of_bushing(sensor) if self._is_bushing(sensor) else super().read_rigid(sensor)

    def _of_section(self, sensor: Sensor, section: Section) -> np.ndarray:
        """Reading of a sensor from N, V_y, V_z, T, M_y, M_z."""
        if sensor.kind == "axial_force":
            return section[0]
        if sensor.kind == "torsional_moment":
            return section[3]
        if sensor.kind == "strain":
            return strain_of(self.scene, sensor, section[0], section[4], section[5])
        return section["xyz".index(sensor.component) + 3 * (sensor.kind == "bending_moment")]

    def _is_bushing(self, sensor: Sensor) -> bool:
        return sensor.kind in SPRING_KINDS and self.scene.springs[str(sensor.target)].bushing is not None

    def _of_bushing(self, sensor: Sensor) -> np.ndarray:
        part = "force" if sensor.kind == "spring_force" else "moment"
        return self.rigid[f"{sensor.target}.{part}_{sensor.component}"]

    def _joint(self, sensor: Sensor) -> Rates:
        """Angle of a joint, continuous over turns [rad], or its slide [m], with its rates."""
        name = address_of(sensor).body
        joint = spatial_mechanism_of(self.scene).joints[name]
        joint, first, second = cast(SpatialMotion, self.rigid).joined_frames(joint)
        if sensor.component != "angle":
            rigid = slide_of(joint, first, second)
        else:
            rigid = self.rigid[f"{name}.angle"], *turn_rates(joint, first, second)
        if not self.motion.model.links:
            return rigid
        freedom = "angle" if sensor.component == "angle" else "position"
        change = cast(SpatialElasticMotion, self.motion).change_of(name, freedom)
        return rigid[0] + change[0], rigid[1] + change[1], rigid[2] + change[2]

    def _exerted(self, sensor: Sensor, reaction: Callable[[str], np.ndarray], of_rigid: bool) -> np.ndarray:
        """Force of a joint on its second body, or its moment about the joint's second point; global."""
        part = "moment" if sensor.component.startswith("angle") else "force"
        return np.array([reaction(f"{sensor.joint_force}.{part}_{axis}") for axis in "xyz"])
