"""Curves of every sensor by several models, as the paper compares its model with Adams.

Paper Figs. 18-22, 27, 28.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import PALETTE, finish, pages, readable

if TYPE_CHECKING:
    from kaneflex.study.comparison import Comparison

_DASHES = ((0, ()), (0, (6, 2)), (0, (2, 1.5)), (0, (6, 2, 1, 2)))
"""Line styles: later curves have more gaps, so that earlier ones remain visible."""


def figure(comparison: Comparison) -> Figure:
    """A panel for each sensor; the reference is drawn first, as a broad grey line."""
    names = list(comparison.scene.sensors)
    page, panels = pages(len(names), f"{comparison.scene.name}: {', '.join(comparison.curves)}", 7.2, 1.6, room=1.1)
    factor, label = readable("s", comparison.times)
    for axes, name in zip(panels, names, strict=True):
        _panel(axes, comparison, name, factor * comparison.times)
    finish(panels, f"time [{label}]")
    handles, labels = panels[0].get_legend_handles_labels()
    page.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return page


def _panel(axes: Axes, comparison: Comparison, name: str, x: np.ndarray) -> None:
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
