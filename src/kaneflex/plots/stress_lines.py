"""Elastic links as lines coloured by their stress."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from mpl_toolkits.mplot3d.art3d import Line3DCollection

from kaneflex.plots.style import readable

if TYPE_CHECKING:
    from kaneflex.solve.solution import Solution


class StressLines:
    """Lines of links (instants, points, 2 or 3) [mm], coloured by the largest von Mises stress of each section.

    The colours keep one scale for all ``instants``, which index the solution's times. Links whose section has no
    shape have no stress: they are left out.
    """

    def __init__(self, axes: Axes, solution: Solution, lines: Mapping[str, np.ndarray], instants: np.ndarray) -> None:
        shown = {name: each for name, each in solution.stresses.items() if name in lines}
        self.factor, self.unit = readable("Pa", *(each.mises[:, instants] for each in shown.values()))
        pieces, values = [], []
        for name, each in shown.items():
            points = lines[name]
            middles = np.linspace(0.0, each.x[-1], 2 * points.shape[1] - 1)[1::2]
            values.append([self.factor * np.interp(middles, each.x, each.mises[:, instant]) for instant in instants])
            pieces.append(np.stack([points[:, :-1], points[:, 1:]], axis=2))
        self._pieces, self._values = np.concatenate(pieces, axis=1), np.concatenate(values, axis=1)
        kind = Line3DCollection if solution.model.scene.is_spatial else LineCollection
        self.artist = kind([*self._pieces[0]], cmap="turbo", linewidths=4.5, capstyle="round", zorder=3.3)
        self.artist.set_clim(0.0, float(self._values.max()) or 1.0)
        self.artist.set_array(self._values[0])
        axes.add_collection(self.artist)

    def move(self, k: int) -> None:
        """Show the k-th instant (in the plane)."""
        self.artist.set_segments([*self._pieces[k]])
        self.artist.set_array(self._values[k])
