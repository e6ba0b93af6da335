"""Error against time, every model of a scene a point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, new_figure
from kaneflex.scene.parts import PRESETS

if TYPE_CHECKING:
    from kaneflex.study.trade.ranking import Ranked, Trade

_LEAST, _MOST = 1e-8, 5.0
"""Errors beyond which a point stands at the bottom or top: the axis is logarithmic, and instability without bounds."""


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
