"""Poincare sections: two sensors against each other once a period, a panel for each of some points of the study."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from kaneflex.plots.bifurcation import sections
from kaneflex.plots.style import PALETTE, cells, new_figure, readable
from kaneflex.plots.sweep import parameters, written

if TYPE_CHECKING:
    import xarray

_MOST = 9
"""Panels; of more points some are taken at equal distances."""


def figure(found: xarray.Dataset) -> Figure:
    """The first two sensors of the scene. Raises ValueError for a scene of fewer, or without a completed point."""
    names = sections(found)[:2]
    done = np.flatnonzero(found["outcome"].values == "completed")
    if len(names) < 2 or not len(done):
        raise ValueError("a section is drawn of two sensors, at points that are completed")
    shown = done[np.unique(np.linspace(0, len(done) - 1, min(_MOST, len(done))).round().astype(int))]
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    title = f"{found.attrs['scene']}: Poincare sections, {names[1]} over {names[0]} once a period"
    title += f" ({len(shown)} of {len(done)} points)" if len(shown) < len(done) else ""
    page = new_figure(max(6.4, 3.4 * columns), 0.8 + 2.7 * rows, title)
    panels = cells(page, rows, columns, len(shown), sharex=True, sharey=True)
    values = [found[f"{name}_series"].values for name in names]
    units = [found[name].attrs["units"] for name in names]
    scales = [readable(unit, np.nan_to_num(part[shown])) for unit, part in zip(units, values, strict=True)]
    varied = [path for path in parameters(found) if len(np.unique(found[path])) > 1]
    for axes, point in zip(panels, shown, strict=True):
        x, y = (factor * part[point] for (factor, _), part in zip(scales, values, strict=True))
        axes.plot(x, y, ".", color=PALETTE[0], markersize=2.5)
        axes.set_title(", ".join(f"{path} = {written(found[path], found[path].values[point])}" for path in varied))
        axes.set_xlabel(f"{names[0]} [{scales[0][1]}]")
        axes.set_ylabel(f"{names[1]} [{scales[1][1]}]")
        axes.tick_params(labelbottom=True, labelleft=True)
    return page
