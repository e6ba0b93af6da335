"""The lowest mode shapes drawn on the mechanism at the reference angle; paper Figs. 11-16."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from kaneflex.multibody.building import has_modes, reference_modes
from kaneflex.plots.drawing import draw_guides, draw_outline, draw_scenery, frame_axes
from kaneflex.plots.mechanism import Outline, grounded, outline, rigid_outline, scenery
from kaneflex.plots.style import GREY, PALETTE, cells, new_figure, shade
from kaneflex.plots.view import angle_name
from kaneflex.response.elastic_motion import ElasticMotion

if TYPE_CHECKING:
    from kaneflex.mechanism.body_frame import Rates
    from kaneflex.multibody.model import Model
    from kaneflex.solve.solution import Solution

MOST = 6
DRAWN = 0.09
"""Largest displacement of a drawn mode, in sizes of the mechanism."""
SMALL = 1e-9
"""Largest displacement at which shapes are evaluated, in sizes: the foreshortening, of second order, vanishes."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``modes``: up to six, each at the largest positive and negative deflection, frequency in the title."""
    model = solution.model
    if model.frame is None or not has_modes(model):
        return {}
    count = min(MOST, model.equations.size)
    omega, shapes = reference_modes(model, count)
    fixed = scenery(model)
    rigid = model.motion.at(np.full(count, model.reference_time))
    still = rigid_outline(model.scene, rigid, fixed)
    positive, negative = (_deflected(model, rigid, fixed, sign * shapes, still) for sign in (1.0, -1.0))
    figure, panels = _panels(count, (still, positive, negative), fixed)
    figure.suptitle(title_at_reference(solution))
    for k, axes in enumerate(panels):
        draw_scenery(axes, fixed)
        draw_guides(axes, fixed, grounded(model.scene), still)
        draw_outline(axes, still, k, ghost=True)
        draw_outline(axes, negative, k, shade(PALETTE[5], 0.3), links_only=True)
        draw_outline(axes, positive, k)
        frame_axes(axes, [still, positive, negative], fixed)
        axes.set_title(f"Mode {k + 1}: {hertz(omega[k])}")
        axes.label_outer()
    figure.legend(handles=_handles(), loc="outside lower center", ncols=3)
    return {"modes": figure}


def _deflected(model: Model, rigid, fixed, shapes: np.ndarray, still: Outline) -> Outline:
    """One mode an instant, each enlarged to the same largest displacement."""
    rates = np.zeros_like(shapes)
    small = shapes * (SMALL * fixed.size / np.abs(shapes).max(axis=0))
    tried = outline(_Alone(model, rigid, (small, rates, rates)), fixed, 1.0 / SMALL)
    largest = np.max([_shift(tried, still, name) for name in still.links], axis=0)
    small *= DRAWN * fixed.size / largest
    return outline(_Alone(model, rigid, (small, rates, rates)), fixed, 1.0 / SMALL)


@dataclass(frozen=True, eq=False)
class _Alone(ElasticMotion):
    """Shapes without what loads do to links of a few modes, which stays as large however small the shapes are."""

    def displacement(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        d, v, a = super().displacement(body, at)
        own = self._loaded.displacement(body, at)
        return d - own[0], v - own[1], a - own[2]

    @cached_property
    def _loaded(self) -> ElasticMotion:
        none = np.zeros_like(self.coordinates[0])
        return ElasticMotion(self.model, self.rigid, (none, none, none))


def _shift(moved: Outline, still: Outline, link: str) -> np.ndarray:
    """Largest displacement of a link at each instant, (n_times,)."""
    return np.hypot(*np.moveaxis(moved.links[link] - still.links[link], -1, 0)).max(axis=1)


def _panels(count: int, outlines: tuple[Outline, ...], fixed) -> tuple[Figure, list]:
    """Panels side by side or one above the other, whichever suits the mechanism's shape."""
    probe = Figure().subplots()
    width, height = frame_axes(probe, list(outlines), fixed)
    columns = min(count, 2 if width > 1.2 * height else 3)
    rows = -(-count // columns)
    panel = min(9.0 / columns, 4.4)
    figure = new_figure(panel * columns + 0.4, (panel * height / width + 0.35) * rows + 1.0, "")
    return figure, cells(figure, rows, columns, count, sharex=True, sharey=True)


def title_at_reference(solution: Solution) -> str:
    model = solution.model
    places = [
        f"{angle_name(solution, drive)} {model.scene.written_coordinate(drive, value)}"
        for drive, value in model.reference_coordinates.items()
    ]
    return f"Mode shapes{' at ' if places else ''}{', '.join(places)}, undamped"


def hertz(omega: float) -> str:
    """A frequency to five digits."""
    value = omega / (2 * math.pi)
    return f"{value:.{max(0, 4 - math.floor(math.log10(value)))}f} Hz" if value > 1e-3 else "0 Hz"


def _handles() -> list[Line2D]:
    return [
        Line2D([], [], color=PALETTE[0], linewidth=2.4, label="mode shape"),
        Line2D([], [], color=shade(PALETTE[5], 0.3), linewidth=1.4, label="half a period later"),
        Line2D([], [], color=GREY, linewidth=0.9, label="undeformed"),
    ]
