"""A bifurcation diagram: what every sensor is once a period, over a parameter of the study."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from kaneflex.plots.style import PALETTE, finish, legend_beside, pages, readable
from kaneflex.plots.sweep import abscissa, groups

if TYPE_CHECKING:
    import xarray

_SERIES = "_series"


def figure(found: xarray.Dataset) -> Figure:
    """A panel for each sensor, a dot for each period. Raises ValueError where no parameter is a number that varies."""
    across, label = abscissa(found)
    names = sections(found)
    page, panels = pages(len(names), f"{found.attrs['scene']}: once a period, over {across}")
    for axes, name in zip(panels, names, strict=True):
        values = found[name + _SERIES].values
        factor, unit = readable(found[name].attrs["units"], np.nan_to_num(values))
        for (called, picked), colour in zip(groups(found, across).items(), PALETTE, strict=False):
            x = np.broadcast_to(found[across].values[picked, None], values[picked].shape)
            axes.plot(x.ravel(), factor * values[picked].ravel(), ".", color=colour, markersize=1.6, label=called)
        axes.set_title(f"{name}: {found[name].attrs['long_name']}")
        axes.set_ylabel(f"[{unit}]")
        if len(axes.get_legend_handles_labels()[1]) > 1:
            legend_beside(axes)
    finish(panels, label)
    return page


def sections(found: xarray.Dataset) -> list[str]:
    """Sensors that are kept once a period."""
    return [str(name).removesuffix(_SERIES) for name in found.data_vars if str(name).endswith(_SERIES)]
