"""Drawing a mechanism's outline on axes in mm."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from kaneflex.plots.outlines import Outline, Scenery, aligned, name_axes
from kaneflex.plots.style import GREY, cells, new_figure, round_down, shade

MM = 1e3
ROUNDING = 1e-9
"""Coordinate of a drive [rad or m] below which it is zero."""
_MARGIN = 0.06
_HATCHES = 26
"""Number of strokes of a hatching as long as the mechanism."""
_MARKED = 4
_MARK = {"marker": "o", "markersize": 3.6, "markerfacecolor": "white", "markeredgewidth": 0.9}
_TICK = 0.03
"""Half length of a tick across an undeformed link, in lengths of the link."""


@dataclass(frozen=True, eq=False)
class Artists:
    """Artists of an outline, which move to its other instants."""

    lines: Mapping[tuple[str, str], Line2D]
    boxes: Mapping[str, Polygon]
    pins: Line2D | None

    def __iter__(self) -> Iterator[Artist]:
        yield from (*self.lines.values(), *self.boxes.values(), *(() if self.pins is None else (self.pins,)))

    def move(self, outline: Outline, k: int) -> None:
        """Show instant k of an outline with the same parts."""
        for (kind, name), line in self.lines.items():
            points = ticks(outline.links[name][k]) if kind == "ticks" else getattr(outline, kind)[name][k]
            line.set_data(*(MM * points).T)
        for name, box in self.boxes.items():
            box.set_xy(MM * outline.boxes[name][k])
        if self.pins is not None:
            self.pins.set_data(*(MM * np.array([place[k] for place in outline.pins.values()])).T)


def ticks(points: np.ndarray) -> np.ndarray:
    """Short strokes across a line (n_points, 2) at equal distances along it, as one broken line."""
    along = np.gradient(points, axis=0)[::_MARKED] * (len(points) - 1)
    across = _TICK * np.column_stack([-along[:, 1], along[:, 0]])
    at = points[::_MARKED]
    return np.stack([at - across, at + across, np.full_like(at, np.nan)], axis=1).reshape(-1, 2)


def draw_scenery(axes: Axes, fixed: Scenery, outline: Outline) -> list[np.ndarray]:
    """Draw pivots as triangles on a hatched base, and guides, in axes whose limits are final; returns the lines [mm].

    A guide on the ground has two faces at the width of the body between them; in space it is an axis, and a triad
    stands for labelled axes.
    """
    size = MM * fixed.size
    strokes: list[np.ndarray] = []
    others: list[np.ndarray] = []
    for pivot in MM * fixed.pivots:
        triangle = pivot + size * np.array([(0.0, 0.0), (-0.022, -0.04), (0.022, -0.04)])
        axes.add_patch(Polygon(triangle, facecolor="white", edgecolor="black", linewidth=0.9, zorder=1.5))
        others.append(triangle[[1, 0, 2]])
        strokes += hatched(pivot + size * np.array([(-0.0396, -0.04), (0.0396, -0.04)]), size, below=True)
    # cylinders that share a bore are drawn once
    rails = {tuple(np.round(ends.ravel() / fixed.size * 1e6)): name for name, ends in reversed(fixed.rails.items())}
    for name in reversed(rails.values()):
        ends = MM * fixed.rails[name]
        if not fixed.flat:
            axes.plot(*ends.T, color=GREY, linewidth=1.0, linestyle="-.", zorder=1)
            others.append(ends)
            continue
        box = outline.boxes[name][0]
        across = 0.5 * MM * (box[0] - box[3])
        for face in (ends + across, ends[::-1] - across):
            strokes += hatched(face, size, below=False)
    axes.add_collection(LineCollection(strokes, colors="black", linewidths=0.8, zorder=1))
    axes.set_aspect("equal")
    axes.grid(False)
    name_axes(axes, fixed.view, "{} [mm]")
    return strokes + others + ([] if aligned(fixed.view) else draw_triad(axes, fixed.view))


def draw_triad(axes: Axes, view: np.ndarray, unit: str = "mm") -> list[np.ndarray]:
    """The global axes and a bar as long as it says, below at the left of axes whose limits are final; their lines."""
    axes.set(xticks=[], yticks=[])
    axes.spines[["left", "bottom"]].set_visible(False)
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    reach = 0.07 * max(right - left, high - low)
    origin = np.array([left + 1.2 * reach, low + 1.6 * reach])
    for name, tip in zip("xyz", view.T, strict=True):
        end = origin + reach * tip
        style: dict[str, Any] = {"arrowstyle": "-|>", "linewidth": 0.9, "mutation_scale": 8, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", xy=tuple(end), xytext=tuple(origin), arrowprops=style, zorder=5)
        axes.annotate(name, tuple(origin + 1.3 * reach * tip), ha="center", va="center", fontsize=8, zorder=5)
    length = round_down(0.25 * max(right - left, high - low))
    ends = left + 0.4 * reach + np.array([0.0, length])
    level = np.full(2, low + 0.35 * reach)
    axes.plot(ends, level, "|-", color="black", linewidth=1.2, markersize=6)
    beside: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": 8}
    axes.annotate(f"{length:g} {unit}", (ends[1], level[0]), (4, 0), **beside)
    return [*(np.array([origin, origin + 1.3 * reach * tip]) for tip in view.T), np.column_stack([ends, level])]


def hatched(face: np.ndarray, size: float, below: bool) -> list[np.ndarray]:
    """A line and the slanted strokes behind it: on the left of its direction, or on the right."""
    start, end = face
    length = float(np.hypot(*(end - start)))
    t = (end - start) / length
    n = np.array([t[1], -t[0]]) if below else np.array([-t[1], t[0]])
    stroke = 0.018 * size
    roots = np.arange(0.5, length / size * _HATCHES * (2 if below else 1)) / (_HATCHES * (2 if below else 1)) * size
    return [face, *(np.array([start + root * t, start + root * t + stroke * (n - t)]) for root in roots)]


def draw_outline(
    axes: Axes, outline: Outline, k: int, colour: str = "#0072B2", ghost: bool = False, links_only: bool = False
) -> Artists:
    """One instant of an outline: elastic links in colour, rigid bodies black; a ghost all pale and thin."""
    body = GREY if ghost else "black"
    lines: dict[tuple[str, str], Line2D] = {}
    boxes: dict[str, Polygon] = {}
    pins = None
    below = -1.0 if ghost or links_only else 0.0
    if not links_only:
        for name, corners in outline.boxes.items():
            boxes[name] = Polygon(
                MM * corners[k], facecolor="none" if ghost else shade(GREY, 0.7), edgecolor=body,
                linewidth=0.7 if ghost else 1.1, zorder=2.0 + below,
            )  # fmt: skip
            axes.add_patch(boxes[name])
        for name, points in outline.bars.items():
            width = 0.9 if ghost else 3.0
            lines["bars", name] = _line(axes, points[k], body, width, 3.0 + below)
    for name, points in outline.links.items():
        width = 0.9 if ghost else 1.4 if links_only else 2.4
        line = lines["links", name] = _line(axes, points[k], body if ghost else colour, width, 3.2 + below)
        if not links_only:  # marks at equal distances show the longitudinal displacement
            if ghost:
                lines["ticks", name] = _line(axes, ticks(points[k]), GREY, 0.8, 3.2 + below)
            else:
                line.set(markevery=_MARKED, **_MARK, markeredgecolor=colour)
    if not ghost and not links_only and outline.pins:
        places = MM * np.array([place[k] for place in outline.pins.values()])
        style: dict[str, Any] = {"marker": "o", "markersize": 5, "markerfacecolor": "white", "markeredgecolor": "black"}
        pins = axes.plot(*places.T, linestyle="none", zorder=4.0, **style)[0]
    return Artists(lines, boxes, pins)


def _line(axes: Axes, points: np.ndarray, colour, width: float, zorder: float) -> Line2D:
    style: dict[str, Any] = {"solid_capstyle": "round", "solid_joinstyle": "round", "zorder": zorder}
    return axes.plot(*(MM * points).T, color=colour, linewidth=width, **style)[0]


def frame_axes(
    axes: Axes, outlines: list[Outline], fixed: Scenery, room: float = _MARGIN, swept: bool = True
) -> tuple[float, float]:
    """Limits that hold every instant of the outlines and the region that a run sweeps; their width and height [mm].

    ``room`` is left free around them, in sizes of the mechanism. Without ``swept`` only guides on the ground are held
    beside the outlines.
    """
    parts = [fixed.pivots - [0, 0.07 * fixed.size]]
    parts += [fixed.lower, fixed.upper] if swept else [*fixed.rails.values()]
    for outline in outlines:
        parts += [*outline.links.values(), *outline.bars.values(), *outline.boxes.values()]
    points = np.concatenate([part.reshape(-1, 2) for part in parts])
    points = points[np.isfinite(points).all(axis=1)]  # at some instants the rigid mechanism may have no place
    if not len(points):  # of a lone body
        points = np.array([fixed.lower, fixed.upper])
    margin = room * fixed.size
    lower, upper = MM * (points.min(axis=0) - margin), MM * (points.max(axis=0) + margin)
    if not aligned(fixed.view):  # the triad stands at the left
        lower[0] -= 0.18 * (upper - lower).max()
    axes.set_xlim(lower[0], upper[0])
    axes.set_ylim(lower[1], upper[1])
    return float(upper[0] - lower[0]), float(upper[1] - lower[1])


def small_drawings(count: int, outlines: list[Outline], fixed: Scenery) -> tuple[Figure, list[Axes]]:
    """A figure of drawings of one size, side by side or one above the other, whichever suits the mechanism's shape."""
    width, height = frame_axes(Figure().subplots(), outlines, fixed, swept=False)
    columns = min(count, 2 if width > 1.2 * height else 3)
    rows = -(-count // columns)
    panel = min(9.0 / columns, 4.4)
    figure = new_figure(panel * columns + 0.4, (panel * height / width + 0.35) * rows + 1.0, "")
    return figure, cells(figure, rows, columns, count, sharex=True, sharey=True)
