"""Outlines of a mechanism in the plane of a picture: fixed pivots and guides once, bodies and joints at any instant.

A mechanism in space is projected by :data:`kaneflex.plots.outlines.VIEW`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kaneflex.mechanism.body_frame import BodyFrame
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.plots.outlines import ALONG_LINK, BOX, STANDING, Outline, Scenery, box, seen, view_of
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address, Vector

if TYPE_CHECKING:
    from kaneflex.response.motion import Motion
    from kaneflex.scene.parts import Joint
    from kaneflex.solve.solution import Solution

_MOST = 20_000
"""Largest number of instants from which the travel along guides and the frame of the picture are found."""
_ON_LINE = 1e-6
"""Share of a guide's margin by which a point may miss its line."""
_CARRIED = 0.5
"""Share of the size of a guided body for one on a guide that moves."""
_AXIS = 0.06
"""Half the length of a joint's axis as drawn, in sizes of the mechanism."""
_PLANE = 0.5
"""Half the edge of a plane as drawn, in sizes of the mechanism."""

Rigid = RigidMotion | Placement


def scenery(solution: Solution, view: np.ndarray | None = None) -> Scenery:
    """Pivots, guides and extent of a run."""
    rigid, every = solution.rigid, len(solution.times) // _MOST + 1
    return rigid_scenery(solution.model.scene, rigid.taken(np.arange(0, len(rigid.times), every)), view)


def rigid_scenery(scene: Scene, rigid: Rigid, view: np.ndarray | None = None) -> Scenery:
    """Pivots, guides and extent of a scene over some rigid motion, or at one configuration.

    Instants at which the rigid mechanism has no place are left out. ``view``: projection, by default the scene's.
    """
    view = view_of(scene.is_spatial) if view is None else view
    lines = np.concatenate([_places(rigid, name, used_points(scene, name)) for name in ("ground", *scene.bodies)])
    lines = lines[..., np.isfinite(lines).all(axis=(0, 1))]
    swept = _in_picture(lines, view).reshape(-1, 2)
    lower, upper = swept.min(axis=0), swept.max(axis=0)
    extent = np.ptp(lines[..., 0], axis=0) if scene.is_spatial else upper - lower
    size = float(np.linalg.norm(extent)) or 1.0
    guides, all_guides = {}, guides_of(scene)
    for name, (carrier, rider, direction) in all_guides.items():
        frame = frame_of(rigid, carrier.body)
        points = frame.to_body(_places(rigid, rider.body, [scene.point(rider)])[0] - frame.origin).T
        points = points[np.isfinite(points).all(axis=1)]
        carried = [] if carrier.body == "ground" else used_points(scene, carrier.body)
        guides[name] = _travel(points, np.array(direction), (BOX[0] if len(points) > 1 else STANDING) * size, carried)
    pivots = [
        seen(np.array(scene.point(side)), view)
        for joint in scene.joints.values() if not _is_guide(joint)
        for side in joint.addresses if side.body == "ground"
    ]  # fmt: skip
    held = frozenset(name for name, (carrier, *_) in all_guides.items() if carrier.body != "ground")
    return Scenery(np.array(pivots).reshape(-1, 2), guides, size, lower, upper, view, held)


def _is_guide(joint: Joint) -> bool:
    """True for joints along whose axis a body slides; a cylindrical joint on a body that moves is drawn as a pin."""
    return joint.kind == "prismatic" or (joint.kind == "cylindrical" and joint.addresses[0].body == "ground")


def guides_of(scene: Scene) -> dict[str, tuple[Address, Address, Vector]]:
    """The side that carries each guide, the side that rides on it, and its direction; those with a clearance, too."""
    sides = {name: (joint.addresses, joint.given_axes[0]) for name, joint in scene.joints.items()
             if _is_guide(joint)}  # fmt: skip
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
    """Lines of every body as it deforms or follows those that do, enlarged, (points, 2 or 3, n_times) [m]."""
    return _Pose(motion.model.scene, motion.rigid, motion, factor).lines({})


def body_lines(scene: Scene, rigid: Rigid) -> dict[str, np.ndarray]:
    """Line of every undeformed body through the points that are used of it, (points, 2 or 3, n_times) [m]."""
    return {name: _places(rigid, name, _star(used_points(scene, name))) for name in scene.bodies}


def joint_axes(scene: Scene, rigid: Rigid, size: float) -> list[np.ndarray]:
    """Ends of the joints' axes at the first instant but those of guides, which are drawn whole, (2, 3) [m]."""
    found = []
    for joint in (joint for joint in scene.joints.values() if not _is_guide(joint)):
        first = joint.addresses[0]
        frame = frame_of(rigid, first.body)
        at = frame.place(scene.point(first))[:, 0]
        arms = [_AXIS * size * frame.to_global(axis)[:, 0] for axis in joint.given_axes]
        found += [np.array([at - arm, at + arm]) for arm in arms]
    return found


class _Pose:
    """Places of a mechanism's parts; ``motion`` is None where nothing is deformed."""

    def __init__(self, scene: Scene, rigid: Rigid, motion: Motion | None = None, factor: float = 0.0):
        self.scene, self.rigid = scene, rigid
        self.motion, self.factor = motion if factor else None, factor
        self.axes = {name: self._axis(name) for name, body in scene.bodies.items() if body.elastic}

    def lines(self, guides: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Elastic links, then rigid bodies with the guides that they carry, and arms of links by their numbers."""
        found = {name: _places(self.rigid, name, axis) for name, axis in self.axes.items()}
        for name in self.scene.bodies:
            path = [] if name in self.axes else _star([self._point(name, at) for at in used_points(self.scene, name)])
            for joint, (carrier, *_) in guides_of(self.scene).items():
                if carrier.body == name and joint in guides:
                    path += [self._point(name, tuple(end)) for end in guides[joint]]
            if len(path) > 1:
                found[f"{name} 0" if name in self.axes else name] = np.array(path)
        arms = ((f"{name} {k}", arm) for name in self.axes for k, arm in enumerate(self._arms(name), 1))
        return found | dict(arms)

    def outline(self, fixed: Scenery) -> Outline:
        lines, boxes, pins = self.lines(fixed.guides), {}, {}
        for name, joint in self.scene.joints.items():
            if joint.kind not in ("prismatic", "weld"):
                side = max(reversed(joint.addresses), key=lambda side: side.body in self.axes)
                pins[name] = self._point(side.body, self.scene.point(side))[None]
        for name, (carrier, rider, direction) in guides_of(self.scene).items():
            if name not in pins:
                t = frame_of(self.rigid, carrier.body).to_global(direction)
                size = fixed.size * (_CARRIED if name in fixed.carried else 1.0)
                boxes[name] = self._point(rider.body, self.scene.point(rider)) + box(t, size)
        lines |= self._touching(fixed)
        links = {name: lines.pop(name) for name in self.axes}
        links, bars, boxes, pins = (
            {name: _in_picture(line, fixed.view) for name, line in kind.items()} for kind in (links, lines, boxes, pins)
        )
        return Outline(links, bars, boxes, {name: place[:, 0] for name, place in pins.items()})

    def _touching(self, fixed: Scenery) -> dict[str, np.ndarray]:
        """Outlines in space of planes and cylinders beside the bodies that touch them, and of balls."""
        found: dict[str, np.ndarray] = {}
        for name, contact in self.scene.contacts.items() if self.scene.is_spatial else ():
            if contact.joint is not None:
                continue
            from kaneflex.mechanism.spatial import across

            (first, second), along, turns = contact.sides, np.array(contact.direction), np.linspace(0.0, 2 * np.pi, 33)
            middle, frame = self._point(second.body, self.scene.point(second)), frame_of(self.rigid, first.body)
            round_it = np.column_stack([np.cos(turns), np.sin(turns)])
            found[f"{name} ball"] = middle + (contact.touching * round_it @ fixed.view)[:, :, None]
            radius = 0.0 if contact.radii is None else contact.radii[1]
            if len(along) == 2:
                middle = self._point(first.body, self.scene.point(first))
                found[f"{name} other ball"] = middle + (radius * round_it @ fixed.view)[:, :, None]
                continue
            foot, start = frame.to_body(middle - frame.origin)[:, 0], np.array(self.scene.point(first))
            height = ((foot - start) @ along) * along
            if contact.kind == "point-plane":
                edges, size = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]), _PLANE * fixed.size
                foot, radius = foot - height, max(size, 2.0 * contact.touching)
            else:
                edges, foot = round_it, start + height
            outline = foot + edges @ (radius * np.array(across(along)))
            found[f"{name} plane"] = np.array([self._point(first.body, tuple(place)) for place in outline.tolist()])
        return found

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
        """Global position of a body's point, displaced, (2 or 3, n_times); for a link it lies on the line that is
        drawn."""
        if body not in self.axes:
            return np.asarray(frame_of(self.rigid, body).place(self._moved(body, at)))
        share = at[0] / (self.scene.bodies[body].length or 1.0) * (ALONG_LINK - 1)
        k, axis = min(max(int(share), 0), ALONG_LINK - 2), self.axes[body]
        local = axis[k] + (share - k) * (axis[k + 1] - axis[k]) + np.reshape((0.0, *at[1:]), (-1, 1))
        return np.asarray(frame_of(self.rigid, body).place(local))

    def _arms(self, name: str) -> Iterator[np.ndarray]:
        """From an elastic link's axis to each used point beside it, (2, 2 or 3, n_times)."""
        length = self.scene.bodies[name].length or 0.0
        for at in used_points(self.scene, name):
            foot = self.scene.vector((min(max(at[0], 0.0), length), 0.0))
            if foot != at:
                yield np.array([self._point(name, foot), self._point(name, at)])


def used_points(scene: Scene, body: str) -> list[Vector]:
    """Points of a body that anything of the scene names, and its ends, in its axes; with one alone its centre of mass.

    Those of joints are first, in the scene's order, then those of springs, loads, masses and sensors.
    """
    pairs = [joint.addresses for joint in scene.joints.values()] + [joint.sides for joint in scene.loose.values()]
    pairs += [spring.ends or () for spring in scene.springs.values()]
    places: list[object] = [side for pair in pairs for side in pair]
    places += [load.force_on for load in scene.forces.values()] + [mass.at for mass in scene.masses.values()]
    places += [sensor.target for sensor in scene.sensors.values() if sensor.stress is None]
    used = [scene.point(each) for each in places if isinstance(each, Address) and each.body == body]
    if body != "ground" and scene.bodies[body].length is not None:
        used += map(scene.vector, ((0.0, 0.0), (scene.bodies[body].length, 0.0)))
    points = list(dict.fromkeys(used)) or [scene.vector((0.0, 0.0))]
    if body != "ground" and len(points) == 1:
        points = list(dict.fromkeys([*points, scene.vector(scene.bodies[body].centre)]))
    return points


def _star(points: Sequence[Any]) -> list[Any]:
    """From the first point to every other and back."""
    hub, *rest = points
    return [hub, *(part for tip in rest for part in (tip, hub))]


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
