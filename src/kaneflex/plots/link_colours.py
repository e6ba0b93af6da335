"""Elastic links as lines coloured by a quantity along them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from kaneflex.plots.drawing import MM
from kaneflex.plots.outlines import ALONG_LINK, Outline
from kaneflex.plots.style import readable

if TYPE_CHECKING:
    from kaneflex.plots.view import View
    from kaneflex.solve.solution import Solution


class Field(NamedTuple):
    """Values of each link at the middles of its drawn pieces, (n_times, n_pieces), and the name of the scale."""

    values: Mapping[str, np.ndarray]
    label: str


def stress_field(solution: Solution, instants: np.ndarray, count: int = ALONG_LINK) -> Field | None:
    """Largest von Mises stress of each section; None where no link's section has a shape.

    ``instants`` index the solution's times; ``count`` is the number of points along a link.
    """
    stresses = solution.stresses
    if not stresses:
        return None
    factor, unit = readable("Pa", *(each.mises[:, instants] for each in stresses.values()))
    values = {}
    for name, each in stresses.items():
        middles = np.linspace(0.0, each.x[-1], 2 * count - 1)[1::2]
        values[name] = np.array([factor * np.interp(middles, each.x, each.mises[:, instant]) for instant in instants])
    return Field(values, f"von Mises stress [{unit}]")


def displacement_field(shown: View) -> Field | None:
    """Size of the elastic displacement; None without elastic links."""
    sizes = {name: np.linalg.norm(shown.displaced(name, np.linspace(0.0, length, 2 * ALONG_LINK - 1)[1::2]), axis=1).T
             for name, length in shown.lengths.items()}  # fmt: skip
    if not sizes:
        return None
    factor, unit = readable("m", *sizes.values())
    return Field({name: factor * each for name, each in sizes.items()}, f"elastic displacement [{unit}]")


class LinkColours:
    """Links of an outline coloured by a field, with one scale for all instants; other links are left out."""

    def __init__(self, axes: Axes, outline: Outline, field: Field) -> None:
        names = [name for name in outline.links if name in field.values]
        lines = [MM * outline.links[name] for name in names]
        self._pieces = np.concatenate([np.stack([line[:, :-1], line[:, 1:]], axis=2) for line in lines], axis=1)
        self._values = np.concatenate([field.values[name] for name in names], axis=1)
        self.artist = LineCollection([*self._pieces[0]], cmap="turbo", linewidths=4.5, capstyle="round", zorder=3.3)
        self.artist.set_clim(0.0, float(self._values.max()) or 1.0)
        self.artist.set_array(self._values[0])
        axes.add_collection(self.artist)

    def move(self, k: int) -> None:
        """Show the k-th instant."""
        self.artist.set_segments([*self._pieces[k]])
        self.artist.set_array(self._values[k])
