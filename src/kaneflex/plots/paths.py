"""Paths of points, coupler curves among them, and hodographs: velocities from one origin (Hamilton 1847)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.drawing import MM, draw_outline, draw_scenery, frame_axes
from kaneflex.plots.mechanism import rigid_outline, scenery
from kaneflex.plots.style import PALETTE, legend_beside, new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import MOTION_KINDS, Sensor

if TYPE_CHECKING:
    from kaneflex.scene import Scene
    from kaneflex.solve.solution import Solution

_ONE = 1e-3
"""Distance of two paths, as a share of the mechanism's size, below which they count as one."""
_APART = 30.0
"""Between two dots [deg]; where no angle is the abscissa, a twelfth of what is drawn."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``paths``: of the points of bodies whose motion sensors read, as many as there are colours."""
    scene = solution.model.scene
    if scene.is_frame or not (points := read_points(scene)):
        return {}
    shown, fixed = view(solution), scenery(solution)
    curves = _together(shown, points, _ONE * fixed.size)
    note = "" if len(curves) <= len(PALETTE) else f", the first {len(PALETTE)} of {len(curves)}"
    figure = new_figure(11.8, 5.0, f"Paths and hodographs{shown.note}{note}")
    grid = figure.add_gridspec(1, 2)
    path, hodograph = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
    outline = rigid_outline(scene, shown.rigid, fixed)
    frame_axes(path, [outline], fixed)
    draw_scenery(path, fixed, outline)
    draw_outline(path, outline, 0, ghost=True)
    drawn = [*zip(curves.items(), PALETTE, strict=False)]
    hodographs = [velocity(shown, point) for ((point, *_), _), _ in drawn]
    factor, unit = readable("m/s", *hodographs)
    for ((together, place), colour), velocities in zip(drawn, hodographs, strict=True):
        name = ", ".join(map(str, together))
        curve(path, shown, MM * place, colour, name)
        curve(hodograph, shown, factor * velocities, colour, name)
    hodograph.plot(0.0, 0.0, "+", color="black", markersize=9)
    hodograph.set(aspect="equal", adjustable="datalim", xlabel=f"v_x [{unit}]", ylabel=f"v_y [{unit}]")
    shape = float(np.ptp(path.get_ylim()) / np.ptp(path.get_xlim()))
    figure.set_size_inches(11.8, min(5.0, 1.2 + 4.8 * shape))  # no white space around a flat mechanism ...
    grid.set_width_ratios((min(1.0, 0.8 / shape), 1.0))  # ... or a tall one
    path.set_title(f"Paths, starting at the ring, {dotted(shown)}")
    hodograph.set_title("Hodographs: velocity vectors from one origin")
    legend_beside(hodograph)
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
    components = "xyz" if shown.solution.model.scene.is_spatial else "xy"
    sensors = (Sensor(velocity=point, component=each, axes="global") for each in components)  # type: ignore[arg-type]
    return np.array([sensor_values(shown.motion, sensor) for sensor in sensors])


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
