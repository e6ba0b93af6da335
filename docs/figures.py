"""Pictures of the documentation, written into docs/pictures.

``python docs/figures.py`` makes the drawings, ``python docs/figures.py NAME ...`` some of them, and
``python docs/figures.py gallery [SCENE ...]`` runs the shipped scenes for the gallery (minutes).
"""

# ruff: noqa: RUF001, RUF005  (minus signs in drawings; sums of arrays and tuples)
from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Arc, Circle, FancyArrowPatch, FancyBboxPatch, Polygon, Rectangle
from PIL import Image, ImageChops, ImageOps

PICTURES = Path(__file__).parent / "pictures"
BLUE, RED, GREY, GREEN, ORANGE = "#0072B2", "#C0392B", "#888888", "#1E8449", "#D98200"
FIGURES: dict[str, Callable[[], None]] = {}


def figure(name: str):
    def keep(draw: Callable[[], None]) -> Callable[[], None]:
        FIGURES[name] = draw
        return draw

    return keep


def panels(n: int, width: float, height: float, titles=(), limits=(-1.0, 1.0, -1.0, 1.0)):
    """Empty drawings side by side, one unit equally long both ways."""
    _, axes = plt.subplots(1, n, figsize=(width, height), squeeze=False, layout="constrained")
    for k, ax in enumerate(axes[0]):
        ax.set_aspect("equal")
        ax.axis("off")
        ax.set_xlim(*limits[:2])
        ax.set_ylim(*limits[2:])
        if titles:
            ax.set_title(titles[k], fontsize=10, family="monospace")
    return axes[0]


def arrow(ax, tail, head, colour="black", width=1.5, style="-|>"):
    ax.add_patch(FancyArrowPatch(tail, head, arrowstyle=style, mutation_scale=12, lw=width, color=colour,
                                 shrinkA=0, shrinkB=0, zorder=6))  # fmt: skip


def turn(ax, at, radius, first, last, colour="black", width=1.5):
    """An arrow along an arc, angles in degrees."""
    phi = np.radians(np.linspace(first, last, 40))
    xy = np.asarray(at)[:, None] + radius * np.array([np.cos(phi), np.sin(phi)])
    ax.plot(*xy[:, :-2], color=colour, lw=width, zorder=6)
    arrow(ax, xy[:, -4], xy[:, -1], colour, width)


def text(ax, x, y, words, colour="black", **style):
    ax.text(x, y, words, **{"ha": "center", "va": "center", "fontsize": 9, "color": colour, "zorder": 8} | style)


def bar(ax, a, b, colour="black", width=5.0):
    ax.plot([a[0], b[0]], [a[1], b[1]], color=colour, lw=width, solid_capstyle="round", zorder=3)


def pin(ax, at, radius=0.05):
    ax.add_patch(Circle(at, radius, facecolor="white", edgecolor="black", lw=1.3, zorder=5))


def ground(ax, at, size=0.16, angle=0.0):
    """A support below a point."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    place = np.asarray(at) + size * (np.array([[0, 0], [-0.7, -1], [0.7, -1]]) @ np.array([[c, s], [-s, c]]))
    ax.add_patch(Polygon(place, facecolor="white", edgecolor="black", lw=1.1, zorder=4))
    hatch(ax, place[1] - 0.15 * (place[2] - place[1]), place[2] + 0.15 * (place[2] - place[1]))


def hatch(ax, a, b, n=7, depth=0.07):
    a, b = np.asarray(a, float), np.asarray(b, float)
    along = (b - a) / np.hypot(*(b - a))
    down = np.array([along[1], -along[0]]) - along
    ax.plot(*np.array([a, b]).T, color="black", lw=1.2, zorder=4)
    for t in np.linspace(0.06, 1.0, n):
        foot = a + t * (b - a)
        ax.plot(*np.array([foot, foot + depth * down]).T, color="black", lw=0.8, zorder=4)


def dimension(ax, a, b, words, side=(0.0, 0.0), colour=GREY, **style):
    arrow(ax, a, b, colour, 1.0, "<|-|>")
    text(ax, (a[0] + b[0]) / 2 + side[0], (a[1] + b[1]) / 2 + side[1], words, **{"fontsize": 8.5} | style)


@figure("pipeline")
def pipeline() -> None:
    (ax,) = panels(1, 8.4, 2.3, limits=(0.0, 8.4, 0.0, 2.3))
    stages = (
        ("scene", "TOML: bodies, joints,\ndrives, loads, sensors", "#FDEBD0"),
        ("derive", "SymPy: Kane's equations,\nonly the terms needed", "#D6EAF8"),
        ("generated", "kernels as numba,\nC or LaTeX", "#D5F5E3"),
        ("run", "assemble, integrate,\nread the sensors", "#FADBD8"),
    )
    for k, (name, words, colour) in enumerate(stages):
        x = 0.1 + 2.1 * k
        ax.add_patch(FancyBboxPatch((x, 0.85), 1.75, 1.2, "round,pad=0.02,rounding_size=0.1", facecolor=colour, lw=1.0))
        text(ax, x + 0.875, 1.72, name, weight="bold", fontsize=12)
        text(ax, x + 0.875, 1.24, words, fontsize=8.5)
        if k < 3:
            arrow(ax, (x + 1.79, 1.45), (x + 2.08, 1.45))
    ax.plot([0.97, 0.97, 7.27], [0.83, 0.42, 0.42], color="black", lw=1.5)
    arrow(ax, (7.27, 0.42), (7.27, 0.83))
    text(ax, 4.1, 0.2, "numbers: lengths, masses, tables, elements, steps (nothing is derived again when they change)")


@figure("scene-axes")
def axes_and_points() -> None:
    (ax,) = panels(1, 6.4, 3.5, limits=(-0.3, 3.3, -0.35, 1.65))
    ground(ax, (0, 0))
    arrow(ax, (0, 0), (0.55, 0), RED)
    arrow(ax, (0, 0), (0, 0.55), RED)
    text(ax, 0.62, -0.02, "x", RED)
    text(ax, -0.02, 0.63, "y", RED)
    text(ax, -0.12, -0.28, "ground (global axes)", RED, ha="left")
    a, angle = np.array([1.0, 0.45]), np.radians(24)
    e, n = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    b = a + 2.0 * e
    bar(ax, a, b)
    arrow(ax, a, a + 0.55 * e, BLUE, 2)
    arrow(ax, a, a + 0.55 * n, BLUE, 2)
    text(ax, *(a + 0.6 * e + 0.12 * n), "x", BLUE)
    text(ax, *(a + 0.55 * n + (0.12, 0.03)), "y", BLUE)
    for point, word, side in (
        (a, '"rod.start"', (-0.1, -0.16)),
        ((a + b) / 2, '"rod.mid"', (0.2, -0.16)),
        (b, '"rod.end"', (0.05, 0.15)),
    ):
        pin(ax, point)
        text(ax, *(point + side), word, family="monospace")
    mark = a + 1.3 * e + 0.35 * n
    ax.plot(*mark, "o", color=GREEN, zorder=6)
    text(ax, *(mark + (-0.35, 0.14)), 'points = {lug = [...]}: "rod.lug"', GREEN, family="monospace", fontsize=8)
    ax.plot([a[0], a[0] + 0.9], [a[1], a[1]], color=GREY, lw=0.8, ls="--")
    turn(ax, a, 0.75, 0, 23, GREY)
    text(ax, a[0] + 1.05, a[1] + 0.11, "angle > 0", GREY, ha="left", va="top")
    text(ax, 0.88, 1.12, "body axes", BLUE, ha="right")


@figure("scene-joints")
def planar_joints() -> None:
    one, two, three = panels(3, 8.4, 2.6, ("revolute (pin)", "prismatic (guide)", "weld"), (-1.1, 1.1, -0.8, 0.8))
    bar(one, (-0.95, -0.3), (0, 0), GREY)
    bar(one, (0, 0), (0.5, 0.65))
    one.plot([0, 0.85], [0, 0.27], color=GREY, lw=0.8, ls="--")
    pin(one, (0, 0), 0.07)
    turn(one, (0, 0), 0.5, 18, 51, RED)
    text(one, 0.5, 0.38, "angle", RED, ha="left")
    text(one, -0.75, -0.45, "first", GREY)
    text(one, 0.15, 0.62, "second")
    two.plot([-0.95, 0.95], [-0.2, -0.2], color=GREY, lw=3)
    two.plot([-0.95, 0.95], [0.2, 0.2], color=GREY, lw=3)
    two.add_patch(Rectangle((0.0, -0.18), 0.5, 0.36, facecolor="#DDDDDD", edgecolor="black", zorder=3))
    pin(two, (-0.8, 0), 0.035)
    pin(two, (0.25, 0), 0.035)
    dimension(two, (-0.8, -0.4), (0.25, -0.4), "position", (0, -0.12), RED)
    arrow(two, (-0.8, 0.42), (-0.35, 0.42), BLUE)
    text(two, 0.15, 0.45, "direction", BLUE)
    text(two, -0.62, 0.07, "first", GREY, va="bottom", fontsize=8)
    text(two, 0.25, 0.1, "second", fontsize=8)
    bar(three, (-0.95, -0.15), (0, -0.15), GREY)
    bar(three, (0, -0.15), (0.7, 0.45))
    three.add_patch(Rectangle((-0.09, -0.24), 0.18, 0.18, facecolor="black", zorder=5))
    three.plot([0, 0.8], [-0.15, -0.15], color=GREY, lw=0.8, ls="--")
    turn(three, (0, -0.15), 0.5, 0, 38, RED)
    text(three, 0.52, 0.0, "relative_angle", RED, ha="left", fontsize=8)
    text(three, -0.7, -0.32, "first", GREY)
    text(three, 0.5, 0.52, "second")


def _space(ax, name: str) -> None:
    """A joint of space in a parallel projection."""
    bar(ax, (-0.95, -0.45), (-0.1, -0.1), GREY, 6)
    bar(ax, (0.1, 0.1), (0.95, 0.4), "black", 6)
    if name in ("revolute", "cylindrical"):
        long = 0.62 if name == "cylindrical" else 0.3
        ax.plot(
            [-0.25 * long / 0.3, 0.25 * long / 0.3],
            [0.38 * long / 0.3, -0.38 * long / 0.3],
            color="#BBBBBB",
            lw=15,
            solid_capstyle="butt",
            zorder=2,
        )
        ax.plot([-0.6, 0.6], [0.91, -0.91], color=RED, lw=1, ls="-.", zorder=4)
        text(ax, -0.42, 0.95, "axis", RED, ha="left")
        turn(ax, (0.42, -0.64), 0.2, 190, 420, BLUE)
        if name == "cylindrical":
            arrow(ax, (0.15, -0.72), (0.36, -1.04), BLUE, style="<|-|>")
    elif name == "universal":
        for end, word in (((-0.5, 0.76), "axes[0]"), ((0.7, 0.25), "")):
            ax.plot([-end[0], end[0]], [-end[1], end[1]], color=RED, lw=1, ls="-.", zorder=4)
            ax.plot([-0.45 * end[0], 0.45 * end[0]], [-0.45 * end[1], 0.45 * end[1]], color="black", lw=5, zorder=3)
            text(ax, end[0] + 0.1, end[1] + 0.1, word, RED, ha="left")
        text(ax, -0.72, -0.1, "axes[1]", RED)
        turn(ax, (0.42, -0.64), 0.18, 190, 420, BLUE)
        turn(ax, (0.58, 0.0), 0.14, 190, 420, BLUE)
    else:
        ax.add_patch(Circle((0, 0), 0.22, facecolor="#BBBBBB", edgecolor="black", zorder=4))
        ax.add_patch(Arc((0, 0), 0.62, 0.62, theta1=70, theta2=330, color=GREY, lw=4, zorder=3))
        for first in (20, 140, 260):
            turn(ax, (0, 0), 0.5, first, first + 60, BLUE)


@figure("scene-joints-space")
def spatial_joints() -> None:
    names = ("revolute", "cylindrical", "universal", "spherical")
    for ax, name in zip(panels(4, 9.0, 2.5, names, (-1.1, 1.1, -1.1, 1.1)), names, strict=True):
        _space(ax, name)


@figure("scene-branches")
def branches() -> None:
    axes = panels(3, 9.0, 2.7, ("", "", ""), (-1.25, 2.3, -1.1, 1.35))
    one, two, three = axes
    crank, end = np.array([0.35, 0.45]), 1.35
    reach = np.sqrt(end**2 - crank[1] ** 2)
    for sign, colour in ((1, BLUE), (-1, ORANGE)):
        x = crank[0] + sign * reach
        bar(one, crank, (x, 0), colour, 3)
        one.add_patch(Rectangle((x - 0.17, -0.11), 0.34, 0.22, facecolor="white", edgecolor=colour, lw=1.6, zorder=4))
        text(one, x, -0.32, f'"{"+" if sign > 0 else "-"}"', colour, weight="bold", fontsize=11)
    bar(one, (0, 0), crank)
    ground(one, (0, 0))
    pin(one, (0, 0))
    pin(one, crank)
    arrow(one, (-0.2, -0.75), (0.6, -0.75), RED)
    text(one, 0.2, -0.93, "direction", RED)
    one.set_title("guide", fontsize=10)
    a, c = np.array([0.2, 0.45]), np.array([1.5, 0.0])
    for sign, colour in ((1, BLUE), (-1, ORANGE)):
        way = c - a
        long = np.hypot(*way)
        r1, r2 = 1.1, 0.95
        along = (r1**2 - r2**2 + long**2) / (2 * long)
        knee = a + along * way / long + sign * np.sqrt(r1**2 - along**2) * np.array([-way[1], way[0]]) / long
        bar(two, a, knee, colour, 3)
        bar(two, knee, c, colour, 3)
        pin(two, knee)
        text(two, *(knee + (0.05, 0.2 * sign)), f'"{"+" if sign > 0 else "-"}"', colour, weight="bold", fontsize=11)
    bar(two, (0, 0), a)
    arrow(two, a, c, RED)
    for at in ((0, 0), tuple(c)):
        ground(two, at)
        pin(two, at)
    pin(two, a)
    text(two, 0.85, 0.4, "line", RED)
    two.set_title("pin: left or right of the line", fontsize=10)
    pivot, crank = np.array([0.3, -0.7]), np.array([0.75, 0.35])
    bar(three, (0.3, 0.0), crank)
    way = (crank - pivot) / np.hypot(*(crank - pivot))
    bar(three, pivot, pivot + 1.9 * way, BLUE, 3)
    bar(three, pivot - 0.05 * way, pivot - 0.45 * way, ORANGE, 3)
    angle = np.degrees(np.arctan2(way[1], way[0]))
    three.add_patch(
        Rectangle(
            crank - 0.14 * way + 0.09 * np.array([way[1], -way[0]]),
            0.28,
            0.18,
            angle=angle,
            facecolor="white",
            edgecolor=BLUE,
            lw=1.6,
            zorder=4,
        )
    )
    ground(three, (0.3, 0.0))
    pin(three, (0.3, 0.0))
    ground(three, tuple(pivot))
    pin(three, tuple(pivot))
    pin(three, tuple(crank))
    arrow(three, pivot + (0.25, 0.0), pivot + (0.25, 0) + 0.7 * way, RED)
    text(three, 0.95, -0.3, "direction", RED, ha="left")
    text(three, 1.62, 0.75, '"+": slider ahead\nof the pivot', BLUE, fontsize=9)
    text(three, 1.2, -0.95, '"-": behind it', ORANGE, fontsize=9)
    three.set_title("slider on a lever", fontsize=10)


@figure("scene-section-forces")
def section_forces() -> None:
    one, two = panels(2, 9.0, 2.4, ("", ""), (-1.15, 1.55, -0.75, 0.75))
    one.add_patch(Rectangle((-1.0, -0.13), 1.2, 0.26, facecolor="#D6EAF8", edgecolor="black", zorder=3))
    hatch(one, (-1.0, 0.25), (-1.0, -0.25), 5)
    arrow(one, (-0.95, 0), (-0.45, 0), BLUE)
    text(one, -0.42, 0.06, "x", BLUE)
    arrow(one, (-0.95, 0), (-0.95, 0.5), BLUE)
    text(one, -0.86, 0.5, "y", BLUE)
    arrow(one, (0.24, 0), (0.85, 0), RED, 2)
    text(one, 0.92, 0.02, "N", RED, fontsize=11)
    arrow(one, (0.3, 0.02), (0.3, 0.6), RED, 2)
    text(one, 0.4, 0.62, "V", RED, fontsize=11)
    turn(one, (0.2, 0), 0.42, -60, 50, RED, 2)
    text(one, 0.68, -0.3, "M", RED, fontsize=11)
    text(one, -0.4, -0.32, "part towards start", fontsize=8)
    text(one, 0.2, -0.62, "what the part towards end exerts on it", RED, fontsize=8.5)
    x = np.linspace(-1, 1, 50)
    two.plot(x, 0.35 * x**2 - 0.1, color=BLUE, lw=7, solid_capstyle="butt")
    text(two, 0, 0.22, "hollow side towards +y:  M = E I v″ > 0", fontsize=9)
    arrow(two, (-1.05, -0.5), (-0.6, -0.5), "black")
    arrow(two, (-1.05, -0.5), (-1.05, -0.05), "black")
    text(two, -0.52, -0.5, "x")
    text(two, -1.05, 0.03, "y")
    text(two, 0.3, -0.35, "strain at y:  N / (E A) − y M / (E I)", fontsize=9)


@figure("scene-sections")
def sections() -> None:
    axes = panels(4, 9.0, 2.7, ("rectangle", "circle", "tube", "I"), (-1.0, 1.0, -1.0, 1.0))
    fill = {"facecolor": "#D6EAF8", "edgecolor": "black", "lw": 1.3}
    axes[0].add_patch(Rectangle((-0.3, -0.55), 0.6, 1.1, **fill))
    dimension(axes[0], (-0.5, -0.55), (-0.5, 0.55), "height", (-0.14, 0), rotation=90)
    dimension(axes[0], (-0.3, -0.72), (0.3, -0.72), "width", (0, -0.14))
    axes[1].add_patch(Circle((0, 0), 0.5, **fill))
    dimension(axes[1], (-0.5, -0.72), (0.5, -0.72), "diameter", (0, -0.14))
    axes[2].add_patch(Circle((0, 0), 0.5, **fill))
    axes[2].add_patch(Circle((0, 0), 0.36, **fill | {"facecolor": "white"}))
    dimension(axes[2], (-0.5, -0.72), (0.5, -0.72), "outer diameter", (0, -0.14))
    text(axes[2], 0.72, 0.5, "wall", fontsize=8.5)
    arrow(axes[2], (0.66, 0.42), (0.38, 0.21), GREY, 1.0)
    outline = [(-0.4, -0.55), (0.4, -0.55), (0.4, -0.42), (0.06, -0.42), (0.06, 0.42), (0.4, 0.42), (0.4, 0.55),
               (-0.4, 0.55), (-0.4, 0.42), (-0.06, 0.42), (-0.06, -0.42), (-0.4, -0.42)]  # fmt: skip
    axes[3].add_patch(Polygon(outline, **fill))
    dimension(axes[3], (-0.55, -0.55), (-0.55, 0.55), "height", (-0.14, 0), rotation=90)
    dimension(axes[3], (-0.4, -0.72), (0.4, -0.72), "width", (0, -0.14))
    text(axes[3], 0.36, 0.08, "web", fontsize=8.5)
    arrow(axes[3], (0.24, 0.04), (0.07, 0.0), GREY, 1.0)
    text(axes[3], 0.74, 0.48, "flange", fontsize=8.5)
    arrow(axes[0], (0.55, 0), (0.55, 0.4), BLUE)
    text(axes[0], 0.66, 0.4, "y", BLUE)
    text(axes[0], 0.6, -0.12, "body axis", BLUE, fontsize=7.5)


@figure("scene-clearance")
def clearances() -> None:
    one, two, three = panels(3, 9.0, 3.0, ("radial", "gap", "angle"), (-1.1, 1.1, -1.0, 1.0))
    one.add_patch(Circle((0, 0), 0.95, facecolor="#EEEEEE", edgecolor="none"))
    one.add_patch(Circle((0, 0), 0.72, facecolor="white", edgecolor="black", lw=1.5))
    one.add_patch(Circle((0.13, -0.1), 0.5, facecolor="#D6EAF8", edgecolor=BLUE, lw=1.5))
    one.plot(0, 0, "k+", ms=9)
    one.plot(0.13, -0.1, "+", color=BLUE, ms=9)
    dimension(one, (0.13, -0.1), (-0.32, 0.12), "radius", (0.12, 0.12))
    arrow(one, (-0.66, -0.74), (-0.52, -0.52), RED, 1.0)
    text(one, 0.0, -0.98, "radial = bearing radius − pin radius", RED, fontsize=7.5)
    text(one, 0.25, -0.32, "pin: second body", BLUE, fontsize=8)
    text(one, 0, 0.84, "bearing: first body", fontsize=8)
    for y in (-0.55, 0.55):
        two.plot([-1.05, 1.05], [y, y], color="black", lw=1.5)
    two.add_patch(Rectangle((-1.05, 0.55), 2.1, 0.14, facecolor="#EEEEEE"))
    two.add_patch(Rectangle((-1.05, -0.69), 2.1, 0.14, facecolor="#EEEEEE"))
    c, s = np.cos(0.06), np.sin(0.06)
    corners = np.array([[-0.6, -0.38], [0.6, -0.38], [0.6, 0.38], [-0.6, 0.38]]) @ np.array([[c, s], [-s, c]])
    two.add_patch(Polygon(corners, facecolor="#D6EAF8", edgecolor=BLUE, lw=1.5))
    for corner, number, dx, dy in zip(
        corners, ("_1", "_2", "_4", "_3"), (0.14, -0.14, -0.14, 0.14), (0.1, 0.1, -0.1, -0.1), strict=True
    ):
        text(two, corner[0] + dx, corner[1] + dy, number, BLUE, fontsize=8.5)
    dimension(two, (0.85, 0.36), (0.85, 0.55), "gap", (0.17, -0.06), RED)
    dimension(two, (-0.6, 0.0), (0.6, 0.05), "length", (0, 0.11))
    dimension(two, (-0.9, -0.38), (-0.9, 0.38), "height", (0.1, 0), rotation=90)
    arrow(two, (-0.4, -0.85), (0.4, -0.85), GREEN)
    text(two, 0.0, -0.95, "direction", GREEN, fontsize=8)
    three.add_patch(Circle((0, 0), 0.9, facecolor="#EEEEEE", edgecolor="black"))
    for centre in (0, 180):
        wedge = [(0, 0)] + [
            (0.9 * np.cos(np.radians(t)), 0.9 * np.sin(np.radians(t)))
            for t in np.linspace(centre - 32, centre + 32, 20)
        ]
        three.add_patch(Polygon(wedge, facecolor="white", edgecolor="black"))
    three.add_patch(Rectangle((-0.85, -0.16), 1.7, 0.32, facecolor="#D6EAF8", edgecolor=BLUE, lw=1.5))
    three.add_patch(Circle((0, 0), 0.24, facecolor="#D6EAF8", edgecolor=BLUE, lw=1.5))
    turn(three, (0, 0), 0.72, 11, 31, RED)
    turn(three, (0, 0), 0.72, -11, -31, RED)
    text(three, 0.54, 0.235, "angle", RED, fontsize=7)
    text(three, 0.54, -0.235, "angle", RED, fontsize=7)
    text(three, 0.82, -0.62, "flank _1", fontsize=8)
    text(three, 0.82, 0.62, "flank _2", fontsize=8)


@figure("scene-contacts")
def contacts() -> None:
    one, two, three = panels(
        3, 9.0, 2.5, ("point_on_line", "circle_on_circle", "circle_in_circle"), (-1.1, 1.1, -0.85, 0.85)
    )
    hatch(one, (-0.95, -0.35), (0.95, -0.35), 12)
    one.add_patch(Circle((0.1, 0.1), 0.3, facecolor="#D6EAF8", edgecolor=BLUE, lw=1.5))
    one.plot(0.1, 0.1, "o", color=BLUE, ms=4)
    arrow(one, (-0.6, -0.35), (-0.6, 0.15), RED)
    text(one, -0.6, 0.26, "normal", RED)
    dimension(one, (0.1, 0.1), (0.36, 0.25), "radius", (0.28, 0.1))
    dimension(one, (0.1, -0.34), (0.1, -0.2), "", colour=GREEN)
    text(one, 0.32, -0.27, "contact_gap", GREEN, fontsize=7.5, ha="left")
    for ax in (two,):
        ax.add_patch(Circle((-0.5, 0), 0.45, facecolor="#EEEEEE", edgecolor="black", lw=1.5))
        ax.add_patch(Circle((0.5, 0.1), 0.35, facecolor="#D6EAF8", edgecolor=BLUE, lw=1.5))
        dimension(ax, (-0.5, 0), (-0.82, 0.3), "radii[0]", (0.12, 0.12))
        dimension(ax, (0.5, 0.1), (0.75, 0.34), "radii[1]", (0.0, 0.26), BLUE)
    three.add_patch(Circle((0, 0), 0.72, facecolor="white", edgecolor="black", lw=1.5))
    three.add_patch(Circle((0.2, -0.15), 0.4, facecolor="#D6EAF8", edgecolor=BLUE, lw=1.5))
    dimension(three, (0, 0), (-0.55, 0.46), "radii[1]", (0.2, 0.12))
    dimension(three, (0.2, -0.15), (0.5, -0.41), "radii[0]", (-0.2, -0.05), BLUE)


@figure("scene-friction")
def friction_laws() -> None:
    _, axes = plt.subplots(1, 4, figsize=(9.0, 2.3), layout="constrained")
    v = np.linspace(0.001, 1, 300)
    size = {
        "coulomb": 0.6 + 0 * v,
        "stribeck": 0.5 + 0.4 * np.exp(-((v / 0.15) ** 2)) + 0.25 * v,
        "viscous": 0.8 * v,
    }
    for ax, (name, f) in zip(axes, size.items(), strict=False):
        ax.plot(v, f, color=BLUE)
        ax.plot(-v, -f, color=BLUE)
        if name != "viscous":
            ax.plot([0, 0], [-f[0], f[0]], color=BLUE)
        ax.set_xlabel("speed v", fontsize=8.5)
    axes[0].text(0.1, 0.66, "mu N + preload", fontsize=7.5)
    axes[1].text(0.1, 0.93, "mu_static N", fontsize=7.5)
    axes[0].set_ylabel("friction", fontsize=8.5)
    z, path = 0.0, []
    way = 0.9 * np.sin(np.linspace(0, 4.5 * np.pi, 6000))
    for move in np.diff(way):
        z += move - 6.0 * abs(move) * z / 1.0
        path.append(0.6 * 6.0 * z)
    axes[3].plot(way[1:] / 0.9, path, color=BLUE)
    axes[3].set_xlabel("displacement", fontsize=8.5)
    for ax, name in zip(axes, (*size, "lugre"), strict=True):
        ax.set_title(name, fontsize=10, family="monospace")
        ax.axhline(0, color=GREY, lw=0.6)
        ax.axvline(0, color=GREY, lw=0.6)
        ax.set_xticks([])
        ax.set_yticks([])
        ax.set_ylim(-1.1, 1.1)
        ax.spines[["top", "right"]].set_visible(False)


@figure("scene-contact-laws")
def contact_laws() -> None:
    """Force over depth of one impact, m = K = v0 = 1, n = 1.5, e = 0.7."""
    _, ax = plt.subplots(figsize=(5.4, 3.0), layout="constrained")
    e = 0.7
    chi = {"hertz": 0.0, "exact": _exact(e), "hunt-crossley": 1.5 * (1 - e), "flores": 8 * (1 - e) / (5 * e)}
    for (name, x), colour in zip(chi.items(), (GREY, BLUE, ORANGE, GREEN), strict=True):
        d, v, step, path = 0.0, 1.0, 1e-3, []
        while True:
            force = max(d, 0.0) ** 1.5 * (1 + x * v)
            v -= step * force
            d += step * v
            if d <= 0:
                break
            path.append((d, force))
        ax.plot(*np.array(path).T, color=colour, label=f"{name}: returns {-v:.2f}")
    ax.set_xlabel("depth d")
    ax.set_ylabel("force F")
    ax.set_xticks([])
    ax.set_yticks([])
    ax.spines[["top", "right"]].set_visible(False)
    ax.legend(fontsize=8, frameon=False, title="law, e = 0.7 asked for", title_fontsize=8)


def _exact(e: float) -> float:
    """Damping factor of law `exact`: (1 + x)/(1 - e x) = exp(x (1 + e)), by bisection."""
    low, high = 1e-6, 1 / e - 1e-6
    for _ in range(80):
        x = (low + high) / 2
        low, high = (x, high) if np.log((1 + x) / (1 - e * x)) < x * (1 + e) else (low, x)
    return x


@figure("scene-references")
def references() -> None:
    axes = panels(3, 9.0, 2.2, ('relative_to = "frame"', '"chord"', '"start"'), (-0.15, 1.3, -0.25, 0.75))
    x = np.linspace(0, 1, 60)
    y = 0.12 + 0.3 * x + 0.28 * np.sin(np.pi * x)
    chord = 0.12 + 0.3 * x
    for ax, base in zip(axes, (0 * x, chord, 0.12 + 0 * x), strict=True):
        ax.plot(x, 0 * x, color=GREY, lw=1.5)
        ax.plot(x, y, color=BLUE, lw=4)
        ax.plot(x, base, color=RED, lw=1, ls="--")
        arrow(ax, (0.5, base[30]), (0.5, y[30] - 0.02), RED)
        for k in (0, -1):
            pin(ax, (x[k], y[k]), 0.025)
        text(ax, 0.5, -0.15, "grey: rigid link, blue: deformed link", fontsize=7.5)


@figure("scene-springs")
def springs() -> None:
    one, two, three = panels(3, 9.0, 2.3, ("between", "torsional_at", "bushing (space)"), (-1.1, 1.1, -0.75, 0.75))
    t = np.linspace(0, 1, 200)
    zigzag = 0.14 * np.abs(2 * ((8 * t) % 1) - 1) - 0.07
    one.plot(-0.7 + 1.4 * t, 0.15 + zigzag, color=BLUE, lw=1.5)
    one.plot([-0.7, -0.1], [-0.15, -0.15], color=BLUE)
    one.plot([0.05, 0.05], [-0.24, -0.06], color=BLUE, lw=2)
    one.plot([0.05, 0.7], [-0.15, -0.15], color=BLUE)
    one.plot([0.15, -0.1, -0.1, 0.15], [-0.04, -0.04, -0.26, -0.26], color=BLUE)
    for side in (-0.7, 0.7):
        one.plot([side, side], [-0.15, 0.15], color=BLUE)
        pin(one, (side, 0))
    dimension(one, (-0.7, -0.45), (0.7, -0.45), "distance L", (0, -0.12))
    bar(two, (-0.9, -0.3), (0, 0), GREY)
    bar(two, (0, 0), (0.85, 0.35))
    phi = np.linspace(0.4, 5.5 * np.pi, 300)
    two.plot((0.1 + 0.013 * phi) * np.cos(phi), (0.1 + 0.013 * phi) * np.sin(phi), color=BLUE)
    pin(two, (0, 0))
    three.add_patch(Rectangle((-0.6, -0.55), 1.2, 0.25, facecolor="#EEEEEE", edgecolor="black"))
    three.add_patch(Rectangle((-0.45, -0.3), 0.9, 0.4, facecolor="#555555", edgecolor="black"))
    three.add_patch(Rectangle((-0.6, 0.1), 1.2, 0.25, facecolor="#D6EAF8", edgecolor="black"))
    arrow(three, (0, 0.35), (0, 0.7), RED)
    arrow(three, (0.6, 0.22), (0.95, 0.22), RED)
    turn(three, (0, 0.5), 0.17, -60, 200, RED)
    text(three, 0, -0.1, "three stiffnesses along,\nthree about the axes", "white", fontsize=7)


def gallery(names: list[str]) -> None:
    """Picture `mechanism` of each scene's run, at most 900 pixels wide, and a thumbnail of it."""
    from kaneflex.cli import main as kaneflex

    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            made = Path(folder) / "run"
            kaneflex(["run", name, "--plots", "mechanism", "-q", "-o", str(made)], standalone_mode=False)
            whole = Image.open(made / "mechanism.png").convert("RGB")
        edges = ImageChops.invert(whole).getbbox()
        whole = ImageOps.expand(whole.crop(edges), 12, "white")
        for file, room in ((PICTURES / f"{name}.png", (900, 640)), (PICTURES / "thumbs" / f"{name}.png", (220, 160))):
            small = ImageOps.contain(whole, room, Image.Resampling.LANCZOS)
            small.quantize(64).save(file, optimize=True)


def main() -> None:
    if sys.argv[1:2] == ["gallery"]:
        from kaneflex import shipped_scenes

        gallery(sys.argv[2:] or list(shipped_scenes()))
        return
    plt.rcParams.update({"font.size": 9, "svg.hashsalt": "kaneflex"})
    for name, draw in FIGURES.items():
        if sys.argv[1:] and name not in sys.argv[1:]:
            continue
        draw()
        file = PICTURES / f"{name}.png"
        plt.savefig(file, dpi=120)
        plt.close("all")
        Image.open(file).convert("RGB").quantize(64).save(file, optimize=True)


if __name__ == "__main__":
    main()
