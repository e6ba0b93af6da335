"""A scene as a drawing: bodies, joints, drives, loads, masses, sensors with their names, before anything is derived."""

from __future__ import annotations

import math
import textwrap
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
from kaneflex.plots.drawing import MM, draw_guides, draw_outline, draw_scenery, frame_axes, hatched
from kaneflex.plots.labels import Labels
from kaneflex.plots.mechanism import Outline, Scenery, grounded, rigid_outline, rigid_scenery
from kaneflex.plots.style import PALETTE, new_figure
from kaneflex.scene import Scene
from kaneflex.scene.parts import Load
from kaneflex.scene.quantities import Address
from kaneflex.scene.sensors import CONTACT_KINDS, FRICTION_KINDS
from kaneflex.support.escaping import picture_text

ELASTIC, DRIVE, SENSOR, LOAD = PALETTE[0], PALETTE[4], PALETTE[2], PALETTE[1]
_ROOM = 0.18
"""Room around the mechanism for names and arrows, in its sizes."""
_ARROW = 0.16
_ARC = 0.055
"""Length of a force's arrow, and radius of a drive's or torque's, in sizes of the mechanism."""
_LINE = 44
"""Characters in a line of the list of sensors."""
_LARGEST = np.array([6.6, 6.0])
"""Of the drawing, in inches."""
_LEFT, _BELOW, _ABOVE = 0.75, 0.55, 0.75
_PER_CHARACTER, _PER_TITLE_CHARACTER = 0.062, 0.088
"""Widths of a character in the list and in the title, in inches."""


def scheme(scene: Scene, placement: Placement) -> Figure:
    """The drawing of a scene at one configuration."""
    fixed = rigid_scenery(scene, placement)
    drawn = rigid_outline(scene, placement, fixed)
    figure = new_figure(_LARGEST[0], _LARGEST[1], "", layout="none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    shape = np.array(frame_axes(axes, [drawn], fixed, _ROOM))
    title = picture_text(f"{scene.name}: {scene.description}" if scene.description else scene.name)
    sensors = _sensors_by_place(scene, placement)
    _arrange(figure, axes, shape, title, _listed(sensors))
    axes.set_title(_configuration(scene, placement))
    draw_scenery(axes, fixed)
    draw_guides(axes, fixed, grounded(scene), drawn)
    for (kind, name), line in draw_outline(axes, drawn, 0, colour=ELASTIC).lines.items():
        if kind == "links":
            line.set_marker("none")  # marks stand for nodes here
            _mark_nodes(axes, scene, placement, name)
    labels = Labels(axes, [*_paths(drawn), *_ground_points(fixed), *_faces(fixed, drawn)])
    _Parts(scene, placement, fixed, axes, labels).draw()
    _mark_sensors(axes, labels, sensors)
    labels.place()
    return figure


def _arrange(figure: Figure, axes: Axes, shape: np.ndarray, title: str, listed: str) -> None:
    """Size the figure to the mechanism's shape [mm], with the title above and the list at its right."""
    width, height = shape * (_LARGEST / shape).min()
    beside = 0.3 + _PER_CHARACTER * max(map(len, listed.splitlines()), default=0)
    total = np.array([_LEFT + width + beside, _BELOW + height + _ABOVE])
    total[0] = max(total[0], 0.3 + _PER_TITLE_CHARACTER * len(title))
    figure.set_size_inches(*total)
    axes.set_position((_LEFT / total[0], _BELOW / total[1], width / total[0], height / total[1]))
    figure.suptitle(title, x=0.15 / total[0], ha="left")
    top = (_BELOW + height) / total[1]
    style: dict[str, Any] = {"color": SENSOR, "fontsize": 7.5, "va": "top", "linespacing": 1.35}
    figure.text((_LEFT + width + 0.2) / total[0], top, listed, **style)


def _configuration(scene: Scene, placement: Placement) -> str:
    angles = ", ".join(f"{name} = {scene.written_coordinate(name, value)}" for name, value in placement.drives.items())
    return f"at {angles}" if angles else ""


def _paths(drawn: Outline) -> list[np.ndarray]:
    """Lines of the bodies [mm], which labels keep clear of."""
    parts = [*drawn.links.values(), *drawn.bars.values(), *drawn.boxes.values()]
    return [MM * part[0] for part in parts]


def _ground_points(fixed: Scenery) -> list[np.ndarray]:
    """The triangles under ground pivots, as drawing.draw_scenery draws them, and their hatching."""
    corners = fixed.size * np.array([(0, 0), (-0.04, -0.04), (-0.05, -0.056), (0.05, -0.056), (0.04, -0.04), (0, 0)])
    return [MM * (pivot + corners) for pivot in fixed.pivots]


def _faces(fixed: Scenery, drawn: Outline) -> list[np.ndarray]:
    """The hatched faces of the guides."""
    lines = []
    for name, ends in fixed.guides.items():
        box = drawn.boxes[name][0]
        lines += [MM * (ends + share * (box[0] - box[3])) for share in (-0.62, -0.5, 0.5, 0.62)]
    return lines


class _Parts:
    """Names and symbols of everything but the sensors."""

    def __init__(self, scene: Scene, placement: Placement, fixed: Scenery, axes: Axes, labels: Labels):
        self.scene, self.placement, self.axes, self.labels = scene, placement, axes, labels
        self.size = MM * fixed.size

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
            if loose.direction is not None:
                self.labels.add(name, self.at(loose.sides[1]), "#555555", size=8)
        for name, load in self.scene.torques.items():
            self._turning(load.torque_at, LOAD, name, radius=1.5 * _ARC)
        if self.scene.gravity != (0.0, 0.0):
            self._gravity()

    def at(self, address: Address) -> np.ndarray:
        return _at(self.scene, self.placement, address)

    def _body(self, name: str) -> None:
        body = self.scene.bodies[name]
        middle = Address(name, "mid" if body.length is not None else "start")
        kind = f"{name} ({body.beam.elements} el.)" if body.elastic else name
        self.labels.add(kind, self.at(middle), ELASTIC if body.elastic else "black", style="italic", size=9.5)

    def _joints(self) -> None:
        """Names of joints, one label a place."""
        here: dict[tuple[float, ...], list[str]] = {}
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
        said = drive.kind in ("free", "law", "table")
        text = drive.kind if said else self.scene.written_speed(name, drive.speed, 4)
        if self.scene.slides(name):
            self._sliding(name, text, back=(drive.speed or 0.0) < 0.0, dashed=drive.kind == "free")
            return
        self._turning(name, DRIVE, text, clockwise=(drive.speed or 0.0) < 0.0, dashed=drive.kind == "free")

    def _sliding(self, joint: str, text: str, back: bool, dashed: bool) -> None:
        """An arrow along a driven guide, from the point that slides."""
        guide = mechanism_of(self.scene).joints[joint]
        start = self.at(self.scene.joints[joint].addresses[1])
        along = np.array(self.placement.pose(guide.first.body).turn(guide.direction))
        end = start + (-1.0 if back else 1.0) * 2.0 * _ARC * self.size * along
        self.axes.plot(*np.stack([start, end], axis=-1), color=DRIVE, linestyle="--" if dashed else "-", zorder=4.6)
        self._arrow(end - 1e-3 * (end - start), end, DRIVE)
        self.labels.add(text, end, DRIVE, size=8)

    def _turning(
        self, joint: str, colour: str, text: str, radius: float = _ARC, clockwise: bool = False, dashed: bool = False
    ) -> None:
        """An arrow around a joint."""
        centre = self.at(self.scene.joints[joint].addresses[0])
        turn = np.radians(np.linspace(-60.0, 200.0, 40))
        arc = centre + radius * self.size * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        if clockwise:
            arc = arc[::-1]
        self.axes.plot(*arc.T, color=colour, linewidth=1.6, linestyle="--" if dashed else "-", zorder=4.6)
        self._arrow(arc[-3], arc[-1], colour)
        self.labels.block(arc)
        self.labels.add(text, arc[20], colour, size=8)

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
        self.axes.plot(*tails.T, color=LOAD, linewidth=1.0, zorder=4.6)
        self.labels.block(tails)
        self.labels.add(name, tails[3], LOAD, size=8)

    def _towards(self, load: Load, body: str) -> np.ndarray:
        """Global direction of a load."""
        return np.array(self.placement.pose(body if load.axes == "body" else GROUND).turn(load.direction))

    def _force(self, name: str) -> None:
        load = self.scene.forces[name]
        d = self._towards(load, load.force_on.body)
        head = self.at(load.force_on)
        tail = head - _ARROW * self.size * d
        self._arrow(tail, head, LOAD)
        self.labels.block(np.linspace(tail, head, 12))
        self.labels.add(name, tail, LOAD, size=8)

    def _spring(self, name: str) -> None:
        """A zigzag between two points, or a spiral around a joint."""
        spring = self.scene.springs[name]
        if spring.ends:
            start, end = (self.at(address) for address in spring.ends)
            along = end - start
            length = np.hypot(*along)
            across = np.array([-along[1], along[0]]) / length if length else np.zeros(2)
            share = np.concatenate([[0.0, 0.2], np.linspace(0.225, 0.775, 12), [0.8, 1.0]])
            swing = np.concatenate([[0.0, 0.0], np.tile([1.0, -1.0], 6), [0.0, 0.0]])
            line = start + np.outer(share, along) + 0.02 * self.size * np.outer(swing, across)
        else:
            turn = np.linspace(0.0, 5.0 * np.pi, 90)
            around = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
            centre = self.at(self.scene.joints[spring.torsional_at].addresses[0])
            line = centre + 1.2 * _ARC * self.size * (turn / turn[-1])[:, None] * around
        self.axes.plot(*line.T, color="#555555", linewidth=1.2, zorder=3.8)
        self.labels.block(line)
        self.labels.add(name, line[len(line) // 2], "#555555", size=8)

    def _contact(self, name: str) -> None:
        """The face that a point stays before, hatched, or two circles; and the circle about what is pushed."""
        contact = self.scene.contacts[name]
        first, second = (self.at(address) for address in contact.sides)
        radii = [(second, contact.touching)]
        if contact.kind == "point-line":
            n = np.array(self.placement.pose(contact.sides[0].body).turn(contact.direction))
            n /= np.hypot(*n)
            along = 1.5 * _ARC * self.size * np.array([n[1], -n[0]])
            middle = first + MM * (contact.reach - contact.touching) * n
            strokes = hatched(np.array([middle - along, middle + along]), self.size, below=True)
            self.axes.add_collection(LineCollection(strokes, colors="black", linewidths=0.8, zorder=1))
            self.labels.block(np.concatenate(strokes))
        else:
            middle = first
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
        half = 0.35 * _ROOM * self.size * g / np.hypot(*g)
        self._arrow(middle - half, middle + half, "#555555")
        self.labels.block(np.linspace(middle - half, middle + half, 12))
        self.labels.add("g", middle, "#555555", style="italic", size=9)

    def _arrow(self, tail: np.ndarray, head: np.ndarray, colour: str) -> None:
        style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "mutation_scale": 12}
        style |= {"shrinkA": 0, "shrinkB": 0}
        self.axes.annotate("", xy=tuple(head), xytext=tuple(tail), arrowprops=style, zorder=4.7)


def _at(scene: Scene, placement: Placement, address: Address) -> np.ndarray:
    """Where a point is drawn [mm]."""
    return MM * np.array(placement.pose(address.body).place(scene.point(address)))


def _sensors_by_place(scene: Scene, placement: Placement) -> list[tuple[str, np.ndarray, list[str]]]:
    """Where sensors measure: (address or joint, place [mm], names), in the scene's order."""
    found: dict[str, tuple[np.ndarray, list[str]]] = {}
    for name, sensor in scene.sensors.items():
        target = sensor.target
        if sensor.kind in ("spring_force", "spring_torque"):
            spring = scene.springs[target]
            ends = spring.ends or scene.joints[spring.torsional_at].addresses
            middle = np.mean([_at(scene, placement, end) for end in ends], axis=0)
            found.setdefault(f"spring {target}", (middle, []))[1].append(name)
            continue
        if sensor.stress is not None:  # modal data don't say where it is
            middle = _at(scene, placement, Address(sensor.stress.body, "mid"))
            found.setdefault(f"stress {target}", (middle, []))[1].append(name)
            continue
        if sensor.kind in (*CONTACT_KINDS, *FRICTION_KINDS) and str(target) in scene.contacts:
            side = scene.contacts[str(target)].sides[1]
            found.setdefault(f"contact {target}", (_at(scene, placement, side), []))[1].append(name)
            continue
        if not isinstance(target, str) and target.body in scene.loose:
            side = scene.loose[target.body].sides[1]
            found.setdefault(target.body, (_at(scene, placement, side), []))[1].append(name)
            continue
        joint = target if isinstance(target, str) else target.body if target.body in scene.joints else None
        address = scene.joints[joint].addresses[1] if joint is not None else target
        key = joint if joint is not None else str(target)
        found.setdefault(key, (_at(scene, placement, address), []))[1].append(name)
    return [(key, at, names) for key, (at, names) in found.items()]


def _mark_nodes(axes: Axes, scene: Scene, placement: Placement, name: str) -> None:
    """The nodes of an elastic link between its ends."""
    x_0, y_0, angle = placement.poses[name]
    nodes = mesh(scene, name, scene.bodies[name].beam.elements)[1:-1]
    points = MM * (np.array([x_0, y_0]) + np.outer(nodes, [math.cos(angle), math.sin(angle)]))
    style: dict[str, Any] = {"marker": "o", "markersize": 3.6, "markerfacecolor": "white", "markeredgecolor": ELASTIC}
    axes.plot(*points.T, linestyle="none", zorder=3.3, **style)


def _mark_sensors(axes: Axes, labels: Labels, sensors: list[tuple[str, np.ndarray, list[str]]]) -> None:
    """A diamond at every place and the numbers of its entries in the list."""
    numbers: dict[tuple[float, ...], list[str]] = {}
    for k, (_, at, _) in enumerate(sensors, 1):
        numbers.setdefault(tuple(np.round(at, 6)), []).append(str(k))
    for at, here in numbers.items():
        axes.plot(*at, marker="D", markersize=5.5, color=SENSOR, markeredgecolor="white", zorder=5)
        labels.add(", ".join(here), np.array(at), SENSOR, weight="bold", size=8)


def _listed(sensors: list[tuple[str, np.ndarray, list[str]]]) -> str:
    """The sensors by number, in lines."""
    lines = ["sensors"] if sensors else []
    for k, (place, _, names) in enumerate(sensors, 1):
        lines += textwrap.wrap(f"{k}  {place}: {', '.join(names)}", _LINE, subsequent_indent="    ")
    return "\n".join(lines)
