"""The mechanism at its worst instant, its deformation enlarged, elastic links coloured by their stress."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.animation import caption_at, enlargement, title
from kaneflex.plots.drawing import MM, draw_guides, draw_outline, draw_scenery, frame_axes
from kaneflex.plots.mechanism import grounded, outline, rigid_outline, scenery
from kaneflex.plots.stress_lines import StressLines
from kaneflex.plots.style import GREY, new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.support.escaping import picture_text

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_MARGINS = (0.8, 1.1, 0.55, 0.7)
"""Left, right (the bar of colours), below and above the axes [inches]."""
_WIDTH, _MOST = 6.2, 5.2
"""Width of the axes and their greatest height [inches]."""


class _Worst(NamedTuple):
    """The instant to draw, and a sentence on why."""

    instant: int
    reason: str


def figures(solution: Solution) -> dict[str, Figure]:
    """``mechanism``: at the instant of the largest stress; where none is known, of the largest displacement."""
    worst = _worst(solution)
    shown = View(solution, np.array([worst.instant]))
    factor = enlargement(shown) if solution.model.links else None
    figure = new_figure(8.1, 6.0, "", layout="none")
    axes, lines = (_in_space if solution.model.scene.is_spatial else _in_plane)(figure, shown, factor)
    _colour(figure, axes, solution, worst.instant, lines)
    figure.suptitle(title(factor))
    axes.set_title(f"{caption_at(shown, 0)}{worst.reason}")
    return {"mechanism": figure}


def _worst(solution: Solution) -> _Worst:
    stresses = solution.stresses
    if stresses:
        name = max(stresses, key=lambda each: float(stresses[each].mises.max()))
        station, instant = stresses[name].largest
        factor, unit = readable("Pa", stresses[name].mises)
        largest = factor * float(stresses[name].mises[station, instant])
        place = f"{picture_text(name)} at {MM * stresses[name].x[station]:.4g} mm"
        return _Worst(instant, f": largest stress of the run, {largest:.3g} {unit} in {place}")
    links = solution.model.links
    if not links:
        return _Worst(0, "")
    shown, vector = view(solution), solution.model.scene.vector
    moved = [shown.motion.displacement(name, vector((float(x), 0.0)))[0][: len(vector((0.0, 0.0)))]
             for name, link in links.items() for x in link.nodes]  # fmt: skip
    sizes = np.linalg.norm(moved, axis=1).max(axis=0)
    return _Worst(int(shown.instants[sizes.argmax()]), ": largest displacement of what is shown")


def _in_plane(figure: Figure, shown: View, factor: float | None) -> tuple[Axes, dict[str, np.ndarray]]:
    """The drawing with the ground, the rigid mechanism pale; its axes and the links' lines [mm]."""
    scene, fixed = shown.solution.model.scene, scenery(shown.solution.model)
    still = rigid_outline(scene, shown.rigid, fixed)
    moved = outline(shown.motion, fixed, factor or 0.0)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    width, height = frame_axes(axes, [still, moved], fixed)
    left, right, below, above = _MARGINS
    tall = min(_MOST, _WIDTH * height / width)
    size = np.array([_WIDTH + left + right, tall + below + above])
    figure.set_size_inches(*size)
    axes.set_position((left / size[0], below / size[1], _WIDTH / size[0], tall / size[1]))
    draw_scenery(axes, fixed)
    draw_guides(axes, fixed, grounded(scene), still)
    if factor is not None:
        draw_outline(axes, still, 0, ghost=True)
    draw_outline(axes, moved, 0)
    return axes, {name: MM * points[0] for name, points in moved.links.items()}


def _in_space(figure: Figure, shown: View, factor: float | None) -> tuple[Axes, dict[str, np.ndarray]]:
    from kaneflex.plots.spatial import body_lines, deformed_lines, frame_box

    axes = figure.add_axes((0.0, 0.0, 0.86, 0.88), projection="3d")
    still = body_lines(shown.solution.model.scene, shown.rigid)
    moved = deformed_lines(shown.motion, factor) if factor is not None else still
    frame_box(axes, [MM * points for points in (*still.values(), *moved.values())])
    links, coloured = shown.solution.model.links, shown.solution.stresses
    rigid: dict[str, Any] = {"color": "black", "linewidth": 3.0, "marker": "o", "markersize": 3.5}
    for name, points in moved.items():
        if factor is not None:
            axes.plot(*(MM * still[name][:, :, 0]).T, color=GREY, linewidth=0.9)
        if name not in coloured:
            axes.plot(*(MM * points[:, :, 0]).T, **({"color": "#0072B2", "linewidth": 2.4} if name in links else rigid))
    return axes, {name: MM * moved[name][:, :, 0] for name in links}


def _colour(figure: Figure, axes: Axes, solution: Solution, instant: int, lines: dict[str, np.ndarray]) -> None:
    """Colour the links' lines (n_points, 2 or 3) by the largest stress of von Mises of each section, with a bar."""
    if not solution.stresses.keys() & lines.keys():
        return
    coloured = StressLines(axes, solution, {name: each[None] for name, each in lines.items()}, np.array([instant]))
    width = figure.get_size_inches()[0]
    bar = figure.add_axes((1.0 - 0.85 / width, 0.2, 0.16 / width, 0.6))
    bar.set_title("von Mises")
    figure.colorbar(coloured.artist, cax=bar, label=f"stress [{coloured.unit}]")
