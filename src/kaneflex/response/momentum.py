"""Momentum of a part of a link, by integrals over its mass."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from kaneflex.fem.links import GAUSS, Link
from kaneflex.mechanism.body_frame import Rates, acceleration
from kaneflex.mechanism.wrenches import moment_of


class Slices(NamedTuple):
    """Slices of an element up to a section, at Gauss's points.

    Attributes
    ----------
    x, weights : ndarray (n,)
        Distances from the link's start [m], and weights [m].
    densities : ndarray (densities, n)
        rho A [kg/m] and what else :attr:`kaneflex.fem.links.Link.densities` names.
    R : ndarray (n, components, size)
        The first D components of R y are their places in the link's axes, with amplitudes y (size, n_times).
    """

    x: np.ndarray
    weights: np.ndarray
    densities: np.ndarray
    R: np.ndarray

    @classmethod
    def up_to(cls, x: float, link: Link, e: int, places: Callable[[float], np.ndarray]) -> Slices:
        """Slices from an element's first node to x [m] from the link's start; ``places``: R at a distance."""
        half, of = 0.5 * float(x - link.nodes[e]), link.parameters
        local = half * (1.0 + GAUSS[0])
        share, at = local / link.length_of(e) - 0.5, link.nodes[e] + local
        densities = np.array([of[name][e] + share * of[f"{name}_rise"][e] for name in link.densities])
        return cls(at, half * GAUSS[1], densities, np.array(list(map(places, at))))


class MassIntegrals(NamedTuple):
    """Integrals over a part of a link.

    Attributes
    ----------
    mass : ndarray (3,)
        Of rho A, of 1 and of x, the distance from the start [m].
    first : ndarray (3, D, size)
        Of R with these weights, see :class:`Slices`.
    second : ndarray (D, D, size, size)
        Of rho A times the products of every two components of R.
    """

    mass: np.ndarray
    first: np.ndarray
    second: np.ndarray

    @classmethod
    def of(cls, slices: Slices) -> MassIntegrals:
        """Integrals over the slices."""
        x, weights, densities, R = slices
        R, of = R[:, : len(densities)], weights * np.array([densities[0], np.ones_like(x), x])
        return cls(of.sum(axis=1), np.einsum("wg,gaj->waj", of, R), np.einsum("g,gaj,gbk->abjk", of[0], R, R))

    def plus(self, other: MassIntegrals) -> MassIntegrals:
        """Integrals over both parts."""
        return MassIntegrals(*map(np.add, self, other))

    def products(self, a: int, y: Rates) -> tuple[np.ndarray, ...]:
        """Integrals of rho A X_a X, rho A X_a X' and rho A X_a X'' for the places X = R y, (D, n_times) each."""
        found = np.zeros((3, len(self.second), y[0].shape[1]), y[2].dtype)
        for b, own in enumerate(self.second[a]):
            # most components have few of the amplitudes
            j, k = (slice(of.argmax(), len(of) - of[::-1].argmax()) for of in map(own.any, (1, 0)))
            weighted = own[j, k].T @ y[0][j]
            found[:, b] = [np.einsum("kt,kt->t", weighted, rate[k]) for rate in y]
        return tuple(found)


def rate_of_momentum(
    part: MassIntegrals, y: Rates, moved: tuple[np.ndarray, np.ndarray, np.ndarray],
    spread: Iterable[tuple[np.ndarray, np.ndarray]],
) -> np.ndarray:  # fmt: skip
    """Rate of momentum of a part of a link and of its moment about the link's start, less its distributed loads; (3 or
    6, n_times).

    Sections are points: their own rotary inertia is not part of it. ``moved`` and ``spread``: see ``carried`` and
    ``spread_loads`` in :mod:`kaneflex.response.section_forces`.
    """
    specific_force, omega, epsilon = moved
    (mass, length, middle), (first, even, rising) = part.mass, part.first
    total = mass * specific_force + acceleration(omega, epsilon, *(first @ rate for rate in y))
    of = [acceleration(omega, epsilon, *part.products(a, y)) for a in range(len(first))]  # of X_a A_b
    turning = [of[a][b] - of[b][a] for a, b in (((0, 1),) if len(of) == 2 else ((1, 2), (2, 0), (0, 1)))]
    moment = moment_of(first @ y[0], specific_force) + np.array(turning)
    for start, rise in spread:
        total = total - (length * start + middle * rise)
        moment = moment - (moment_of(even @ y[0], start) + moment_of(rising @ y[0], rise))
    return np.vstack([total, moment])
