"""Lines of a mechanism in a picture, and their projection: the plane as it is, space axonometrically."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from kaneflex.mechanism.body_frame import normal

ALONG_LINK = 33
"""Points along an elastic link."""
BOX = (0.10, 0.07)
"""Half length and half width of a guided body, in sizes of the mechanism."""
STANDING = 0.2
"""Half length of a guide where only one configuration is known."""


@dataclass(frozen=True, eq=False)
class Scenery:
    """Parts that do not move, and the extent of the motion.

    Attributes
    ----------
    pivots : ndarray (n, 2)
        Points of the ground that joints other than guides use [m].
    guides : mapping of str to ndarray (2, 2 or 3)
        Ends of each guide's centre line over the travel of its body, in the axes of the body that carries it [m].
    size : float
        Diagonal of the region that the rigid mechanism sweeps in the plane, of the box that it fills in space [m].
    lower, upper : ndarray (2,)
        Corners of the region that it sweeps in the picture [m].
    view : ndarray (2, 2 or 3)
        Projection; its columns are the global axes in the picture.
    carried : frozenset of str
        Guides that a body carries, not the ground.
    """

    pivots: np.ndarray
    guides: Mapping[str, np.ndarray]
    size: float
    lower: np.ndarray
    upper: np.ndarray
    view: np.ndarray
    carried: frozenset[str]

    @property
    def flat(self) -> bool:
        """True for a mechanism in the plane."""
        return self.view.shape[1] == 2

    @property
    def rails(self) -> dict[str, np.ndarray]:
        """Ends of the guides on the ground in the picture [m]."""
        return {name: ends @ self.view.T for name, ends in self.guides.items() if name not in self.carried}


@dataclass(frozen=True, eq=False)
class Outline:
    """A mechanism at some instants; all points in the picture's plane [m].

    Attributes
    ----------
    links : mapping of str to ndarray (n_times, n_points, 2)
        Axis of each elastic link.
    bars : mapping of str to ndarray (n_times, n_points, 2)
        Path through the used points of each rigid body, and the guides that it carries; for elastic links a stiff arm
        from the axis to each used point that does not lie on it, by the link's name and a number.
    boxes : mapping of str to ndarray (n_times, n_corners, 2)
        Closed outline of the body on each guide, by the guide's joint.
    pins : mapping of str to ndarray (n_times, 2)
        Each joint but welds and guides.
    """

    links: Mapping[str, np.ndarray]
    bars: Mapping[str, np.ndarray]
    boxes: Mapping[str, np.ndarray]
    pins: Mapping[str, np.ndarray]

    def combined(self, function: Callable[..., np.ndarray], *others: Outline) -> Outline:
        """An outline of the same parts, whose points are a function of these and those of other outlines."""
        kinds = ({name: function(points, *(getattr(other, kind)[name] for other in others))
                  for name, points in getattr(self, kind).items()}
                 for kind in ("links", "bars", "boxes", "pins"))  # fmt: skip
        return Outline(*kinds)

    def farthest(self, other: Outline) -> float:
        """Largest distance between a point of this outline and of another one of the same parts [m]."""
        apart = self.combined(np.subtract, other)
        shifts = [np.hypot(each[..., 0], each[..., 1]) for kind in (apart.links, apart.bars, apart.boxes, apart.pins)
                  for each in kind.values()]  # fmt: skip
        return max((float(np.nanmax(each)) for each in shifts if each.size), default=0.0)


def _view(azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Projection (2, 3) onto a picture's plane, and the direction to its viewer (3,); angles in degrees."""
    (c, s), (cos, sin) = ((math.cos(a), math.sin(a)) for a in map(math.radians, (azimuth, elevation)))
    return np.array([[-s, c, 0.0], [-sin * c, -sin * s, cos]]), np.array([cos * c, cos * s, sin])


VIEW, TO_VIEWER = _view(-62.0, 24.0)
"""The one view of all pictures in space: x to the right, y to the back, z up; no axis hides another."""
FLAT = {"along z": np.eye(3)[[0, 1]], "along y": np.eye(3)[[0, 2]], "along x": np.eye(3)[[1, 2]]}
"""Projections along the global axes."""
_CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)])
# Edges of a block as one closed line, by the signs of its three half edges, + towards the viewer: first the three that
# meet at the nearest corner, then around its silhouette.
_EDGES = np.array([
    (1, 1, 1), (1, -1, 1), (1, 1, 1), (1, 1, -1), (1, 1, 1), (-1, 1, 1), (-1, 1, -1), (1, 1, -1), (1, -1, -1),
    (1, -1, 1), (-1, -1, 1), (-1, 1, 1),
])  # fmt: skip


def seen(points: np.ndarray, view: np.ndarray = VIEW) -> np.ndarray:
    """Points (..., 2 or 3) in the picture, (..., 2), in their unit."""
    return points @ view.T


def aligned(view: np.ndarray) -> bool:
    """True for a view along an axis, whose panel has labelled axes."""
    return bool((view.max(axis=1) == 1.0).all())


def name_axes(axes: Axes, view: np.ndarray, label: str) -> None:
    """Names of the axes of a view along an axis, in place of the braces of a label; other views get none."""
    if aligned(view):
        across, up = ("xyz"[k] for k in view.argmax(axis=1))
        axes.set(xlabel=label.format(across), ylabel=label.format(up))


def view_of(in_space: bool) -> np.ndarray:
    """Projection of a mechanism onto the picture's plane, (2, 2 or 3)."""
    *_, view = views_of(in_space).values()
    return view


def views_of(in_space: bool) -> dict[str, np.ndarray]:
    """Views of a mechanism by their names: in space along each axis, and at an angle."""
    if not in_space:
        return {"": np.eye(2)}
    return {f" {name}": view for name, view in (FLAT | {"at an angle": VIEW}).items()}


def box(axis: np.ndarray, size: float) -> np.ndarray:
    """Edges of a guided body about its middle as one closed line, (n_corners, 2 or 3, n_times) [m].

    ``axis``: unit vectors along its guide, (2 or 3, n_times); in space the edges that face the viewer.
    """
    length, width = (size * half for half in BOX)
    if len(axis) == 2:
        halves = np.array([length * axis, width * normal(axis)])
        return np.einsum("ek,kct->ect", _CORNERS, halves)
    across = np.cross(axis, np.eye(3)[np.abs(axis[:, 0]).argmin()][:, None], axis=0)
    across /= np.linalg.norm(across, axis=0)
    halves = 0.6 * np.array([length * axis, width * across, width * np.cross(axis, across, axis=0)])
    return np.einsum("ek,kct->ect", _EDGES, np.array([half * np.where(TO_VIEWER @ half < 0, -1, 1) for half in halves]))
