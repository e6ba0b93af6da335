"""Pictures of a judgement of stability: frozen frequencies over the drive, Campbell's diagram, multipliers."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, new_figure, readable
from kaneflex.response.whirl import turns
from kaneflex.study.stability.report import Stability
from kaneflex.study.stability.sweep import FORWARD, Sweep

_LEAST = 1e-3
"""Multiplier under which all disturbances are gone after a period."""


def figure(found: Stability) -> Figure:
    """Frequencies and load factors over the cycle; with speeds also Campbell's diagram and the spectral radius."""
    scene = found.model.scene
    rows = 2 if found.sweep is None else 4
    page = new_figure(7.2, 0.8 + 2.3 * rows, f"{scene.name}, {found.model.options.preset}: stability")
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
    where = ", in axes that turn with the links" if turns(found.model) else ""
    frequencies.set_title(f"frozen natural frequencies{where}")
    frequencies.set_ylabel(f"[{unit}]")
    factors.set_title("share of the buckling load, 1 / lambda")
    if found.buckling is not None:
        factors.plot(x, 1.0 / found.buckling.factors)
    factors.axhline(1.0, color=GREY, linewidth=0.8)
    for axes in (frequencies, factors):
        axes.margins(x=0)


def _over_speed(campbell: Axes, radii: Axes, swept: Sweep, factor: float, slides: bool) -> None:
    x = factor * swept.speeds
    scale, unit = readable("Hz", swept.highest[:, :2])
    styles = [{"backward": "--", "torsion": ":"}.get(mode.split()[0], "-") for mode in swept.modes]
    for k, style in enumerate(styles):
        colour = PALETTE[k % len(PALETTE)]
        campbell.fill_between(x, scale * swept.lowest[:, k], scale * swept.highest[:, k], color=colour, alpha=0.25)
        campbell.plot(x, scale * swept.mean[:, k], color=colour, linestyle=style)
    # What the orders can't reach is of no use to read where they cross.
    reach = max(swept.highest[:, :2].max(), max(swept.orders) * swept.speeds[-1] / (2.0 * np.pi))
    campbell.set_ylim(0.0, 1.05 * scale * reach)
    for k, mode in enumerate(swept.modes):
        at = k * len(x) // 12  # beside each other, where modes are close
        _name(campbell, _short(mode), x[at], scale * swept.mean[at, k], PALETTE[k % len(PALETTE)], above=True)
    for order in swept.orders if not slides else ():
        line = scale * order * swept.speeds / (2.0 * np.pi)
        campbell.plot(x, line, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
        _name(campbell, f"{order:g}", x[-1], line[-1], "black", above=False)
    for _, _, speed in swept.critical:
        place = factor * speed
        campbell.axvline(place, color="black", linewidth=0.7, linestyle=":")
        campbell.plot(place, scale * speed / (2.0 * np.pi), "o", color="black", markersize=5, markerfacecolor="white")
        campbell.annotate(f"{place:.4g} rpm", (place, 0.92), xycoords=campbell.get_xaxis_transform(), xytext=(3, 0),
                          textcoords="offset points", fontsize=8)  # fmt: skip
    campbell.set_title(_heading(swept))
    campbell.set_ylabel(f"[{unit}]")
    seen = np.maximum(swept.radii, _LEAST)
    radii.semilogy(x, seen, marker=".", markersize=3)
    radii.set_ylim(bottom=max(_LEAST, 0.8 * seen.min()))
    radii.axhline(1.0, color=GREY, linewidth=0.8)
    radii.set_title("largest Floquet multiplier, unstable bands shaded")
    for axes in (campbell, radii):
        axes.margins(x=0)
        for low, high in swept.bands:
            axes.axvspan(factor * low, factor * high, color=PALETTE[1], alpha=0.15, linewidth=0)


def _heading(swept: Sweep) -> str:
    if any(mode.startswith(FORWARD) for mode in swept.modes):
        return "fixed axes: forward and backward whirl, torsion or axial; critical speeds ringed"
    turning = " in axes that turn with the links" if swept.axes == "link" else ""
    return f"frozen frequencies{turning}, over the cycle shaded; orders dashed"


def _short(mode: str) -> str:
    """The name of a rotor's mode by its first letter, like F1; of another as it is."""
    return mode if mode.startswith("mode") else f"{mode[0].upper()}{mode.split()[-1]}"


def _name(axes: Axes, text: str, x: float, y: float, colour: str, above: bool) -> None:
    """The name of a curve above a point of it, or beside its last one, where the panel shows that."""
    if y < axes.get_ylim()[1]:
        place, va = ((2.0, 1.5), "bottom") if above else ((3.0, 0.0), "center_baseline")
        axes.annotate(text, (x, y), xytext=place, textcoords="offset points", va=va, fontsize=7, color=colour)
