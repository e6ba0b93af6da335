"""Displacements of a link as surfaces over its length and time, in its axes and in global ones; paper Figs. 23, 24."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from kaneflex.plots.style import new_figure, readable
from kaneflex.plots.view import View, view

if TYPE_CHECKING:
    from kaneflex.deformation import Deformation
    from kaneflex.solution import Solution

_ALONG, _INSTANTS = 21, 181


def figures(solution: Solution) -> dict[str, Figure]:
    """``surfaces_LINK``: longitudinal, transverse, global X and global Y displacement of each elastic link."""
    if solution.model.frame is None:
        return {}
    shown = _thinned(view(solution))
    return {f"surfaces_{name}": _figure(shown, name, part) for name, part in shown.links.items()}


def _thinned(shown: View) -> View:
    picked = np.linspace(0, len(shown.instants) - 1, min(_INSTANTS, len(shown.instants))).round().astype(int)
    return View(shown.solution, shown.instants[picked], shown.turns)


def _figure(shown: View, name: str, deformation: Deformation) -> Figure:
    figure = new_figure(9.6, 7.6, f"Elastic displacement of {name} relative to its rigid frame{shown.note}")
    x = np.linspace(0.0, deformation.link.length, _ALONG)
    u, v = np.moveaxis(np.array([deformation.at(at)[0][:2] for at in x]), 1, 0)
    c, s = shown.rigid[f"{name}.c"], shown.rigid[f"{name}.s"]
    fields = (
        ("Longitudinal, link axes", u), ("Transverse, link axes", v),
        ("X, global axes", c * u - s * v), ("Y, global axes", s * u + c * v),
    )  # fmt: skip
    for k, (title, field) in enumerate(fields):
        axes = figure.add_subplot(2, 2, k + 1, projection="3d")
        _surface(axes, shown, x, field)
        axes.set_title(title, loc="center")
    return figure


def _surface(axes: Axes3D, shown: View, x: np.ndarray, field: np.ndarray) -> None:
    """One displacement (n_points, n_times) [m]."""
    factor, label = readable("m", field)
    along, instants = np.meshgrid(1e3 * x, shown.x, indexing="ij")
    surface = axes.plot_surface(
        instants, along, factor * field, cmap="viridis", rcount=_ALONG, ccount=_INSTANTS, linewidth=0.0, antialiased=False
    )
    surface.set_rasterized(True)  # thousands of facets: pixels inside the SVG
    axes.set_xlabel(shown.x_label, labelpad=4)
    axes.set_ylabel("x [mm]", labelpad=2)
    axes.set_zlabel(f"displacement [{label}]", labelpad=2)
    axes.tick_params(pad=0)
    if shown.drive:
        axes.set_xticks(np.arange(np.ceil(shown.x[0] / 180) * 180, shown.x[-1] + 1, 180))
    axes.view_init(elev=28, azim=-58)
    axes.set_box_aspect((1.5, 0.9, 0.75), zoom=0.92)
