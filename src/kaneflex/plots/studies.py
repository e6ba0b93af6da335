"""Pictures of studies: models by error and time, terms, sensitivities, comparisons, sweeps.

Comparisons show the curves of every sensor by several models as the paper's Figs. 18-22, 27, 28 do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import (
    GREY,
    PALETTE,
    cells,
    finish,
    legend_of_page,
    new_figure,
    pages,
    readable,
    shade,
)
from kaneflex.scene.parts import PRESETS
from kaneflex.support.errors import counted
from kaneflex.support.escaping import picture_text
from kaneflex.support.labelled import Labelled

if TYPE_CHECKING:

    from kaneflex.study.comparison import Comparison
    from kaneflex.study.sensitivity.report import Sensitivities
    from kaneflex.study.trade.terms import Terms
    from kaneflex.study.trade.trials import Ranked, Trade

_LEAST_ERROR, _MOST_ERROR = 1e-8, 5.0
"""Errors beyond which a point stands at the bottom or top: the axis is logarithmic, and instability without bounds."""
_CHANGE = 1e-6
"""Change [%] at which the logarithmic axis begins."""
_THIN = 0.09
"""Height of a bar [inches]."""
_MARKERS = "osD^v"
"""Markers of curves with the same colour."""
_DASHES = ((0, ()), (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1, 2)))
"""Line styles: later curves have more gaps, so that earlier ones remain visible."""
_SERIES = "_series"
_MOST_SECTIONS = 9
"""Panels of sections; of more points, some at equal distances are taken."""


def trade(found: Trade) -> Figure:
    """Points for all models, the Pareto front as a stair, presets and the chosen model by name."""
    title = f"{found.scene.name}: {counted(len(found.ranked), 'model')} against {found.reference.name}"
    page = new_figure(8.6, 5.6, title)
    axes = page.subplots()
    axes.set(xscale="log", yscale="log")
    families = sorted({_preset(entry) for entry in found.ranked}, key=[*PRESETS].index)
    for family in families:
        own = [entry for entry in found.ranked if _preset(entry) == family]
        colour = PALETTE[[*PRESETS].index(family) % len(PALETTE)]
        axes.plot(*_places(own), "o", color=colour, markersize=5, label=family)
    front_x, front_y = _places(found.front)
    axes.step(front_x, front_y, where="post", color=GREY, zorder=1, label="Pareto front")
    axes.axhline(100 * found.tolerance, color="black", linestyle="--", linewidth=0.9)
    axes.annotate(
        f"tolerance {100 * found.tolerance:.3g} %", (1.0, 100 * found.tolerance), xycoords=("axes fraction", "data"),
        xytext=(0, 3), textcoords="offset points", ha="right", fontsize=8,
    )  # fmt: skip
    uncertainty = 100 * max(found.reference.doubts.values())
    axes.axhspan(0.0, uncertainty, color="#F0F0F0", zorder=0.1, label="uncertainty of the reference")
    # Room for the name of the chosen model below all points.
    axes.set_ylim(bottom=0.3 * min(_places(found.ranked)[1]))
    axes.margins(x=0.12)
    _name(axes, found)
    axes.set_xlabel("time of a run: set-up, solving, sensors [ms]")
    beyond = ", at the top more" if any(entry.error > _MOST_ERROR for entry in found.ranked) else ""
    axes.set_ylabel(f"largest error of a sensor [% of its peak{beyond}]")
    page.legend(loc="outside lower center", ncols=4)
    return page


def _preset(entry: Ranked) -> str:
    return entry.candidate.settings[0].removeprefix("solve.preset=")


def _places(entries: Sequence[Ranked]) -> tuple[list[float], list[float]]:
    """Times [ms] and errors [%]."""
    errors = [min(max(entry.error, _LEAST_ERROR), _MOST_ERROR) for entry in entries]
    return [1e3 * entry.cost.total for entry in entries], [100 * error for error in errors]


def _name(axes: Axes, found: Trade) -> None:
    """Presets to the right of their points; the chosen model below all points, on the left."""
    for entry in found.ranked:
        at = tuple(place[0] for place in _places([entry]))
        if entry is found.of_scene:
            axes.plot(*at, "s", color="black", markersize=13, fillstyle="none", label="the scene's own setting")
        if entry is found.chosen:
            axes.plot(*at, "o", color="black", markersize=12, fillstyle="none", markeredgewidth=1.6)
            axes.annotate(
                f"chosen: {entry.name}", at, xytext=(0.02, 0.02), textcoords="axes fraction", fontsize=8.5,
                fontweight="bold", arrowprops={"arrowstyle": "-", "linewidth": 0.8},
            )  # fmt: skip
        elif entry.name in PRESETS:
            axes.annotate(entry.name, at, xytext=(6, 4), textcoords="offset points", fontsize=8)


def terms(found: Terms) -> Figure:
    """A bar for each group: the largest change of a sensor, its rms in it, and beside it its operations, if counted."""
    names = [effect.group.name for effect in found.effects]
    page = new_figure(9.6, 1.6 + 0.42 * len(names), f"{found.scene.name}: the model without each group")
    ratios = (2,) if found.operations is None else (2, 1)
    changes, *costs = page.subplots(1, len(ratios), sharey=True, squeeze=False, width_ratios=ratios)[0]
    _changes(changes, found)
    for axes in costs:
        _costs(axes, found)
    _name_bars(changes, names)
    return page


def _changes(axes: Axes, found: Terms) -> None:
    axes.set_xscale("log")
    for row, effect in enumerate(found.effects):
        colour = PALETTE[1] if effect.needed else PALETTE[0]
        if not effect.differences:
            note = "needed: does not run without" if effect.needed else "shows only rounding"
            axes.annotate(note, (0.02, row), xycoords=("axes fraction", "data"), va="center", color=colour)
            continue
        peak, rms = 100 * effect.worst.error, 100 * effect.worst.rms_error
        axes.barh(row, max(peak, _CHANGE), height=0.7, color=shade(colour, 0.45))
        axes.barh(row, max(rms, _CHANGE), height=0.4, color=colour)
        axes.annotate(
            effect.worst.sensor, (max(peak, _CHANGE), row), xytext=(3, 0), textcoords="offset points", va="center",
            fontsize=7.5, bbox={"color": "white", "pad": 0.5},
        )  # fmt: skip
    axes.axvline(100 * found.tolerance, color="black", linestyle="--", linewidth=0.9, zorder=0.5)
    peaks = [100 * effect.worst.error for effect in found.effects if effect.differences]
    least = max(_CHANGE, 0.2 * min(peak for peak in [*peaks, 100 * found.tolerance] if peak > 0))
    axes.set_xlim(least, 30 * max([*peaks, 100 * found.tolerance]))
    axes.set_title(f"largest change of a sensor, dark: rms; dashed: {100 * found.tolerance:.3g} %, red: needed")
    axes.set_xlabel("change [% of the sensor's peak]")


def _costs(axes: Axes, found: Terms) -> None:
    most = 1
    for row, effect in enumerate(found.effects):
        if effect.operations is not None:
            axes.barh(row, effect.operations, height=0.7, color=GREY)
            axes.annotate(f"{effect.operations}", (effect.operations, row), xytext=(3, 0), textcoords="offset points",
                          va="center", fontsize=7.5)  # fmt: skip
            most = max(most, effect.operations)
    axes.set_xlim(0, 1.3 * most)
    axes.set_title(f"of {found.operations} operations")
    axes.set_xlabel("multiply-adds of M, C, K and F")
    axes.grid(axis="y", visible=False)


def sensitivities(found: Sensitivities) -> Figure:
    """A row for each sensor with a bar for each parameter; none where a peak is zero, which has no per cent."""
    count, scene = len(found.parameters), found.solution.model.scene
    sensors = [*scene.sensors]
    page = new_figure(8.6, 1.3 + len(sensors) * _THIN * (count + 1.5), f"{scene.name}: sensitivities of the peaks")
    axes = page.subplots()
    height = 1.0 / (count + 1.5)
    for k, parameter in enumerate(found.parameters):
        peaks = [found.peak(parameter, sensor) for sensor in sensors]
        lengths = np.array([np.nan if peak is None else peak for peak in peaks])
        rows = np.arange(len(sensors)) + (k - 0.5 * (count - 1)) * height
        colour, hatch = PALETTE[k % len(PALETTE)], "" if k < len(PALETTE) else "////"
        axes.barh(rows, lengths, height=0.9 * height, label=parameter.name, color=colour, hatch=hatch)
    axes.axvline(0.0, color="black", linewidth=0.8)
    _name_bars(axes, sensors)
    axes.set_xlabel("growth of the peak by 1 % of the parameter [%]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return page


def overlay(comparison: Comparison) -> Figure:
    """A panel for each sensor; the reference is drawn first, as a broad grey line."""
    names = list(comparison.scene.sensors)
    page, panels = pages(len(names), f"{comparison.scene.name}: {', '.join(comparison.curves)}", 7.2, 1.6, room=1.1)
    factor, label = readable("s", comparison.times)
    for axes, name in zip(panels, names, strict=True):
        _compared(axes, comparison, name, factor * comparison.times)
    finish(panels, f"time [{label}]")
    handles, labels = panels[0].get_legend_handles_labels()
    page.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return page


def _compared(axes: Axes, comparison: Comparison, name: str, x: np.ndarray) -> None:
    sensor = comparison.scene.sensors[name]
    shown = {model: curves.values[name] for model, curves in comparison.curves.items() if name in curves.values}
    factor, unit = readable(sensor.unit, *shown.values())
    others = [model for model in comparison.curves if model != comparison.against]
    for model in (comparison.against, *others):
        values = factor * shown[model] if model in shown else np.full(len(x), np.nan)
        if model == comparison.against:
            axes.plot(x, values, color="#BBBBBB", linewidth=3.2, label=f"{model} (reference)")
            continue
        k = others.index(model)
        axes.plot(x, values, color=PALETTE[k % len(PALETTE)], linestyle=_DASHES[k % len(_DASHES)], label=model)
    missing = [model for model in comparison.curves if model not in shown]
    title = name + (f" (not available from {', '.join(missing)})" if missing else "")
    axes.set(title=title, ylabel=f"[{unit}]", xmargin=0)


def sweep(found: Labelled) -> Figure:
    """Extremes: a panel for each sensor, a curve for each value of the other parameters.

    Raises ValueError where no parameter is a number that varies.
    """
    names = [name for name, (dims, *_) in found.variables.items() if dims == ("point", "statistic")]
    places = [_values(found, "statistic").tolist().index(end) for end in ("max", "min")]
    ends = {name: [_values(found, name)[:, place] for place in places] for name in names}
    return _over(found, ends, "largest and smallest values (dashed)", ("o-", "o--"), 3.0)


def bifurcation(found: Labelled) -> Figure:
    """A panel for each sensor, a dot for each period. Raises ValueError where no parameter is a number that varies."""
    values = {name: [_values(found, name + _SERIES)] for name in _sections(found)}
    return _over(found, values, "once a period,", (".",), 1.6)


def poincare(found: Labelled) -> Figure:
    """Sections: the first two sensors of the scene against each other once a period, a panel for each point.

    Raises ValueError for a scene of fewer sensors, or without a completed point.
    """
    names = _sections(found)[:2]
    done = np.flatnonzero(_values(found, "outcome") == "completed")
    if len(names) < 2 or not len(done):
        raise ValueError("a section is drawn of two sensors, at points that are completed")
    shown = done[np.unique(np.linspace(0, len(done) - 1, min(_MOST_SECTIONS, len(done))).round().astype(int))]
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    title = f"{found.attributes['scene']}: Poincare sections, {names[1]} over {names[0]} once a period"
    title += f" ({len(shown)} of {len(done)} points)" if len(shown) < len(done) else ""
    page = new_figure(max(6.4, 3.4 * columns), 0.8 + 2.7 * rows, title)
    panels = cells(page, rows, columns, len(shown), sharex=True, sharey=True)
    values = [_values(found, name + _SERIES) for name in names]
    units = [_about(found, name)["units"] for name in names]
    scales = [readable(unit, np.nan_to_num(part[shown])) for unit, part in zip(units, values, strict=True)]
    varied = [path for path in _parameters(found) if len(np.unique(_values(found, path))) > 1]
    for axes, point in zip(panels, shown, strict=True):
        x, y = (factor * part[point] for (factor, _), part in zip(scales, values, strict=True))
        axes.plot(x, y, ".", color=PALETTE[0], markersize=2.5)
        axes.set_title(", ".join(f"{path} = {_written(found, path, _values(found, path)[point])}" for path in varied))
        axes.set(xlabel=f"{names[0]} [{scales[0][1]}]", ylabel=f"{names[1]} [{scales[1][1]}]")
        axes.tick_params(labelbottom=True, labelleft=True)
    return page


def _over(
    found: Labelled, sensors: dict[str, list[np.ndarray]], what: str, styles: tuple[str, ...], size: float
) -> Figure:
    """Values of sensors, (points,) or (points, periods), each in its style, over the parameter that varies."""
    across, label = _abscissa(found)
    page, panels = pages(len(sensors), f"{found.attributes['scene']}: {what} over {across}", 5.8)
    for axes, (name, parts) in zip(panels, sensors.items(), strict=True):
        factor, unit = readable(_about(found, name)["units"], *map(np.nan_to_num, parts))
        for k, (called, picked) in enumerate(_groups(found, across).items()):
            colour, marker = PALETTE[k % len(PALETTE)], _MARKERS[k // len(PALETTE) % len(_MARKERS)]
            for part, style in zip(parts, (each.replace("o", marker) for each in styles), strict=True):
                y = factor * part[picked]
                x = np.repeat(_values(found, across)[picked], y.size // len(picked))
                label_of = called if part is parts[0] else None
                axes.plot(x, y.ravel(), style, color=colour, markersize=size, label=label_of)
        axes.set(title=f"{name}: {_about(found, name)['long_name']}", ylabel=f"[{unit}]")
    if len(panels[0].get_legend_handles_labels()[1]) > 1:
        legend_of_page(panels)
    finish(panels, label)
    return page


def _sections(found: Labelled) -> list[str]:
    """Sensors that are kept once a period."""
    return [name.removesuffix(_SERIES) for name in found.variables if name.endswith(_SERIES)]


def _abscissa(found: Labelled) -> tuple[str, str]:
    """Path and label of the first parameter that is a number and takes more than one value."""
    for path in _parameters(found):
        values = _values(found, path)
        if np.issubdtype(values.dtype, np.number) and len(np.unique(values)) > 1:
            return path, f"{path} [{_about(found, path).get('units', '1')}]"
    raise ValueError("no parameter of the study is a number that varies")


def _parameters(found: Labelled) -> list[str]:
    """Paths of what varies, in the order of the study."""
    others = ("point", "outcome", "reason")
    return [name for name, (dims, *_) in found.variables.items() if dims == ("point",) and name not in others]


def _values(found: Labelled, name: str) -> np.ndarray:
    return found.variables[name][1]


def _about(found: Labelled, name: str) -> Mapping[str, str]:
    """Its unit and meaning."""
    return dict(*found.variables[name][2:])


def _groups(found: Labelled, across: str) -> dict[str, np.ndarray]:
    """Values of the other parameters -> numbers of the completed points there, by rising abscissa."""
    others = [path for path in _parameters(found) if path != across and len(np.unique(_values(found, path))) > 1]
    done = _values(found, "outcome") == "completed"
    grouped = {}
    for values in product(*(np.unique(_values(found, path)) for path in others)):
        own = done.copy()
        for path, value in zip(others, values, strict=True):
            own &= _values(found, path) == value
        picked = np.flatnonzero(own)
        if len(picked):
            named = (f"{path} = {_written(found, path, value)}" for path, value in zip(others, values, strict=True))
            grouped[", ".join(named)] = picked[np.argsort(_values(found, across)[picked], kind="stable")]
    return grouped


def _written(found: Labelled, path: str, value: object) -> str:
    """A value of a parameter with its unit."""
    number = f"{value:.6g}" if isinstance(value, float) else str(value)
    return picture_text(f"{number} {_about(found, path).get('units', '')}".strip())


def _name_bars(axes: Axes, names: Sequence[str]) -> None:
    """Names of rows of bars, from above."""
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
