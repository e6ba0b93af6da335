"""Picture of the mechanism at its worst instant: enlarged deformation, elastic links coloured by stress."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from kaneflex.plots.drawing import MM, draw_outline, draw_scenery, frame_axes
from kaneflex.plots.enlarged import Enlarged, caption_at, enlarged
from kaneflex.plots.outlines import ALONG_LINK, Outline
from kaneflex.plots.paths import global_vector, velocity
from kaneflex.plots.style import new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.support.errors import SceneError
from kaneflex.support.escaping import picture_text

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_MARGINS = (0.8, 0.3, 0.55, 0.85)
"""Left, right, below and above the axes [inches]."""
_BAR = 1.1
"""Room for the scale of colours beside the axes [inches]."""
_WIDTH, _LEAST, _MOST = 6.2, 1.6, 5.2
"""Width of the axes, their least and greatest height [inches]."""


class Field(NamedTuple):
    """Values of each link at the middles of its drawn pieces, (n_times, n_pieces), and the name of the scale."""

    values: Mapping[str, np.ndarray]
    label: str


def stress_field(solution: Solution, instants: np.ndarray, count: int = ALONG_LINK) -> Field | None:
    """Largest von Mises stress of each section; None where no link's section has a shape.

    ``instants`` index the solution's times; ``count`` is the number of points along a link.
    """
    stresses = solution.stresses
    if not stresses:
        return None
    factor, unit = readable("Pa", *(each.mises[:, instants] for each in stresses.values()))
    values = {}
    for name, each in stresses.items():
        middles = np.linspace(0.0, each.x[-1], 2 * count - 1)[1::2]
        values[name] = np.array([factor * np.interp(middles, each.x, each.mises[:, instant]) for instant in instants])
    return Field(values, f"von Mises stress [{unit}]")


def displacement_field(shown: View) -> Field | None:
    """Size of the elastic displacement; None without elastic links."""
    sizes = {name: np.linalg.norm(shown.displaced(name, np.linspace(0.0, length, 2 * ALONG_LINK - 1)[1::2]), axis=1).T
             for name, length in shown.lengths.items()}  # fmt: skip
    if not sizes:
        return None
    factor, unit = readable("m", *sizes.values())
    return Field({name: factor * each for name, each in sizes.items()}, f"elastic displacement [{unit}]")


class LinkColours:
    """Links of an outline coloured by a field, with one scale for all instants; other links are left out."""

    def __init__(self, axes: Axes, outline: Outline, field: Field) -> None:
        names = [name for name in outline.links if name in field.values]
        lines = [MM * outline.links[name] for name in names]
        self._pieces = np.concatenate([np.stack([line[:, :-1], line[:, 1:]], axis=2) for line in lines], axis=1)
        self._values = np.concatenate([field.values[name] for name in names], axis=1)
        self.artist = LineCollection([*self._pieces[0]], cmap="turbo", linewidths=4.5, capstyle="round", zorder=3.3)
        self.artist.set_clim(0.0, float(self._values.max()) or 1.0)
        self.artist.set_array(self._values[0])
        axes.add_collection(self.artist)

    def move(self, k: int) -> None:
        """Show the k-th instant."""
        self.artist.set_segments([*self._pieces[k]])
        self.artist.set_array(self._values[k])


class _Worst(NamedTuple):
    """Instant to draw, the reason for it, and the marked place: a body and a share of its length, or a joint."""

    instant: int
    reason: str = ""
    body: str = ""
    share: float = 0.0
    joint: str = ""


def figures(solution: Solution) -> dict[str, Figure]:
    """``mechanism``: at the instant of the largest stress; else of the largest displacement, joint force or speed."""
    worst = _worst(solution)
    shown = View(solution, np.array([worst.instant]))
    found = enlarged(shown)
    figure = new_figure(8.1, 6.0, "", layout="none")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    field = None
    if found.moved.links and found.visible:
        field = stress_field(solution, shown.instants) or displacement_field(shown)
    _draw(figure, axes, found, 0.0 if field is None else _BAR)
    if field is not None:
        colours = LinkColours(axes, found.moved, field)
        width = figure.get_size_inches()[0]
        bar = figure.add_axes((1.0 - 0.95 / width, 0.2, 0.16 / width, 0.6))
        bar.set_title(field.label.partition(" [")[0].split()[-1])
        figure.colorbar(colours.artist, cax=bar).set_label(field.label, labelpad=6.0)
    marked = found.visible or bool(worst.joint)
    if marked:
        _mark(axes, found, worst)
    figure.suptitle(f"{picture_text(solution.model.scene.name)}: {found.title}")
    axes.set_title(f"{caption_at(shown, 0)}{worst.reason if marked else ''}")
    return {"mechanism": figure}


def _worst(solution: Solution) -> _Worst:
    stresses, scene = solution.stresses, solution.model.scene
    if stresses:
        name = max(stresses, key=lambda each: float(stresses[each].mises.max()))
        station, instant = stresses[name].largest
        factor, unit = readable("Pa", stresses[name].mises)
        largest, x = factor * float(stresses[name].mises[station, instant]), stresses[name].x
        where = f"{picture_text(name)} at {MM * x[station]:.4g} mm"
        share = float(x[station] / x[-1])
        return _Worst(instant, f"\nlargest stress of the run, {largest:.3g} {unit}, in {where}", name, share)
    shown, links = view(solution), solution.model.links
    if links:
        places = [(name, float(x)) for name, link in links.items() for x in link.nodes]
        moved = np.vstack([np.linalg.norm(shown.displaced(name, link.nodes), axis=1) for name, link in links.items()])
        which, at = np.unravel_index(int(moved.argmax()), moved.shape)
        name, place = places[int(which)]
        factor, unit = readable("m", moved)
        where = f"{picture_text(name)} at {MM * place:.4g} mm"
        words = f"\nlargest displacement, {factor * moved.max():.3g} {unit}, of {where}"
        return _Worst(int(shown.instants[at]), words, name, place / links[name].length)
    instants, (quantity, si, of) = np.arange(len(solution.times)), ("force", "N", "in")
    sizes = _joint_forces(solution)
    if not sizes:
        instants, (quantity, si, of) = shown.instants, ("speed", "m/s", "of")
        sizes = {name: np.linalg.norm(velocity(shown, point), axis=0) for name, joint in scene.joints.items()
                 for point in joint.addresses if point.body != "ground"}  # fmt: skip
    if not sizes:
        return _Worst(0)
    name = max(sizes, key=lambda each: float(sizes[each].max()))
    factor, unit = readable(si, sizes[name])
    words = f"\nlargest joint {quantity} of the run, {factor * sizes[name].max():.3g} {unit}, {of} {picture_text(name)}"
    return _Worst(int(instants[sizes[name].argmax()]), words, joint=name)


def _joint_forces(solution: Solution) -> dict[str, np.ndarray]:
    """Size of each joint's force [N], (n_times,), of the joints whose forces the equations of motion determine."""
    found = {}
    for name in solution.model.scene.joints:
        with suppress(LookupError, SceneError):
            size = np.linalg.norm(global_vector(solution.motion, joint_force=name), axis=0)
            if np.isfinite(size).all():
                found[name] = size
    return found


def _draw(figure: Figure, axes: Axes, found: Enlarged, beside: float) -> None:
    """Both outlines with the ground, in axes that fit them."""
    fixed = found.fixed
    width, height = frame_axes(axes, [found.still, found.moved], fixed, swept=False)
    left, right, below, above = _MARGINS
    across, tall = _WIDTH, _WIDTH * height / width
    if tall > _MOST:
        across, tall = max(_LEAST, _MOST * width / height), _MOST
    across = max(across, 4.4)  # the title needs this
    tall = max(_LEAST, tall)
    size = np.array([across + left + right + beside, tall + below + above])
    figure.set_size_inches(*size)
    axes.set_position((left / size[0], below / size[1], across / size[0], tall / size[1]))
    (start, end), (low, high) = axes.get_xlim(), axes.get_ylim()
    wider, taller = max(0.0, across * height / tall - width) / 2, max(0.0, tall * width / across - height) / 2
    axes.set(xlim=(start - wider, end + wider), ylim=(low - taller, high + taller))
    draw_scenery(axes, fixed, found.still)
    if found.visible:
        draw_outline(axes, found.still, 0, ghost=True)
    draw_outline(axes, found.moved, 0)


def _mark(axes: Axes, found: Enlarged, worst: _Worst) -> None:
    """A ring around the place of the largest value."""
    place = None
    if worst.body in found.moved.links:
        line = found.moved.links[worst.body][0]
        place = line[round(worst.share * (len(line) - 1))]
    elif worst.joint in found.moved.pins:
        place = found.moved.pins[worst.joint][0]
    elif worst.joint in found.moved.boxes:
        corners = found.moved.boxes[worst.joint][0]
        place = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    if place is not None:
        axes.plot(*(MM * place), "o", markersize=14, markerfacecolor="none", markeredgecolor="#D55E00", zorder=5)
