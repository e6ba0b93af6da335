"""Outlines of a mechanism in the plane of a picture: fixed pivots and guides once, bodies and joints at any instant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, cast

import numpy as np

from kaneflex.mechanism.body_frame import BodyFrame, normal
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.plots.outlines import ALONG_LINK, BOX, STANDING, Outline, Scenery
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.response.motion import Motion

_SWEEP, _MOST = 180, 20_000
"""Least and largest number of instants from which the travel along guides and the frame of the picture are found;
in space the largest."""
_ON_LINE = 1e-6
"""Share of a guide's margin by which a point may miss its line."""
_CARRIED = 0.5
"""Share of that size for a body on a guide that moves."""

Place = tuple[float, float]


def scenery(model: Model, rigid: RigidMotion | None = None) -> Scenery:
    """Pivots, guides and extent of a model's run, without instants at which the rigid mechanism has no place.

    ``rigid``: motion of a run, from which those in space are found.
    """
    if model.scene.is_spatial:
        rigid = model.motion.at(0.0) if rigid is None else rigid
        return rigid_scenery(model.scene, rigid.taken(np.arange(0, len(rigid.times), len(rigid.times) // _SWEEP + 1)))
    count = min(max(_SWEEP, model.options.steps), _MOST)
    rigid = model.motion.at(np.linspace(0.0, model.options.duration, count, endpoint=False))
    placed = np.all([np.isfinite(rigid[f"{name}.x"] + rigid[f"{name}.c"]) for name in model.scene.bodies], axis=0)
    if not placed.all():
        rigid = model.motion.at(rigid.times[placed])
    return rigid_scenery(model.scene, rigid)


def rigid_scenery(scene: Scene, rigid: RigidMotion | Placement) -> Scenery:
    """Pivots, guides and extent of a scene over some rigid motion, or at one configuration."""
    if scene.is_spatial:
        from kaneflex.plots.axonometric import spatial_scenery

        return spatial_scenery(scene, cast("RigidMotion", rigid))
    swept = [_rigid_point(rigid, name, at) for name in ("ground", *scene.bodies) for at in used_points(scene, name)]
    swept = np.concatenate(swept)
    lower, upper = swept.min(axis=0), swept.max(axis=0)
    size = float(np.hypot(*(upper - lower))) or 1.0
    guides, all_guides = {}, guides_of(scene)
    for name, (carrier, rider, direction) in all_guides.items():
        points = _rigid_point(rigid, rider.body, scene.point(rider))
        if carrier.body != "ground":
            frame = BodyFrame(rigid, carrier.body)
            points = frame.to_body(points.T - frame.origin).T
        margin = (BOX[0] if len(points) > 1 else STANDING) * size
        carried = [] if carrier.body == "ground" else used_points(scene, carrier.body)
        guides[name] = _travel(points, np.array(direction), margin, carried)
    pivots = [
        scene.point(address)
        for joint in scene.joints.values()
        for address in joint.addresses
        if joint.kind != "prismatic" and address.body == "ground"
    ]
    held = frozenset(name for name, (carrier, *_) in all_guides.items() if carrier.body != "ground")
    return Scenery(np.array(pivots).reshape(-1, 2), guides, size, lower, upper, carried=held)


def guides_of(scene: Scene) -> dict[str, tuple[Address, Address, Place]]:
    """The side that carries each guide, the side that rides on it, and its direction; those with a clearance, too."""
    sides = {name: (joint.addresses, joint.direction) for name, joint in scene.joints.items()}
    sides |= {name: (joint.sides, joint.direction) for name, joint in scene.loose.items()}
    return {name: (*pair, direction) for name, (pair, direction) in sides.items() if direction is not None}


def _travel(points: np.ndarray, direction: np.ndarray, margin: float, carried: list[Place]) -> np.ndarray:
    """Ends of the line along a direction that covers points (n_times, 2) with a margin.

    ``carried``: points of the body that carries it; of those on the line the outer ones end it, as a barrel's do.
    """
    along = points @ direction
    across = points[0] - along[0] * direction
    ends = [along.min() - margin, along.max() + margin]
    on_line = [p @ direction for p in map(np.array, carried)
               if np.linalg.norm(p - across - (p @ direction) * direction) < _ON_LINE * margin]  # fmt: skip
    if on_line and min(on_line) <= along.min():
        ends[0] = max(ends[0], min(on_line))
    if on_line and max(on_line) >= along.max():
        ends[1] = min(ends[1], max(on_line))
    return across + np.outer(ends, direction)


def outline(motion: Motion, fixed: Scenery, factor: float) -> Outline:
    """The mechanism at the times of a motion, its elastic displacements multiplied by ``factor``."""
    return _outline(motion.model.scene, motion.rigid, fixed, motion, factor)


def rigid_outline(scene: Scene, rigid: RigidMotion | Placement, fixed: Scenery) -> Outline:
    """The undeformed mechanism at the times of a rigid motion, or at one configuration."""
    return _outline(scene, rigid, fixed, None, 0.0)


def _outline(
    scene: Scene, rigid: RigidMotion | Placement, fixed: Scenery, motion: Motion | None, factor: float
) -> Outline:
    if not scene.is_spatial:
        return _Pose(scene, rigid, fixed, motion, factor).outline()
    from kaneflex.plots.axonometric import spatial_outline

    return spatial_outline(scene, cast("RigidMotion", rigid), fixed, motion, factor)


class _Pose:
    """Parts of one outline in the plane; ``motion`` is None where nothing is deformed."""

    def __init__(self, scene: Scene, rigid, fixed: Scenery, motion: Motion | None, factor: float):
        self.scene, self.rigid, self.fixed = scene, rigid, fixed
        self.motion, self.factor = motion, factor
        self.axes = {name: self._axis(name) for name, body in scene.bodies.items() if body.elastic}

    def outline(self) -> Outline:
        links = {name: _to_global(self.rigid, name, axis) for name, axis in self.axes.items()}
        bars = {name: bar for name in self.scene.bodies if (bar := self._bar(name)).size}
        bars |= {f"{name} {k}": arm for name in self.axes for k, arm in enumerate(self._arms(name))}
        boxes, pins = {}, {}
        for name, joint in self.scene.joints.items():
            if joint.kind == "revolute":
                address = max(joint.addresses, key=lambda side: side.body in self.axes)
                pins[name] = self._point(address.body, self.scene.point(address))
        for name, guide in guides_of(self.scene).items():
            boxes[name] = self._box(*guide)
        return Outline(links, bars, boxes, pins)

    def _axis(self, name: str) -> np.ndarray:
        """Points along a link in its own axes, displaced, (n_times, n_points, 2)."""
        x = np.linspace(0.0, self.scene.bodies[name].length, ALONG_LINK)
        axis = np.zeros((len(self.rigid.times), ALONG_LINK, 2))
        axis[:, :, 0] = x
        if self.motion is not None:
            for k, at in enumerate(x):
                axis[:, k] += self.factor * self.motion.displacement(name, (at, 0.0))[0][:2].T
        return axis

    def _point(self, body: str, at: Place) -> np.ndarray:
        """Global position of a body's point, displaced, (n_times, 2)."""
        if body not in self.axes:
            if self.motion is None or body == "ground":
                return _rigid_point(self.rigid, body, at)
            moved = np.reshape(at, (2, 1)) + self.factor * self.motion.displacement(body, at)[0][:2]
            return BodyFrame(self.rigid, body).place(moved).T
        x, y = at
        share = x / self.scene.bodies[body].length * (ALONG_LINK - 1)
        k = min(max(int(share), 0), ALONG_LINK - 2)
        axis = self.axes[body]
        local = axis[:, k] + (share - k) * (axis[:, k + 1] - axis[:, k]) + np.array([0.0, y])
        return _to_global(self.rigid, body, local[:, None])[:, 0]

    def _bar(self, name: str) -> np.ndarray:
        """From the first used point of a rigid body to every other and back, then along the guides that it carries."""
        path = []
        if name not in self.axes:
            hub, *rest = (self._point(name, at) for at in used_points(self.scene, name))
            path = [part for tip in rest for part in (hub, tip, hub)]
        for joint, (carrier, *_) in guides_of(self.scene).items():
            if carrier.body == name:
                ends = self.fixed.guides[joint]
                path += [self._point(name, tuple(end)) for end in ends]
        return np.stack(path, axis=1) if path else np.zeros((0, 0, 2))

    def _arms(self, name: str) -> Iterator[np.ndarray]:
        """From an elastic link's axis to each used point beside it, (n_times, 2, 2)."""
        length = self.scene.bodies[name].length or 0.0
        for x, y in used_points(self.scene, name):
            foot = min(max(x, 0.0), length), 0.0
            if foot != (x, y):
                yield np.stack([self._point(name, foot), self._point(name, (x, y))], axis=1)

    def _box(self, carrier: Address, rider: Address, direction: Place) -> np.ndarray:
        """Corners of a guided body about its joint, along its guide, (n_times, 5, 2)."""
        centre = self._point(rider.body, self.scene.point(rider))
        t = BodyFrame(self.rigid, carrier.body).to_global(direction)
        t, n = t.T, normal(t).T
        size = self.fixed.size * (1.0 if carrier.body == "ground" else _CARRIED)
        corners = size * np.array(BOX) * [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
        return centre[:, None] + corners[None, :, :1] * t[:, None] + corners[None, :, 1:] * n[:, None]


def used_points(scene: Scene, body: str) -> list[Place]:
    """Points of a body that anything of the scene names, and its ends, in its axes; each place once.

    Those of joints are first, in the scene's order, then those of springs, loads, masses and sensors.
    """
    pairs = [joint.addresses for joint in scene.joints.values()] + [joint.sides for joint in scene.loose.values()]
    pairs += [spring.ends or () for spring in scene.springs.values()]
    places: list[object] = [side for pair in pairs for side in pair]
    places += [load.force_on for load in scene.forces.values()] + [mass.at for mass in scene.masses.values()]
    places += [sensor.target for sensor in scene.sensors.values() if sensor.stress is None]
    used = [scene.point(each) for each in places if isinstance(each, Address) and each.body == body]
    if body != "ground" and scene.bodies[body].length is not None:
        used += [(0.0, 0.0), (scene.bodies[body].length, 0.0)]
    return list(dict.fromkeys(used)) or [(0.0, 0.0)]


def _rigid_point(rigid: RigidMotion | Placement, body: str, at: Place) -> np.ndarray:
    """Global position of a point of the rigid mechanism, (n_times, 2)."""
    return BodyFrame(rigid, body).place(at).T


def _to_global(rigid: RigidMotion | Placement, body: str, local: np.ndarray) -> np.ndarray:
    """Points (n_times, n_points, 2) from a body's axes to global ones."""
    frame = BodyFrame(rigid, body)
    return np.transpose(frame.origin[:, None] + frame.to_global(np.transpose(local)))
