"""Drawing of a scene without deriving it: bodies, joints, drives, loads, masses and sensors with names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from kaneflex.fem.links import mesh
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.plots.drawing import (
    MM,
    ROUNDING,
    draw_outline,
    draw_scenery,
    frame_axes,
    hatched,
    small_drawings,
)
from kaneflex.plots.marks import SENSOR, Labels, PlacedScene, listed, mark_sensors, sensors_by_place
from kaneflex.plots.mechanism import Rigid, body_lines, joint_axes, rigid_outline, rigid_scenery
from kaneflex.plots.outlines import FLAT, Scenery, name_axes, seen
from kaneflex.plots.style import PALETTE, new_figure, wrapped
from kaneflex.scene import Scene
from kaneflex.scene.bodies import Body
from kaneflex.scene.parts import Load
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError, counted
from kaneflex.support.escaping import picture_text

ELASTIC, DRIVE, LOAD = PALETTE[0], PALETTE[4], PALETTE[1]
_ROOM = 0.18
"""Room around the mechanism for names and arrows, in its sizes."""
_ARROW = 0.16
_ARC = 0.055
"""Length of a force's arrow, and radius of a drive's or torque's, in sizes of the mechanism."""
_LARGEST = np.array([6.6, 6.0])
"""Largest size of the drawing, in inches."""
_LEFT, _BELOW, _ABOVE = 0.75, 0.55, 0.75
_PER_CHARACTER, _PER_LINE = 0.062, 0.143
"""Width of a character and height of a line of the list, in inches."""
_LEAST, _FLAT_VIEWS = 8.9, 2.9
"""Least width of the picture, which three views along the axes need, and their height, in inches."""
_TOLD = 90
"""Characters in a line of the configuration."""


def scheme(scene: Scene, placed: Rigid) -> Figure:
    """The drawing of a scene at one configuration: a placement in the plane, the first instant of a motion in space."""
    fixed = rigid_scenery(scene, placed)
    drawn = rigid_outline(scene, placed, fixed)
    pose = PlacedScene(scene, placed)
    figure = new_figure(_LARGEST[0], _LARGEST[1], "", layout="none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    shape = np.array(frame_axes(axes, [drawn], fixed, _ROOM))
    title = picture_text(f"{scene.name}: {scene.description}" if scene.description else scene.name)
    sensors = sensors_by_place(pose)
    below = _arrange(figure, axes, shape, title, listed(sensors), 0.0 if fixed.flat else _FLAT_VIEWS)
    axes.set_title(_configuration(scene, pose))
    ground = draw_scenery(axes, fixed, drawn)
    for (kind, name), line in draw_outline(axes, drawn, 0, colour=ELASTIC).lines.items():
        if kind == "links":
            line.set_marker("none")  # marks stand for nodes here
            _mark_nodes(axes, pose, name)
    bodies = (*drawn.links.values(), *drawn.bars.values(), *drawn.boxes.values())
    labels = Labels(axes, [*(MM * part[0] for part in bodies), *ground])
    if not fixed.flat:
        _draw_flat_views(figure, scene.bodies, body_lines(scene, placed), below)
    _Parts(pose, fixed, axes, labels).draw()
    mark_sensors(axes, labels, sensors)
    labels.place()
    return figure


def branches(scene: Scene, ways: Sequence[tuple[str, Placement]]) -> Figure:
    """Small drawings of the ways in which a scene's loops close, the scene's own one first and framed."""
    fixed = [rigid_scenery(scene, placed) for _, placed in ways]
    outlines = [rigid_outline(scene, placed, each) for (_, placed), each in zip(ways, fixed, strict=True)]
    figure, panels = small_drawings(len(ways), outlines, fixed[0])
    title = f"{scene.name}: {counted(len(ways), 'closure')} of its loops"
    title = f"{picture_text(title)} {_configuration(scene, ways[0][1])}"
    figure.suptitle(wrapped(title, figure.get_figwidth()))
    for axes, (words, _), each, drawn in zip(panels, ways, fixed, outlines, strict=True):
        frame_axes(axes, outlines, each)
        draw_scenery(axes, each, drawn)
        draw_outline(axes, drawn, 0, colour=ELASTIC)
        own = axes is panels[0]
        axes.set_title(fill(f"{'this scene: ' * own}{words or 'no loop to choose'}", 38), fontsize=8)
        axes.label_outer()
        if own:
            axes.spines[:].set(visible=True, color=SENSOR, linewidth=2.0)
    return figure


def refuse_places(at: Mapping[str, float]) -> None:
    """Raise SceneError where a mechanism in space is to be drawn at another place than its start."""
    for name, place in at.items():
        cure = "Leave it out, or set where the drive starts"
        raise SceneError("at", f"{name} = {place:.6g}", "a mechanism in space is drawn at its start", cure)


def _draw_flat_views(
    figure: Figure, bodies: Mapping[str, Body], lines: Mapping[str, np.ndarray], height: float
) -> None:
    """Lines of bodies, seen along the three axes, side by side below the drawing, in that share of its height."""
    width, inches = figure.get_size_inches()
    placed_at = np.concatenate([each[:, :, 0] for each in lines.values()])
    margin = 0.1 * np.ptp(placed_at, axis=0).max()  # or an axis could have a range of zero
    corners = np.array([placed_at.min(axis=0) - margin, placed_at.max(axis=0) + margin])
    for k, (title, view) in enumerate(FLAT.items()):
        axes = figure.add_axes(((_LEFT + k * 2.75) / width, _BELOW / inches, 2.0 / width, height - 1.1 / inches))
        name_axes(axes, view, "{} [mm]")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(title)
        axes.locator_params(nbins=5)
        for name, points in lines.items():
            colour = ELASTIC if bodies[name].elastic else "black"
            axes.plot(*(MM * seen(points[:, :, 0], view)).T, color=colour, marker="o", markersize=2.5, linewidth=1.6)
        axes.update_datalim(MM * seen(corners, view))
        axes.autoscale_view()


def _arrange(figure: Figure, axes: Axes, shape: np.ndarray, title: str, listed: str, below: float) -> float:
    """Size the figure to the mechanism's shape [mm], with the title above and the list at its right.

    Returns the share of the figure's height that ``below`` [inches] leaves under the drawing.
    """
    width, height = shape * (_LARGEST / shape).min()
    beside = 0.3 + _PER_CHARACTER * max(map(len, listed.splitlines()), default=0)
    total = np.array([_LEFT + width + beside, below + _BELOW + height + _ABOVE])
    total[0] = max(total[0], _LEAST)
    heading = wrapped(title, total[0])
    total[1] = max(total[1] + 0.2 * heading.count("\n"), below + _BELOW + _ABOVE + _PER_LINE * (listed.count("\n") + 1))
    figure.set_size_inches(*total)
    base = below + _BELOW
    axes.set_position((_LEFT / total[0], base / total[1], width / total[0], height / total[1]))
    figure.suptitle(heading, x=0.15 / total[0], ha="left")
    style: dict[str, Any] = {"color": SENSOR, "fontsize": 7.5, "va": "top", "linespacing": 1.35}
    figure.text((_LEFT + width + 0.2) / total[0], (base + height) / total[1], listed, **style)
    return below / total[1]


def _configuration(scene: Scene, pose: PlacedScene | Placement) -> str:
    places = {name: 0.0 if abs(value) < ROUNDING else value for name, value in pose.drives.items()}
    words = mechanism_of(scene).written(places)
    return fill(f"at {words}", _TOLD) if words else ""


class _Parts:
    """Names and symbols of everything but the sensors."""

    def __init__(self, pose: PlacedScene, fixed: Scenery, axes: Axes, labels: Labels):
        self.scene, self.pose, self.axes, self.labels = pose.scene, pose, axes, labels
        self.size, self.at = MM * fixed.size, pose.at

    def draw(self) -> None:
        for name in self.scene.bodies:
            self._body(name)
        self._joints()
        for name in self.scene.masses:
            self._mass(name)
        for name in self.scene.drives:
            self._drive(name)
        for name in self.scene.forces:
            self._force(name)
        for name in self.scene.spreads:
            self._distributed_load(name)
        for name in self.scene.springs:
            self._spring(name)
        for name, contact in self.scene.contacts.items():
            if not contact.corner and contact.kind != "angle":
                self._contact(name)
        for name, loose in self.scene.loose.items():
            if loose.direction or loose.axis:
                self.labels.add(name, self.at(loose.sides[1]), "#555555", size=8)
        for name, load in self.scene.torques.items():
            self._turning(load.torque_at, LOAD, name, radius=1.5 * _ARC)
        if any(self.scene.gravity):
            self._gravity()

    def _body(self, name: str) -> None:
        body = self.scene.bodies[name]
        middle = Address(name, "mid" if body.length is not None else "start")
        kind = f"{name} ({body.beam.elements} el.)" if body.elastic else name
        self.labels.add(kind, self.at(middle), ELASTIC if body.elastic else "black", style="italic", size=9.5)

    def _joints(self) -> None:
        """Names of joints, one label a place."""
        here: dict[tuple[float, ...], list[str]] = {}
        for ends in joint_axes(self.scene, self.pose.placed, self.size / MM):
            self.axes.plot(*(MM * self.pose.view @ ends.T), color="0.35", linestyle="-.", linewidth=0.9, zorder=2)
        for name, joint in self.scene.joints.items():
            at = self.at(joint.addresses[1])
            here.setdefault(tuple(np.round(at, 6)), []).append(name)
            if joint.kind == "weld":
                self.axes.plot(*at, marker="s", markersize=5, color="black", zorder=4.5)
        for at, names in here.items():
            self.labels.add(", ".join(names), np.array(at), "#555555", size=8)

    def _mass(self, name: str) -> None:
        mass = self.scene.masses[name]
        at = self.at(mass.at)
        self.axes.plot(*at, marker="o", markersize=8, color="black", zorder=3.9)
        self.labels.add(f"{name} ({mass.mass:.4g} kg)" if mass.mass else name, at, "black", size=8)

    def _drive(self, name: str) -> None:
        drive = self.scene.drives[name]
        is_text, back = drive.kind in ("free", "law", "table"), (drive.speed or 0.0) < 0.0
        text = drive.kind if is_text else self.scene.written_speed(name, drive.speed, 4)
        style = "--" if drive.kind == "free" else "-"
        if not self.scene.slides(name):
            self._turning(name, DRIVE, text, way=-1 if back else 1, style=style)
            return
        first, second = self.scene.joints[name].addresses  # an arrow along the guide, from the point that slides
        start, along = self.at(second), self.pose.direction(first.body, self.scene.joints[name].given_axes[0])
        end = start + (-1.0 if back else 1.0) * 2.0 * _ARC * self.size * along
        self.axes.plot(*np.stack([start, end], axis=-1), color=DRIVE, linestyle=style, zorder=4.6)
        self._arrow(end - 1e-3 * (end - start), end, DRIVE)
        self.labels.add(text, end, DRIVE, size=8)

    def _turning(
        self, joint: str, colour: str, text: str, radius: float = _ARC, way: int = 1, style: str = "-"
    ) -> None:
        """An arrow around a joint, clockwise with ``way`` = -1."""
        centre = self.at(self.scene.joints[joint].addresses[0])
        turn = np.radians(np.linspace(-60.0, 200.0, 40))
        arc = (centre + radius * self.size * self.pose.around(joint, turn))[::way]
        self._arrow(arc[-3], arc[-1], colour)
        self._line(arc, text, colour, 1.6, 4.6, style)

    def _distributed_load(self, name: str) -> None:
        """Arrows along a body, as long as the load's profile is high there, under a line."""
        load = self.scene.spreads[name]
        d = self._towards(load, load.spread_on)
        start, end = (self.at(Address(load.spread_on, point)) for point in ("start", "end"))
        share = np.linspace(0.0, 1.0, 7)
        height = load.profile[0] + share * (load.profile[1] - load.profile[0])
        heads = start + np.outer(share, end - start)
        tails = heads - 0.6 * _ARROW * self.size * np.outer(height / abs(height).max(), d)
        for tail, head in zip(tails, heads, strict=True):
            if np.hypot(*(head - tail)) > 0.1 * _ARROW * self.size:
                self._arrow(tail, head, LOAD)
        self._line(tails, name, LOAD, 1.0, 4.6)

    def _towards(self, load: Load, body: str) -> np.ndarray:
        """Direction of a load in the drawing."""
        return self.pose.direction(body if load.axes == "body" else GROUND, load.direction)

    def _force(self, name: str) -> None:
        load = self.scene.forces[name]
        d = self._towards(load, load.force_on.body)
        head = self.at(load.force_on)
        tail = head - _ARROW * self.size * d
        self._arrow(tail, head, LOAD)
        self.labels.block(np.linspace(tail, head, 12))
        self.labels.add(name, tail, LOAD, size=8)

    def _spring(self, name: str) -> None:
        """A zigzag between two points, a short one if they coincide as those of a bushing, or a spiral around a joint.
        """
        spring = self.scene.springs[name]
        if spring.ends:
            start, end = (self.at(address) for address in spring.ends)
            if np.hypot(*(end - start)) < 1e-3 * self.size:
                aside = np.array([0.5 * _ARROW * self.size, 0.0])
                start, end = start - aside, end + aside
            along = end - start
            across = np.array([-along[1], along[0]]) / np.hypot(*along)
            share = np.concatenate([[0.0, 0.2], np.linspace(0.225, 0.775, 12), [0.8, 1.0]])
            swing = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], 6), [0.0, 0.0]])
            line = start + np.outer(share, along) + 0.02 * self.size * np.outer(swing, across)
        else:
            turn = np.linspace(0.0, 5.0 * np.pi, 90)
            around = self.pose.around(str(spring.torsional_at), turn)
            centre = self.at(self.scene.joints[spring.torsional_at].addresses[0])
            line = centre + 1.2 * _ARC * self.size * (turn / turn[-1])[:, None] * around
        self._line(line, name, "#555555", 1.2, 3.8)

    def _contact(self, name: str) -> None:
        """The face that a point stays before, hatched, or two circles; and the circle about what is pushed."""
        contact = self.scene.contacts[name]
        first, second = (self.at(address) for address in contact.sides)
        radii, middle = [(second, contact.touching)], first
        if contact.kind == "point-line":
            n = self.pose.direction(contact.sides[0].body, contact.direction)
            n /= np.hypot(*n)
            along = 1.5 * _ARC * self.size * np.array([n[1], -n[0]])
            middle = first + MM * (contact.reach - contact.touching) * n
            strokes = hatched(np.array([middle - along, middle + along]), self.size, below=True)
            self.axes.add_collection(LineCollection(strokes, colors="black", linewidths=0.8, zorder=1))
            self.labels.block(np.concatenate(strokes))
        elif contact.axis is None:
            outer = contact.reach + (contact.touching if contact.kind == "circle-in-circle" else -contact.touching)
            radii.append((first, outer))
        for centre, radius in radii:
            if MM * radius > 2e-3 * self.size:
                round_it = Circle(tuple(centre), MM * radius, fill=False, color="#555555", linewidth=0.8, zorder=3.8)
                self.axes.add_patch(round_it)
        self.labels.add(name, middle, "#555555", size=8)

    def _gravity(self) -> None:
        g = np.array(self.scene.gravity)
        (left, _), (_, top) = self.axes.get_xlim(), self.axes.get_ylim()
        middle = np.array([left, top]) + 0.5 * _ROOM * self.size * np.array([1.0, -1.0])
        g = self.pose.view @ g
        half = 0.35 * _ROOM * self.size * g / np.hypot(*g)
        self._arrow(middle - half, middle + half, "#555555")
        self.labels.block(np.linspace(middle - half, middle + half, 12))
        self.labels.add("g", middle, "#555555", style="italic", size=9)

    def _line(self, points: np.ndarray, name: str, colour: str, width: float, zorder: float, style: str = "-") -> None:
        """A line that labels keep clear of, named at its middle."""
        self.axes.plot(*points.T, color=colour, linewidth=width, linestyle=style, zorder=zorder)
        self.labels.block(points)
        self.labels.add(name, points[len(points) // 2], colour, size=8)

    def _arrow(self, tail: np.ndarray, head: np.ndarray, colour: str) -> None:
        style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "mutation_scale": 12}
        style |= {"shrinkA": 0, "shrinkB": 0}
        self.axes.annotate("", xy=tuple(head), xytext=tuple(tail), arrowprops=style, zorder=4.7)


def _mark_nodes(axes: Axes, pose: PlacedScene, name: str) -> None:
    """The nodes of an elastic link between its ends."""
    scene = pose.scene
    nodes = mesh(mechanism_of(scene), name, scene.bodies[name].beam.elements)[1:-1]
    points = np.array([pose.point(name, scene.vector((float(x), 0.0))) for x in nodes]).reshape(-1, 2)
    style: dict[str, Any] = {"marker": "o", "markersize": 3.6, "markerfacecolor": "white", "markeredgecolor": ELASTIC}
    axes.plot(*points.T, linestyle="none", zorder=3.3, **style)
