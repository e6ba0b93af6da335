"""Section forces of a link under preset coupled, by d'Alembert's principle for the part before a section."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.body_frame import BodyFrame
from kaneflex.mechanism.planar import BodyPoint
from kaneflex.mechanism.wrenches import Wrench, moment_of
from kaneflex.response.section_forces import LinkForces, rate_of_momentum, spread_loads
from kaneflex.scene.quantities import Address

if TYPE_CHECKING:
    from kaneflex.response.floating_motion import FloatingMotion

_SAME = 1e-9
"""Distance of points, as a share of the link's length, that counts as zero."""


@dataclass(frozen=True, eq=False)
class DAlembert(ABC):
    """Equilibrium of one link in its deformed configuration by d'Alembert's principle.

    Force and moment at a section are int rho A (a - g) and its moment over the part before it, less all forces on that
    part; a is the acceleration of the deflected axis. By these two integrations section forces include loads that the
    shapes can't represent (the idea of the mode-acceleration method, Craig 1981, ch. 15).

    Sums are a force and its moment about the link's start, in the axes of its floating frame, (components, n_times).
    Mass-proportional damping (Rayleigh's alpha, viscous) acts on the deformation only and is not a force on the link.

    ``wrenches``: function that gives those of joints, loads, springs, contacts and lumped masses, all but inertia,
    weight and distributed loads.
    """

    motion: Any
    link: str
    wrenches: Callable[[], Iterable[Wrench]]

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
        """Positions [m] of loads, and their sums."""
        return [(each.on[0], each.about_start) for each in self.wrenches()]

    @property
    @abstractmethod
    def _link(self) -> Link: ...

    @abstractmethod
    def _slice(self, e: int, x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slice of an element at x [m] from the start: place, acceleration less gravity, and rate of the moment of
        momentum about its own centre per length."""

    @property
    @abstractmethod
    def _spread(self) -> Iterable[tuple[np.ndarray, np.ndarray]]:
        """Distributed loads in the link's axes: load at its start [N/m], and its slope [N/m^2]."""

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Section forces: axial force N [N, tension positive], shear force V [N] and bending moment M [N m], or N, V_y,
        V_z, T, M_y, M_z; (3 or 6, n_times). Components are those along the floating frame's axes."""
        total = self.before(x, after)
        n = len(total) // 2 + len(total) % 2
        total[n:] -= moment_of(self._slice(self._link.locate(x)[0], x)[0], total[:n])
        return total

    def _sums(self, e: int, x: float) -> np.ndarray:
        """Rate of momentum of an element up to x [m], less its distributed loads."""
        return rate_of_momentum(self._link, e, x, partial(self._slice, e), self._spread)


@dataclass(frozen=True, eq=False)
class Balance(DAlembert):
    """Equilibrium of a planar link."""

    motion: FloatingMotion

    @property
    def _link(self) -> Link:
        return self.motion.system.links[self.link]

    @cached_property
    def _axes(self) -> BodyFrame:
        return self.motion.floating.frame(self.link)

    def _slice(self, e: int, x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        own, axes, gravity = self._link, self._axes, np.array(self.motion.model.scene.gravity)[:, None]
        share = (x - own.nodes[e]) / own.length_of(e) - 0.5
        rotary = own.parameters["rho_I"][e] + share * own.parameters["rho_I_rise"][e]
        place, _, accel = self.motion.moving_place(self.link, (x, 0.0))
        return axes.to_body(place[:2] - axes.origin), axes.to_body(accel[:2] - gravity), rotary * accel[2]

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
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
        """N [N, tension positive], V [N] and M [N m] at x [m] from the start, as :meth:`DAlembert.section`."""
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
        super().__init__(motion.model.scene, motion.floating, self._deflected)
        self.motion = motion

    def _deflected(self, side: BodyPoint) -> tuple[BodyFrame, BodyPoint]:
        """Floating axes of a point's body, and the displaced point in these."""
        frame, place = self.rigid.frame(side.body), self.motion.moving_place(side.body, side.at)[0][:2]
        x, y = frame.to_body(place - frame.origin)
        return frame, replace(side, at=(x, y))

    def specific_force(self, address: Address) -> np.ndarray:
        g_x, g_y = self.scene.gravity
        return self.motion.joined(address)[2] - np.array([[g_x], [g_y], [0.0]])

    def balance(self, link: str) -> Balance:
        """Equilibrium of a link with all forces on it."""
        return Balance(self.motion, link, partial(self.wrenches, link))


def balanced(motion: FloatingMotion) -> dict[str, Balanced]:
    """Section forces of every link of a coupled motion."""
    loud, quiet = FloatingForces(motion), FloatingForces(motion.quiet)
    return {name: Balanced(loud.balance(name), quiet.balance(name)) for name in motion.system.links}
