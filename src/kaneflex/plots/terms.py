"""Loss of a scene without each group of terms, and what the group costs: two rows of bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, name_bars, new_figure, shade

if TYPE_CHECKING:
    from kaneflex.study.trade.terms import Terms

_LEAST = 1e-6
"""Change [%] at which the logarithmic axis begins."""


def figure(found: Terms) -> Figure:
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
        axes.barh(row, max(peak, _LEAST), height=0.7, color=shade(colour, 0.45))
        axes.barh(row, max(rms, _LEAST), height=0.4, color=colour)
        axes.annotate(
            effect.worst.sensor, (max(peak, _LEAST), row), xytext=(3, 0), textcoords="offset points", va="center",
            fontsize=7.5, bbox={"color": "white", "pad": 0.5},
        )  # fmt: skip
    axes.axvline(100 * found.tolerance, color="black", linestyle="--", linewidth=0.9, zorder=0.5)
    peaks = [100 * effect.worst.peak_share for effect in found.effects if effect.worst is not None]
    least = max(_LEAST, 0.2 * min(peak for peak in [*peaks, 100 * found.tolerance] if peak > 0))
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
