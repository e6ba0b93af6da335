"""Motion of a mechanism in space, and velocities of its points: seen along the three axes and at an angle."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.plots.drawing import MM, draw_triad
from kaneflex.plots.mechanism import body_lines, joint_axes, scenery
from kaneflex.plots.outlines import FLAT, VIEW, label_flat, seen
from kaneflex.plots.paths import curve, dotted, read_points, velocity
from kaneflex.plots.style import PALETTE, legend_beside, new_figure, readable
from kaneflex.plots.view import view

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_GHOSTS = 9
"""Instants at which the mechanism is drawn pale beside its first."""
_STILL = 1e-8
"""Travel of a point, in sizes of the mechanism, below which it counts as fixed."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``motion``: the mechanism at first, pale at later instants, and the paths of points whose places sensors read."""
    shown, scene = view(solution), solution.model.scene
    lines, tracks = body_lines(scene, shown.rigid), _tracks(solution)
    figure = new_figure(8.6, 7.0, f"{scene.name}: rigid motion{shown.note}")
    ghosts = np.unique(np.linspace(0, shown.times.size - 1, _GHOSTS).round().astype(int))[1:].tolist()
    for axes, projection in _views(figure, "{} [mm]"):

        def draw(points: np.ndarray, axes=axes, projection=projection, **style) -> None:
            axes.plot(*(MM * seen(points, projection)).T, **style)

        for k, (name, points) in enumerate(lines.items()):
            style = {"color": PALETTE[k % len(PALETTE)], "linestyle": "-" if k < len(PALETTE) else (0, (2, 1))}
            for ghost in ghosts:
                draw(points[:, :, ghost], alpha=0.22, linewidth=1.0, **style)
            label = name if len(points) > 1 else None  # a dot where a line ends needs no name
            draw(points[:, :, 0], marker="o", markersize=3.5, linewidth=2.2, label=label, **style)
        for ends in joint_axes(scene, shown.rigid, scenery(solution).size):
            draw(ends, color="0.35", linestyle="-.", linewidth=0.9)
        for name, track in tracks.items():
            draw(track.T, color="0.1", linewidth=0.8, label=f"path of {name}")
    _finish(figure, "mm")
    return {"motion": figure}


def hodographs(solution: Solution) -> dict[str, Figure]:
    """``hodographs``: velocities from one origin, of the points of bodies whose motion sensors read and that move."""
    shown, scene = view(solution), solution.model.scene
    still = _STILL * spatial_mechanism_of(scene).size / float(np.ptp(shown.times))
    found = {str(point): velocity(shown, point) for point in read_points(scene)}
    found = {name: values for name, values in found.items() if abs(values).max() > still}
    found = dict(list(found.items())[: len(PALETTE)])
    if not found:
        return {}
    factor, unit = readable("m/s", *found.values())
    heading = f"Hodographs, velocity vectors from one origin, starting at the ring, {dotted(shown)}{shown.note}"
    figure = new_figure(8.6, 7.0, heading)
    for axes, projection in _views(figure, f"v_{{}} [{unit}]"):
        for (name, velocities), colour in zip(found.items(), PALETTE, strict=False):
            curve(axes, shown, factor * seen(velocities.T, projection).T, colour, name)
        axes.plot(0.0, 0.0, "+", color="black", markersize=9)
    _finish(figure, unit)
    return {"hodographs": figure}


def _finish(figure: Figure, unit: str) -> None:
    """Names beside the views, and the axes of the one at an angle."""
    legend_beside(figure.axes[1])
    figure.draw_without_rendering()  # limits with equal scales are known only then
    draw_triad(figure.axes[-1], VIEW, unit)


def _views(figure: Figure, label: str) -> Iterator[tuple[Axes, np.ndarray]]:
    """Axes of the three views along an axis and of the one at an angle, with their projections (2, 3).

    ``label`` names an axis, with braces for x, y or z.
    """
    for place, (title, flat) in enumerate(FLAT.items(), 1):
        axes = figure.add_subplot(2, 2, place, title=title)
        label_flat(axes, flat, label)
        yield axes, flat
    axes = figure.add_subplot(2, 2, 4, title="at an angle")
    axes.set_aspect("equal", adjustable="datalim")
    axes.grid(False)
    axes.margins(0.12)
    yield axes, VIEW


def _tracks(solution: Solution) -> dict[str, np.ndarray]:
    """Paths of the points whose places sensors read, (3, times) [m]."""
    scene, rigid = solution.model.scene, solution.motion.rigid
    places = [sensor.position for sensor in scene.sensors.values() if sensor.position is not None]
    points = [place for place in dict.fromkeys(places) if place.body in scene.bodies and place.body != GROUND]
    return {str(place): rigid.frame(place.body).place(scene.point(place)) for place in points}
