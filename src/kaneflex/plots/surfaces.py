"""Displacements of a link as surfaces over its length and time, in its axes and in global ones; paper Figs. 23, 24."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from kaneflex.plots.style import new_figure, readable
from kaneflex.plots.view import View, view

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_ALONG, _INSTANTS = 33, 181


def figures(solution: Solution) -> dict[str, Figure]:
    """``surfaces_LINK``: longitudinal, transverse, global X and global Y displacement of each elastic link."""
    if solution.model.frame is None:
        return {}
    shown = _thinned(view(solution))
    return {f"surfaces_{name}": _figure(shown, name, length) for name, length in shown.lengths.items()}


def _thinned(shown: View) -> View:
    picked = np.linspace(0, len(shown.instants) - 1, min(_INSTANTS, len(shown.instants))).round().astype(int)
    return View(shown.solution, shown.instants[picked], shown.turns)


def _figure(shown: View, name: str, length: float) -> Figure:
    title = f"Elastic displacement of {name} relative to its rigid frame{shown.note}"
    figure = new_figure(9.6, 6.6, title, layout="none")  # the constrained one leaves axes in space a wide margin
    figure.subplots_adjust(left=0.0, right=0.95, bottom=0.05, top=0.92, wspace=0.08, hspace=0.16)
    x = np.linspace(0.0, length, _ALONG)
    local = np.array([shown.motion.displacement(name, (at, 0.0))[0][:2] for at in x]).swapaxes(0, 1)
    titles = "Longitudinal, link axes", "Transverse, link axes", "X, global axes", "Y, global axes"
    fields = (*local, *shown.rigid.frame(name).to_global(local))
    for k, (title, field) in enumerate(zip(titles, fields, strict=True)):
        axes = figure.add_subplot(2, 2, k + 1, projection="3d")
        _surface(axes, shown, x, field)
        axes.set_title(title, loc="center", y=0.97)
    return figure


def _surface(axes: Axes, shown: View, x: np.ndarray, field: np.ndarray) -> None:
    """One displacement (n_points, n_times) [m]."""
    factor, label = readable("m", field)
    along, instants = np.meshgrid(1e3 * x, shown.x, indexing="ij")
    style = {"cmap": "viridis", "rcount": _ALONG, "ccount": _INSTANTS, "linewidth": 0.0, "antialiased": False}
    surface = axes.plot_surface(instants, along, factor * field, **style)
    surface.set_rasterized(True)  # thousands of facets: pixels inside the SVG
    axes.set_xlabel(shown.x_label, labelpad=4)
    axes.set_ylabel("x [mm]", labelpad=2)
    axes.set_zlabel(f"displacement [{label}]", labelpad=2)
    axes.tick_params(pad=0)
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.zaxis.set_major_locator(MaxNLocator(5))
    if shown.drive:
        axes.set_xticks(np.arange(np.ceil(shown.x[0] / 180) * 180, shown.x[-1] + 1, 180))
    axes.view_init(elev=28, azim=-58)
    axes.set_box_aspect((1.5, 0.9, 0.75), zoom=1.12)
