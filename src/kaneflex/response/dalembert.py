"""Section forces of a link under preset coupled, by d'Alembert's principle for the part before a section."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.body_frame import BodyFrame
from kaneflex.mechanism.planar import cross
from kaneflex.response.section_forces import Forces, LinkForces, spread_loads
from kaneflex.scene.quantities import Address

if TYPE_CHECKING:
    from kaneflex.response.floating_motion import FloatingMotion

GAUSS = np.polynomial.legendre.leggauss(5)
"""Quadrature, exact for rho A (r x a) of an element: v is cubic, u with its shortening of fifth degree."""
_SAME = 1e-9
"""Distance of points, as a share of the link's length, that counts as zero."""


class DAlembert(ABC):
    """Equilibrium of one link in its deformed configuration by d'Alembert's principle.

    Force and moment at a section are int rho A (a - g) and its moment over the part before it, less all forces on that
    part; a is the acceleration of the deflected axis. By these two integrations section forces include loads that the
    shapes can't represent (the idea of the mode-acceleration method, Craig 1981, ch. 15).

    Sums are a force and its moment about the link's start, in the axes of its floating frame, (components, n_times).
    Mass-proportional damping (Rayleigh's alpha, viscous) acts on the deformation only and is not a force on the link.
    """

    def before(self, x: float, after: bool) -> np.ndarray:
        """Force and moment that the part before x [m] needs, just before or just after the loads at x.

        At the start always after them, at the end before them.
        """
        inside = _SAME < x / self._link.length < 1 - _SAME
        at_x = float(after if inside else x < 0.5 * self._link.length)
        e, _ = self._link.locate(x)
        total = self._elements_before[e] + self._sums(e, x) - self._pushes(x, at_x)
        # the whole link balances up to terms of third order, shared by both sides of a section
        total -= x / self._link.length * self._gap
        return total

    @cached_property
    def _gap(self) -> np.ndarray:
        """Rate of momentum of the whole link less all forces on it."""
        return self._elements_before[-1] - self._pushes(self._link.length, 1.0)

    @cached_property
    def _elements_before(self) -> list[np.ndarray]:
        """Sums over the elements before every node."""
        return list(accumulate(self._sums(max(k - 1, 0), x) for k, x in enumerate(self._link.nodes)))

    def _pushes(self, x: float, at_x: float) -> np.ndarray:
        """Sum of the loads before x, and of the share ``at_x`` of those at x."""
        total = np.zeros_like(self._elements_before[-1])
        for at, push in self._acting:
            total += (at_x if abs(x - at) <= _SAME * self._link.length else float(at < x)) * push
        return total

    @cached_property
    def _acting(self) -> list[tuple[float, np.ndarray]]:
        return list(self._pushing())

    @property
    @abstractmethod
    def _link(self) -> Link: ...

    @abstractmethod
    def _pushing(self) -> Iterator[tuple[float, np.ndarray]]:
        """Positions [m] of loads, and their sums."""

    @abstractmethod
    def _sums(self, e: int, x: float) -> np.ndarray:
        """Rate of momentum of an element up to x [m], less its distributed loads."""


@dataclass(frozen=True, eq=False)
class Balance(DAlembert):
    """Equilibrium of a planar link.

    Attributes
    ----------
    forces : mapping of float to (ndarray (2, n_times), ndarray (n_times,))
        Distance from the start [m] -> force and moment there by joints, loads, springs and lumped masses, in the axes
        of the floating frame.
    """

    motion: FloatingMotion
    link: str
    forces: Mapping[float, tuple[np.ndarray, np.ndarray]]

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Axial force N [N, tension positive], shear force V [N] and bending moment M [N m]; (3, n_times).

        N and V are components along the floating frame's axes.
        """
        total = self.before(x, after)
        total[2] -= cross(self._place(x), total)
        return total

    @property
    def _link(self) -> Link:
        return self.motion.system.links[self.link]

    def _pushing(self) -> Iterator[tuple[float, np.ndarray]]:
        for at, (force, moment) in self.forces.items():
            yield at, np.array([*force, cross(self._place(at), force) + moment])

    def _place(self, x: float) -> np.ndarray:
        """Position of a point of the deflected axis in the floating frame, (2, n_times)."""
        return self._axes.to_body(self.motion.moving_place(self.link, (x, 0.0))[0][:2] - self._axes.origin)

    @cached_property
    def _axes(self) -> BodyFrame:
        return self.motion.floating.frame(self.link)

    def _sums(self, e: int, x: float) -> np.ndarray:
        own, reach = self._link, float(x - self._link.nodes[e])
        start, gravity = self._axes.origin, np.array(self.motion.model.scene.gravity)[:, None]
        total = np.zeros((3, len(self.motion.times)))
        for point, weight in zip(*GAUSS, strict=True) if reach else ():
            local = 0.5 * reach * (1 + point)
            share = local / own.length_of(e) - 0.5
            density, rotary = (
                own.parameters[key][e] + share * own.parameters[f"{key}_rise"][e] for key in ("rho_A", "rho_I")
            )
            place, _, accel = self.motion.moving_place(self.link, (own.nodes[e] + local, 0.0))
            r, a = self._axes.to_body(place[:2] - start), density * self._axes.to_body(accel[:2] - gravity)
            a -= sum(first + (own.nodes[e] + local) * rise for first, rise in self._spread)
            total += 0.5 * reach * weight * np.array([*a, cross(r, a) + rotary * accel[2]])
        return total

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Distributed loads of the link, in the floating frame's axes."""
        return list(spread_loads(self.motion.model.scene, self.motion.floating, self.link))


@dataclass(frozen=True, eq=False)
class Balanced:
    """Section forces of a link with few modal coordinates.

    The equilibrium treats truncated modes statically. That is correct for loads slower than these modes, but not for
    axial vibration of the link, which is faster than most of them. Therefore shear and bending follow from the
    ``quiet`` equilibrium, with accelerations without axial vibration. At ends, joints and contacts they must match the
    actual forces of the ``loud`` equilibrium: the difference there is interpolated linearly in between.
    """

    loud: Balance
    quiet: Balance

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """N [N, tension positive], V [N] and M [N m] at x [m] from the start, as :meth:`Balance.section`."""
        N, V, M = self.loud.section(x, after)
        stops = self._stops
        if np.min(abs(stops - x)) > _SAME * stops[-1]:
            last = int(np.searchsorted(stops, x))
            a, b = stops[last - 1], stops[last]
            at_a, at_b = self._differences[last - 1]
            _, V, M = self.quiet.section(x, after) + (b - x) / (b - a) * at_a + (x - a) / (b - a) * at_b
        return np.array([N, V, M])

    @cached_property
    def _stops(self) -> np.ndarray:
        """Positions of the ends, and of joints and contacts between them [m]."""
        motion, link = self.loud.motion, self.loud.link
        scene = motion.model.scene
        acting = [address for joint in scene.joints.values() for address in joint.addresses]
        acting += [side for contact in scene.contacts.values() for side in contact.sides]
        places = [scene.point(address)[0] for address in acting if address.body == link]
        return np.unique([0.0, motion.system.links[link].length, *places])

    @cached_property
    def _differences(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Loud less quiet balance at both ends of each part between two stops."""
        return [(self._difference(a, True), self._difference(b, False)) for a, b in pairwise(self._stops)]

    def _difference(self, x: float, after: bool) -> np.ndarray:
        return self.loud.section(x, after) - self.quiet.section(x, after)


class FloatingForces(LinkForces):
    """Forces on the links of a coupled motion in their floating frames, with lumped masses on the deflected axis."""

    def __init__(self, motion: FloatingMotion):
        super().__init__(motion.model.scene, motion.floating)
        self.motion = motion

    def specific_force(self, address: Address) -> np.ndarray:
        g_x, g_y = self.scene.gravity
        return self.motion.joined(address)[2] - np.array([[g_x], [g_y], [0.0]])

    def balance(self, link: str) -> Balance:
        """Equilibrium of a link with all forces on it."""
        forces: dict[float, Forces] = {}
        for point, (x, _) in self.scene.bodies[link].points_all.items():
            before, more = forces.get(x, (0.0, 0.0)), self.forces_at(Address(link, point))
            forces[x] = before[0] + more[0], before[1] + more[1]
        return Balance(self.motion, link, forces)


def balanced(motion: FloatingMotion) -> dict[str, Balanced]:
    """Section forces of every link of a coupled motion."""
    loud, quiet = FloatingForces(motion), FloatingForces(motion.quiet)
    return {name: Balanced(loud.balance(name), quiet.balance(name)) for name in motion.system.links}
