"""A mechanism in space: seen along the three axes and at an angle, where it stands and as it moves."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from kaneflex.mechanism.planar import GROUND
from kaneflex.plots.animation import DPI, PER_SECOND
from kaneflex.plots.drawing import MM
from kaneflex.plots.style import PALETTE, as_file, legend_beside, new_figure, styled
from kaneflex.plots.view import FRAMES, frames_of, view
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Vector

if TYPE_CHECKING:
    from kaneflex.mechanism.rigid_motion import RigidMotion
    from kaneflex.solve.solution import Solution

_GHOSTS = 9
"""Instants at which the mechanism is drawn pale beside its first."""
_AXIS = 0.09
"""Half the length of a joint's axis as drawn, in sizes of the mechanism."""
_FLAT = (("x", "y"), ("x", "z"), ("y", "z"))
"""Views along an axis: what is drawn to the right, and up."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``motion``: the mechanism at first, pale at later instants, and the paths of points whose places sensors read."""
    shown = view(solution)
    figure = _drawn(solution.model.scene, shown.motion.rigid, f"Rigid motion{shown.note}", _tracks(solution))
    return {"motion": figure}


def scheme_picture(scene: Scene, motion: RigidMotion, kind: str) -> bytes:
    """The drawing of a scene as it starts as a "png", "svg" or "pdf" file; the same scene, the same bytes."""
    title = f"{scene.name}: {scene.description}" if scene.description else scene.name
    with styled():
        return as_file(_drawn(scene, motion, title, {}), kind)


def animate(solution: Solution, path: Path, frames: int = FRAMES) -> Path:
    """The moving mechanism, seen at an angle, as a small GIF."""
    shown = frames_of(view(solution), frames)
    lines = _bodies(solution.model.scene, shown.rigid)
    figure = new_figure(5.0, 4.6, "Rigid mechanism")
    axes = figure.add_subplot(projection="3d")
    _frame(axes, list(lines.values()))
    found = {name: axes.plot([], [], [], marker="o", markersize=3, color=PALETTE[k % len(PALETTE)])[0]
             for k, name in enumerate(lines)}  # fmt: skip
    caption = axes.set_title("")
    figure.canvas.draw()
    figure.set_layout_engine("none")
    writer = PillowWriter(fps=PER_SECOND)
    with writer.saving(figure, str(path), DPI):
        for k in range(len(shown.instants)):
            for name, line in found.items():
                line.set_data_3d(*(MM * lines[name][:, :, k]).T)
            caption.set_text(f"t = {shown.times[k]:.3g} s")
            writer.grab_frame()
    return path


def _drawn(scene: Scene, motion: RigidMotion, title: str, tracks: dict[str, np.ndarray]) -> Figure:
    figure = new_figure(9.0, 7.6, title)
    lines = _bodies(scene, motion)
    axes_of = _axes(scene, motion, max(abs(points[:, :, 0]).max() for points in lines.values()))
    count = motion.times.size
    ghosts = np.unique(np.linspace(0, count - 1, _GHOSTS).round().astype(int))[1:].tolist()
    for place, names in enumerate((*_FLAT, None)):
        axes = figure.add_subplot(2, 2, place + 1, projection=None if names else "3d")
        columns = [0, 1, 2] if names is None else ["xyz".index(name) for name in names]

        def draw(points: np.ndarray, axes=axes, columns=columns, **style) -> None:
            axes.plot(*(MM * points[:, columns]).T, **style)

        for k, (name, points) in enumerate(lines.items()):
            colour = PALETTE[k % len(PALETTE)]
            for ghost in ghosts:
                draw(points[:, :, ghost], color=colour, alpha=0.22, linewidth=1.0)
            draw(points[:, :, 0], color=colour, marker="o", markersize=3.5, linewidth=2.2, label=name)
        for ends in axes_of:
            draw(ends, color="0.35", linestyle="-.", linewidth=0.9)
        for name, track in tracks.items():
            draw(track.T, color="0.1", linewidth=0.8, label=f"path of {name}")
        if names is None:
            _frame(axes, [*lines.values(), *(track.T[:, :, None] for track in tracks.values())])
        else:
            axes.set(xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]", title=f"along {_third(names)}")
            axes.set_aspect("equal", adjustable="datalim")
    legend_beside(figure.axes[1])
    return figure


def _third(names: tuple[str, str]) -> str:
    return next(axis for axis in "xyz" if axis not in names)


def _frame(axes, points: list[np.ndarray]) -> None:
    """Equal scales around all that is drawn; points (n, 3, times)."""
    found = MM * np.concatenate([part.transpose(0, 2, 1).reshape(-1, 3) for part in points])
    low, high = found.min(axis=0), found.max(axis=0)
    middle, half = (low + high) / 2, max(0.55 * (high - low).max(), 1e-9)
    for axis, centre in zip("xyz", middle, strict=True):
        axes.set(**{f"{axis}lim": (centre - half, centre + half), f"{axis}label": f"{axis} [mm]"})
        getattr(axes, f"{axis}axis").set_major_locator(MaxNLocator(4))
    axes.set_box_aspect((1, 1, 1))


def _bodies(scene: Scene, motion: RigidMotion) -> dict[str, np.ndarray]:
    """Of every body the line through its ends and the points at which joints hold it, (points, 3, times) [m]."""
    found = {}
    for name in scene.bodies:
        frame = motion.frame(name)
        found[name] = np.array([frame.place(point) for point in outline_points(scene, name)])
    return found


def outline_points(scene: Scene, name: str) -> list[Vector]:
    """Points of a body in its axes that a line through it connects: its ends, where joints hold it, else its centre."""
    body = scene.bodies[name]
    held = [scene.point(side) for joint in scene.joints.values() for side in joint.addresses if side.body == name]
    ends = [scene.vector(body.points_all[end]) for end in ("start", "end") if end in body.points_all]
    points = list(dict.fromkeys([*ends, *held]))
    if len(points) == 1 and any(body.centre):
        points.append(scene.vector(body.centre))
    return points


def _axes(scene: Scene, motion: RigidMotion, reach: float) -> list[np.ndarray]:
    """Ends of the joints' axes at the first instant, (2, 3) [m]."""
    found = []
    for joint in scene.joints.values():
        first = joint.addresses[0]
        frame = motion.frame(first.body)
        at = frame.place(scene.point(first))[:, 0]
        for axis in joint.given_axes:
            arm = _AXIS * reach * frame.to_global(axis)[:, 0]
            found.append(np.array([at - arm, at + arm]))
    return found


def _tracks(solution: Solution) -> dict[str, np.ndarray]:
    """Paths of the points whose places sensors read, (3, times) [m]."""
    scene, rigid = solution.model.scene, solution.motion.rigid
    places = [sensor.position for sensor in scene.sensors.values() if sensor.position is not None]
    points = [place for place in dict.fromkeys(places) if place.body in scene.bodies and place.body != GROUND]
    return {str(place): rigid.frame(place.body).place(scene.point(place)) for place in points}
