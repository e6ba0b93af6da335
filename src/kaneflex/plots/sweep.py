"""A sweep: least and greatest values of every sensor over the first parameter that is a number."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import PALETTE, finish, legend_beside, pages, readable
from kaneflex.support.escaping import picture_text

if TYPE_CHECKING:
    import xarray


def figure(found: xarray.Dataset) -> Figure:
    """A panel for each sensor, a curve for each value of the others. Raises ValueError where none is a number."""
    across, label = abscissa(found)
    names = [name for name, values in found.data_vars.items() if values.dims == ("point", "statistic")]
    page, panels = pages(len(names), f"{found.attrs['scene']}: greatest and least values over {across}")
    for axes, name in zip(panels, names, strict=True):
        _panel(axes, found, name, across)
    finish(panels, label)
    return page


def abscissa(found: xarray.Dataset) -> tuple[str, str]:
    """Path and label of the first parameter that is a number and takes more than one value."""
    for path in parameters(found):
        values = found[path]
        if np.issubdtype(values.dtype, np.number) and len(np.unique(values)) > 1:
            return path, f"{path} [{values.attrs.get('units', '1')}]"
    raise ValueError("no parameter of the study is a number that varies")


def parameters(found: xarray.Dataset) -> list[str]:
    """Paths of what varies, in the order of the study."""
    return [str(name) for name in found.coords if name not in ("point", "statistic", "instant")]


def groups(found: xarray.Dataset, across: str) -> dict[str, np.ndarray]:
    """Values of the other parameters -> numbers of the completed points there, by rising abscissa."""
    others = [path for path in parameters(found) if path != across and len(np.unique(found[path])) > 1]
    done = found["outcome"].values == "completed"
    grouped = {}
    for values in product(*(np.unique(found[path]) for path in others)):
        own = done.copy()
        for path, value in zip(others, values, strict=True):
            own &= found[path].values == value
        picked = np.flatnonzero(own)
        if len(picked):
            named = (f"{path} = {written(found[path], value)}" for path, value in zip(others, values, strict=True))
            grouped[", ".join(named)] = picked[np.argsort(found[across].values[picked], kind="stable")]
    return grouped


def written(parameter: xarray.DataArray, value: object) -> str:
    """A value of a parameter with its unit."""
    number = f"{value:.6g}" if isinstance(value, float) else str(value)
    return picture_text(f"{number} {parameter.attrs.get('units', '')}".strip())


def _panel(axes: Axes, found: xarray.Dataset, name: str, across: str) -> None:
    ends = [found[name].sel(statistic=statistic).values for statistic in ("max", "min")]
    factor, unit = readable(found[name].attrs["units"], *(np.nan_to_num(part) for part in ends))
    for (called, picked), colour in zip(groups(found, across).items(), PALETTE, strict=False):
        x = found[across].values[picked]
        for part, style in zip(ends, ("o-", "o--"), strict=True):
            label = called if part is ends[0] else None
            axes.plot(x, factor * part[picked], style, color=colour, markersize=3, label=label)
    axes.set_title(f"{name}: {found[name].attrs['long_name']}; least values dashed")
    axes.set_ylabel(f"[{unit}]")
    if len(axes.get_legend_handles_labels()[1]) > 1:
        legend_beside(axes)
