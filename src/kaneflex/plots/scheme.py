"""A scene as a drawing: bodies, joints, drives, loads, masses and sensors with their names, before anything is derived."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.placing import Placement, place_of
from kaneflex.plots.drawing import MM, draw_guides, draw_outline, draw_scenery, frame_axes
from kaneflex.plots.labels import Labels
from kaneflex.plots.mechanism import Outline, Scenery, rigid_outline, rigid_scenery
from kaneflex.plots.style import PALETTE, new_figure, styled
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address

ELASTIC, DRIVE, SENSOR, LOAD = PALETTE[0], PALETTE[4], PALETTE[2], PALETTE[1]
_ROOM = 0.22
"""Room around the mechanism for names and arrows, in its sizes."""
_ARROW = 0.16
_ARC = 0.055
"""Length of a force's arrow, and radius of a drive's or torque's, in sizes of the mechanism."""
_LINE = 44
"""Characters in a line of the list of sensors."""
_WIDTH, _LIST = 7.2, 3.6


def draw_scheme(scene: Scene, placement: Placement, path: Path) -> None:
    """Write the drawing of a scene at one configuration; ``path`` ends in .png, .svg or .pdf.

    Raises
    ------
    OSError
        If the file can't be written.
    """
    with styled():
        figure = scheme(scene, placement)
        metadata = {"CreationDate": None} if path.suffix == ".pdf" else {"Date": None} if path.suffix == ".svg" else None
        figure.savefig(path, metadata=metadata)


def scheme(scene: Scene, placement: Placement) -> Figure:
    """The drawing as a matplotlib Figure."""
    fixed = rigid_scenery(scene, placement)
    drawn = rigid_outline(scene, placement, fixed)
    figure = new_figure(_WIDTH, 4.0, "", layout="none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    width, height = frame_axes(axes, [drawn], fixed, _ROOM)
    sensors = _sensors_by_place(scene, placement)
    _arrange(figure, axes, width, height, bool(sensors))
    figure.suptitle(f"{scene.name}: {scene.description}" if scene.description else scene.name, x=0.02, ha="left")
    axes.set_title(_configuration(placement))
    draw_scenery(axes, fixed)
    grounded = {name: scene.joints[name].addresses[0].body == "ground" for name in fixed.guides}
    draw_guides(axes, fixed, grounded, drawn)
    draw_outline(axes, drawn, 0, colour=ELASTIC)
    labels = Labels(axes, [*_paths(drawn), *_ground_points(fixed)])
    _Parts(scene, placement, fixed, axes, labels).draw()
    _mark_sensors(axes, labels, sensors)
    labels.place()
    _list(figure, axes, scene, sensors)
    return figure


def _arrange(figure: Figure, axes: Axes, width: float, height: float, listed: bool) -> None:
    """Size the figure to the mechanism's shape, with room for the list at its right."""
    tall = min(6.5, max(2.6, (_WIDTH - 0.9) * height / width))
    total = _WIDTH + (_LIST if listed else 0.0)
    figure.set_size_inches(total, tall + 1.25)
    axes.set_position((0.75 / total, 0.55 / (tall + 1.25), (_WIDTH - 0.9) / total, tall / (tall + 1.25)))
    axes.set_anchor("NW")


def _configuration(placement: Placement) -> str:
    angles = ", ".join(f"{name} = {math.degrees(value):.6g} deg" for name, value in placement.drives.items())
    return f"at {angles}" if angles else ""


def _paths(drawn: Outline) -> list[np.ndarray]:
    """Lines of the bodies [mm], which labels keep clear of."""
    parts = [*drawn.links.values(), *drawn.bars.values(), *drawn.boxes.values()]
    return [MM * part[0] for part in parts]


def _ground_points(fixed: Scenery) -> list[np.ndarray]:
    """The triangles under ground pivots."""
    depth = np.array([0.0, 0.05 * fixed.size])
    return [MM * np.array([pivot, pivot - depth]) for pivot in fixed.pivots]


class _Parts:
    """Names and symbols of everything but the sensors."""

    def __init__(self, scene: Scene, placement: Placement, fixed: Scenery, axes: Axes, labels: Labels):
        self.scene, self.placement, self.axes, self.labels = scene, placement, axes, labels
        self.size = MM * fixed.size

    def draw(self) -> None:
        for name in self.scene.bodies:
            self._body(name)
        for name in self.scene.joints:
            self._joint(name)
        for name in self.scene.masses:
            self._mass(name)
        for name in self.scene.drives:
            self._drive(name)
        for name in self.scene.forces:
            self._force(name)
        for name, load in self.scene.torques.items():
            self._turning(load.torque_at, LOAD, name, radius=1.5 * _ARC)
        if self.scene.gravity != (0.0, 0.0):
            self._gravity()

    def at(self, address: Address) -> np.ndarray:
        return MM * place_of(self.scene, self.placement.poses, address)

    def _body(self, name: str) -> None:
        body = self.scene.bodies[name]
        middle = Address(name, "mid" if body.length is not None else "start")
        kind = f"{name} ({body.beam.elements} el.)" if body.elastic else name
        self.labels.add(kind, self.at(middle), ELASTIC if body.elastic else "black", style="italic", size=9.5)

    def _joint(self, name: str) -> None:
        joint = self.scene.joints[name]
        at = self.at(joint.addresses[1])
        if joint.kind == "weld":
            self.axes.plot(*at, marker="s", markersize=5, color="black", zorder=4.5)
        self.labels.add(name, at, "#555555", size=8)

    def _mass(self, name: str) -> None:
        mass = self.scene.masses[name]
        at = self.at(mass.at)
        self.axes.plot(*at, marker="o", markersize=8, color="black", zorder=3.9)
        self.labels.add(f"{name} ({mass.mass:.4g} kg)" if mass.mass else name, at, "black", size=8)

    def _drive(self, name: str) -> None:
        drive = self.scene.drives[name]
        text = {"free": "free", "law": "law", "table": "table"}.get(drive.kind)
        if text is None:
            text = f"{drive.speed * 30.0 / math.pi:.4g} rpm"
        self._turning(name, DRIVE, text, clockwise=(drive.speed or 0.0) < 0.0, dashed=drive.kind == "free")

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

    def _force(self, name: str) -> None:
        load = self.scene.forces[name]
        d = np.array(load.direction)
        if load.axes == "body":
            angle = self.placement.poses[load.force_on.body][2]
            d = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]) @ d
        head = self.at(load.force_on)
        tail = head - _ARROW * self.size * d
        self._arrow(tail, head, LOAD)
        self.labels.block(np.linspace(tail, head, 12))
        self.labels.add(name, tail, LOAD, size=8)

    def _gravity(self) -> None:
        g = np.array(self.scene.gravity)
        (left, _), (_, top) = self.axes.get_xlim(), self.axes.get_ylim()
        middle = np.array([left, top]) + 0.5 * _ROOM * self.size * np.array([1.0, -1.0])
        half = 0.35 * _ROOM * self.size * g / np.hypot(*g)
        self._arrow(middle - half, middle + half, "#555555")
        self.labels.block(np.linspace(middle - half, middle + half, 12))
        self.labels.add("g", middle, "#555555", style="italic", size=9)

    def _arrow(self, tail: np.ndarray, head: np.ndarray, colour: str) -> None:
        style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 12}
        self.axes.annotate("", xy=tuple(head), xytext=tuple(tail), arrowprops=style, zorder=4.7)


def _sensors_by_place(scene: Scene, placement: Placement) -> list[tuple[str, np.ndarray, list[str]]]:
    """Where sensors measure: (address or joint, place [mm], names), in the scene's order."""
    found: dict[str, tuple[np.ndarray, list[str]]] = {}
    for name, sensor in scene.sensors.items():
        target = sensor.target
        joint = target if isinstance(target, str) else target.body if target.body in scene.joints else None
        address = scene.joints[joint].addresses[1] if joint is not None else target
        key = joint if joint is not None else str(target)
        found.setdefault(key, (MM * place_of(scene, placement.poses, address), []))[1].append(name)
    return [(key, at, names) for key, (at, names) in found.items()]


def _mark_sensors(axes: Axes, labels: Labels, sensors: list[tuple[str, np.ndarray, list[str]]]) -> None:
    """A diamond at every place and the numbers of its entries in the list."""
    numbers: dict[tuple[float, ...], list[str]] = {}
    for k, (_, at, _) in enumerate(sensors, 1):
        numbers.setdefault(tuple(np.round(at, 6)), []).append(str(k))
    for at, here in numbers.items():
        axes.plot(*at, marker="D", markersize=5.5, color=SENSOR, markeredgecolor="white", zorder=5)
        labels.add(", ".join(here), np.array(at), SENSOR, weight="bold", size=8)


def _list(figure: Figure, axes: Axes, scene: Scene, sensors: list[tuple[str, np.ndarray, list[str]]]) -> None:
    """The sensors by number, beside the drawing."""
    if not sensors:
        return
    width, height = figure.get_size_inches()
    lines = ["sensors"]
    for k, (place, _, names) in enumerate(sensors, 1):
        lines += textwrap.wrap(f"{k}  {place}: {', '.join(names)}", _LINE, subsequent_indent="    ")
    figure.text(
        (_WIDTH + 0.1) / width, axes.get_position().y1, "\n".join(lines), color=SENSOR, fontsize=7.5, va="top",
        linespacing=1.35,
    )  # fmt: skip


