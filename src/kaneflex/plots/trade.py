"""Models of a scene as points of error and time; changes of its sensors without groups of terms, and by clearances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, name_bars, new_figure, shade
from kaneflex.scene.parts import PRESETS

if TYPE_CHECKING:
    from kaneflex.study.trade.price import Price, Prices
    from kaneflex.study.trade.ranking import Ranked, Trade
    from kaneflex.study.trade.terms import Terms

_LEAST, _MOST = 1e-8, 5.0
"""Errors beyond which a point stands at the bottom or top: the axis is logarithmic, and instability without bounds."""
_CHANGE = 1e-6
"""Change [%] at which the logarithmic axis begins."""
_BAR = 0.38
"""Width of a bar."""


def figure(found: Trade) -> Figure:
    """Points for all models, the Pareto front as a stair, presets and the chosen model by name."""
    title = f"{found.scene.name}: {len(found.ranked)} models against {found.reference.name}"
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
    uncertainty = 100 * max(found.reference.doubt(sensor) for sensor in found.reference.refinement)
    axes.axhspan(0.0, uncertainty, color="#F0F0F0", zorder=0.1, label="uncertainty of the reference")
    # Room for the name of the chosen model below all points.
    axes.set_ylim(bottom=0.3 * min(_places(found.ranked)[1]))
    axes.margins(x=0.12)
    _name(axes, found)
    axes.set_xlabel("time of a run: set-up, solving, sensors [ms]")
    beyond = ", at the top more" if any(entry.error > _MOST for entry in found.ranked) else ""
    axes.set_ylabel(f"largest error of a sensor [% of its peak{beyond}]")
    page.legend(loc="outside lower center", ncols=4)
    return page


def _preset(entry: Ranked) -> str:
    return entry.name.split(",")[0].split(" without ")[0]


def _places(entries: Sequence[Ranked]) -> tuple[list[float], list[float]]:
    """Times [ms] and errors [%]."""
    errors = [min(max(entry.error, _LEAST), _MOST) for entry in entries]
    return [1e3 * entry.cost.total for entry in entries], [100 * error for error in errors]


def _name(axes: Axes, found: Trade) -> None:
    """Presets to the right of their points; the chosen model below all points, on the left."""
    for entry in found.ranked:
        at = tuple(place[0] for place in _places([entry]))
        if entry is found.chosen:
            axes.plot(*at, "o", color="black", markersize=12, fillstyle="none", markeredgewidth=1.6)
            axes.annotate(
                f"chosen: {entry.name}", at, xytext=(0.02, 0.02), textcoords="axes fraction", fontsize=8.5,
                fontweight="bold", arrowprops={"arrowstyle": "-", "linewidth": 0.8},
            )  # fmt: skip
        elif entry.name in PRESETS:
            axes.annotate(entry.name, at, xytext=(6, 4), textcoords="offset points", fontsize=8)


def terms(found: Terms) -> Figure:
    """A bar for each group: the largest change of a sensor, its rms in it, and beside it its operations."""
    names = [effect.group.name for effect in found.effects]
    page = new_figure(9.6, 1.6 + 0.42 * len(names), f"{found.scene.name}: each group of terms left out of stiffened")
    changes, costs = page.subplots(1, 2, sharey=True, width_ratios=(2, 1))
    _changes(changes, found)
    _costs(costs, found)
    name_bars(changes, names)
    return page


def _changes(axes: Axes, found: Terms) -> None:
    axes.set_xscale("log")
    for row, effect in enumerate(found.effects):
        colour = PALETTE[1] if effect.needed else PALETTE[0]
        if effect.worst is None:
            said = "needed: does not run without" if effect.needed else "shows only rounding"
            axes.annotate(said, (0.02, row), xycoords=("axes fraction", "data"), va="center", color=colour)
            continue
        peak, rms = 100 * effect.worst.peak_share, 100 * effect.rms
        axes.barh(row, max(peak, _CHANGE), height=0.7, color=shade(colour, 0.45))
        axes.barh(row, max(rms, _CHANGE), height=0.4, color=colour)
        axes.annotate(
            effect.worst.sensor, (max(peak, _CHANGE), row), xytext=(3, 0), textcoords="offset points", va="center",
            fontsize=7.5, bbox={"color": "white", "pad": 0.5},
        )  # fmt: skip
    axes.axvline(100 * found.tolerance, color="black", linestyle="--", linewidth=0.9, zorder=0.5)
    peaks = [100 * effect.worst.peak_share for effect in found.effects if effect.worst is not None]
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
    axes.set_title(f"of {found.full.operations} operations")
    axes.set_xlabel("multiply-adds of M, C, K and F")
    axes.grid(axis="y", visible=False)


def price(found: Prices) -> Figure:
    """Peaks and rms as multiples of those of tight joints: a panel for each part, a pair of bars for each sensor."""
    counts = [len(price.changes) for price in found.prices]
    height = 1.3 + sum(0.9 + 0.5 * count for count in counts)
    page = new_figure(9.0, height, f"{found.scene.name}: effect of clearance and friction")
    panels = page.subplots(len(counts), 1, squeeze=False, height_ratios=[1.8 + count for count in counts])[:, 0]
    for axes, price in zip(panels, found.prices, strict=True):
        _bars(axes, price)
    panels[0].legend(loc="lower right", fontsize=8)
    panels[-1].set_xlabel("value with it / value without; black lines: error estimate")
    return page


def _bars(axes: Axes, price: Price) -> None:
    for k, (name, colour) in enumerate((("peak", PALETTE[1]), ("rms", PALETTE[0]))):
        shares = [change.shares[k] for change in price.changes]
        doubts = [change.doubts[k] for change in price.changes]
        rows = [row + (k - 0.5) * _BAR for row in range(len(shares))]
        bars = [0.0 if math.isnan(share) else 1.0 + share for share in shares]
        lines = [0.0 if math.isnan(doubt) else doubt for doubt in doubts]
        axes.barh(rows, bars, height=_BAR, xerr=lines, color=colour, label=name, error_kw={"linewidth": 0.9})
    axes.axvline(1.0, color="black", linestyle="--", linewidth=0.9)
    name_bars(axes, [change.sensor for change in price.changes])
    axes.set_title(price.part)
