"""A mechanism in space: seen along the three axes and at an angle, where it stands and as it moves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import fill
from types import MappingProxyType
from typing import TYPE_CHECKING, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.multibody.building import has_modes, reference_modes
from kaneflex.plots.animation import enlargement, recording, title
from kaneflex.plots.drawing import MM
from kaneflex.plots.mechanism import ALONG_LINK
from kaneflex.plots.modes import DRAWN, MOST, SMALL, hertz, title_at_reference
from kaneflex.plots.paths import curve, dotted, read_points, velocity
from kaneflex.plots.style import GREY, PALETTE, legend_beside, new_figure, readable
from kaneflex.plots.view import FRAMES, frames_of, view
from kaneflex.response.elastic_motion import elastic_motion
from kaneflex.response.motion import Motion
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Vector
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.mechanism.rigid_motion import RigidMotion
    from kaneflex.multibody.model import Model
    from kaneflex.response.spatial_elastic_motion import SpatialElasticMotion
    from kaneflex.solve.solution import Solution

_GHOSTS = 9
"""Instants at which the mechanism is drawn pale beside its first."""
_AXIS = 0.09
"""Half the length of a joint's axis as drawn, in sizes of the mechanism."""
_WIDEST = 85
"""Letters of a line above all four views."""
_FLAT = (("x", "y"), ("x", "z"), ("y", "z"))
"""Views along an axis: what is drawn to the right, and up."""
_PLACE = "{} [mm]"
_FLAT_BOX = 0.25
"""Least extent of a box along an axis, as a share of its largest: tick labels need that room."""
_STILL = 1e-8
"""A point that would go so far in all that is shown, in sizes of the mechanism, stands still."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``motion``: the mechanism at first, pale at later instants, and the paths of points whose places sensors read."""
    shown = view(solution)
    lines = body_lines(solution.model.scene, shown.rigid)
    figure = _drawn(solution.model.scene, shown.rigid, lines, f"Rigid motion{shown.note}", _tracks(solution))
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
    heading = f"Hodographs, velocities from one origin: from the ring on, {dotted(shown)}{shown.note}"
    figure = new_figure(8.6, 7.0, heading)
    label = f"v_{{}} [{unit}]"
    for axes, columns in _views(figure, label):
        for (name, velocities), colour in zip(found.items(), PALETTE, strict=False):
            curve(axes, shown, factor * velocities[columns], colour, name)
        axes.plot(*np.zeros((len(columns), 1)), "+", color="black", markersize=9)
        if len(columns) == 3:
            frame_box(axes, [factor * velocities[None] for velocities in found.values()], label)
    legend_beside(figure.axes[1])
    return {"hodographs": figure}


def modes(solution: Solution) -> dict[str, Figure]:
    """``modes``: up to six, at their largest deflection, beside the mechanism at the reference place."""
    model = solution.model
    if model.frame is None or not has_modes(model):
        return {}
    count = min(MOST, model.equations.size)
    omega, shapes = reference_modes(model, count)
    rigid = model.motion.at(np.full(count, model.reference_time))
    still, none = body_lines(model.scene, rigid), np.zeros_like(shapes)
    size = spatial_mechanism_of(model.scene).size
    small = shapes * (SMALL * size / abs(shapes).max(axis=0))
    loaded, moved = (
        deformed_lines(elastic_motion(model, rigid, (each, none, none)), 1.0 / SMALL) for each in (none, small)
    )
    lines = body_lines(model.scene, rigid, _along(model))
    shifts = {name: moved[name] - loaded[name] for name in moved}  # links of a few modes bend by their loads, too
    largest = np.max([np.linalg.norm(shifts[name], axis=1).max(axis=0) for name in model.links], axis=0)
    figure = new_figure(9.6, 3.5 * -(-count // 3) + 0.7, title_at_reference(solution))
    for k in range(count):
        axes = figure.add_subplot(-(-count // 3), 3, k + 1, projection="3d")
        for points in still.values():
            axes.plot(*(MM * points[:, :, k]).T, color=GREY, linewidth=0.9)
        away = DRAWN * size / largest[k] if largest[k] else 0.0
        for n, name in enumerate(shifts):
            drawn = lines[name][:, :, k] + away * shifts[name][:, :, k]
            axes.plot(*(MM * drawn).T, color=PALETTE[n % len(PALETTE)], linewidth=2.2)
        frame_box(axes, [MM * points[:, :, k : k + 1] for points in still.values()])
        axes.set_title(f"Mode {k + 1}: {hertz(omega[k])}")
    handles = [Line2D([], [], color=PALETTE[n % len(PALETTE)], linewidth=2.2, label=name)
               for n, name in enumerate(shifts)]  # fmt: skip
    handles.append(Line2D([], [], color=GREY, linewidth=0.9, label="undeformed"))
    figure.legend(handles=handles, loc="outside lower center", ncols=min(6, len(handles)))
    return {"modes": figure}


def scheme(scene: Scene, motion: RigidMotion) -> Figure:
    """The drawing of a scene as it starts; ``motion`` is that of this instant."""
    title = fill(f"{scene.name}: {scene.description}" if scene.description else scene.name, _WIDEST)
    return _drawn(scene, motion, body_lines(scene, motion), title, {})


def refuse_places(at: Mapping[str, float]) -> None:
    """Raise SceneError where a mechanism in space is to be drawn elsewhere than it starts."""
    for name, place in at.items():
        cure = "Leave it out, or set where the drive starts"
        raise SceneError("at", f"{name} = {place:.6g}", "a mechanism in space is drawn as it starts", cure)


def animate(solution: Solution, files: Sequence[Path], frames: int = FRAMES, seconds: float | None = None) -> None:
    """The moving mechanism, seen at an angle, as a small GIF or an MP4."""
    shown = frames_of(view(solution), frames)
    factor = enlargement(shown) if solution.model.links else None
    lines = deformed_lines(shown.motion, factor or 1.0)
    figure = new_figure(5.0, 4.6, "")
    figure.suptitle(title(factor) + shown.note)
    axes = figure.add_subplot(projection="3d")
    frame_box(axes, [MM * points for points in lines.values()])
    found = {name: axes.plot([], [], [], marker="" if name in solution.model.links else "o", markersize=3,
                             color=PALETTE[k % len(PALETTE)])[0] for k, name in enumerate(lines)}  # fmt: skip
    caption = axes.set_title("")
    with recording(axes, [*found.values(), caption], files, len(shown.instants), seconds) as grab:
        for k in range(len(shown.instants)):
            for name, line in found.items():
                line.set_data_3d(*(MM * lines[name][:, :, k]).T)
            caption.set_text(f"t = {shown.times[k]:.3g} s")
            grab()


def _drawn(
    scene: Scene, motion: RigidMotion, lines: dict[str, np.ndarray], heading: str, tracks: dict[str, np.ndarray]
) -> Figure:
    figure = new_figure(8.6, 7.0, heading)
    axes_of = _axes(scene, motion, max(abs(points[:, :, 0]).max() for points in lines.values()))
    count = motion.times.size
    ghosts = np.unique(np.linspace(0, count - 1, _GHOSTS).round().astype(int))[1:].tolist()
    for axes, columns in _views(figure, _PLACE):

        def draw(points: np.ndarray, axes=axes, columns=columns, **style) -> None:
            axes.plot(*(MM * points[:, columns]).T, **style)

        for k, (name, points) in enumerate(lines.items()):
            colour = PALETTE[k % len(PALETTE)]
            for ghost in ghosts:
                draw(points[:, :, ghost], color=colour, alpha=0.22, linewidth=1.0)
            marker = "" if len(points) == ALONG_LINK else "o"  # those are places on a deformed axis
            label = name if len(points) > 1 else None  # a dot where a line ends needs no name
            draw(points[:, :, 0], color=colour, marker=marker, markersize=3.5, linewidth=2.2, label=label)
        for ends in axes_of:
            draw(ends, color="0.35", linestyle="-.", linewidth=0.9)
        for name, track in tracks.items():
            draw(track.T, color="0.1", linewidth=0.8, label=f"path of {name}")
        if len(columns) == 3:
            frame_box(axes, [MM * part for part in (*lines.values(), *(track[None] for track in tracks.values()))])
    legend_beside(figure.axes[1])
    return figure


def _views(figure: Figure, label: str) -> Iterator[tuple[Axes, list[int]]]:
    """Axes of the three views along an axis and the one at an angle, with the components that each shows.

    ``label`` names an axis, with braces for x, y or z.
    """
    for place, names in enumerate(_FLAT):
        (third,) = set("xyz") - set(names)
        axes = figure.add_subplot(2, 2, place + 1, title=f"along {third}")
        axes.set(xlabel=label.format(names[0]), ylabel=label.format(names[1]))
        axes.set_aspect("equal", adjustable="datalim")
        yield axes, ["xyz".index(name) for name in names]
    yield figure.add_subplot(2, 2, 4, projection="3d"), [0, 1, 2]


def frame_box(axes, points: list[np.ndarray], label: str = _PLACE) -> None:
    """Equal scales, and a box around all that is drawn; points (n, 3, times) in the unit of the axes."""
    found = np.concatenate([part.transpose(0, 2, 1).reshape(-1, 3) for part in points])
    low, high = found.min(axis=0), found.max(axis=0)
    middle, reach = (low + high) / 2, max((high - low).max(), 1e-9)
    half = 0.55 * np.maximum(high - low, _FLAT_BOX * reach)
    for axis, centre, room in zip("xyz", middle, half, strict=True):
        axes.set(**{f"{axis}lim": (centre - room, centre + room), f"{axis}label": label.format(axis)})
        getattr(axes, f"{axis}axis").set_major_locator(MaxNLocator(4 if room > 0.3 * half.max() else 2))
    zoom = 0.8 * np.linalg.norm(half) / (np.sqrt(3.0) * half.max())  # labels need their room, which no layout leaves
    axes.set_box_aspect(half, zoom=zoom)


def body_lines(
    scene: Scene, motion: RigidMotion, along: Mapping[str, np.ndarray] = MappingProxyType({})
) -> dict[str, np.ndarray]:
    """Of every body the line through its ends and the points at which joints hold it, (points, 3, times) [m].

    ``along``: of some bodies places on their x axis instead [m].
    """
    found = {}
    for name in scene.bodies:
        frame = motion.frame(name)
        points = [(float(x), 0.0, 0.0) for x in along[name]] if name in along else outline_points(scene, name)
        found[name] = np.array([frame.place(point) for point in points])
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


def deformed_lines(motion: Motion, factor: float) -> dict[str, np.ndarray]:
    """The bodies as they deform and follow, all displacements enlarged."""
    model = motion.model
    lines = body_lines(model.scene, motion.rigid, _along(model))
    for name in model.links:
        frame = motion.rigid.frame(name)
        for k, x in enumerate(_along(model)[name]):
            lines[name][k] += factor * frame.to_global(_shift(motion, name, float(x))[:3])
    moving = model.frame.bodies if model.frame is not None else ()
    for name in lines.keys() & set(moving):  # lumped masses, which are bodies there, have no line of their own
        frame, moved = motion.rigid.frame(name), _shift(motion, name)
        shift, turn = frame.to_global(moved[:3]), frame.to_global(moved[3:])
        lines[name] = lines[name] + factor * (shift + np.cross(turn[None], lines[name] - frame.origin, axis=1))
    return lines


def _shift(motion: Motion, body: str, x: float = 0.0) -> np.ndarray:
    """Displacement and rotation of a point on a body's x axis, in the body's axes, (6, n_times)."""
    return cast("SpatialElasticMotion", motion).displacement(body, (x, 0.0, 0.0))[0]


def _along(model: Model) -> dict[str, np.ndarray]:
    """Places on the axes of elastic links at which these are drawn [m]."""
    return {name: np.linspace(0.0, link.length, ALONG_LINK) for name, link in model.links.items()}


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
