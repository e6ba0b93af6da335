"""Paths of points, coupler curves among them, and hodographs: velocities from one origin (Hamilton 1847).

In space the mechanism and the velocities are seen along the three axes and at an angle.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.plots.drawing import MM, draw_outline, draw_scenery, draw_triad, frame_axes
from kaneflex.plots.mechanism import body_lines, joint_axes, rigid_outline, scenery
from kaneflex.plots.outlines import FLAT, VIEW, label_flat, seen
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
_STILL = 1e-8
"""Travel of a point, in sizes of the mechanism, below which it counts as fixed."""


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


def in_space(solution: Solution) -> dict[str, Figure]:
    """``motion``: the mechanism at first, pale at later instants, and the paths of points whose motion sensors read."""
    shown, scene = view(solution), solution.model.scene
    lines = body_lines(scene, shown.rigid)
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
        for point in read_points(scene):
            track = shown.rigid.frame(point.body).place(scene.point(point))
            draw(track.T, color="0.1", linewidth=0.8, label=f"path of {point}")
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
