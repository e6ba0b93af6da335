"""Projection of mechanisms onto the plane of a picture: the plane as it is, space axonometrically."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes

from kaneflex.mechanism.body_frame import normal
from kaneflex.plots.outlines import BOX
from kaneflex.scene import Scene


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


def label_flat(axes: Axes, view: np.ndarray, label: str) -> None:
    """Equal scales of a view along an axis, and the names of the two others, in place of the braces of a label."""
    across, up = ("xyz"[k] for k in view.argmax(axis=1))
    axes.set(xlabel=label.format(across), ylabel=label.format(up))
    axes.set_aspect("equal", adjustable="datalim")


def view_of(scene: Scene) -> np.ndarray:
    """Projection of a scene onto the picture's plane, (2, 2 or 3)."""
    return VIEW if scene.is_spatial else np.eye(2)


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
