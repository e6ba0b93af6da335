"""Section forces of a link under preset coupled, by d'Alembert's principle for the part before a section."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates, applied
from kaneflex.mechanism.spatial_frame import rotation_matrix
from kaneflex.mechanism.wrenches import Wrench, moment_of
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.time.sections import turn_in_space
from kaneflex.response.momentum import MassIntegrals, Slices, rate_of_momentum
from kaneflex.response.section_forces import LinkForces, carried, spread_loads
from kaneflex.support.weak_cache import WeakCache

if TYPE_CHECKING:
    from kaneflex.multibody.time.sections import DeformingMotion

_SAME = 1e-9
"""Distance of points, as a share of the link's length, that counts as zero."""


class ShapedMass:
    """Integrals over the parts of a link before its sections, by products of its shapes' amplitudes."""

    def __init__(self, shapes: Shapes) -> None:
        self.shapes, self.link, self.size = shapes, shapes.link, (len(shapes.link.names) + 1) // 2
        self.pairs = np.nonzero(np.triu(shapes.shortened))
        self.slices = cache(lambda e, x: Slices.up_to(x, self.link, e, self.places))
        self.elements = [self.slices(e, x) for e, x in enumerate(self.link.nodes[1:])]
        parts = map(MassIntegrals.of, (self.slices(0, 0.0), *self.elements))
        self.before = list(accumulate(parts, MassIntegrals.plus))

    def places(self, x: float) -> np.ndarray:
        """Place of the axis at x [m] in the link's axes and rotation of its section by :meth:`amplitudes`, (D + 1 or 3,
        size)."""
        (rows, G), n, (j, k) = self.shapes.at((x, 0.0, 0.0)), self.size, self.pairs
        found = np.zeros((len(rows), len(j) + 1 + rows.shape[1]))
        found[:n, : len(j)] = np.where(j == k, 0.5, 1.0) * G[:n, j, k]
        found[0, len(j)], found[:, len(j) + 1 :] = x, rows
        return found

    def amplitudes(self, q: np.ndarray, u: np.ndarray, b: np.ndarray) -> Rates:
        """Products of every two amplitudes that shorten the link, 1, and the amplitudes, with their rates."""
        (j, k), one = self.pairs, np.ones((1, q.shape[1]))
        rate, accel = u[j] * q[k] + q[j] * u[k], b[j] * q[k] + 2.0 * u[j] * u[k] + q[j] * b[k]
        return np.vstack([q[j] * q[k], one, q]), np.vstack([rate, 0.0 * one, u]), np.vstack([accel, 0.0 * one, b])


_MASSES: WeakCache[Any, dict[str, ShapedMass]] = WeakCache()
"""System -> link -> its integrals."""


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
    _known: dict[float, np.ndarray] = field(default_factory=dict)

    def before(self, x: float, after: bool) -> np.ndarray:
        """Force and moment that the part before x [m] needs, just before or just after the loads at x.

        At the start always after them, at the end before them.
        """
        inside = _SAME < x / self._mass.link.length < 1 - _SAME
        at_x = float(after if inside else x < 0.5 * self._mass.link.length)
        total = self._momentum(x) - self._pushes(x, at_x)
        # the whole link balances up to terms of third order, shared by both sides of a section
        total -= x / self._mass.link.length * self._gap
        return total

    @cached_property
    def _gap(self) -> np.ndarray:
        """Rate of momentum of the whole link less all forces on it."""
        return self._momentum(self._mass.link.length) - self._pushes(self._mass.link.length, 1.0)

    def _momentum(self, x: float) -> np.ndarray:
        """Rate of momentum of the part before x [m], less its distributed loads; sensors of a link share sections."""
        if x not in self._known:
            own, e = self._mass, self._mass.link.locate(x)[0]
            last = own.slices(e, x)
            part = own.before[e].plus(MassIntegrals.of(last))
            self._known[x] = rate_of_momentum(part, self._places, self._carried, self._spread)
            self._known[x][own.size :] += self._turned_before[e] + self._turning(last)
        return self._known[x]

    def _pushes(self, x: float, at_x: float) -> np.ndarray:
        """Sum of the loads before x, and of the share ``at_x`` of those at x."""
        total = np.zeros((len(self._mass.link.names), len(self.motion.times)))
        for at, push in self._acting:
            total += (at_x if abs(x - at) <= _SAME * self._mass.link.length else float(at < x)) * push
        return total

    @cached_property
    def _acting(self) -> list[tuple[float, np.ndarray]]:
        """Positions [m] of loads, and their sums."""
        return [(each.on[0], each.about_start) for each in self.wrenches()]

    @cached_property
    def _mass(self) -> ShapedMass:
        made = _MASSES.of(self.motion.system, dict)
        if self.link not in made:
            made[self.link] = ShapedMass(self.motion.shapes[self.link])
        return made[self.link]

    @cached_property
    def _places(self) -> Rates:
        """Amplitudes of :class:`ShapedMass`."""
        return self._mass.amplitudes(*self.motion.modal(self.link))

    @cached_property
    def _carried(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return carried(self.motion.mechanism, self.motion, self.link)

    @cached_property
    def _turned_before(self) -> list[np.ndarray]:
        """Rate of the moment of momentum of the sections before every node about their own centres."""
        return list(accumulate(map(self._turning, (self._mass.slices(0, 0.0), *self._mass.elements))))

    def _turning(self, slices: Slices) -> np.ndarray:
        """Rate of the moment of momentum of an element's sections about their own centres, (1 or 3, n_times)."""
        (_, omega, epsilon), n, total = self._carried, self._mass.size, np.zeros(())
        if n == 2:
            rotary = slices.weights * slices.densities[1]
            return cast(np.ndarray, rotary.sum() * epsilon + rotary @ slices.R[:, 2] @ self._places[2])[None]
        profile, amplitudes = self.motion.mechanism.deforming[self.link].profile, self.motion.modal(self.link)
        for x, weight, rows in zip(slices.x, slices.weights, slices.R[:, n:, -len(amplitudes[0]) :], strict=True):
            about_y, about_z = profile.at(x)[1:3]
            I = weight * np.array([[about_y + about_z], [about_y * profile.rotary], [about_z * profile.rotary]])
            turned, turning, faster = turn_in_space(*(rows @ of for of in amplitudes))
            to_section = turned.swapaxes(0, 1)
            own_omega = applied(to_section, omega + turning)
            own_epsilon = applied(to_section, epsilon + moment_of(omega, turning) + faster)
            total = total + applied(turned, I * own_epsilon + moment_of(own_omega, I * own_omega))
        return total

    @cached_property
    def _spread(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Distributed loads in the link's axes: load at its start [N/m], and its slope [N/m^2]."""
        start = self.motion.deformed(self.link, np.zeros(self._mass.size))
        return list(spread_loads(self.motion.mechanism, self.motion, self.link, partial(applied, start.turned)))

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Section forces: axial force N [N, tension positive], shear force V [N] and bending moment M [N m], or N, V_y,
        V_z, T, M_y, M_z; (3 or 6, n_times). Components are those along the floating frame's axes, in space along those
        of the tangent, the chord or the mean rotation, as in the plane."""
        total, n = self.before(x, after), self._mass.size
        total[n:] -= moment_of(self._mass.places(x)[:n] @ self._places[0], total[:n])
        if n == 2:
            return total
        return cast(np.ndarray, np.einsum("jit,kjt->kit", self._turned, total.reshape(2, 3, -1)).reshape(6, -1))

    @cached_property
    def _turned(self) -> np.ndarray:
        """Axes of the components in the body's axes, columns (3, 3, n_times)."""
        q, *_ = self.motion.modal(self.link)
        turn = self.motion.shapes[self.link].turn
        return cast(np.ndarray, rotation_matrix((turn @ q).T).transpose(1, 2, 0))


@dataclass(frozen=True, eq=False)
class Balanced:
    """Section forces of a link with few modal coordinates.

    The equilibrium treats truncated modes statically. That is correct for loads slower than these modes, but not for
    axial vibration of the link, which is faster than most of them. Therefore shear and bending follow from the
    ``quiet`` equilibrium, with accelerations without axial vibration. At ends, joints and contacts they must match the
    actual forces of the ``loud`` equilibrium: the difference there is interpolated linearly in between.
    """

    loud: Balance

    @cached_property
    def quiet(self) -> Balance:
        return _balance(self.loud.motion.quiet, self.loud.link)

    def section(self, x: float, after: bool = False) -> np.ndarray:
        """Section forces at x [m] from the start, as :meth:`Balance.section`."""
        found, stops = self.loud.section(x, after), self._stops
        if np.min(abs(stops - x)) > _SAME * stops[-1] and self.loud.motion.quiet is not self.loud.motion:
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


def balanced(motion: DeformingMotion) -> dict[str, Balanced]:
    """Section forces of every elastic link of a coupled motion."""
    links = [name for name in motion.shapes if motion.mechanism.deforming[name].elastic]
    return {name: Balanced(_balance(motion, name)) for name in links}


def _balance(motion: DeformingMotion, link: str) -> Balance:
    """Equilibrium of a link with all forces on it."""
    return Balance(motion, link, partial(LinkForces(motion.mechanism, motion).wrenches, link))
