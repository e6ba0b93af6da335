"""Orders of the sensors of a periodic run: amplitudes of their harmonics over multiples of the drive's turning."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from kaneflex.plots.records import marked
from kaneflex.plots.sensors import grouped, quantity_of
from kaneflex.plots.style import GREY, PALETTE, finish, legend_beside, pages, readable
from kaneflex.plots.view import view

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_FLOOR = 1e-4
"""Share of a panel's largest amplitude below which none is drawn."""
_SEEN = 1e-3
"""Share of it that an amplitude must reach for the axis to go as far."""
_CLOSED = 1e-3
"""Share of what a sensor spans by which it may miss its first value at the end of the cycle."""
_ROUNDING = 1e-9
"""Share of the largest value of its unit up to which what a sensor spans is taken for rounding."""


def figures(solution: Solution) -> dict[str, Figure]:
    """``orders``: of every sensor that repeats itself over the cycle, beside the lowest natural frequencies."""
    found, scene = harmonics(solution), solution.model.scene
    if not found:
        return {}
    groups, base = grouped(scene, found), 1.0 / float(np.ptp(solution.times))
    drive = view(solution).drive
    speed = scene.drives[drive].speed if drive is not None else None
    one = abs(speed) / (2.0 * math.pi) if speed else 1.0  # Hz on the axis' 1
    last = max(np.flatnonzero(found[name] >= _SEEN * found[name].max())[-1] for name in found) + 2
    last = min(last, len(next(iter(found.values()))) - 1)
    x = base / one * np.arange(1, last + 1)
    natural = [(frequency, what) for frequency, style, what in marked(solution, x[-1] * one) if style == "--"]
    page, panels = pages(len(groups), "Amplitudes of the sensors' harmonics, means left out")
    for axes, (title, names) in zip(panels, groups.items(), strict=True):
        factor, unit = readable(scene.sensors[names[0]].unit, *(found[name] for name in names))
        top = factor * max(found[name].max() for name in names)
        for k, (name, colour) in enumerate(zip(names, PALETTE, strict=False)):
            at, height = x + x[0] * 0.7 * ((k + 0.5) / len(names) - 0.5), factor * found[name][1 : last + 1]
            axes.vlines(at, _FLOOR * top, np.maximum(height, _FLOOR * top), color=colour, linewidth=1.1)
            axes.plot(at, height, "o", color=colour, markersize=2.5, label=name)
        for frequency, what in natural:
            label = what if axes is panels[0] else None
            axes.axvline(frequency / one, color=GREY, linestyle="--", linewidth=0.8, label=label, zorder=1)
        axes.set(title=title, ylabel=f"{quantity_of(scene.sensors[names[0]])} [{unit}]")
        axes.set(yscale="log", ylim=(_FLOOR * top, 3.0 * top), xlim=(0.0, x[-1] + x[0]))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.yaxis.set_minor_locator(NullLocator())  # half of the time to draw
        legend_beside(axes)
    finish(panels, f"order of {drive} [1 = {one:.4g} Hz]" if speed else "frequency [Hz]")
    return {"orders": page}


def harmonics(solution: Solution) -> dict[str, np.ndarray]:
    """Amplitudes of a periodic run's sensors at multiples 0, 1, 2 .. of the cycle's frequency, about their means.

    Sensors that go on from cycle to cycle, as the angle of what turns, and those that never change have none.
    """
    steps = np.diff(solution.times)
    if not solution.model.options.cycles or len(steps) < 16 or np.ptp(steps) > 1e-6 * steps[0]:
        return {}
    series, found = {name: solution.series[name] for name in solution.model.scene.sensors}, {}
    for name, each in series.items():
        values, reach = each.values, float(np.ptp(each.values))
        beside = max(np.nan_to_num(abs(other.values)).max() for other in series.values() if other.unit == each.unit)
        if reach > _ROUNDING * beside and abs(values[-1] - values[0]) <= _CLOSED * reach:
            found[name] = 2.0 / len(steps) * abs(np.fft.rfft(values[:-1] - values[:-1].mean()))[: len(steps) // 2]
    return found
