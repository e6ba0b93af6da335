"""Stresses of elastic links along their lengths, and their share of the yield strength."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, legend_beside, new_figure, readable
from kaneflex.plots.view import View, view
from kaneflex.response.stresses import LinkStresses

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution


def figures(solution: Solution) -> dict[str, Figure]:
    """``stress``: of elastic links whose sections have a shape, all that they go through in what is shown."""
    shown, bodies = view(solution), solution.model.scene.bodies
    found = {name: each.taken(shown.instants) for name, each in solution.stresses.items()}
    if not found:
        return {}
    page = new_figure(7.6, 0.9 + 2.2 * len(found), f"Stress of links{shown.note}")
    panels = page.subplots(len(found), 1, squeeze=False)[:, 0]
    for axes, (name, stresses) in zip(panels, found.items(), strict=True):
        beam = bodies[name].beam
        _panel(axes, shown, name, stresses, beam.yield_strength if beam else None)
    return {"stress": page}


def _panel(axes: Axes, shown: View, name: str, stresses: LinkStresses, strength: float | None) -> None:
    factor, unit = readable("Pa", stresses.upper, stresses.lower, stresses.mises)
    along, length_unit = readable("m", stresses.x)
    planar = shown.solution.model.in_space is None
    labels = ("upper edge", "lower edge") if planar else ("largest tension", "largest compression")
    for label, values, colour in zip(labels, (stresses.upper, stresses.lower), PALETTE, strict=False):
        low, high = factor * values.min(axis=1), factor * values.max(axis=1)
        axes.fill_between(along * stresses.x, low, high, color=colour, alpha=0.25, linewidth=0, label=label)
        for side in (low, high):
            axes.plot(along * stresses.x, side, color=colour, linewidth=0.9)
    mises = factor * stresses.mises.max(axis=1)
    axes.plot(along * stresses.x, mises, color="black", linestyle=":", linewidth=1.2, label="von Mises, largest")
    station, instant = stresses.largest
    largest, place, when = mises[station], along * stresses.x[station], shown.x[instant]
    axes.plot(place, largest, "o", color="black", markersize=3.5)
    over, _, over_unit = shown.x_label.rstrip("]").partition(" [")
    title = f"{name}: {largest:.3g} {unit} at {place:.4g} {length_unit}, {over} {when:.4g} {over_unit}"
    if strength is not None:
        title += f", {100.0 * largest / (factor * strength):.3g} % of {factor * strength:.4g} {unit}"
        for side in (-strength, strength):
            if factor * abs(side) <= 3.0 * largest:
                axes.axhline(factor * side, color=GREY, linestyle="--", linewidth=0.9)
    axes.set(title=title, ylabel=f"stress [{unit}]", xmargin=0)
    axes.set_xlabel(f"distance from the start of {name} [{length_unit}]")
    legend_beside(axes)
