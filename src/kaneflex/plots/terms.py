"""What a scene loses without each group of terms, and what the group costs: two rows of bars."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, new_figure, shade

if TYPE_CHECKING:
    from kaneflex.study.trade.terms import Terms

_LEAST = 1e-6
"""Change [%] at which the logarithmic axis begins."""


def figure(found: Terms) -> Figure:
    """A bar for each group: the largest change of a sensor, its rms in it, and beside it the time of a step."""
    names = [effect.group.name for effect in found.effects]
    page = new_figure(9.6, 1.6 + 0.42 * len(names), f"{found.scene.name}: each group of terms left out of stiffened")
    changes, costs = page.subplots(1, 2, sharey=True, width_ratios=(2, 1))
    _changes(changes, found)
    _costs(costs, found)
    changes.set_yticks(range(len(names)), names)
    changes.set_ylim(len(names) - 0.4, -0.6)
    return page


def _changes(axes: Axes, found: Terms) -> None:
    axes.set_xscale("log")
    for row, effect in enumerate(found.effects):
        colour = PALETTE[1] if effect.needed else PALETTE[0]
        if effect.worst is None:
            axes.annotate(
                "needed: does not run without", (0.02, row), xycoords=("axes fraction", "data"), va="center",
                color=PALETTE[1],
            )  # fmt: skip
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
    axes.set_xlim(least, 30 * max(*peaks, 100 * found.tolerance))
    axes.set_title(f"largest change of a sensor, dark: rms; dashed: {100 * found.tolerance:.3g} %, red: needed")
    axes.set_xlabel("change [% of the sensor's peak]")
    axes.grid(axis="y", visible=False)


def _costs(axes: Axes, found: Terms) -> None:
    for row, effect in enumerate(found.effects):
        if effect.ns_per_step is not None:
            axes.barh(row, 1e-3 * effect.ns_per_step, height=0.7, color=GREY)
        if effect.noise_ns is not None:
            axes.errorbar(1e-3 * effect.ns_per_step, row, xerr=1e-3 * effect.noise_ns, color="black", linewidth=0.9)
        if effect.operations is not None:
            axes.annotate(
                f"{effect.operations:+d} op.", (1.0, row), xycoords=("axes fraction", "data"), ha="right",
                va="center", fontsize=7.5,
            )  # fmt: skip
    times = [1e-3 * effect.ns_per_step for effect in found.effects if effect.ns_per_step is not None]
    reach = np.max(np.abs([*times, 1e-3 * found.full.ns_per_step]))
    axes.set_xlim(min(0.0, *times, -0.1 * reach) * 1.3, 1.6 * reach)
    axes.set_title("what it adds to a step, with the noise")
    axes.set_xlabel("time [µs]")
    axes.grid(axis="y", visible=False)
