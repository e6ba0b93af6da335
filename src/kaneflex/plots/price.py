"""Change of each sensor by clearances: peak and rms with them, as multiples of those of tight joints."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import PALETTE, name_bars, new_figure

if TYPE_CHECKING:
    from kaneflex.study.trade.price import Price, Prices

_SIDE = 0.38
"""Width of a bar."""


def figure(found: Prices) -> Figure:
    """A panel for each part, a pair of bars for each sensor, with error estimates."""
    counts = [len(price.changes) for price in found.prices]
    height = 1.3 + sum(0.9 + 0.5 * count for count in counts)
    page = new_figure(9.0, height, f"{found.scene.name}: effect of clearance and friction")
    panels = page.subplots(len(counts), 1, squeeze=False, height_ratios=[1.8 + count for count in counts])[:, 0]
    for axes, price in zip(panels, found.prices, strict=True):
        _panel(axes, price)
    panels[0].legend(loc="lower right", fontsize=8)
    panels[-1].set_xlabel("value with it / value without; black lines: error estimate")
    return page


def _panel(axes: Axes, price: Price) -> None:
    for k, (name, colour) in enumerate((("peak", PALETTE[1]), ("rms", PALETTE[0]))):
        shares = [change.shares[k] for change in price.changes]
        doubts = [change.doubts[k] for change in price.changes]
        rows = [row + (k - 0.5) * _SIDE for row in range(len(shares))]
        bars = [0.0 if math.isnan(share) else 1.0 + share for share in shares]
        lines = [0.0 if math.isnan(doubt) else doubt for doubt in doubts]
        axes.barh(rows, bars, height=_SIDE, xerr=lines, color=colour, label=name, error_kw={"linewidth": 0.9})
    axes.axvline(1.0, color="black", linestyle="--", linewidth=0.9)
    name_bars(axes, [change.sensor for change in price.changes])
    axes.set_title(price.part)
