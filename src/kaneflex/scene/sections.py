"""Numbers of cross-sections, and profile of a beam along its length."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, NamedTuple

import numpy as np
from pydantic import BeforeValidator, WithJsonSchema

from kaneflex.support.errors import Fault
from kaneflex.support.units import RATIO, to_si


def _shear_coefficient(value: object) -> float:
    number = to_si(value, RATIO)
    if not 0 < number <= 1:
        raise Fault("a shear coefficient is above 0 and at most 1", "Write one like 0.85")
    return number


ShearCoefficient = Annotated[
    float, BeforeValidator(_shear_coefficient), WithJsonSchema({"type": "number", "exclusiveMinimum": 0, "maximum": 1})
]


class SectionNumbers(NamedTuple):
    """Numbers of a section with its height along y and its width along z, its principal axes.

    Area A [m^2]; I_y = int z^2 dA and I_z = int y^2 dA [m^4]; J, Saint-Venant's torsion constant [m^4], equal to
    I_y + I_z for round sections only; k_y A and k_z A are the areas in shear along y and z, with k None if unknown. The
    plane bends about z, and has I_y = J = 0 where only A and I are given.
    """

    A: float
    I_y: float
    I_z: float
    J: float
    k_y: float | None
    k_z: float | None


_GAUSS = np.polynomial.legendre.leggauss(5)  # exact for x^2 A and (x - middle) I of every tapered shape


class Constants(NamedTuple):
    """Young's modulus E [Pa], density rho [kg/m^3], shear modulus G [Pa] and Poisson's ratio nu; None if unknown."""

    E: float | None
    rho: float | None
    G: float | None
    nu: float | None


class Properties(NamedTuple):
    """Numbers of a beam's section, with its height along y.

    rho_A mass per length [kg/m], rho_I_y and rho_I_z rotary inertias per length [kg m], whatever the theory; E_A axial,
    E_I_y and E_I_z bending, G_J torsional stiffness [N, N m^2, N m^2]; G_A_y and G_A_z stiffnesses in shear along y and
    z [N], inf for theories without shear. In the plane bending is about z, and the numbers about x and y may be 0.
    """

    rho_A: float
    rho_I_y: float
    rho_I_z: float
    E_A: float
    E_I_y: float
    E_I_z: float
    G_J: float
    G_A_y: float = math.inf
    G_A_z: float = math.inf


def properties_of(section: SectionNumbers, E: float, G: float | None, rho: float, shear: bool = False) -> Properties:
    """Numbers of a section of one material: E and G [Pa], rho [kg/m^3]; ``shear``: true if the theory includes it.

    Raises
    ------
    ValueError
        With shear, for a section with unknown shear coefficients or a material with unknown G.
    """
    A, I_y, I_z, J, k_y, k_z = section
    found = Properties(rho * A, rho * I_y, rho * I_z, E * A, E * I_y, E * I_z, 0.0 if G is None else G * J)
    if not shear:
        return found
    if k_y is None or k_z is None or G is None:
        raise ValueError(f"k_y = {k_y}, k_z = {k_z}: shear needs both; give the material a Poisson's ratio")
    return found._replace(G_A_y=G * k_y * A, G_A_z=G * k_z * A)


def element_parameters(
    at: Callable[[float], Properties], nodes: np.ndarray, borders: tuple[float, ...] = ()
) -> dict[str, np.ndarray]:
    """Parameters of a link's elements by their names in ``kaneflex.derive.elements.parameters``, (elements,).

    A varying property is replaced by its least-squares linear fit: the mean keeps the element's mass and average
    stiffness, and the error is of the fourth order in the element's length. Those that the element holds constant take
    their means. Sections may jump at nodes and ``borders`` [m].
    """
    stops, length = _stops(nodes, borders), np.diff(nodes)
    x, weights = _gauss(stops)
    values = np.array([at(place) for place in x.tolist()])
    first = len(_GAUSS[0]) * np.searchsorted(stops, nodes[:-1])
    element = np.repeat(np.arange(len(length)), np.diff(np.append(first, len(x))))
    share = (x - nodes[element]) / length[element] - 0.5
    begin = values[first[element]]  # a constant has itself as its mean, and grows by exactly zero; inf may be one
    apart = np.subtract(values, begin, out=np.zeros_like(values), where=values != begin)
    means = values[first] + np.add.reduceat(weights[:, None] * apart, first) / length[:, None]
    rises = 12 * np.add.reduceat((weights * share)[:, None] * apart[:, :7], first) / length[:, None]
    mass, moment = length * means[:, 0], np.add.reduceat(weights * x * values[:, 0], first)
    mean = Properties(*means.T)
    found = mean._asdict() | {f"{name}_rise": rise for name, rise in zip(mean._fields, rises.T, strict=False)}
    found |= {"length": length, "x_0": nodes[:-1], "I_p_A": (mean.E_I_y + mean.E_I_z) / mean.E_A}
    found |= {"phi_y": 12 * mean.E_I_z / (mean.G_A_y * length**2), "phi_z": 12 * mean.E_I_y / (mean.G_A_z * length**2)}
    return found | {name: np.append(0.0, np.cumsum(of)[:-1]) for name, of in (("m_0", mass), ("S_0", moment))}


def _stops(nodes: np.ndarray, borders: tuple[float, ...]) -> np.ndarray:
    return np.array(sorted({*nodes.tolist(), *(x for x in borders if nodes[0] < x < nodes[-1])}))


def _gauss(stops: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points [m] and weights [m] of an exact quadrature between stops."""
    half = np.diff(stops)[:, None] / 2
    return (stops[:-1, None] + half * (1 + _GAUSS[0])).ravel(), (half * _GAUSS[1]).ravel()


class Inertia(NamedTuple):
    """Inertia of a piece of a beam: mass [kg], first and second moment about the link's origin [kg m, kg m^2], and the
    sums of the sections' rotary inertias about y and z, whatever the theory [kg m^2]."""

    mass: float
    first: float
    second: float
    about_y: float
    about_z: float


class Piece(NamedTuple):
    """Piece of a beam from `start` to `stop` [m] whose section's dimensions vary linearly from end to end.

    `made_of`: constants of its material; `shape`, a Shape or None, has the dimensions `first` and `last`.
    """

    start: float
    stop: float
    numbers: Callable[..., SectionNumbers]
    first: tuple[float, ...]
    last: tuple[float, ...]
    made_of: Constants
    shape: Any = None

    def at(self, x: float) -> SectionNumbers:
        """Numbers of the section at distance x [m] from the beam's start."""
        return self.numbers(*self.dimensions(x))

    def dimensions(self, x: float) -> tuple[float, ...]:
        """Linear interpolation between `first` and `last` at distance x [m] from the beam's start."""
        s = (x - self.start) / (self.stop - self.start)
        return tuple(a + (b - a) * s for a, b in zip(self.first, self.last, strict=True))


class Profile(NamedTuple):
    """Profile of a beam by its pieces; `rotary` and `shear` tell if its theory includes them."""

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

    def piece_at(self, x: float, after: bool = False) -> Piece:
        """Piece at distance x [m] from the start; at a border the one before or after it."""
        *inner, last = self.pieces
        return next((piece for piece in inner if x < piece.stop or (x == piece.stop and not after)), last)

    def at(self, x: float, after: bool = False) -> Properties:
        """Properties at distance x [m] from the start; at a border as `piece_at`."""
        piece = self.piece_at(x, after)
        E, rho, G, _ = piece.made_of
        assert E is not None and rho is not None  # checked with the scene
        return properties_of(piece.at(min(max(x, piece.start), piece.stop)), E, G, rho, self.shear)

    def of_mass(self, mass: float) -> Profile:
        """Profile with densities scaled so that the beam's mass is exactly `mass` [kg]."""
        share = mass / self.inertia(self.length).mass
        scaled = (p._replace(made_of=p.made_of._replace(rho=p.made_of.rho * share)) for p in self.pieces)
        return self._replace(pieces=tuple(scaled))

    def elements(self, nodes: np.ndarray) -> dict[str, np.ndarray]:
        """Parameters of elements in space, see :func:`element_parameters`."""
        uniform, before = self.at(0.0), self.inertia(nodes[0])
        found = element_parameters(self.at if self.varying else lambda x: uniform, nodes, self.borders)
        return found | {"m_0": before.mass + found["m_0"], "S_0": before.first + found["S_0"],
                        "rotary": np.full(len(nodes) - 1, float(self.rotary))}  # fmt: skip

    def planar_elements(self, nodes: np.ndarray) -> dict[str, np.ndarray]:
        """Parameters of planar elements, by their names in ``kaneflex.derive.elements.parameters``."""
        found, growing = self.elements(nodes), ("rho_A", "E_A", "E_I_z", "rho_I_z")
        names = (*growing, *(f"{name}_rise" for name in growing), "length", "x_0", "m_0", "S_0")
        planar = {name.replace("_z", ""): found[name] for name in names} | {"phi_s": found["phi_y"]}
        return planar if self.rotary else planar | dict.fromkeys(("rho_I", "rho_I_rise"), np.zeros(len(nodes) - 1))

    def element(self, x_0: float, length: float) -> dict[str, float]:
        """Parameters of the planar element from x_0 to x_0 + length [m]."""
        return {name: float(of[0]) for name, of in self.planar_elements(np.array([x_0, x_0 + length])).items()}

    def inertia(self, x: float) -> Inertia:
        """Inertia of the beam from its start to x [m]."""
        if not self.varying:
            rho_A, rho_I_y, rho_I_z, *_ = self.at(0.0)
            return Inertia(rho_A * x, rho_A * x**2 / 2, rho_A * x**3 / 3, rho_I_y * x, rho_I_z * x)
        points, weights = _gauss(_stops(np.array([0.0, x]), self.borders))
        of_mass, *of_turns = np.array([self.at(point)[:3] for point in points]).reshape(-1, 3).T
        sums = (of_mass, of_mass * points, of_mass * points**2, *of_turns)
        return Inertia(*(float(weights @ of) for of in sums))

    def rotary_inertia(self, x: float) -> float:
        """Rotary inertia of the sections from the start to x [m] in the plane [kg m^2], 0 for theories without."""
        return self.inertia(x).about_z if self.rotary else 0.0
