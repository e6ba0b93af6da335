"""Paths of points, coupler curves among them, and hodographs: velocities from one origin (Hamilton 1847)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.drawing import MM, draw_outline, draw_scenery, draw_triad, frame_axes
from kaneflex.plots.mechanism import rigid_outline, scenery
from kaneflex.plots.outlines import aligned, name_axes, views_of
from kaneflex.plots.style import PALETTE, legend_beside, new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import MOTION_KINDS, Sensor

if TYPE_CHECKING:
    from kaneflex.response.motion import Motion
    from kaneflex.scene import Scene
    from kaneflex.solve.solution import Solution

_ONE = 1e-3
"""Distance of two paths, as a share of the mechanism's size, below which they count as one."""
_APART = 30.0
"""Between two dots [deg]; where no angle is the abscissa, a twelfth of what is drawn."""
_GHOSTS = 9
"""Instants at which a mechanism in space is drawn pale beside its first."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``paths``: of the points of bodies whose motion sensors read, as many as there are colours; a row of two panels
    in the plane, in space for each view."""
    scene = solution.model.scene
    if scene.is_frame or not (points := read_points(scene)):
        return {}
    shown, size = view(solution), scenery(solution).size
    curves = _together(shown, points, _ONE * size)
    note = "" if len(curves) <= len(PALETTE) else f", the first {len(PALETTE)} of {len(curves)}"
    views, start = views_of(scene.is_spatial), f", starting at the ring, {dotted(shown)}"
    figure = new_figure(11.8, 5.0, f"Paths and hodographs{start * (len(views) > 1)}{shown.note}{note}")
    grid, shapes = figure.add_gridspec(len(views), 2), list[float]()
    drawn = [*zip(curves.items(), PALETTE, strict=False)]
    hodographs = [velocity(shown, point) for ((point, *_), _), _ in drawn]
    factor, unit = readable("m/s", *hodographs)
    for row, (seen_from, projection) in enumerate(views.items()):
        path, hodograph = figure.add_subplot(grid[row, 0]), figure.add_subplot(grid[row, 1])
        fixed = scenery(solution, projection)
        outline = rigid_outline(scene, shown.rigid, fixed)
        frame_axes(path, [outline], fixed)
        draw_scenery(path, fixed, outline)
        for k in (0,) if fixed.flat else range(0, len(shown.times), len(shown.times) // _GHOSTS + 1):
            draw_outline(path, outline, k, ghost=True)
        if not fixed.flat:
            draw_outline(path, outline, 0)
        for ((together, place), colour), velocities in zip(drawn, hodographs, strict=True):
            name = ", ".join(map(str, together))
            curve(path, shown, MM * projection @ place, colour, name)
            curve(hodograph, shown, factor * projection @ velocities, colour, name)
        hodograph.plot(0.0, 0.0, "+", color="black", markersize=9)
        hodograph.set_aspect("equal", adjustable="datalim")
        name_axes(hodograph, projection, f"v_{{}} [{unit}]")
        shapes.append(float(np.ptp(path.get_ylim()) / np.ptp(path.get_xlim())))
        path.set_title(f"Paths{seen_from or start}")
        hodograph.set_title(f"Hodographs{seen_from or ': velocity vectors from one origin'}")
        if row == 0:
            legend_beside(hodograph)
    heights = [min(3.8, 4.8 * shape) for shape in shapes]  # no white space around a flat mechanism ...
    figure.set_size_inches(11.8, 1.2 + sum(heights))
    grid.set_height_ratios(heights)
    grid.set_width_ratios((min(1.0, 0.8 / min(shapes)), 1.0))  # ... or a tall one
    if not aligned(projection):
        figure.draw_without_rendering()  # limits with equal scales are known only then
        draw_triad(hodograph, projection, unit)
    return {"paths": figure}


def read_points(scene: Scene) -> list[Address]:
    """Points of bodies whose places, velocities, accelerations or displacements sensors read, each once."""
    targets = (sensor.target for sensor in scene.sensors.values() if sensor.kind in MOTION_KINDS)
    points = (each for each in targets if isinstance(each, Address) and each.body in scene.bodies)
    return [*{(point.body, scene.point(point)): point for point in points}.values()]


def _together(shown: View, points: list[Address], apart: float) -> dict[tuple[Address, ...], np.ndarray]:
    """Points with the same path, such as those joined by a pin -> this path [m], (2, n_times)."""
    found: dict[tuple[Address, ...], np.ndarray] = {}
    for point in points:
        place = shown.motion.place(point.body, shown.solution.model.scene.point(point))
        same = next((key for key, other in found.items() if abs(place - other).max() <= apart), ())
        found = {(*key, point) if key == same else key: each for key, each in found.items()}
        if not same:
            found[point,] = place
    return found


def velocity(shown: View, point: Address) -> np.ndarray:
    """In global axes [m/s], (2, n_times), in space (3, n_times)."""
    return global_vector(shown.motion, velocity=point)


def global_vector(motion: Motion, **read: Any) -> np.ndarray:
    """Global components of what a sensor of a motion reads, (2 or 3, n_times)."""
    components = "xyz"[: len(motion.model.scene.vector((0.0, 0.0)))]
    sensors = (Sensor(component=each, axes="global", **read) for each in components)  # type: ignore[arg-type]
    return np.array([sensor_values(motion, sensor) for sensor in sensors])


def dotted(shown: View) -> str:
    """Distance of the dots of a curve, in words."""
    return f"a dot each {f'{_APART:g} deg' if shown.drive else 'twelfth of the time'}"


def curve(axes: Axes, shown: View, values: np.ndarray, colour: str, name: str) -> None:
    """A curve (2, n_times), in space (3, n_times), with a ring where it begins and dots along it."""
    axes.plot(*values, color=colour, label=name)
    done = abs(shown.x - shown.x[0])
    apart = _APART if shown.drive else done[-1] / 12.0
    at = np.arange(apart, done[-1] + 1e-6 * apart, apart)
    axes.plot(*(np.interp(at, done, part) for part in values), "o", color=colour, markersize=3)
    axes.plot(*values[:, :1], "o", color=colour, markersize=7, markerfacecolor="white")
