"""Stresses of elastic links at the outlines of their sections, by the section forces of a motion.

Normal stress by Navier's hypothesis, shear of forces by Jourawski's, of torsion by Saint-Venant's; von Mises' stress of
both. Where a load enters, at notches and where warping is held, stresses are others.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaneflex.scene.sections import Shape, SpatialSectionNumbers

if TYPE_CHECKING:
    from kaneflex.response.motion import Motion
    from kaneflex.scene.bodies import Body

STATIONS = 25
"""Places along a link, equally far apart, beside those at which its stresses jump."""
_POINTS = 64
"""Of an outline; between two of them the stress of a round section is at most 0.12 % higher."""
_TERMS = 2 * np.arange(2000)[:, None] + 1
"""Odd numbers of Saint-Venant's series, which converges slowly at the corners alone, where there is no shear."""


class Outline(NamedTuple):
    """Points of a section's outline, y and z [m], (n,), and the shear stress there along it, (n, 3).

    ``shear`` is that of unit forces V_y and V_z [1/m^2] and of a unit torque T [1/m^3].
    """

    y: np.ndarray
    z: np.ndarray
    shear: np.ndarray


class LinkStresses(NamedTuple):
    """Of an elastic link, at ``x`` [m] from its start: normal and von Mises' stresses [Pa], (n_stations, n_times) each.

    ``upper`` and ``lower`` are those of the edges at +y and -y in the plane; in space the greatest and the least of the
    outline. ``mises`` is the greatest of the outline.
    """

    x: np.ndarray
    upper: np.ndarray
    lower: np.ndarray
    mises: np.ndarray

    @property
    def largest(self) -> tuple[int, int]:
        """Station and instant of the largest stress of von Mises: of places that are alike the first."""
        station, instant = np.unravel_index(int(self.mises.argmax()), self.mises.shape)
        return int(station), int(instant)

    def taken(self, instants: np.ndarray) -> LinkStresses:
        """Those at some of the instants, by their numbers."""
        return LinkStresses(self.x, *(part[:, instants] for part in self[1:]))


def stresses_of(motion: Motion) -> dict[str, LinkStresses]:
    """Those of every elastic link that has any; of rigid mechanisms, in which nothing deforms, none."""
    if motion.model.options.dynamics == "rigid":
        return {}
    links = [name for name, body in motion.model.scene.bodies.items() if body.elastic]
    return {name: found for name in links if (found := link_stresses(motion, name)) is not None}


def link_stresses(motion: Motion, name: str) -> LinkStresses | None:
    """Stresses of an elastic link; None where a section has no shape, or nobody knows its forces.

    Where something acts, and where a segment ends, there are two stations: just before it and just after it.
    """
    body, spatial = motion.model.scene.bodies[name], motion.model.scene.is_spatial
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


def section_at(body: Body, x: float, after: bool = False) -> tuple[Outline, SpatialSectionNumbers] | None:
    """The outline and the numbers of a body's section x [m] from its start; None where its shape isn't known."""
    assert body.beam is not None
    piece = body.profile.piece_at(x, after)
    if piece.shape is None:
        return None
    return _outline_of(piece.shape, piece.dimensions(x))


@lru_cache(maxsize=4 * STATIONS)
def _outline_of(shape: Shape, dimensions: tuple[float, ...]) -> tuple[Outline, SpatialSectionNumbers]:
    numbers = shape.spatial_numbers_of(dimensions, None)
    return _OUTLINES[shape.kind](numbers, *dimensions), numbers


def _in_space(forces: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """N, V, M of the plane among the six of space."""
    N, V, M = forces
    none = np.zeros_like(N)
    return N, V, none, none, none, M


def _of_section(
    outline: Outline, numbers: SpatialSectionNumbers, forces: tuple[np.ndarray, ...], spatial: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normal stress above, that below, and von Mises' [Pa], (n_times,) each."""
    N, V_y, V_z, T, M_y, M_z = forces
    z, y = outline.z[:, None], outline.y[:, None]
    normal = N / numbers.A + z * (M_y / numbers.I_y) - y * (M_z / numbers.I_z)
    shear = outline.shear @ np.stack([V_y, V_z, T])
    mises = np.sqrt((normal**2 + 3.0 * shear**2).max(axis=0))
    if spatial:
        return normal.max(axis=0), normal.min(axis=0), mises
    return normal[outline.y.argmax()], normal[outline.y.argmin()], mises


def _rectangle(numbers: SpatialSectionNumbers, height: float, width: float) -> Outline:
    """Its sides at +y, -y, +z and -z, from corner to corner; a shear force along a side is a parabola there."""
    s = np.linspace(-1.0, 1.0, _POINTS // 4 + 1)
    one, parabola, none = np.ones_like(s), 1.5 / numbers.A * (1.0 - s**2), np.zeros_like(s)
    upper = _torsion_along(s, width, height) / numbers.J
    side = _torsion_along(s, height, width) / numbers.J
    y = 0.5 * height * np.concatenate([one, -one, s, s])
    z = 0.5 * width * np.concatenate([s, s, one, -one])
    # torsion goes round, from y to z; the other two along y and z
    V_y = np.concatenate([none, none, parabola, parabola])
    V_z = np.concatenate([parabola, parabola, none, none])
    T = np.concatenate([upper, -upper, -side, side])
    return Outline(y, z, np.column_stack([V_y, V_z, T]))


def _torsion_along(s: np.ndarray, along: float, across: float) -> np.ndarray:
    """J times Saint-Venant's shear stress of a unit torque on a rectangle's side, at shares s of half its length.

    2 a (1 - 8/pi^2 sum cosh(n pi y/2a)/(n^2 cosh(n pi b/2a))) over odd n at x = a of -a < x < a, -b < y < b
    (Timoshenko & Goodier, Theory of Elasticity, 109); ``along`` is 2 b and ``across`` 2 a.
    """
    n = _TERMS * np.pi * along / (2.0 * across)
    ratio = np.exp(n * (abs(s) - 1.0)) * (1.0 + np.exp(-2.0 * n * abs(s))) / (1.0 + np.exp(-2.0 * n))
    return across * (1.0 - 8.0 / math.pi**2 * (ratio / _TERMS**2).sum(axis=0))


def _round(numbers: SpatialSectionNumbers, radius: float, share: float) -> Outline:
    """``share``: largest shear stress of a shear force over its mean; it goes with the sine around the outline."""
    angle = 2.0 * np.pi / _POINTS * np.arange(_POINTS)
    c, s = np.cos(angle), np.sin(angle)
    most = share / numbers.A
    shear = np.column_stack([-most * s, most * c, np.full(_POINTS, radius / numbers.J)])
    return Outline(radius * c, radius * s, shear)


def _circle(numbers: SpatialSectionNumbers, diameter: float) -> Outline:
    """4/3 of the mean where a shear force has most of it; by the theory of elasticity 1.23 there for nu = 0.3."""
    return _round(numbers, 0.5 * diameter, 4.0 / 3.0)


def _tube(numbers: SpatialSectionNumbers, diameter: float, wall: float) -> Outline:
    """4/3 (R^2 + R r + r^2)/(R^2 + r^2) of the mean, by the first moment of half the ring over its two walls."""
    R = 0.5 * diameter
    r = R - wall
    return _round(numbers, R, 4.0 / 3.0 * (R**2 + R * r + r**2) / (R**2 + r**2))


def _i_section(numbers: SpatialSectionNumbers, height: float, width: float, flange: float, web: float) -> Outline:
    """Both sides of its flanges and of its web, by thin walls: shear flows, and T t/J on either side of a wall.

    Timoshenko & Goodier, Theory of Elasticity, 110; what its fillets concentrate is left out.
    """
    clear, middle = height - 2.0 * flange, height - flange
    s = np.linspace(-1.0, 1.0, 2 * (_POINTS // 12) + 1)
    one, none, z = np.ones_like(s), np.zeros_like(s), 0.5 * width * s
    across = 0.75 / (width * flange) * (1.0 - s**2)  # V_z on the two flanges, each a rectangle
    flow = np.sign(s) * (0.5 * width - abs(z)) * 0.5 * middle / numbers.I_z  # V_y's, out of the web and into it
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
