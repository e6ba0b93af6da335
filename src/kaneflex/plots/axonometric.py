"""Mechanisms in space as pictures show them: an axonometric projection onto the picture's plane."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.plots.outlines import ALONG_LINK, BOX, STANDING, Outline, Scenery
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Vector

if TYPE_CHECKING:
    from kaneflex.mechanism.rigid_motion import RigidMotion
    from kaneflex.response.elastic_motion import SpatialElasticMotion
    from kaneflex.response.motion import Motion


def _view(azimuth: float, elevation: float) -> tuple[np.ndarray, np.ndarray]:
    """Projection (2, 3) onto a picture's plane, and the direction to its viewer (3,); angles in degrees."""
    (c, s), (cos, sin) = ((math.cos(a), math.sin(a)) for a in map(math.radians, (azimuth, elevation)))
    return np.array([[-s, c, 0.0], [-sin * c, -sin * s, cos]]), np.array([cos * c, cos * s, sin])


VIEW, TO_VIEWER = _view(-62.0, 24.0)
"""The one view of all pictures in space: x to the right, y to the back, z up; no axis hides another."""
FLAT = {"along z": np.eye(3)[[0, 1]], "along y": np.eye(3)[[0, 2]], "along x": np.eye(3)[[1, 2]]}
"""Projections along the global axes."""
_GUIDES = ("prismatic", "cylindrical")
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


def spatial_scenery(scene: Scene, rigid: RigidMotion) -> Scenery:
    """Ground pivots, guides and extent of a mechanism in space over a rigid motion, in the picture [m]."""
    lines = body_lines(scene, rigid)
    swept = np.concatenate([seen(line.transpose(0, 2, 1)).reshape(-1, 2) for line in lines.values()])
    swept = swept[np.isfinite(swept).all(axis=1)]
    size = _size(scene, lines)
    guides, pivots = {}, []
    for name, joint in scene.joints.items():
        first, second = joint.addresses
        if joint.kind in _GUIDES:
            origin, axis = rigid.frame(first.body).place(scene.point(first)), _axis(scene, rigid, name)
            along = ((rigid.frame(second.body).place(scene.point(second)) - origin) * axis).sum(axis=0)
            room = (BOX[0] if len(along) > 1 else STANDING) * size
            ends = np.array([along.min() - room, along.max() + room])
            guides[name] = seen(origin[:, 0] + np.outer(ends, axis[:, 0]))
        else:
            pivots += [seen(np.array(scene.point(side))) for side in joint.addresses if side.body == "ground"]
    lower, upper = swept.min(axis=0), swept.max(axis=0)
    return Scenery(np.array(pivots).reshape(-1, 2), guides, size, lower, upper, VIEW)


def _size(scene: Scene, lines: Mapping[str, np.ndarray]) -> float:
    """Diagonal of the box that a mechanism fills at its first instant [m]."""
    first = np.concatenate([line[:, :, 0] for line in lines.values()])
    return float(np.linalg.norm(np.ptp(first, axis=0))) or spatial_mechanism_of(scene).size


def _axis(scene: Scene, rigid: RigidMotion, joint: str) -> np.ndarray:
    """Global direction of a joint's first axis, (3, n_times)."""
    given = scene.joints[joint]
    return rigid.frame(given.addresses[0].body).to_global(np.array(given.given_axes[0])[:, None])


def joint_axes(scene: Scene, rigid: RigidMotion) -> list[np.ndarray]:
    """Ends of the joints' axes at the first instant but those of guides, which are drawn whole, (2, 3) [m]."""
    reach, found = _AXIS * _size(scene, body_lines(scene, rigid)), []
    for joint in scene.joints.values():
        if joint.kind in _GUIDES:
            continue
        first = joint.addresses[0]
        frame = rigid.frame(first.body)
        at = frame.place(scene.point(first))[:, 0]
        for axis in joint.given_axes:
            arm = reach * frame.to_global(axis)[:, 0]
            found.append(np.array([at - arm, at + arm]))
    return found


def spatial_outline(scene: Scene, rigid: RigidMotion, fixed: Scenery, motion: Motion | None, factor: float) -> Outline:
    """A mechanism in space in the picture, its elastic displacements multiplied by ``factor`` [m]."""
    elastic = [name for name, body in scene.bodies.items() if body.elastic]
    along = {name: np.linspace(0.0, scene.bodies[name].length or 0.0, ALONG_LINK) for name in elastic}
    lines = body_lines(scene, rigid, along) if motion is None else deformed_lines(motion, factor)
    drawn = {name: seen(line.transpose(2, 0, 1)) for name, line in lines.items()}
    boxes, pins = {}, {}
    for name, joint in scene.joints.items():
        side = max(reversed(joint.addresses), key=lambda side: side.body in elastic)
        place = _moved(scene, rigid, motion, side.body, [scene.point(side)], factor)[0]
        if joint.kind == "prismatic":
            boxes[name] = seen(_block(place, _axis(scene, rigid, name), fixed.size))
        else:
            pins[name] = seen(place.T)
    links = {name: drawn[name] for name in elastic if name in drawn}
    return Outline(links, {name: line for name, line in drawn.items() if name not in links}, boxes, pins)


def _block(centre: np.ndarray, axis: np.ndarray, size: float) -> np.ndarray:
    """Edges of a block about a guide's axis as one closed line, (n_times, 12, 3) [m]."""
    helper = np.eye(3)[np.abs(axis[:, 0]).argmin()][:, None]
    across = np.cross(axis, helper, axis=0)
    across /= np.linalg.norm(across, axis=0)
    halves = [0.6 * BOX[0] * size * axis, 0.6 * BOX[1] * size * across,
              0.6 * BOX[1] * size * np.cross(axis, across, axis=0)]  # fmt: skip
    halves = [half * np.where(TO_VIEWER @ half < 0.0, -1.0, 1.0) for half in halves]
    return np.einsum("ek,kct->tec", _EDGES, np.array(halves)) + centre.T[:, None]


def body_lines(
    scene: Scene, motion: RigidMotion, along: Mapping[str, np.ndarray] = MappingProxyType({})
) -> dict[str, np.ndarray]:
    """Line of every body through its ends and the points at which joints hold it, (points, 3, times) [m].

    ``along``: places on the x axis of some bodies to draw instead [m].
    """
    found = {}
    for name in scene.bodies:
        frame = motion.frame(name)
        points = [(float(x), 0.0, 0.0) for x in along[name]] if name in along else outline_points(scene, name)
        found[name] = np.array([frame.place(point) for point in points])
    return found


def outline_points(scene: Scene, name: str) -> list[Vector]:
    """Points of a body in its axes that its line connects: its ends and joints, or its centre where it has only one."""
    body = scene.bodies[name]
    held = [scene.point(side) for joint in scene.joints.values() for side in joint.addresses if side.body == name]
    ends = [scene.vector(body.points_all[end]) for end in ("start", "end") if end in body.points_all]
    points = list(dict.fromkeys([*ends, *held]))
    if len(points) == 1 and any(body.centre):
        points.append(scene.vector(body.centre))
    return points


def deformed_lines(motion: Motion, factor: float) -> dict[str, np.ndarray]:
    """Line of every body as it deforms or follows those that do, all displacements enlarged."""
    model, found = motion.model, {}
    for name in model.scene.bodies:
        points = [(float(x), 0.0, 0.0) for x in np.linspace(0.0, model.links[name].length, ALONG_LINK)] \
            if name in model.links else outline_points(model.scene, name)  # fmt: skip
        found[name] = _moved(model.scene, motion.rigid, motion, name, points, factor)
    return found


def _moved(
    scene: Scene, rigid: RigidMotion, motion: Motion | None, body: str, points: list[Vector], factor: float
) -> np.ndarray:
    """Global places of a body's points, their displacements enlarged, (points, 3, times) [m]."""
    frame = rigid.frame(body)
    places = np.array([frame.place(point) for point in points])
    if motion is None or body not in scene.bodies:
        return places
    model = motion.model
    if body in model.links:
        for place, (x, *_) in zip(places, points, strict=True):
            place += factor * frame.to_global(_shift(motion, body, x)[:3])
    if model.frame is not None and body in model.frame.bodies:
        moved = _shift(motion, body)
        shift, turn = frame.to_global(moved[:3]), frame.to_global(moved[3:])
        places = places + factor * (shift + np.cross(turn[None], places - frame.origin, axis=1))
    return places


def _shift(motion: Motion, body: str, x: float = 0.0) -> np.ndarray:
    """Displacement and rotation of a point on a body's x axis, in the body's axes, (6, n_times)."""
    return cast("SpatialElasticMotion", motion).displacement(body, (x, 0.0, 0.0))[0]
