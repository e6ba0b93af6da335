"""Stresses at the edges of elastic links along their lengths, and their share of what the material bears."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from kaneflex.plots.style import GREY, PALETTE, legend_beside, new_figure, readable
from kaneflex.plots.view import View, view

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution

_STATIONS = 25


class Edges(NamedTuple):
    """Stations along a link [m], and the stress [Pa] at its upper and its lower edge, (n_stations, n_times) each."""

    x: np.ndarray
    upper: np.ndarray
    lower: np.ndarray


def figures(solution: Solution) -> dict[str, Figure]:
    """``stress``: of planar elastic links whose sections have a shape, all that they go through in what is shown."""
    shown, bodies = view(solution), solution.model.scene.bodies
    found = {name: edges for name in solution.model.links if (edges := edge_stresses(shown, name)) is not None}
    if not found:
        return {}
    page = new_figure(7.6, 0.9 + 2.2 * len(found), f"Stress at the edges of links{shown.note}")
    panels = page.subplots(len(found), 1, squeeze=False)[:, 0]
    for axes, (name, edges) in zip(panels, found.items(), strict=True):
        beam = bodies[name].beam
        _panel(axes, shown, name, edges, beam.yield_strength if beam else None)
    return {"stress": page}


def edge_stresses(shown: View, name: str) -> Edges | None:
    """N / A -+ M h / (2 I) along a link, its upper edge at +y; None where no section has a shape or none are known.

    A point at which a joint or a load acts divides two sections; what is shown there is the one before it.
    """
    body = shown.solution.model.scene.bodies[name]
    profile, x = body.profile, np.linspace(0.0, body.length or 0.0, _STATIONS)
    heights = [profile.height(float(place)) for place in x]
    if any(height is None for height in heights):
        return None
    parts = []
    for place, height in zip(x, heights, strict=True):
        N, _, M = shown.motion.section(name, float(place))
        (A, I, _), half = profile.piece_at(float(place)).at(float(place)), 0.5 * (height or 0.0)
        parts.append((N / A - half * M / I, N / A + half * M / I))
    upper, lower = np.array(parts).swapaxes(0, 1)
    return Edges(x, upper, lower) if np.isfinite(upper).all() and np.isfinite(lower).all() else None


def _panel(axes: Axes, shown: View, name: str, edges: Edges, strength: float | None) -> None:
    factor, unit = readable("Pa", edges.upper, edges.lower)
    along, length_unit = readable("m", edges.x)
    for label, values, colour in (("upper edge", edges.upper, PALETTE[0]), ("lower edge", edges.lower, PALETTE[1])):
        low, high = factor * values.min(axis=1), factor * values.max(axis=1)
        axes.fill_between(along * edges.x, low, high, color=colour, alpha=0.25, linewidth=0, label=label)
        for side in (low, high):
            axes.plot(along * edges.x, side, color=colour, linewidth=0.9)
    both = np.maximum(abs(edges.upper), abs(edges.lower))
    station, instant = np.unravel_index(int(both.argmax()), both.shape)
    largest = float(both[station, instant])
    values = edges.upper if abs(edges.upper[station, instant]) >= largest else edges.lower
    place, when = along * edges.x[station], shown.x[instant]
    axes.plot(place, factor * values[station, instant], "o", color="black", markersize=3.5, label="largest")
    over, _, over_unit = shown.x_label.rstrip("]").partition(" [")
    title = f"{name}: {factor * largest:.3g} {unit} at {place:.4g} {length_unit}, {over} {when:.4g} {over_unit}"
    if strength is not None:
        title += f", {100.0 * largest / strength:.3g} % of {factor * strength:.4g} {unit}"
        for side in (-strength, strength):
            if abs(side) <= 3.0 * largest:
                axes.axhline(factor * side, color=GREY, linestyle="--", linewidth=0.9)
    axes.set_title(title)
    axes.set_ylabel(f"stress [{unit}]")
    axes.set_xlabel(f"distance from the start of {name} [{length_unit}]")
    axes.margins(x=0)
    legend_beside(axes)
