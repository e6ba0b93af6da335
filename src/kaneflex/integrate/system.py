"""The equations that are integrated: linear, second order, coefficients affine in a table of scalars."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import csc_array, csr_array

_LONGEST_GAP = 4  # zeros worth adding up rather than starting a new run of slots
_MATRICES = ("M", "C", "K")


class Layout(NamedTuple):
    """Where the entries of a banded matrix lie: (i, j) at ``base[i] + j`` for ``first[i] <= j < last[i]``."""

    n: int
    n_slots: int
    base: np.ndarray
    first: np.ndarray
    last: np.ndarray


class Packed(NamedTuple):
    """An :class:`AffineSystem` as the compiled steppers read it.

    One vector holds the slots of M, then C, then K, then F. Row k of ``runs`` says: add scalar ``runs[k,
    0]`` times the ``runs[k, 2]`` numbers at ``data[runs[k, 3]]`` to the slots from ``runs[k, 1]`` on. A
    scalar of a motion touches the coordinates of one link, which are neighbours, so the runs are few and
    long.
    """

    layout: Layout
    pairs: Layout  # of the matrix of order 2 n in which every coordinate is two neighbouring unknowns
    runs: np.ndarray
    data: np.ndarray


@dataclass(frozen=True, eq=False)
class AffineSystem:
    """M(t) z'' + C(t) z' + K(t) z = F(t), each a sum of scalar of the motion x constant matrix.

    Parameters ---------- n: number of coordinates z. half_bandwidth: largest ``|i - j|`` with an entry (i,
    j) in M, C or K, called w below; n - 1 means dense. M, C, K: shape ``(n * (2 w + 1), n_scalars)``; row
    ``i * (2 w + 1) + (j - i + w)`` times the scalars is entry
        (i, j).
    F: shape ``(n, n_scalars)``.

    The scalars are the caller's, ``table(times) -> array (n_times, n_scalars)``; a constant matrix belongs
    to a scalar that is 1 at all times. Units are the caller's too, as long as they are consistent.

    Raises ValueError where the shapes do not fit each other or an entry lies outside the matrix.
    """

    n: int
    half_bandwidth: int
    M: csr_array
    C: csr_array
    K: csr_array
    F: csr_array

    def __post_init__(self) -> None:
        if not 0 <= self.half_bandwidth < self.n:
            raise ValueError(f"half_bandwidth = {self.half_bandwidth}: must be 0 to n - 1 = {self.n - 1}")
        rows = self.n * (2 * self.half_bandwidth + 1)
        for name in (*_MATRICES, "F"):
            expected = (self.n if name == "F" else rows, self.n_scalars)
            if getattr(self, name).shape != expected:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}: must be {expected}")
        for name in _MATRICES:
            _, columns = self._places(getattr(self, name))
            if columns.size and (columns.min() < 0 or columns.max() >= self.n):
                raise ValueError(f"{name} has an entry in a column outside 0 to {self.n - 1}, off the matrix")

    @property
    def n_scalars(self) -> int:
        """Number of scalars in a row of the table."""
        return self.F.shape[1]

    def scalars_of(self, name: str) -> np.ndarray:
        """Indices of the scalars that enter M, C, K or F."""
        return np.unique(csc_array(getattr(self, name)).nonzero()[1])

    def dense(self, name: str, scalars: np.ndarray) -> np.ndarray:
        """M, C or K as an (n, n) array, or F as (n,), at one row of the table, shape (n_scalars,)."""
        values = getattr(self, name) @ np.asarray(scalars, dtype=float)
        if name == "F":
            return values
        matrix = np.zeros((self.n, self.n))
        slots = np.flatnonzero(values)
        width = 2 * self.half_bandwidth + 1
        rows = slots // width
        matrix[rows, slots % width + rows - self.half_bandwidth] = values[slots]
        return matrix

    @cached_property
    def packed(self) -> Packed:
        """The same numbers, in the layout of the compiled steppers."""
        layout = _layout(self.n, self.half_bandwidth, 1)
        columns = {name: csc_array(getattr(self, name)) for name in (*_MATRICES, "F")}
        runs, data, offset = [], [], 0
        for block, (name, matrix) in enumerate(columns.items()):
            for scalar in range(self.n_scalars):
                entries = slice(matrix.indptr[scalar], matrix.indptr[scalar + 1])
                slots, values = matrix.indices[entries], matrix.data[entries]
                if name != "F":
                    rows, places = self._places_of_slots(slots)
                    slots = layout.base[rows].astype(np.int64) + places
                for start, run in _runs_of(slots, values):
                    runs.append((scalar, block * int(layout.n_slots) + start, run.size, offset))
                    offset += run.size
                    data.append(run)
        return Packed(
            layout=layout,
            pairs=_layout(self.n, self.half_bandwidth, 2),
            runs=np.array(runs, dtype=np.uint64).reshape(-1, 4),
            data=np.concatenate(data) if data else np.zeros(0),
        )

    def _places(self, matrix: csr_array) -> tuple[np.ndarray, np.ndarray]:
        return self._places_of_slots(matrix.nonzero()[0])

    def _places_of_slots(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = 2 * self.half_bandwidth + 1
        rows = slots // width
        return rows, slots % width + rows - self.half_bandwidth


def _layout(n: int, half_bandwidth: int, copies: int) -> Layout:
    """Layout of a band with every coordinate `copies` times, side by side; nothing beyond the matrix."""
    blocks = np.repeat(np.arange(n, dtype=np.int64), copies)
    first = np.maximum(blocks - half_bandwidth, 0) * copies
    last = (np.minimum(blocks + half_bandwidth, n - 1) + 1) * copies
    lengths = last - first
    starts = np.concatenate(([0], np.cumsum(lengths)[:-1]))
    places = (np.asarray(each, dtype=np.uint64) for each in (starts - first, first, last))
    return Layout(np.uint64(n * copies), np.uint64(lengths.sum()), *places)


def _runs_of(slots: np.ndarray, values: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Cut entries at `slots` into runs without long gaps: first slot and numbers, short gaps filled by 0."""
    used = np.flatnonzero(values)
    if not used.size:
        return []
    order = used[np.argsort(slots[used], kind="stable")]
    slots, values = slots[order].astype(np.int64), values[order]
    cuts = np.flatnonzero(np.diff(slots) > _LONGEST_GAP + 1) + 1
    runs = []
    for places, numbers in zip(np.split(slots, cuts), np.split(values, cuts), strict=True):
        run = np.zeros(places[-1] - places[0] + 1)
        np.add.at(run, places - places[0], numbers)
        runs.append((int(places[0]), run))
    return runs
