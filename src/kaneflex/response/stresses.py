"""Stresses of elastic links at the outlines of their sections, from the section forces of a motion.

Normal stress by Navier's hypothesis, shear of forces by Jourawski's formula, of torsion by Saint-Venant's; von Mises
stress of both. Not valid at load introductions, at notches and with restrained warping.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaneflex.scene.sections import SectionNumbers
from kaneflex.scene.shapes import Shape

if TYPE_CHECKING:
    from kaneflex.response.motion import Motion
    from kaneflex.scene.bodies import Body

STATIONS = 25
"""Evenly spaced stations along a link, in addition to those at jumps of its stresses."""
_POINTS = 64
"""Points of an outline; between two of them the stress of a round section is at most 0.12 % higher."""
_TERMS = 2 * np.arange(2000)[:, None] + 1
"""Odd numbers of Saint-Venant's series, which converges slowly only at the corners, where shear is zero."""


class Outline(NamedTuple):
    """Points y and z [m] of a section's outline, (n,), and the shear stress along it, (n, 3).

    ``shear`` is that of unit forces V_y and V_z [1/m^2] and of a unit torque T [1/m^3].
    """

    y: np.ndarray
    z: np.ndarray
    shear: np.ndarray


class LinkStresses(NamedTuple):
    """Normal and von Mises stresses [Pa] of an elastic link at ``x`` [m] from its start, (n_stations, n_times) each.

    ``upper`` and ``lower``: at the edges +y and -y in the plane, greatest and least of the outline in space. ``mises``:
    greatest of the outline.
    """

    x: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    mises: np.ndarray

    @property
    def largest(self) -> tuple[int, int]:
        """Station and instant of the largest von Mises stress; the first of equal ones."""
        station, instant = np.unravel_index(int(self.mises.argmax()), self.mises.shape)
        return int(station), int(instant)

    def taken(self, instants: np.ndarray) -> LinkStresses:
        """Stresses at some of the instants, by their indices."""
        return LinkStresses(self.x, *(part[:, instants] for part in self[1:]))


def stresses_of(motion: Motion) -> dict[str, LinkStresses]:
    """Stresses of every elastic link with known section shapes; none under preset rigid."""
    if motion.model.options.dynamics == "rigid":
        return {}
    links = [name for name, body in motion.model.scene.bodies.items() if body.elastic]
    return {name: found for name in links if (found := link_stresses(motion, name)) is not None}


def link_stresses(motion: Motion, name: str) -> LinkStresses | None:
    """Stresses of an elastic link; None if a section has no shape, or its forces are not known.

    At loads and ends of segments there are two stations: just before and just after.
    """
    body, spatial = motion.model.scene.bodies[name], motion.rigid.freedoms == 6
    if body.beam is None:
        return None
    jumps = {*motion.model.scene.acted_on(name), *(piece.stop for piece in body.profile.pieces[:-1])}
    evenly = np.linspace(0.0, body.length or 0.0, STATIONS)
    stations = sorted({(x, False) for x in (*evenly.tolist(), *jumps)} | {(x, True) for x in jumps})
    found = np.empty((3, len(stations), len(motion.times)))
    for k, (x, after) in enumerate(stations):
        section = section_at(body, x, after)
        if section is None:
            return None
        forces = motion.section(name, x, after)
        found[:, k] = _of_section(*section, forces if spatial else _in_space(forces), spatial)
    return LinkStresses(np.array([x for x, _ in stations]), *found) if np.isfinite(found).all() else None


def section_at(body: Body, x: float, after: bool = False) -> tuple[Outline, SectionNumbers] | None:
    """Outline and numbers of a body's section x [m] from its start; None if its shape is not known."""
    assert body.beam is not None
    piece = body.profile.piece_at(x, after)
    if piece.shape is None:
        return None
    return _outline_of(piece.shape, piece.dimensions(x))


@lru_cache(maxsize=4 * STATIONS)
def _outline_of(shape: Shape, dimensions: tuple[float, ...]) -> tuple[Outline, SectionNumbers]:
    numbers = shape.numbers_of(dimensions, None)
    return _OUTLINES[shape.kind](numbers, *dimensions), numbers


def _in_space(forces: Iterable[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Planar N, V, M as six section forces."""
    N, V, M = forces
    none = np.zeros_like(N)
    return N, V, none, none, none, M


def _of_section(
    outline: Outline, numbers: SectionNumbers, forces: Iterable[np.ndarray], spatial: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Greatest and least normal stress (upper and lower in the plane), and von Mises stress [Pa], (n_times,) each."""
    N, V_y, V_z, T, M_y, M_z = forces
    z, y = outline.z[:, None], outline.y[:, None]
    normal = N / numbers.A + z * (M_y / numbers.I_y) - y * (M_z / numbers.I_z)
    shear = outline.shear @ np.stack([V_y, V_z, T])
    mises = np.sqrt((normal**2 + 3.0 * shear**2).max(axis=0))
    if spatial:
        return normal.max(axis=0), normal.min(axis=0), mises
    return normal[outline.y.argmax()], normal[outline.y.argmin()], mises


def _rectangle(numbers: SectionNumbers, height: float, width: float) -> Outline:
    """Outline of a rectangle: sides at +y, -y, +z and -z; shear stress of a force is parabolic along its sides."""
    s = np.linspace(-1.0, 1.0, _POINTS // 4 + 1)
    one, parabola, none = np.ones_like(s), 1.5 / numbers.A * (1.0 - s**2), np.zeros_like(s)
    upper = _torsion_along(s, width, height) / numbers.J
    side = _torsion_along(s, height, width) / numbers.J
    y = 0.5 * height * np.concatenate([one, -one, s, s])
    z = 0.5 * width * np.concatenate([s, s, one, -one])
    # torsion is positive from y to z; the forces act along y and z
    V_y = np.concatenate([none, none, parabola, parabola])
    V_z = np.concatenate([parabola, parabola, none, none])
    T = np.concatenate([upper, -upper, -side, side])
    return Outline(y, z, np.column_stack([V_y, V_z, T]))


def _torsion_along(s: np.ndarray, along: float, across: float) -> np.ndarray:
    """Saint-Venant's shear stress times J for a unit torque on a rectangle's side, at shares s of half its length.

    2 a (1 - 8/pi^2 sum cosh(n pi y/2a)/(n^2 cosh(n pi b/2a))) over odd n at x = a of -a < x < a, -b < y < b (Timoshenko
    & Goodier, Theory of Elasticity, 109); ``along`` is 2 b and ``across`` 2 a.
    """
    n = _TERMS * np.pi * along / (2.0 * across)
    ratio = np.exp(n * (abs(s) - 1.0)) * (1.0 + np.exp(-2.0 * n * abs(s))) / (1.0 + np.exp(-2.0 * n))
    return across * (1.0 - 8.0 / math.pi**2 * (ratio / _TERMS**2).sum(axis=0))


def _round(numbers: SectionNumbers, radius: float, share: float) -> Outline:
    """Outline of a round section; ``share``: largest shear stress of a force over its mean, varying with the sine of
    the angle."""
    angle = 2.0 * np.pi / _POINTS * np.arange(_POINTS)
    c, s = np.cos(angle), np.sin(angle)
    most = share / numbers.A
    shear = np.column_stack([-most * s, most * c, np.full(_POINTS, radius / numbers.J)])
    return Outline(radius * c, radius * s, shear)


def _circle(numbers: SectionNumbers, diameter: float) -> Outline:
    """Outline of a circle: largest shear 4/3 of the mean; elasticity theory gives 1.23 in the middle for nu = 0.3."""
    return _round(numbers, 0.5 * diameter, 4.0 / 3.0)


def _tube(numbers: SectionNumbers, diameter: float, wall: float) -> Outline:
    """Outline of a tube: largest shear 4/3 (R^2 + R r + r^2)/(R^2 + r^2) of the mean, from the first moment of half
    the ring."""
    R = 0.5 * diameter
    r = R - wall
    return _round(numbers, R, 4.0 / 3.0 * (R**2 + R * r + r**2) / (R**2 + r**2))


def _i_section(numbers: SectionNumbers, height: float, width: float, flange: float, web: float) -> Outline:
    """Outline of an I section, both sides of flanges and web, as thin walls: shear flows, and T t/J on either side of
    a wall.

    Timoshenko & Goodier, Theory of Elasticity, 110; without stress concentration at fillets.
    """
    clear, middle = height - 2.0 * flange, height - flange
    s = np.linspace(-1.0, 1.0, 2 * (_POINTS // 12) + 1)
    one, none, z = np.ones_like(s), np.zeros_like(s), 0.5 * width * s
    across = 0.75 / (width * flange) * (1.0 - s**2)  # V_z on the two flanges, each a rectangle
    flow = np.sign(s) * (0.5 * width - abs(z)) * 0.5 * middle / numbers.I_z  # shear flow of V_y
    y = 0.5 * clear * s
    first = 0.5 * width * flange * middle + 0.5 * web * (0.25 * clear**2 - y**2)
    along = first / (numbers.I_z * web)
    twist = np.array([flange, web]) / numbers.J
    walls = [
        (side * level * one, z, side * flow, across, side * turn * twist[0] * one)
        for side in (1.0, -1.0) for level, turn in ((0.5 * height, 1.0), (0.5 * clear, -1.0))
    ]  # fmt: skip
    walls += [(y, side * 0.5 * web * one, along, none, -side * twist[1] * one) for side in (1.0, -1.0)]
    y, z, *shear = (np.concatenate(column) for column in zip(*walls, strict=True))
    return Outline(y, z, np.column_stack(shear))


_OUTLINES: dict[str, Callable[..., Outline]] = {
    "rectangle": _rectangle, "circle": _circle, "tube": _tube, "I": _i_section,
}  # fmt: skip
