"""Energy of a run: stored, supplied and dissipated."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from kaneflex.plots.style import legend_beside, pages, readable
from kaneflex.plots.view import view

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution


def figures(solution: Solution) -> dict[str, Figure]:
    """``energy``: of runs whose energy was integrated with the motion, instant by instant: preset coupled."""
    energy = solution.energy
    if energy is None or len(energy.kinetic) != len(solution.times) or not energy.stored.any():
        return {}
    shown = view(solution)
    page, panels = pages(2, f"Energy, drift {energy.drift:.1e} of the energy that is exchanged{shown.note}", 8.4, 1.9)
    stored = {"kinetic": energy.kinetic, "strain, springs": energy.strain, "weight": energy.weight}
    grown = energy.stored - energy.stored[0]
    balance = {"stored, increase": grown, "dissipated": energy.dissipated, "supplied": energy.supplied}
    titles = ("Stored energy", "Since the start: increase of the stored energy + dissipated = supplied energy")
    for axes, title, curves in zip(panels, titles, (stored, balance), strict=True):
        curves = {name: values[shown.instants] for name, values in curves.items() if values.any()}
        factor, unit = readable("J", *curves.values())
        for name, values in curves.items():
            dashes = (0, (4, 5)) if name == "supplied" else "-"  # what is supplied lies on what is stored
            axes.plot(shown.x, factor * values, linestyle=dashes, label=name)
        axes.set(title=title, ylabel=f"energy [{unit}]", xmargin=0)
        if curves:
            legend_beside(axes)
    shown.finish(panels)
    return {"energy": page}
