"""Section forces of a link under preset coupled, by d'Alembert's principle for the part before a section."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.mechanism.body_frame import Rates, acceleration, applied
from kaneflex.mechanism.spatial_frame import rotation_matrix
from kaneflex.mechanism.wrenches import Wrench, moment_of
from kaneflex.multibody.time.sections import Deformed, deformed
from kaneflex.response.section_forces import LinkForces, carried, rate_of_momentum, spread_loads

if TYPE_CHECKING:
    from kaneflex.multibody.time.sections import DeformingMotion

_SAME = 1e-9
"""Distance of points, as a share of the link's length, that counts as zero."""


@dataclass(frozen=True, eq=False)
class Balance:
    """Equilibrium of one link in its deformed configuration by d'Alembert's principle.

    Force and moment at a section are int rho A (a - g) and its moment over the part before it, less all forces on that
    part; a is the acceleration of the deflected axis. By these two integrations section forces include loads that the
    shapes can't represent (the idea of the mode-acceleration method, Craig 1981, ch. 15).

    Sums are a force and its moment about the link's start, in the axes of its floating frame, (components, n_times).
    Mass-proportional damping (Rayleigh's alpha, viscous) acts on the deformation only and is not a force on the link.

    ``wrenches``: function that gives those of joints, loads, springs, contacts and lumped masses, all but inertia,
    weight and distributed loads.
    """

    motion: DeformingMotion
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

    @cached_property
    def _link(self) -> Link:
        return cast(Link, self.motion.link(self.link))

    def _at(self, x: float) -> Deformed:
        """Motion of the axis at x [m] from the start."""
        at = np.array([x, 0.0, 0.0][: len(self.motion.mechanism.gravity)])
        return deformed(self.motion.shapes[self.link], at, self._amplitudes)

    @cached_property
    def _amplitudes(self) -> Rates:
        q, u, b = map(np.ascontiguousarray, self.motion.modal(self.link))
        return q, u, b

    @cached_property
    def _carried(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return carried(self.motion.mechanism, self.motion, self.link)

    def _slice(self, e: int, x: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Slice of an element at x [m] from the start: place, acceleration less gravity, and rate of the moment of
        momentum about its own centre per length."""
        part, own, (force, omega, epsilon) = self._at(x), self._link, self._carried
        (place, rate, accel), (turning, faster) = part.moved, part.turning
        place = np.vstack([x + place[0], place[1:]])
        force = force + acceleration(omega, epsilon, place, rate, accel)
        if len(place) == 2:
            share = (x - own.nodes[e]) / own.length_of(e) - 0.5
            rotary = own.parameters["rho_I"][e] + share * own.parameters["rho_I_rise"][e]
            return place, force, rotary * (epsilon + faster)
        profile = self.motion.mechanism.deforming[self.link].profile
        about_y, about_z = profile.at(x)[1:3]
        I = np.array([[about_y + about_z], [about_y * profile.rotary], [about_z * profile.rotary]])
        to_section = part.turned.swapaxes(0, 1)
        own_omega = applied(to_section, omega + turning)
        own_epsilon = applied(to_section, epsilon + moment_of(omega, turning) + faster)
        return place, force, applied(part.turned, I * own_epsilon + moment_of(own_omega, I * own_omega))

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Distributed loads in the link's axes: load at its start [N/m], and its slope [N/m^2]."""
        to_body = partial(applied, self._at(0.0).turned)
        return list(spread_loads(self.motion.mechanism, self.motion, self.link, to_body))

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Section forces: axial force N [N, tension positive], shear force V [N] and bending moment M [N m], or N, V_y,
        V_z, T, M_y, M_z; (3 or 6, n_times). Components are those along the floating frame's axes, in space along those
        of the tangent, the chord or the mean rotation, as in the plane."""
        total = self.before(x, after)
        n = len(total) // 2 + len(total) % 2
        total[n:] -= moment_of(self._slice(self._link.locate(x)[0], x)[0], total[:n])
        if n == 2:
            return total
        return cast(np.ndarray, np.einsum("jit,kjt->kit", self._turned, total.reshape(2, 3, -1)).reshape(6, -1))

    @cached_property
    def _turned(self) -> np.ndarray:
        """Axes of the components in the body's axes, columns (3, 3, n_times)."""
        q, *_ = self._amplitudes
        turn = self.motion.shapes[self.link].turn
        return cast(np.ndarray, rotation_matrix((turn @ q).T).transpose(1, 2, 0))

    def _sums(self, e: int, x: float) -> np.ndarray:
        """Rate of momentum of an element up to x [m], less its distributed loads."""
        return rate_of_momentum(self._link, e, x, partial(self._slice, e), self._spread)


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
        """Section forces at x [m] from the start, as :meth:`Balance.section`."""
        found, stops = self.loud.section(x, after), self._stops
        if np.min(abs(stops - x)) > _SAME * stops[-1]:
            last = int(np.searchsorted(stops, x))
            a, b = stops[last - 1], stops[last]
            at_a, at_b = self._differences[last - 1]
            without = self.quiet.section(x, after) + (b - x) / (b - a) * at_a + (x - a) / (b - a) * at_b
            found[1:] = without[1:]
        return found

    @cached_property
    def _stops(self) -> np.ndarray:
        """Positions of the ends, and of joints and contacts between them [m]."""
        motion, link = self.loud.motion, self.loud.link
        acting = [*motion.mechanism.joints.values(), *motion.mechanism.contacts.values()]
        places = [side.at[0] for each in acting for side in each.sides if side.body == link]
        return np.unique([0.0, motion.link(link).length, *places])

    @cached_property
    def _differences(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Loud less quiet balance at both ends of each part between two stops."""
        return [(self._difference(a, True), self._difference(b, False)) for a, b in pairwise(self._stops)]

    def _difference(self, x: float, after: bool) -> np.ndarray:
        return self.loud.section(x, after) - self.quiet.section(x, after)


def balanced(motion: DeformingMotion) -> dict[str, Balance] | dict[str, Balanced]:
    """Section forces of every link of a coupled motion."""
    loud = _balances(motion)
    if motion.quiet is motion:
        return loud
    return {name: Balanced(loud[name], quiet) for name, quiet in _balances(motion.quiet).items()}


def _balances(motion: DeformingMotion) -> dict[str, Balance]:
    """Equilibria of the elastic links with all forces on them."""
    forces = LinkForces(motion.mechanism, motion)
    links = [name for name in motion.shapes if motion.mechanism.deforming[name].elastic]
    return {name: Balance(motion, name, partial(forces.wrenches, name)) for name in links}
