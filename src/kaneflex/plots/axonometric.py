"""Axonometric projection of mechanisms in space onto the plane of a picture."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes

from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.plots.outlines import BOX
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Vector

if TYPE_CHECKING:
    from kaneflex.mechanism.rigid_motion import RigidMotion


def _view(azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Projection (2, 3) onto a picture's plane, and the direction to its viewer (3,); angles in degrees."""
    (c, s), (cos, sin) = ((math.cos(a), math.sin(a)) for a in map(math.radians, (azimuth, elevation)))
    return np.array([[-s, c, 0.0], [-sin * c, -sin * s, cos]]), np.array([cos * c, cos * s, sin])


VIEW, TO_VIEWER = _view(-62.0, 24.0)
"""The one view of all pictures in space: x to the right, y to the back, z up; no axis hides another."""
FLAT = {"along z": np.eye(3)[[0, 1]], "along y": np.eye(3)[[0, 2]], "along x": np.eye(3)[[1, 2]]}
"""Projections along the global axes."""
GUIDES = ("prismatic", "cylindrical")
_AXIS = 0.06
"""Half the length of a joint's axis as drawn, in sizes of the mechanism."""
# Edges of a block as one closed line, by the signs of its three half edges, + towards the viewer: first the three that
# meet at the nearest corner, then around its silhouette.
_EDGES = np.array([
    (1, 1, 1), (1, -1, 1), (1, 1, 1), (1, 1, -1), (1, 1, 1), (-1, 1, 1), (-1, 1, -1), (1, 1, -1), (1, -1, -1),
    (1, -1, 1), (-1, -1, 1), (-1, 1, 1),
])  # fmt: skip


def seen(points: np.ndarray, view: np.ndarray = VIEW) -> np.ndarray:
    """Points (..., 3) in the picture, (..., 2), in their unit."""
    return points @ view.T


def label_flat(axes: Axes, view: np.ndarray, label: str) -> None:
    """Equal scales of a view along an axis, and the names of the two others, in place of the braces of a label."""
    across, up = ("xyz"[k] for k in view.argmax(axis=1))
    axes.set(xlabel=label.format(across), ylabel=label.format(up))
    axes.set_aspect("equal", adjustable="datalim")


def view_of(scene: Scene) -> np.ndarray:
    """Projection of a scene onto the picture's plane, (2, 2 or 3)."""
    return VIEW if scene.is_spatial else np.eye(2)


def lines_size(scene: Scene, lines: Mapping[str, np.ndarray]) -> float:
    """Diagonal of the box that a mechanism fills at its first instant [m]."""
    first = np.concatenate([line[:, :, 0] for line in lines.values()])
    return float(np.linalg.norm(np.ptp(first, axis=0))) or spatial_mechanism_of(scene).size


def joint_axes(scene: Scene, rigid: RigidMotion) -> list[np.ndarray]:
    """Ends of the joints' axes at the first instant but those of guides, which are drawn whole, (2, 3) [m]."""
    reach, found = _AXIS * lines_size(scene, body_lines(scene, rigid)), []
    for joint in scene.joints.values():
        if joint.kind in GUIDES:
            continue
        first = joint.addresses[0]
        frame = rigid.frame(first.body)
        at = frame.place(scene.point(first))[:, 0]
        for axis in joint.given_axes:
            arm = reach * frame.to_global(axis)[:, 0]
            found.append(np.array([at - arm, at + arm]))
    return found


def block(centre: np.ndarray, axis: np.ndarray, size: float) -> np.ndarray:
    """Edges of a block about a guide's axis as one closed line, (12, 3, n_times) [m]."""
    helper = np.eye(3)[np.abs(axis[:, 0]).argmin()][:, None]
    across = np.cross(axis, helper, axis=0)
    across /= np.linalg.norm(across, axis=0)
    halves = [0.6 * BOX[0] * size * axis, 0.6 * BOX[1] * size * across,
              0.6 * BOX[1] * size * np.cross(axis, across, axis=0)]  # fmt: skip
    halves = [half * np.where(TO_VIEWER @ half < 0.0, -1.0, 1.0) for half in halves]
    return np.einsum("ek,kct->ect", _EDGES, np.array(halves)) + centre


def body_lines(scene: Scene, motion: RigidMotion) -> dict[str, np.ndarray]:
    """Line of every body through its ends and the points at which joints hold it, (points, 3, times) [m]."""
    return {name: np.array([motion.frame(name).place(point) for point in outline_points(scene, name)])
            for name in scene.bodies}  # fmt: skip


def outline_points(scene: Scene, name: str) -> list[Vector]:
    """Points of a body in its axes that its line connects: its ends and joints, or its centre where it has only one."""
    body = scene.bodies[name]
    held = [scene.point(side) for joint in scene.joints.values() for side in joint.addresses if side.body == name]
    ends = [scene.vector(body.points_all[end]) for end in ("start", "end") if end in body.points_all]
    points = list(dict.fromkeys([*ends, *held]))
    if len(points) == 1 and any(body.centre):
        points.append(scene.vector(body.centre))
    return points
