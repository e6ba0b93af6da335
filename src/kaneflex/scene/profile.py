"""Profile of a beam along its length: stiffnesses and masses at a point, of an element, up to a point."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np

from kaneflex.scene.materials import Constants
from kaneflex.scene.sections import Shape, SpatialSectionNumbers

_GAUSS = np.polynomial.legendre.leggauss(5)  # exact for x^2 A and (x - middle) I of every tapered shape


class Properties(NamedTuple):
    """Numbers of a beam's section.

    rho_A mass per length [kg/m], E_A axial stiffness [N], E_I bending stiffness [N m^2], rho_I rotary inertia per
    length [kg m], G_A shear stiffness kappa G A [N]; theories without rotary inertia have rho_I = 0, those
    without shear G_A = inf.
    """

    rho_A: float
    E_A: float
    E_I: float
    rho_I: float
    G_A: float


class Inertia(NamedTuple):
    """Inertia of a piece of a beam: mass [kg], first and second moment about the link's origin [kg m, kg m^2], and the
    sum of the sections' rotary inertias [kg m^2]."""

    mass: float
    first: float
    second: float
    rotary: float


@dataclass(frozen=True)
class Piece:
    """Piece of a beam from `start` to `stop` [m] whose section's dimensions vary linearly from end to end.

    `made_of`: constants of its material; `shape` (None if unknown) has the dimensions `first` and `last`.
    """

    start: float
    stop: float
    numbers: Callable[..., Any]
    first: tuple[float, ...]
    last: tuple[float, ...]
    made_of: Constants
    shape: Shape | None = None

    def at(self, x: float) -> Any:
        """Numbers of the section at distance x [m] from the beam's start, SectionNumbers or SpatialSectionNumbers."""
        return self.numbers(*self.dimensions(x))

    def dimensions(self, x: float) -> tuple[float, ...]:
        """Linear interpolation between `first` and `last` at distance x [m] from the beam's start."""
        s = (x - self.start) / (self.stop - self.start)
        return tuple(a + (b - a) * s for a, b in zip(self.first, self.last, strict=True))


@dataclass(frozen=True)
class Stretches:
    """Pieces of a beam; `rotary` and `shear` tell if its theory includes them."""

    pieces: tuple[Piece, ...]
    rotary: bool
    shear: bool

    @property
    def length(self) -> float:
        return self.pieces[-1].stop

    @property
    def varying(self) -> bool:
        return len(self.pieces) > 1 or self.pieces[0].first != self.pieces[0].last

    @property
    def borders(self) -> tuple[float, ...]:
        """Borders between pieces [m]."""
        return tuple(piece.stop for piece in self.pieces[:-1])

    def denser(self, share: float) -> Self:
        """Profile with densities multiplied by a factor."""
        scaled = (replace(p, made_of=p.made_of._replace(rho=p.made_of.rho * share)) for p in self.pieces)
        return replace(self, pieces=tuple(scaled))

    def piece_at(self, x: float, after: bool = False) -> Piece:
        """Piece at distance x [m] from the start; at a border the one before or after it."""
        *inner, last = self.pieces
        return next((piece for piece in inner if x < piece.stop or (x == piece.stop and not after)), last)

    def _gauss(self, a: float, b: float) -> tuple[np.ndarray, np.ndarray]:
        """Points [m] and weights [m] of an exact quadrature from a to b, piece by piece."""
        points, weights = [np.zeros(0)], [np.zeros(0)]
        for piece in self.pieces:
            low, high = max(a, piece.start), min(b, piece.stop)
            if high > low:
                points.append((low + high) / 2 + (high - low) / 2 * _GAUSS[0])
                weights.append((high - low) / 2 * _GAUSS[1])
        return np.concatenate(points), np.concatenate(weights)


class SpatialProfile(Stretches):
    """Profile of a spatial beam."""

    def at(self, x: float, after: bool = False) -> tuple[SpatialSectionNumbers, Constants]:
        """Section at distance x [m] from the start, and its material; at a border as `piece_at`."""
        piece = self.piece_at(x, after)
        return piece.at(min(max(x, piece.start), piece.stop)), piece.made_of

    def rotary_inertias(self, x: float | None = None) -> tuple[float, float, float]:
        """Integrals of the sections' inertias about x, y and z [kg m^2] from the start to x [m], by default to the end.

        They do not depend on the theory; one without rotary inertia ignores those about y and z.
        """
        points, weights = self._gauss(0.0, self.length if x is None else x)
        sums = np.zeros(2)
        for place, weight in zip(points, weights, strict=True):
            numbers, made_of = self.at(place)
            sums += weight * made_of.rho * np.array([numbers.I_y, numbers.I_z])
        return float(sums.sum()), float(sums[0]), float(sums[1])


class Profile(Stretches):
    """Profile of a planar beam."""

    def at(self, x: float, after: bool = False) -> Properties:
        """Properties at distance x [m] from the start; at a border as `piece_at`."""
        piece = self.piece_at(x, after)
        (A, I, kappa), (E, rho, G, _) = piece.at(x), piece.made_of
        rho_I = rho * I if self.rotary else 0.0
        G_A = kappa * G * A if self.shear else math.inf
        return Properties(rho * A, E * A, E * I, rho_I, G_A)

    def of_mass(self, mass: float) -> Profile:
        """Profile with densities scaled so that the beam's mass is exactly `mass` [kg]."""
        return self.denser(mass / self.inertia(self.length).mass)

    def element(self, x_0: float, length: float) -> dict[str, float]:
        """Parameters of the element from x_0 to x_0 + length [m], by their names in ``kaneflex.support.contract``.

        A varying property is replaced by its least-squares linear fit: the mean keeps the element's mass and average
        stiffness, and the error is of the fourth order in the element's length. phi_s uses the means of E I and of
        kappa G A.
        """
        before = self.inertia(x_0)
        if self.varying:
            points, weights = self._gauss(x_0, x_0 + length)
            share = weights / length
            values = np.array([self._near(x) for x in points])
            means = share @ values
            rises = 12 * (share * ((points - x_0) / length - 0.5)) @ values[:, :4]
        else:
            means, rises = self.at(x_0), (0.0, 0.0, 0.0, 0.0)
        found = dict(zip(("rho_A", "E_A", "E_I", "rho_I"), map(float, means[:4]), strict=True))
        found |= dict(zip(("rho_A_rise", "E_A_rise", "E_I_rise", "rho_I_rise"), map(float, rises), strict=True))
        phi_s = 12 * found["E_I"] / (float(means[4]) * length**2)
        return found | {"length": length, "x_0": x_0, "phi_s": phi_s, "m_0": before.mass, "S_0": before.first}

    def inertia(self, x: float) -> Inertia:
        """Inertia of the beam from its start to x [m]."""
        if not self.varying:
            rho_A, _, _, rho_I, _ = self.at(0.0)
            return Inertia(rho_A * x, rho_A * x**2 / 2, rho_A * x**3 / 3, rho_I * x)
        points, weights = self._gauss(0.0, x)
        values = np.array([self._near(point) for point in points]).reshape(-1, 5)
        mass, rotary = weights * values[:, 0], weights * values[:, 3]
        return Inertia(*(float(v.sum()) for v in (mass, mass * points, mass * points**2, rotary)))

    def _near(self, x: float) -> Properties:
        return self.at(min(max(x, 0.0), self.length))
