"""Section forces of deforming bodies in space, by d'Alembert's principle for the part before a section."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from typing import cast

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.spatial import Side
from kaneflex.mechanism.spatial_frame import applied, cross
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.time.spatial_motion import SpatialMotion
from kaneflex.multibody.time.spatial_sections import Deformed
from kaneflex.response.dalembert import DAlembert
from kaneflex.response.section_forces import carried, spread_loads


@dataclass(frozen=True, eq=False)
class SpatialBalance(DAlembert):
    """Equilibrium of a body in space, with the rotary inertia of its sections."""

    motion: SpatialMotion

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Section forces in the axes of the tangent, the chord or the mean rotation, as in the plane; (6, n_times)."""
        total = super().section(x, after)
        return cast(np.ndarray, np.einsum("jit,kjt->kit", self._axes, total.reshape(2, 3, -1)).reshape(6, -1))

    def _slice(self, e: int, x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        part, profile = self._at(x), self.motion.system.scene.bodies[self.link].profile
        (d, rate, accel), (turning, faster) = part.moved, part.turning
        place, (specific_force, omega, epsilon) = d + np.array([[x], [0.0], [0.0]]), self._carried
        specific_force = specific_force + accel + cross(epsilon, place) + 2.0 * cross(omega, rate)
        specific_force += cross(omega, cross(omega, place))
        about_y, about_z = profile.at(x)[1:3]
        I = np.array([[about_y + about_z], [about_y * profile.rotary], [about_z * profile.rotary]])
        to_section = part.turned.swapaxes(0, 1)
        own = applied(to_section, omega + turning)
        own_rate = applied(to_section, epsilon + cross(omega, turning) + faster)
        return place, specific_force, applied(part.turned, I * own_rate + cross(own, I * own))

    @cached_property
    def _carried(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return carried(self.motion.system.scene, self.motion, self.link)

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        to_body = partial(applied, self._at(0.0).turned)
        return list(spread_loads(self.motion.system.scene, self.motion, self.link, to_body))

    def _at(self, x: float) -> Deformed:
        return self.motion.deformed(Side(self.link, (x, 0.0, 0.0)))

    @cached_property
    def _axes(self) -> np.ndarray:
        """Axes of the components in the body's axes, columns (3, 3, n_times)."""
        from scipy.spatial.transform import Rotation

        q, *_ = self.motion.modal(self.link)
        return Rotation.from_rotvec((self._shapes.turn @ q).T).as_matrix().transpose(1, 2, 0)

    @property
    def _shapes(self) -> Shapes:
        return cast(Shapes, self.motion.system.layout.shapes[self.link])

    @property
    def _link(self) -> Link:
        return self._shapes.link
