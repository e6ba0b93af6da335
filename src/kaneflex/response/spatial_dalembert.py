"""Section forces of deforming bodies in space, by d'Alembert's principle for the part before a section."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.spatial import Side
from kaneflex.mechanism.spatial_frame import SpatialFrame, cross
from kaneflex.mechanism.spatial_wrenches import wrenches_on
from kaneflex.multibody.spatial_motion import SpatialMotion
from kaneflex.multibody.spatial_shapes import SpatialShapes
from kaneflex.response.dalembert import GAUSS, DAlembert


@dataclass(frozen=True, eq=False)
class SpatialBalance(DAlembert):
    """Equilibrium of a body in space, with the rotary inertia of its sections."""

    motion: SpatialMotion
    body: str

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Section forces N, V_y, V_z, T, M_y, M_z at x [m] from the start, in the axes of the tangent, the chord or
        the mean rotation, as in the plane; (6, n_times)."""
        total = self.before(x, after)
        total[3:] -= cross(self._place(self._section(x)), total[:3])
        return cast(np.ndarray, np.einsum("jit,kjt->kit", self._axes, total.reshape(2, 3, -1)).reshape(6, -1))

    def _sums(self, e: int, b: float) -> np.ndarray:
        scene, frame, total = self.motion.system.scene, self._frame, np.zeros((6, len(self.motion.times)))
        profile, gravity = scene.bodies[self.body].spatial_profile, self.motion.system.mechanism.gravity[:, None]
        a = self._link.nodes[e]
        for point, weight in zip(*GAUSS, strict=True) if b > a else ():
            x = 0.5 * (a + b) + 0.5 * (b - a) * point
            section, made_of = profile.at(x)
            assert made_of.rho is not None  # checked with the scene
            here = self._section(x)
            of_area = np.array([section.I_y + section.I_z, section.I_y * profile.rotary, section.I_z * profile.rotary])
            omega, epsilon = here.to_body(here.omega), here.to_body(here.epsilon)
            inertia = made_of.rho * of_area[:, None]
            turning = here.to_global(inertia * epsilon + cross(omega, inertia * omega))
            force = made_of.rho * section.A * frame.to_body(here.acceleration(np.zeros(3)) - gravity)
            force -= sum(first + x * rise for first, rise in self._spread)
            moment = cross(self._place(here), force) + frame.to_body(turning)
            total += 0.5 * (b - a) * weight * np.vstack([force, moment])
        return total

    def _pushing(self) -> Iterator[tuple[float, np.ndarray]]:
        mechanism = self.motion.system.mechanism
        spread = {name for name, load in mechanism.loads.items() if load.is_spread}
        for each in wrenches_on(mechanism, self.motion, self.body, self.motion.section_frame):
            if each.by not in spread:
                yield each.on[0], np.vstack([each.force, cross(each.at, each.force) + each.moment])

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Distributed loads of the body, in its axes: load at its start [N/m], and its slope [N/m^2]."""
        return list(self._spread_loads())

    def _spread_loads(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        scene, loads = self.motion.system.scene, self.motion.system.mechanism.loads
        for name, load in scene.spreads.items():
            if load.spread_on == self.body:
                direction = np.outer(loads[name].direction, self.motion[name])
                start = self._section(0.0)
                push = self._frame.to_body(start.to_global(direction) if loads[name].in_body else direction)
                first, last = load.profile
                yield first * push, (last - first) / self._link.length * push

    @cached_property
    def _axes(self) -> np.ndarray:
        """Axes of the components in the body's axes, columns (3, 3, n_times)."""
        from scipy.spatial.transform import Rotation

        q = np.array([self.motion[f"{self.body}.shape_{k}"] for k in range(self._shapes.count)])
        return Rotation.from_rotvec((self._shapes.turn @ q).T).as_matrix().transpose(1, 2, 0)

    def _section(self, x: float) -> SpatialFrame:
        return self.motion.section_frame(Side(self.body, (x, 0.0, 0.0)))[0]

    def _place(self, section: SpatialFrame) -> np.ndarray:
        """Position of a section in the body's axes."""
        return self._frame.to_body(section.place(np.zeros(3)) - self._frame.origin)

    @cached_property
    def _frame(self) -> SpatialFrame:
        return self.motion.frame(self.body)

    @property
    def _shapes(self) -> SpatialShapes:
        return cast(SpatialShapes, self.motion.system.layout.shapes[self.body])

    @property
    def _link(self) -> Link:
        return self._shapes.link
