"""Linear second-order equations for integration, with coefficients affine in a table of scalars."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from kaneflex.support.sparse_rows import SparseRows, rows_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Rows: TypeAlias = "SparseRows | csr_array"
_LONGEST_GAP = 4  # zeros worth adding up rather than starting a new run of slots
_MATRICES = ("M", "C", "K")


class Layout(NamedTuple):
    """Layout of a banded matrix: entry (i, j) at ``base[i] + j`` for ``first[i] <= j < last[i]``."""

    n: int
    n_slots: int
    base: np.ndarray
    first: np.ndarray
    last: np.ndarray


class Packed(NamedTuple):
    """An :class:`AffineSystem` as the compiled steppers read it.

    One vector holds the slots of M, then C, then K, then F. A row (scalar, start, length, offset) of ``runs`` says:
    add that scalar times `length` numbers of ``data`` from `offset` on to the slots from `start` on. A scalar of a
    motion touches the coordinates of one link, which are neighbours, so the runs are few and long. Where several
    scalars run over the same slots, four of them are a row (scalars, start, length, offset) of ``quads``, with four
    numbers a slot: a sum is then stored once, not four times.
    """

    layout: Layout
    quads: np.ndarray
    runs: np.ndarray
    data: np.ndarray


@dataclass(frozen=True, eq=False)
class AffineSystem:
    """M(t) z'' + C(t) z' + K(t) z = F(t), each a sum of scalar of the motion x constant matrix.

    n: number of coordinates z
    half_bandwidth: largest ``|i - j|`` with an entry (i, j) in M, C or K, called w below; n - 1 means dense
    M, C, K: shape ``(n * (2 w + 1), n_scalars)``; row ``i * (2 w + 1) + (j - i + w)`` times the scalars is entry (i, j)
    F: shape ``(n, n_scalars)``

    The scalars are the caller's, ``table(times) -> array (n_times, n_scalars)``; a constant matrix belongs
    to a scalar that is 1 at all times. Units are the caller's too, as long as they are consistent.

    Raises ValueError where the shapes do not fit each other or an entry lies outside the matrix.
    """

    n: int
    half_bandwidth: int
    M: Rows
    C: Rows
    K: Rows
    F: Rows

    def __post_init__(self) -> None:
        if not 0 <= self.half_bandwidth < self.n:
            raise ValueError(f"half_bandwidth = {self.half_bandwidth}: must be 0 to n - 1 = {self.n - 1}")
        rows = self.n * (2 * self.half_bandwidth + 1)
        for name in (*_MATRICES, "F"):
            expected = (self.n if name == "F" else rows, self.n_scalars)
            if getattr(self, name).shape != expected:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}: must be {expected}")
        for name in _MATRICES:
            matrix = getattr(self, name)
            _, columns = self._places(rows_of(matrix)[matrix.data != 0.0])
            if columns.size and (columns.min() < 0 or columns.max() >= self.n):
                raise ValueError(f"{name} has an entry in a column outside 0 to {self.n - 1}, off the matrix")

    @property
    def n_scalars(self) -> int:
        """Number of scalars in a row of the table."""
        return self.F.shape[1]

    def scalars_of(self, name: str) -> np.ndarray:
        """Indices of the scalars that enter M, C, K or F."""
        matrix = getattr(self, name)
        return np.unique(matrix.indices[matrix.data != 0.0])

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
    def sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Ends of the terms of each slot of M, then C, then K, then F, with their scalars and numbers."""
        matrices = [getattr(self, name) for name in (*_MATRICES, "F")]
        before = np.cumsum([0, *(matrix.data.size for matrix in matrices)])
        each = [matrix.indptr[1:] + first for matrix, first in zip(matrices, before[:-1], strict=True)]
        ends = np.concatenate([before[:1], *each]).astype(np.uint64)
        what = np.concatenate([matrix.indices for matrix in matrices]).astype(np.uint64)
        return ends, what, np.concatenate([matrix.data for matrix in matrices])

    @cached_property
    def packed(self) -> Packed:
        """The same numbers, in the layout of the compiled steppers."""
        n, layout = self.n, layout_of(self.n, self.half_bandwidth, 1)
        scalars, slots, values = self.entries(layout)
        # M before C before K before F, then by scalar, then by slot; far apart where a run must end
        block = np.minimum(slots // int(layout.n_slots), len(_MATRICES))
        far = len(_MATRICES) * int(layout.n_slots) + n + _LONGEST_GAP + 1
        keys, places = np.unique((block * self.n_scalars + scalars) * far + slots, return_inverse=True)
        begins = np.concatenate(([True], np.diff(keys) > _LONGEST_GAP + 1))[: len(keys)]
        starts = np.flatnonzero(begins)
        run = np.cumsum(begins) - 1
        lengths = keys[np.append(starts[1:], len(keys)) - 1] - keys[starts] + 1 if len(keys) else starts
        offsets = np.cumsum(lengths) - lengths
        numbers = np.zeros(int(lengths.sum()))
        np.add.at(numbers, (offsets - keys[starts])[run][places] + keys[places], values)
        found = np.stack((keys[starts] // far % self.n_scalars, keys[starts] % far, lengths, offsets), axis=1)
        return Packed(layout, *_grouped(found, numbers))

    def entries(self, layout: Layout) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Scalar, slot in the vector of M, C, K and F, and value of everything that is not zero."""
        scalars, slots, values = [], [], []
        for block, name in enumerate((*_MATRICES, "F")):
            matrix = getattr(self, name)
            used = matrix.data != 0.0
            slot = rows_of(matrix)[used]
            if name != "F":
                rows, columns = self._places(slot)
                slot = layout.base[rows].astype(np.int64) + columns
            scalars.append(matrix.indices[used])
            slots.append(block * int(layout.n_slots) + slot)
            values.append(matrix.data[used])
        return np.concatenate(scalars), np.concatenate(slots), np.concatenate(values)

    def _places(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = 2 * self.half_bandwidth + 1
        rows = slots // width
        return rows, slots % width + rows - self.half_bandwidth


def _grouped(runs: np.ndarray, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Quads, runs and data of :class:`Packed` from runs alone: fours, or what is left of them, over the same slots."""
    spans, span = np.unique(runs[:, 1:3], axis=0, return_inverse=True)
    quads, single, data, size = [], [], [], 0
    for k, (start, length) in enumerate(spans.tolist()):
        members = runs[span.ravel() == k]
        for first in range(0, len(members), 4):
            four = members[first : first + 4]
            places = four[:, 3, None] + np.arange(length)
            if len(four) == 1:
                single.append((four[0, 0], start, length, size))
                data.append(numbers[places[0]])
            else:
                block = np.zeros((length, 4))
                block[:, : len(four)] = numbers[places].T
                quads.append((*np.resize(four[:, 0], 4), start, length, size))
                data.append(block.ravel())
            size += len(data[-1])
    tables = (np.array(rows, dtype=np.uint64).reshape(-1, width) for rows, width in ((quads, 7), (single, 4)))
    return *tables, np.concatenate(data) if data else numbers


def layout_of(n: int, half_bandwidth: int, copies: int) -> Layout:
    """Layout of a band with every coordinate `copies` times, side by side; nothing beyond the matrix."""
    blocks = np.repeat(np.arange(n, dtype=np.int64), copies)
    first = np.maximum(blocks - half_bandwidth, 0) * copies
    last = (np.minimum(blocks + half_bandwidth, n - 1) + 1) * copies
    lengths = last - first
    starts = np.concatenate(([0], np.cumsum(lengths)[:-1]))
    places = (np.asarray(each, dtype=np.uint64) for each in (starts - first, first, last))
    return Layout(np.uint64(n * copies), np.uint64(lengths.sum()), *places)
