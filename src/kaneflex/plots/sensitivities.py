"""Bars of the relative change of each sensor's peak with each number of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from kaneflex.plots.style import PALETTE, name_bars, new_figure

if TYPE_CHECKING:
    from kaneflex.study.sensitivity.report import Sensitivities

_BAR = 0.09
"""Height of a bar [inches]."""


def figure(found: Sensitivities) -> Figure:
    """A row for each sensor with a bar for each parameter; none where a peak is zero, which has no per cent."""
    count, scene = len(found.parameters), found.solution.model.scene
    sensors = [*scene.sensors]
    page = new_figure(8.6, 1.3 + len(sensors) * _BAR * (count + 1.5), f"{scene.name}: sensitivities of the peaks")
    axes = page.subplots()
    height = 1.0 / (count + 1.5)
    for k, parameter in enumerate(found.parameters):
        peaks = [found.peak(parameter, sensor) for sensor in sensors]
        lengths = np.array([np.nan if peak is None else peak for peak in peaks])
        rows = np.arange(len(sensors)) + (k - 0.5 * (count - 1)) * height
        colour, hatch = PALETTE[k % len(PALETTE)], "" if k < len(PALETTE) else "////"
        axes.barh(rows, lengths, height=0.9 * height, label=parameter.name, color=colour, hatch=hatch)
    axes.axvline(0.0, color="black", linewidth=0.8)
    name_bars(axes, sensors)
    axes.set_xlabel("growth of the peak by 1 % of the parameter [%]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return page
