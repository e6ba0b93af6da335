"""Names beside the things they name, without covering lines or each other."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.text import Text
from matplotlib.transforms import Bbox

_DISTANCES = np.array([7.0, 9.0, 12.0, 17.0, 24.0, 33.0, 45.0, 60.0])
"""Distances of a label's box from its point, in points (1/72 inch)."""
_UNITS = np.array([(np.cos(turn), np.sin(turn)) for turn in np.radians(np.arange(0.0, 360.0, 22.5))])
"""Directions in which a label may lie from its point."""
_STEP = 4.0
"""Distance of the samples along a line that labels keep clear of, in pixels."""
_LEADER = 20.0
"""From this distance on a thin line leads from the label to its point, in points."""


@dataclass(frozen=True)
class _Label:
    text: Text
    at: np.ndarray


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
        self._labels: list[_Label] = []
        self._lines = list(lines)

    def add(self, text: str, at: np.ndarray, colour: str, **font: Any) -> None:
        """A label of the point ``at`` (data coordinates)."""
        artist = self.axes.text(0.0, 0.0, text, color=colour, ha="center", va="center", zorder=6, **font)
        self._labels.append(_Label(artist, np.asarray(at, dtype=float)))

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
        for label in self._labels:
            box = label.text.get_window_extent(renderer)
            half = np.array([box.width, box.height]) / 2.0
            at = self.axes.transData.transform(label.at)
            centre, distance = self._best(at, half, scale, obstacles, taken, frame)
            taken.append(Bbox([centre - half, centre + half]))
            inverse = self.axes.transData.inverted()
            label.text.set_position(inverse.transform(centre))
            if distance >= _LEADER:
                ends = inverse.transform(np.array([at, np.clip(at, centre - half, centre + half)]))
                self.axes.plot(*ends.T, color=label.text.get_color(), linewidth=0.5, zorder=3.5)

    def _obstacles(self) -> np.ndarray:
        """Samples of all lines and the labelled points, in pixels."""
        samples = [self.axes.transData.transform(label.at)[None] for label in self._labels]
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
