"""Pictures of stability: frozen frequencies over the drive, Campbell's diagram, multipliers."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, new_figure, readable
from kaneflex.response.whirl import turns
from kaneflex.study.stability.report import Stability
from kaneflex.study.stability.sweep import FORWARD, Sweep

_APART = 8.5
"""Distance of two names of 7 points [points]."""
_LEAST = 1e-3
"""Multiplier below which disturbances have decayed after one period."""


def stability(found: Stability) -> Figure:
    """Frequencies and load factors over the cycle; with speeds also Campbell's diagram and the spectral radius."""
    scene = found.model.scene
    rows = 2 if found.sweep is None else 4
    page = new_figure(7.4, 0.8 + 2.4 * rows, f"{scene.name}, {found.model.options.preset}: stability")
    panels = page.subplots(rows, 1)
    drive = next(iter(scene.drives))
    slides = scene.slides(drive)
    factor = 1e3 if slides else 180.0 / np.pi
    _over_cycle(panels[0], panels[1], found, factor * found.frozen.coordinates)
    panels[1].set_xlabel(f"{drive} [{'mm' if slides else 'deg'}]")
    if found.sweep is not None:
        factor, unit = (1.0, "m/s") if slides else (30.0 / np.pi, "rpm")
        _over_speed(panels[2], panels[3], found.sweep, factor, slides)
        panels[3].set_xlabel(f"speed of {drive} [{unit}]")
    return page


def _over_cycle(frequencies: Axes, factors: Axes, found: Stability, x: np.ndarray) -> None:
    factor, unit = readable("Hz", found.frozen.frequencies)
    frequencies.plot(x, factor * found.frozen.frequencies)
    frequencies.set_xmargin(0)
    last = factor * found.frozen.frequencies[-1]
    _name_ends(frequencies, x[-1], [(y, f"mode {k}", PALETTE[(k - 1) % len(PALETTE)]) for k, y in enumerate(last, 1)])
    where = ", in axes that turn with the links" if turns(found.model) else ""
    frequencies.set(title=f"frozen natural frequencies{where}", ylabel=f"frequency [{unit}]")
    title = "no buckling load" if found.buckling is None else "share of the buckling load, 1 / lambda"
    factors.set(title=title, ylabel="load / buckling load [1]", xlim=(x.min(), x.max()))
    if found.buckling is not None:
        factors.plot(x, 1.0 / found.buckling.factors)
    factors.axhline(1.0, color=GREY, linewidth=0.8)


def _over_speed(campbell: Axes, radii: Axes, swept: Sweep, factor: float, slides: bool) -> None:
    x = factor * swept.speeds
    scale, unit = readable("Hz", swept.highest[:, :2])
    # What the orders can't reach is of no use to read where they cross.
    reach = max(swept.highest[:, :2].max(), max(swept.orders) * swept.speeds[-1] / (2.0 * np.pi))
    campbell.set(xlim=(x[0], x[-1]), ylim=(0.0, 1.05 * scale * reach))
    ends = []
    for k, mode in enumerate(swept.modes):
        colour, style = PALETTE[k % len(PALETTE)], {"backward": "--", "torsion": ":"}.get(mode.split()[0], "-")
        campbell.fill_between(x, scale * swept.lowest[:, k], scale * swept.highest[:, k], color=colour, alpha=0.25)
        campbell.plot(x, scale * swept.mean[:, k], color=colour, linestyle=style)
        ends.append((scale * swept.mean[-1, k], _short(mode), colour))
    for order in swept.orders if not slides else ():
        line = scale * order * swept.speeds / (2.0 * np.pi)
        campbell.plot(x, line, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
        ends.append((line[-1], f"order {order:g}", "black"))
    _name_ends(campbell, x[-1], ends)
    if not slides:
        _mark_crossings(campbell, swept, factor, scale)
    campbell.set(title=_heading(swept), ylabel=f"frequency [{unit}]")
    seen = np.maximum(swept.radii, _LEAST)
    radii.semilogy(x, seen, marker=".", markersize=3)
    radii.set_ylim(bottom=max(_LEAST, 0.8 * seen.min()))
    radii.axhline(1.0, color=GREY, linewidth=0.8)
    radii.set(title="largest Floquet multiplier, unstable bands shaded", ylabel="multiplier [1]", xmargin=0)
    for axes in (campbell, radii):
        for low, high in swept.bands:
            axes.axvspan(factor * low, factor * high, color=PALETTE[1], alpha=0.15, linewidth=0)


def _mark_crossings(campbell: Axes, swept: Sweep, factor: float, scale: float) -> None:
    """Rings where orders meet frequencies, and the speeds of these: of critical ones alone where there are any."""
    critical = swept.critical
    drawn: list[float] = []
    start, end = campbell.get_xlim()
    width = campbell.bbox.width / (end - start)
    apart = _APART * campbell.get_figure(root=True).dpi / 72.0  # type: ignore[union-attr]
    for crossing in sorted(swept.crossings(), key=lambda each: (each not in critical, each.speed)):
        place, height = factor * crossing.speed, scale * crossing.order * crossing.speed / (2.0 * np.pi)
        ring: dict[str, Any] = {"color": "black", "markerfacecolor": "white", "zorder": 4}
        campbell.plot(place, height, "o", markersize=5 if crossing in critical else 3.5, **ring)
        if critical and crossing not in critical:
            continue
        campbell.axvline(place, color="black", linewidth=0.6, linestyle=":")
        if all(abs(place - other) * width > apart for other in drawn):
            drawn.append(place)
            campbell.annotate(f"{place:.4g} rpm", (place, 0.98), xycoords=campbell.get_xaxis_transform(), rotation=90,
                              ha="right" if (place - start) * width > apart else "left", va="top", fontsize=7,
                              bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.5})  # fmt: skip


def _heading(swept: Sweep) -> str:
    if any(mode.startswith(FORWARD) for mode in swept.modes):
        return "fixed axes: forward and backward whirl, torsion or axial; critical speeds ringed"
    turning = " in axes that turn with the links" if swept.axes == "link" else ""
    return f"frozen frequencies{turning}, over the cycle shaded; orders dashed"


def _short(mode: str) -> str:
    """The name of a rotor's mode by its first letter, like F1; another name stays as it is."""
    return mode if mode.startswith("mode") else f"{mode[0].upper()}{mode.split()[-1]}"


def _name_ends(axes: Axes, x: float, ends: list[tuple[float, str, str]]) -> None:
    """Names of curves (height of the end, name, colour) beside those ends that the panel shows, without overlap."""
    low, high = axes.get_ylim()
    shown = sorted(each for each in ends if low <= each[0] <= high)
    height = axes.bbox.height / axes.get_figure(root=True).dpi * 72.0  # type: ignore[union-attr]
    at = [(y - low) / (high - low) * height for y, *_ in shown]
    places = list[float]()
    for each in at:
        places.append(max(each, places[-1] + _APART) if places else each)
    for k in range(len(places) - 1, -1, -1):  # down again from the upper end
        places[k] = min(places[k], height + 4.0 if k == len(places) - 1 else places[k + 1] - _APART)
    for (y, text, colour), own, place in zip(shown, at, places, strict=True):
        axes.annotate(text, (x, y), xytext=(4.0, place - own), textcoords="offset points", va="center", fontsize=7,
                      color=colour, annotation_clip=False)  # fmt: skip
