"""Section forces of deforming bodies in space, by d'Alembert's principle for the part before a section."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import cast

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.spatial import Side
from kaneflex.mechanism.spatial_frame import SpatialFrame, applied, cross
from kaneflex.mechanism.spatial_wrenches import wrenches_on
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.time.spatial_motion import SpatialMotion
from kaneflex.multibody.time.spatial_sections import Deformed
from kaneflex.response.dalembert import GAUSS, DAlembert
from kaneflex.response.section_forces import spread_loads


@dataclass(frozen=True, eq=False)
class SpatialBalance(DAlembert):
    """Equilibrium of a body in space, with the rotary inertia of its sections."""

    motion: SpatialMotion
    body: str

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Section forces N, V_y, V_z, T, M_y, M_z at x [m] from the start, in the axes of the tangent, the chord or
        the mean rotation, as in the plane; (6, n_times)."""
        total = self.before(x, after)
        total[3:] -= cross(self._place(x, self._at(x)), total[:3])
        return cast(np.ndarray, np.einsum("jit,kjt->kit", self._axes, total.reshape(2, 3, -1)).reshape(6, -1))

    def _sums(self, e: int, b: float) -> np.ndarray:
        a, n = self._link.nodes[e], len(self.motion.times)
        if not b > a:
            return np.zeros((6, n))
        points, weights = 0.5 * (a + b) + 0.5 * (b - a) * GAUSS[0], 0.5 * (b - a) * GAUSS[1]
        parts, (rho_A, rho_I) = [self._at(x) for x in points], self._inertia(points)
        turned, place = (np.concatenate(each, axis=-1) for each in (
            [part.turned for part in parts], [self._place(*at) for at in zip(points, parts, strict=True)]
        ))  # fmt: skip
        _, rate, accel, turning, faster = (
            np.hstack(each) for each in zip(*((*part.moved, *part.turning) for part in parts), strict=True)
        )  # fmt: skip
        falling, omega, epsilon = (np.tile(part, len(points)) for part in self._carried)
        accel += falling + cross(epsilon, place) + cross(omega, cross(omega, place)) + 2.0 * cross(omega, rate)
        to_section, I = turned.swapaxes(0, 1), np.repeat(rho_I, n, axis=1)
        own = applied(to_section, omega + turning)
        own_rate = applied(to_section, epsilon + cross(omega, turning) + faster)
        force = np.repeat(rho_A, n) * accel
        for first, rise in self._spread:
            force -= np.tile(first, len(points)) + np.kron(points, rise)
        moment = cross(place, force) + applied(turned, I * own_rate + cross(own, I * own))
        return np.asarray(np.vstack([force, moment]).reshape(6, -1, n).transpose(0, 2, 1) @ weights)

    def _inertia(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass and rotary inertias about x, y, z per length at some points, (n,) and (3, n)."""
        profile = self.motion.system.scene.bodies[self.body].profile
        of_mass, about_y, about_z = np.array([profile.at(x)[:3] for x in points]).T
        return of_mass, np.array([about_y + about_z, about_y * profile.rotary, about_z * profile.rotary])

    @cached_property
    def _carried(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Acceleration of the origin less gravity, angular velocity and acceleration of the body's axes, in these."""
        frame, gravity = self._frame, self.motion.system.mechanism.gravity[:, None]
        of = frame.acceleration(np.zeros(3)) - gravity, frame.omega, frame.epsilon
        return frame.to_body(of[0]), frame.to_body(of[1]), frame.to_body(of[2])

    def _pushing(self) -> Iterator[tuple[float, np.ndarray]]:
        mechanism = self.motion.system.mechanism
        spread = {name for name, load in mechanism.loads.items() if load.is_spread}
        for each in wrenches_on(mechanism, self.motion, self.body, self.motion.section_frame):
            if each.by not in spread:
                yield each.on[0], np.vstack([each.force, cross(each.at, each.force) + each.moment])

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Distributed loads of the body, in its axes: load at its start [N/m], and its slope [N/m^2]."""
        turned = self._at(0.0).turned
        return list(spread_loads(self.motion.system.scene, self.motion, self.body, partial(applied, turned)))

    @cached_property
    def _axes(self) -> np.ndarray:
        """Axes of the components in the body's axes, columns (3, 3, n_times)."""
        from scipy.spatial.transform import Rotation

        q, *_ = self.motion.modal(self.body)
        return Rotation.from_rotvec((self._shapes.turn @ q).T).as_matrix().transpose(1, 2, 0)

    def _at(self, x: float) -> Deformed:
        return self.motion.deformed(Side(self.body, (x, 0.0, 0.0)))

    def _place(self, x: float, section: Deformed) -> np.ndarray:
        """Position of a section in the body's axes."""
        return np.asarray(section.moved[0] + np.array([[x], [0.0], [0.0]]))

    @cached_property
    def _frame(self) -> SpatialFrame:
        return self.motion.frame(self.body)

    @property
    def _shapes(self) -> Shapes:
        return cast(Shapes, self.motion.system.layout.shapes[self.body])

    @property
    def _link(self) -> Link:
        return self._shapes.link
