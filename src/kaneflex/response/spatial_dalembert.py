"""Section forces of a body in space that deforms: what the part before a section needs to move as it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import cast

import numpy as np

from kaneflex.mechanism.spatial import Side
from kaneflex.mechanism.spatial_frame import SpatialFrame, cross
from kaneflex.mechanism.spatial_wrenches import Wrench, wrenches_on
from kaneflex.multibody.spatial_motion import SpatialMotion
from kaneflex.multibody.spatial_sections import section_frame
from kaneflex.multibody.spatial_shapes import SpatialShapes

_GAUSS = np.polynomial.legendre.leggauss(5)
"""Exact for rho A (r x a) of an element: the cubic v, and u with its shortening of the fifth degree."""
_SAME = 1e-9
"""Points closer than this share of a body's length are one."""


@dataclass(frozen=True, eq=False)
class SpatialBalance:
    """d'Alembert's balance of one body in its deformed configuration, as :class:`kaneflex.response.dalembert.Balance`
    is that of a planar one, with the rotary inertia of its sections.

    Sums are a force and its moment about the body's origin, in the body's axes, (6, n_times). Damping in proportion to
    the mass acts on the deformation alone, and is none of the forces on the body.
    """

    motion: SpatialMotion
    body: str

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """N, V_y, V_z, T, M_y, M_z at x [m] from the start, what the part beyond exerts: along the tangent, the chord
        or the axes of the mean turn, as in the plane; (6, n_times).

        Just before what acts there, or just after it; at the start it is after it, at the end before it.
        """
        inside = _SAME < x / self._length < 1.0 - _SAME
        share = float(after if inside else x < 0.5 * self._length)
        e, _ = self._shapes.link.locate(x)
        total = self._before[e] + self._sums(self._shapes.link.nodes[e], x) - self._pushes(x, share)
        # The body as a whole balances but for terms of third order: both sides of a section share them.
        total -= x / self._length * self._gap
        total[3:] -= cross(self._place(self._section(x)), total[:3])
        return cast(np.ndarray, np.einsum("jit,kjt->kit", self._axes, total.reshape(2, 3, -1)).reshape(6, -1))

    @cached_property
    def _gap(self) -> np.ndarray:
        """Rate of momentum of the whole body less all forces on it."""
        return self._before[-1] - self._pushes(self._length, 1.0)

    @cached_property
    def _before(self) -> list[np.ndarray]:
        """Sums over the elements before every node."""
        still = np.zeros((6, len(self.motion.times)))
        return list(accumulate((self._sums(a, b) for a, b in pairwise(self._shapes.link.nodes)), initial=still))

    def _sums(self, a: float, b: float) -> np.ndarray:
        """Rate of momentum between two places of an element [m], less the loads that are spread along it."""
        scene, frame, total = self.motion.system.scene, self._frame, np.zeros((6, len(self.motion.times)))
        profile, gravity = scene.bodies[self.body].spatial_profile, self.motion.system.mechanism.gravity[:, None]
        for point, weight in zip(*_GAUSS, strict=True) if b > a else ():
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

    def _pushes(self, x: float, at_x: float) -> np.ndarray:
        """Sum of what acts before x and of the share ``at_x`` of that at x."""
        total = np.zeros((6, len(self.motion.times)))
        for each in self._acting:
            share = at_x if abs(x - each.on[0]) <= _SAME * self._length else float(each.on[0] < x)
            total += share * np.vstack([each.force, cross(each.at, each.force) + each.moment])
        return total

    @cached_property
    def _acting(self) -> list[Wrench]:
        """What acts at points of the body."""
        mechanism = self.motion.system.mechanism
        spread = {name for name, load in mechanism.loads.items() if load.is_spread}
        found = wrenches_on(mechanism, self.motion, self.body, lambda side: section_frame(self.motion, side))
        return [each for each in found if each.by not in spread]

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Loads along the body, in its axes: per length at its start [N/m], and how that rises [N/m^2]."""
        return list(self._spread_loads())

    def _spread_loads(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        scene, loads = self.motion.system.scene, self.motion.system.mechanism.loads
        for name, load in scene.spreads.items():
            if load.spread_on == self.body:
                direction = np.outer(loads[name].direction, self.motion[name])
                start = self._section(0.0)
                push = self._frame.to_body(start.to_global(direction) if loads[name].in_body else direction)
                first, last = load.profile
                yield first * push, (last - first) / self._length * push

    @cached_property
    def _axes(self) -> np.ndarray:
        """Axes of the components in the body's, columns (3, 3, n_times)."""
        from scipy.spatial.transform import Rotation

        q = np.array([self.motion[f"{self.body}.shape_{k}"] for k in range(self._shapes.count)])
        return Rotation.from_rotvec((self._shapes.turn @ q).T).as_matrix().transpose(1, 2, 0)

    def _section(self, x: float) -> SpatialFrame:
        return section_frame(self.motion, Side(self.body, (x, 0.0, 0.0)))[0]

    def _place(self, section: SpatialFrame) -> np.ndarray:
        """Where a section is in the body's axes."""
        return self._frame.to_body(section.place(np.zeros(3)) - self._frame.origin)

    @cached_property
    def _frame(self) -> SpatialFrame:
        return self.motion.frame(self.body)

    @property
    def _shapes(self) -> SpatialShapes:
        return cast(SpatialShapes, self.motion.system.layout.shapes[self.body])

    @property
    def _length(self) -> float:
        return float(self._shapes.link.nodes[-1])
