"""Outlines of a mechanism in the plane of a picture: fixed pivots and guides once, bodies and joints at any instant.

A mechanism in space is projected by :data:`kaneflex.plots.axonometric.VIEW`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.mechanism.body_frame import BodyFrame, normal
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.plots.axonometric import GUIDES, block, lines_size, outline_points, seen, view_of
from kaneflex.plots.outlines import ALONG_LINK, BOX, STANDING, Outline, Scenery
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address, Vector

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

Rigid = RigidMotion | Placement


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


def rigid_scenery(scene: Scene, rigid: Rigid) -> Scenery:
    """Pivots, guides and extent of a scene over some rigid motion, or at one configuration."""
    space, view = scene.is_spatial, view_of(scene)
    lines = {name: _places(rigid, name, outline_points(scene, name) if space else used_points(scene, name))
             for name in (*("ground",)[space:], *scene.bodies)}  # fmt: skip
    swept = np.concatenate([_in_picture(line, view).reshape(-1, 2) for line in lines.values()])
    swept = swept[np.isfinite(swept).all(axis=1)]
    lower, upper = swept.min(axis=0), swept.max(axis=0)
    size = lines_size(scene, lines) if space else float(np.hypot(*(upper - lower))) or 1.0
    guides, all_guides = {}, guides_of(scene)
    for name, (carrier, rider, direction) in all_guides.items():
        frame = frame_of(rigid, carrier.body)
        points = frame.to_body(_places(rigid, rider.body, [scene.point(rider)])[0] - frame.origin).T
        carried = [] if space or carrier.body == "ground" else used_points(scene, carrier.body)
        ends = _travel(points, np.array(direction), (BOX[0] if len(points) > 1 else STANDING) * size, carried)
        guides[name] = seen(_places(rigid, carrier.body, ends)[..., 0], view) if space else ends
    pivots = [
        seen(np.array(scene.point(side)), view)
        for joint in scene.joints.values() if joint.kind not in GUIDES
        for side in joint.addresses if side.body == "ground"
    ]  # fmt: skip
    held = [name for name, (carrier, *_) in all_guides.items() if carrier.body != "ground" and not space]
    at = np.array(pivots).reshape(-1, 2)
    return Scenery(at, guides, size, lower, upper, view if space else None, frozenset(held))


def guides_of(scene: Scene) -> dict[str, tuple[Address, Address, Vector]]:
    """The side that carries each guide, the side that rides on it, and its direction; those with a clearance, too."""
    sides = {name: (joint.addresses, joint.given_axes[0]) for name, joint in scene.joints.items()
             if joint.kind in GUIDES}  # fmt: skip
    sides |= {name: (joint.sides, joint.direction) for name, joint in scene.loose.items() if joint.direction}
    return {name: (*pair, direction) for name, (pair, direction) in sides.items()}


def _travel(points: np.ndarray, direction: np.ndarray, margin: float, carried: list[Vector]) -> np.ndarray:
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
    return _Pose(motion.model.scene, motion.rigid, motion, factor).outline(fixed)


def rigid_outline(scene: Scene, rigid: Rigid, fixed: Scenery) -> Outline:
    """The undeformed mechanism at the times of a rigid motion, or at one configuration."""
    return _Pose(scene, rigid).outline(fixed)


def deformed_lines(motion: Motion, factor: float) -> dict[str, np.ndarray]:
    """Line of every body in space as it deforms or follows those that do, enlarged, (points, 3, n_times) [m]."""
    return _Pose(motion.model.scene, motion.rigid, motion, factor).lines


class _Pose:
    """Places of a mechanism's parts; ``motion`` is None where nothing is deformed."""

    def __init__(self, scene: Scene, rigid: Rigid, motion: Motion | None = None, factor: float = 0.0):
        self.scene, self.rigid, self.space = scene, rigid, scene.is_spatial
        self.motion, self.factor = motion if factor else None, factor
        self.axes = {name: self._axis(name) for name, body in scene.bodies.items() if body.elastic}
        self.lines = {name: _places(rigid, name, axis) for name, axis in self.axes.items()}
        if self.space:
            self.lines |= {name: np.array([self._point(name, at) for at in outline_points(scene, name)])
                           for name in scene.bodies if name not in self.axes}  # fmt: skip

    def outline(self, fixed: Scenery) -> Outline:
        links = {name: self.lines[name] for name in self.axes}
        bars = {name: line for name, line in self.lines.items() if name not in links}
        boxes, pins = {}, {}
        if not self.space:
            bars = {name: np.array(bar) for name in self.scene.bodies if (bar := self._bar(name, fixed))}
            bars |= {f"{name} {k}": arm for name in self.axes for k, arm in enumerate(self._arms(name))}
        for name, joint in self.scene.joints.items():
            if joint.kind != "prismatic" and (self.space or joint.kind == "revolute"):
                side = max(reversed(joint.addresses), key=lambda side: side.body in self.axes)
                pins[name] = self._point(side.body, self.scene.point(side))[None]
        for name, guide in guides_of(self.scene).items():
            if name not in pins:
                boxes[name] = self._box(*guide, fixed.size)
        view = view_of(self.scene)
        links, bars, boxes = (
            {name: _in_picture(line, view) for name, line in kind.items()} for kind in (links, bars, boxes)
        )
        return Outline(links, bars, boxes, {name: _in_picture(place, view)[:, 0] for name, place in pins.items()})

    def _axis(self, name: str) -> np.ndarray:
        """Points along a link in its own axes, displaced, (n_points, 2 or 3, n_times)."""
        length = self.scene.bodies[name].length or 0.0
        return np.array([self._moved(name, self.scene.vector((x, 0.0)))
                         for x in np.linspace(0.0, length, ALONG_LINK).tolist()])  # fmt: skip

    def _moved(self, body: str, at: Vector) -> np.ndarray:
        """A body's point in its axes, displaced, (2 or 3, n_times)."""
        place = np.repeat(np.reshape(at, (-1, 1)), len(self.rigid.times), axis=1)
        if self.motion is None or body == "ground":
            return place
        return place + self.factor * self.motion.displacement(body, at)[0][: len(at)]

    def _point(self, body: str, at: Vector) -> np.ndarray:
        """Global position of a body's point, displaced, (2 or 3, n_times); of a link's on the line that is drawn."""
        if body not in self.axes:
            return np.asarray(frame_of(self.rigid, body).place(self._moved(body, at)))
        share = at[0] / (self.scene.bodies[body].length or 1.0) * (ALONG_LINK - 1)
        k, axis = min(max(int(share), 0), ALONG_LINK - 2), self.axes[body]
        local = axis[k] + (share - k) * (axis[k + 1] - axis[k]) + np.reshape((0.0, *at[1:]), (-1, 1))
        return np.asarray(frame_of(self.rigid, body).place(local))

    def _bar(self, name: str, fixed: Scenery) -> list[np.ndarray]:
        """From the first used point of a rigid body to every other and back, then along the guides that it carries."""
        path = list[np.ndarray]()
        if name not in self.axes:
            hub, *rest = (self._point(name, at) for at in used_points(self.scene, name))
            path = [part for tip in rest for part in (hub, tip, hub)]
        for joint, (carrier, *_) in guides_of(self.scene).items():
            if carrier.body == name:
                path += [self._point(name, tuple(end)) for end in fixed.guides[joint]]
        return path

    def _arms(self, name: str) -> Iterator[np.ndarray]:
        """From an elastic link's axis to each used point beside it, (2, 2, n_times)."""
        length = self.scene.bodies[name].length or 0.0
        for x, y in used_points(self.scene, name):
            foot = min(max(x, 0.0), length), 0.0
            if foot != (x, y):
                yield np.array([self._point(name, foot), self._point(name, (x, y))])

    def _box(self, carrier: Address, rider: Address, direction: Vector, size: float) -> np.ndarray:
        """Corners of a guided body about its joint, along its guide, (n_corners, 2 or 3, n_times)."""
        side = max(rider, carrier, key=lambda side: side.body in self.axes) if self.space else rider
        centre = self._point(side.body, self.scene.point(side))
        t = frame_of(self.rigid, carrier.body).to_global(direction)
        if self.space:
            return block(centre, t, size)
        corners = np.array(BOX) * [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
        corners *= size * (1.0 if carrier.body == "ground" else _CARRIED)
        return centre + corners[:, :1, None] * t + corners[:, 1:, None] * normal(t)


def used_points(scene: Scene, body: str) -> list[Vector]:
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


def _in_picture(line: np.ndarray, view: np.ndarray) -> np.ndarray:
    """Points (n_points, 2 or 3, n_times) in the picture, (n_times, n_points, 2)."""
    return seen(line.transpose(2, 0, 1), view)


def frame_of(rigid: Rigid, body: str) -> Any:
    """Axes of a body over a rigid motion, or at one configuration."""
    return BodyFrame(rigid, body) if isinstance(rigid, Placement) else rigid.frame(body)


def _places(rigid: Rigid, body: str, points: Sequence[Vector] | np.ndarray) -> np.ndarray:
    """Global positions of points in a body's axes, (n_points, 2 or 3, n_times)."""
    frame = frame_of(rigid, body)
    return np.array([frame.place(at) for at in points])
