"""Sweeps over the first parameter that is a number: extremes of every sensor, bifurcations, Poincare sections."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from kaneflex.plots.style import PALETTE, cells, finish, legend_beside, new_figure, pages, readable
from kaneflex.support.escaping import picture_text

if TYPE_CHECKING:
    import xarray

_SERIES = "_series"
_MOST = 9
"""Panels of sections; of more points some are taken at equal distances."""


def figure(found: xarray.Dataset) -> Figure:
    """Extremes: a panel for each sensor, a curve for each value of the other parameters.

    Raises ValueError where no parameter is a number that varies.
    """
    names = [str(name) for name, values in found.data_vars.items() if values.dims == ("point", "statistic")]
    ends = {name: [found[name].sel(statistic=end).values for end in ("max", "min")] for name in names}
    return _over(found, ends, "largest and smallest values", ("o-", "o--"), 3.0, "; smallest values dashed")


def bifurcation(found: xarray.Dataset) -> Figure:
    """A panel for each sensor, a dot for each period. Raises ValueError where no parameter is a number that varies."""
    values = {name: [found[name + _SERIES].values] for name in _sections(found)}
    return _over(found, values, "once a period,", (".",), 1.6)


def poincare(found: xarray.Dataset) -> Figure:
    """Sections: the first two sensors of the scene against each other once a period, a panel for each point.

    Raises ValueError for a scene of fewer sensors, or without a completed point.
    """
    names = _sections(found)[:2]
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
    values = [found[name + _SERIES].values for name in names]
    units = [found[name].attrs["units"] for name in names]
    scales = [readable(unit, np.nan_to_num(part[shown])) for unit, part in zip(units, values, strict=True)]
    varied = [path for path in _parameters(found) if len(np.unique(found[path])) > 1]
    for axes, point in zip(panels, shown, strict=True):
        x, y = (factor * part[point] for (factor, _), part in zip(scales, values, strict=True))
        axes.plot(x, y, ".", color=PALETTE[0], markersize=2.5)
        axes.set_title(", ".join(f"{path} = {_written(found[path], found[path].values[point])}" for path in varied))
        axes.set(xlabel=f"{names[0]} [{scales[0][1]}]", ylabel=f"{names[1]} [{scales[1][1]}]")
        axes.tick_params(labelbottom=True, labelleft=True)
    return page


def _over(
    found: xarray.Dataset, sensors: dict[str, list[np.ndarray]], what: str, styles: tuple[str, ...], size: float,
    note: str = "",
) -> Figure:  # fmt: skip
    """Values of sensors, (points,) or (points, periods), each in its style, over the parameter that varies."""
    across, label = _abscissa(found)
    page, panels = pages(len(sensors), f"{found.attrs['scene']}: {what} over {across}")
    for axes, (name, parts) in zip(panels, sensors.items(), strict=True):
        factor, unit = readable(found[name].attrs["units"], *map(np.nan_to_num, parts))
        for (called, picked), colour in zip(_groups(found, across).items(), PALETTE, strict=False):
            for part, style in zip(parts, styles, strict=True):
                y = factor * part[picked]
                x = np.repeat(found[across].values[picked], y.size // len(picked))
                label_of = called if part is parts[0] else None
                axes.plot(x, y.ravel(), style, color=colour, markersize=size, label=label_of)
        axes.set(title=f"{name}: {found[name].attrs['long_name']}{note}", ylabel=f"[{unit}]")
        if len(axes.get_legend_handles_labels()[1]) > 1:
            legend_beside(axes)
    finish(panels, label)
    return page


def _sections(found: xarray.Dataset) -> list[str]:
    """Sensors that are kept once a period."""
    return [str(name).removesuffix(_SERIES) for name in found.data_vars if str(name).endswith(_SERIES)]


def _abscissa(found: xarray.Dataset) -> tuple[str, str]:
    """Path and label of the first parameter that is a number and takes more than one value."""
    for path in _parameters(found):
        values = found[path]
        if np.issubdtype(values.dtype, np.number) and len(np.unique(values)) > 1:
            return path, f"{path} [{values.attrs.get('units', '1')}]"
    raise ValueError("no parameter of the study is a number that varies")


def _parameters(found: xarray.Dataset) -> list[str]:
    """Paths of what varies, in the order of the study."""
    return [str(name) for name in found.coords if name not in ("point", "statistic", "instant")]


def _groups(found: xarray.Dataset, across: str) -> dict[str, np.ndarray]:
    """Values of the other parameters -> numbers of the completed points there, by rising abscissa."""
    others = [path for path in _parameters(found) if path != across and len(np.unique(found[path])) > 1]
    done = found["outcome"].values == "completed"
    grouped = {}
    for values in product(*(np.unique(found[path]) for path in others)):
        own = done.copy()
        for path, value in zip(others, values, strict=True):
            own &= found[path].values == value
        picked = np.flatnonzero(own)
        if len(picked):
            named = (f"{path} = {_written(found[path], value)}" for path, value in zip(others, values, strict=True))
            grouped[", ".join(named)] = picked[np.argsort(found[across].values[picked], kind="stable")]
    return grouped


def _written(parameter: xarray.DataArray, value: object) -> str:
    """A value of a parameter with its unit."""
    number = f"{value:.6g}" if isinstance(value, float) else str(value)
    return picture_text(f"{number} {parameter.attrs.get('units', '')}".strip())
