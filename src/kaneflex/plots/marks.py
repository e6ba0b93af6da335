"""Names and sensors in a drawing of a scene at one configuration.

Names stand beside the things they name, without covering lines or each other; sensors are diamonds with numbers.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.plots.drawing import MM
from kaneflex.plots.mechanism import Rigid, frame_of
from kaneflex.plots.outlines import view_of
from kaneflex.plots.style import PALETTE
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import CONTACT_KINDS, FRICTION_KINDS, SPRING_KINDS, Sensor

SENSOR = PALETTE[2]
_LINE = 44
"""Characters in a line of the list of sensors."""
_DISTANCES = np.array([7.0, 9.0, 12.0, 17.0, 24.0, 33.0, 45.0, 60.0])
"""Distances of a label's box from its point, in points (1/72 inch)."""
_UNITS = np.array([(np.cos(turn), np.sin(turn)) for turn in np.radians(np.arange(0.0, 360.0, 22.5))])
"""Directions in which a label may lie from its point."""
_STEP = 4.0
"""Distance of the samples along a line that labels keep clear of, in pixels."""
_LEADER = 20.0
"""From this distance on a thin line leads from the label to its point, in points."""


class PlacedScene:
    """A scene in the plane at a placement, or in space at the first instant of a motion."""

    def __init__(self, scene: Scene, placed: Rigid) -> None:
        self.scene, self.placed = scene, placed
        self.view = view_of(scene.is_spatial)

    @property
    def drives(self) -> Mapping[str, float]:
        """Coordinates of the drives that have one [rad or m]."""
        if isinstance(self.placed, Placement):
            return self.placed.drives
        known = [name for name in self.scene.drives if f"{name}.angle" in self.placed]
        return {name: float(self.placed[f"{name}.angle"][0]) for name in known}

    def point(self, body: str, at: Any) -> np.ndarray:
        """Place in the drawing of a point in a body's axes [mm], (2,)."""
        return MM * self.view @ frame_of(self.placed, body).place(at)[:, 0]

    def at(self, address: Address) -> np.ndarray:
        """Place in the drawing of an address [mm], (2,)."""
        return self.point(address.body, self.scene.point(address))

    def direction(self, body: str, vector: Any) -> np.ndarray:
        """A vector in a body's axes as it is drawn, (2,); shorter where it points to or from the viewer."""
        return self.view @ frame_of(self.placed, body).to_global(np.reshape(vector, (-1, 1)))[:, 0]

    def around(self, joint: str, turn: np.ndarray) -> np.ndarray:
        """Points at angles [rad] of the unit circle around a joint's axis, as they are drawn, (n, 2)."""
        first, axes = self.scene.joints[joint].addresses[0].body, self.scene.joints[joint].given_axes
        if len(self.view.T) == 2:
            return np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        axis = np.array(axes[-1] if axes else (0.0, 0.0, 1.0))
        helper = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        one = helper / np.linalg.norm(helper)
        other = np.cross(axis / np.linalg.norm(axis), one)
        drawn = [self.direction(first if axes else GROUND, tuple(each)) for each in (one, other)]
        return np.outer(np.cos(turn), drawn[0]) + np.outer(np.sin(turn), drawn[1])


class Labels:
    """Labels that are collected first and placed together, each where it covers least.

    Parameters
    ----------
    axes : Axes
        With its limits and position final.
    lines : iterable of ndarray (n, 2)
        Polylines in data coordinates that labels keep clear of.
    """

    def __init__(self, axes: Axes, lines: Iterable[np.ndarray]):
        self.axes = axes
        self._labels: list[tuple[Text, np.ndarray]] = []
        self._lines = list(lines)

    def add(self, text: str, at: np.ndarray, colour: str, **font: Any) -> None:
        """A label of the point ``at`` (data coordinates)."""
        artist = self.axes.text(0.0, 0.0, text, color=colour, ha="center", va="center", zorder=6, **font)
        self._labels.append((artist, np.asarray(at, dtype=float)))

    def block(self, line: np.ndarray) -> None:
        """Keep clear of one more polyline."""
        self._lines.append(line)

    def place(self) -> None:
        """Place all labels, in the order in which they were added."""
        figure = self.axes.figure
        renderer = figure.canvas.get_renderer()
        scale = figure.dpi / 72.0
        obstacles = self._obstacles()
        frame = self.axes.get_window_extent(renderer)
        taken: list[Bbox] = []
        for text, place in self._labels:
            box = text.get_window_extent(renderer)
            half = np.array([box.width, box.height]) / 2.0
            at = self.axes.transData.transform(place)
            centre, distance = self._best(at, half, scale, obstacles, taken, frame)
            taken.append(Bbox([centre - half, centre + half]))
            inverse = self.axes.transData.inverted()
            text.set_position(inverse.transform(centre))
            if distance >= _LEADER:
                ends = inverse.transform(np.array([at, np.clip(at, centre - half, centre + half)]))
                self.axes.plot(*ends.T, color=text.get_color(), linewidth=0.5, zorder=3.5)

    def _obstacles(self) -> np.ndarray:
        """Samples of all lines and the labelled points, in pixels."""
        samples = [self.axes.transData.transform(place)[None] for _, place in self._labels]
        for line in self._lines:
            ends = self.axes.transData.transform(line)
            for start, end in pairwise(ends):
                count = max(2, int(np.hypot(*(end - start)) / _STEP))
                samples.append(np.linspace(start, end, count))
        return np.concatenate(samples) if samples else np.zeros((0, 2))

    def _best(self, at, half, scale: float, obstacles, taken: list[Bbox], frame: Bbox) -> tuple[np.ndarray, float]:
        """Centre of the candidate box that covers least, and its distance from the point."""
        # The box touches the circle of that radius from outside.
        beside = np.sign(np.round(_UNITS, 6)) * np.minimum(half, half * abs(_UNITS) * 1.5)
        centres = at + _DISTANCES[:, None, None] * scale * _UNITS + beside
        low, high = centres - half - 1.5, centres + half + 1.5
        near = obstacles[((obstacles > low.min((0, 1))) & (obstacles < high.max((0, 1)))).all(axis=-1)]
        boxes = np.array([box.get_points() for box in taken]).reshape(-1, 2, 2)
        outside = ((low <= frame.min) | (high >= frame.max)).any(axis=-1)
        cost = _hit(low, high, near, near) + 30.0 * _hit(low, high, boxes[:, 0], boxes[:, 1]) + 100.0 * outside
        cost += 0.02 * _DISTANCES[:, None]
        ring, way = np.unravel_index(int(np.round(cost, 8).argmin()), cost.shape)  # the nearest of equal ones
        return centres[ring, way], float(_DISTANCES[ring])


def _hit(low: np.ndarray, high: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Number of the boxes or points (n, 2) that each box of an array (..., 2) meets."""
    meets = (low[..., None, :] < upper) & (high[..., None, :] > lower)
    return np.count_nonzero(meets[..., 0] & meets[..., 1], axis=-1)


def sensors_by_place(pose: PlacedScene) -> list[tuple[str, np.ndarray, list[str]]]:
    """Places at which sensors measure: (address or joint, place [mm], names), in the scene's order."""
    found: dict[str, tuple[np.ndarray, list[str]]] = {}
    for name, sensor in pose.scene.sensors.items():
        key, ends = _measured_at(pose.scene, sensor)
        found.setdefault(key, (np.mean([pose.at(end) for end in ends], axis=0), []))[1].append(name)
    return [(key, at, names) for key, (at, names) in found.items()]


def _measured_at(scene: Scene, sensor: Sensor) -> tuple[str, Sequence[Address]]:
    """Key of the place of a sensor, and the points in the middle of which it lies."""
    target = sensor.target
    if sensor.kind in SPRING_KINDS:
        spring = scene.springs[str(target)]
        return f"spring {target}", spring.ends or scene.joints[str(spring.torsional_at)].addresses
    if sensor.stress is not None:  # modal data don't say where it is
        return f"stress {target}", (Address(sensor.stress.body, "mid"),)
    if sensor.kind in (*CONTACT_KINDS, *FRICTION_KINDS) and str(target) in scene.contacts:
        return f"contact {target}", scene.contacts[str(target)].sides[1:]
    if isinstance(target, Address) and target.body in scene.loose:
        return target.body, scene.loose[target.body].sides[1:]
    joint = target if isinstance(target, str) else target.body
    if isinstance(target, Address) and joint not in scene.joints:
        return str(target), (target,)
    return joint, scene.joints[joint].addresses[1:]


def mark_sensors(axes: Axes, labels: Labels, sensors: list[tuple[str, np.ndarray, list[str]]]) -> None:
    """A diamond at every place and the numbers of its entries in the list."""
    numbers: dict[tuple[float, ...], list[str]] = {}
    for k, (_, at, _) in enumerate(sensors, 1):
        numbers.setdefault(tuple(np.round(at, 6)), []).append(str(k))
    for at, here in numbers.items():
        axes.plot(*at, marker="D", markersize=5.5, color=SENSOR, markeredgecolor="white", zorder=5)
        labels.add(", ".join(here), np.array(at), SENSOR, weight="bold", size=8)


def listed(sensors: list[tuple[str, np.ndarray, list[str]]]) -> str:
    """The sensors by number, in lines."""
    lines = ["sensors"] if sensors else []
    for k, (place, _, names) in enumerate(sensors, 1):
        lines += wrap(f"{k}  {place}: {', '.join(names)}", _LINE, subsequent_indent="    ")
    return "\n".join(lines)
