"""Map q = L(t) z from independent coordinates to those of all parts of a spatial mechanism.

L follows from the rows of the joints (``kaneflex.fem.spatial_joined``). Coordinates held by joints and drives to the
ground are zero; the entries of L that vary are scalars of the motion like others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array, csr_array

from kaneflex.fem.coordinate_map import Placed
from kaneflex.fem.links import Part
from kaneflex.fem.spatial_joined import ZERO, Choice, Joined
from kaneflex.mechanism.affine import Affine, from_entries
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.rigid_bodies import Site
from kaneflex.mechanism.rigid_motion import RigidMotion

_VARY = 1e-9
"""Change of an entry of L over the run, in its own measure, that counts as none."""
_AT_ONCE = 300_000
"""Numbers in the rows of the instants that are in memory at once; allocating more takes longer than computing them."""


@dataclass(frozen=True, eq=False)
class SpatialMap:
    """Map L of a mechanism: its constant part and its varying entries.

    Attributes
    ----------
    joined : Joined
    choice : Choice
    constant : csr_array (rows, independent)
    varying : ndarray (n, 2)
        Row and column of the entries that are scalars of the motion.
    rows : ndarray
        All rows of the joints that don't follow from others.
    """

    joined: Joined
    choice: Choice
    constant: csr_array
    varying: np.ndarray
    rows: np.ndarray

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the independent coordinates z."""
        return tuple(self.joined.labels[k] for k in self.choice.independent)

    @property
    def scalars(self) -> list[tuple[str, str, str]]:
        """Name, unit and meaning of the varying entries, each with its two rates."""
        found = []
        for name, row, column in self._entries():
            labels = self.joined.labels[row], self.joined.labels[self.choice.independent[column]]
            units = ["rad" if label.rpartition(".")[2].startswith("theta") else "m" for label in labels]
            ratio = "1" if units[0] == units[1] else "/".join(units)
            meaning = f"displacement {labels[0]} by that of {labels[1]}"
            for kind, per in (("value", ""), ("rate", "/s"), ("accel", "/s^2")):
                found.append((f"{name}.{kind}", f"{ratio}{per}", meaning))
        return found

    def _entries(self) -> list[tuple[str, int, int]]:
        labels, independent = self.joined.labels, self.choice.independent
        return [(f"{labels[r]} by {labels[independent[c]]}", int(r), int(c)) for r, c in self.varying]

    def table(self, motion: RigidMotion) -> np.ndarray:
        """The scalars at the instants of a motion, (n_times, 3 n)."""
        if not len(self.varying):
            return np.zeros((len(motion.times), 0))
        joined, rows = self.joined, self.varying[:, 0]
        columns, column = np.unique(self.varying[:, 1], return_inverse=True)
        row = np.where(rows < joined.size, joined.places(rows), rows - joined.size + len(joined.tied))
        found = np.empty((len(motion.times), len(rows), 3))
        count = max(_AT_ONCE // (joined.row_count * len(joined.tied)), 1)
        for first in range(0, len(motion.times), count):
            part = slice(first, first + count)
            some = replace(motion, times=motion.times[part], values=motion.values[part])
            found[part] = joined.tied_maps(some, self.choice, columns)[:, :, row, column].transpose(1, 2, 0)
        return found.reshape(len(motion.times), 3 * len(rows))

    def of(self, body: str) -> Affine:
        """L of a part, or how far the ends of a spring part."""
        first, size = self.joined.first[body], self.joined.size_of(body)
        constant = self.constant[first : first + size]
        total = Affine.constant(constant) if constant.nnz else Affine.zero(*constant.shape)
        for name, row, column in self._entries():
            if first <= row < first + size:
                entry = from_entries((size, self.constant.shape[1]), [row - first], [column], [1.0])
                total += Affine.term((f"{name}.value",), entry)
        return total

    def place(self, part: Part, joint: str) -> Placed:
        """Part whose coordinate is the elastic rotation of a joint's second body relative to its first, about its first
        axis."""
        of, joined, at = self.joined.mechanism.joints[joint], self.joined, list[tuple[Site, Affine]]()
        L = Affine.zero(1, self.constant.shape[1])
        for side, sign in zip(of.sides, (-1.0, 1.0), strict=True):
            if side.body != GROUND:
                axes, site = joined.mechanism.rest_axes, joined.site(side)
                axis = axes(side.body).T @ axes(of.sides[0].body) @ of.axes[0]
                rows = np.concatenate([np.zeros(3), sign * axis])[None]
                at.append((site, Affine.constant(rows)))
                pick = np.eye(joined.parts[side.body].size)[joined.columns(site) - joined.first[side.body]]
                L += Affine.constant(rows @ pick) @ self.of(side.body)
        return Placed(part, L, tuple(at))


def map_of(joined: Joined, motion: RigidMotion) -> SpatialMap:
    """Build the map; instants spread over the run show which entries vary.

    Coordinates that drives alone hold do not move; they and their rows are left out.
    """
    choice = joined.choose(motion)
    L, rows, columns = _of_tied(joined, motion, choice)
    moved = abs(L[0]) * joined.measure[choice.independent[columns]] / joined.measures[rows][:, None] > ZERO
    still = np.zeros(joined.size, bool)
    still[joined.tied] = ~moved.any(axis=(0, 2))[: len(joined.tied)]
    choice = joined.choose(motion, still)
    L, rows, columns = _of_tied(joined, motion, choice)
    measure = joined.measures[rows][:, None] / joined.measure[choice.independent[columns]]
    apart = abs(L[0] - L[0, :1]).max(axis=0) / measure
    row, column = np.nonzero(apart > _VARY)
    varying = np.column_stack([rows[row], columns[column]])
    steady = np.where((apart <= _VARY) & (abs(L[0, 0]) >= ZERO * measure), L[0, 0], 0.0)
    row, column = np.nonzero(steady)
    free = np.setdiff1d(np.arange(len(choice.independent)), columns)  # at no joint
    at = np.append(rows[row], choice.independent[free]), np.append(columns[column], free)
    values = np.append(steady[row, column], np.ones(len(free)))
    constant = csr_array(coo_array((values, at), (len(joined.measures), len(choice.independent))))
    return SpatialMap(joined, choice, constant, varying, joined.independent_rows(motion))


def _of_tied(joined: Joined, motion: RigidMotion, choice: Choice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """L and its rates between the coordinates at joints alone, springs' ends below; its rows and columns in the whole.
    """
    rows = np.append(joined.tied, np.arange(joined.size, len(joined.measures)))
    columns = np.flatnonzero(np.isin(choice.independent, joined.tied))
    return joined.tied_maps(motion, choice, columns), rows, columns
