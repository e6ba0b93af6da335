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
_MATRICES = ("M", "C", "K")


class Layout(NamedTuple):
    """Layout of a banded matrix: entry (i, j) at ``base[i] + j`` for ``first[i] <= j < last[i]``."""

    n: int
    n_slots: int
    base: np.ndarray
    first: np.ndarray
    last: np.ndarray


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

    @property
    def layout(self) -> Layout:
        """Layout of M, C and K."""
        return layout_of(self.n, self.half_bandwidth, 1)

    def _places(self, slots: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = 2 * self.half_bandwidth + 1
        rows = slots // width
        return rows, slots % width + rows - self.half_bandwidth


def layout_of(n: int, half_bandwidth: int, copies: int) -> Layout:
    """Layout of a band with every coordinate `copies` times, side by side; zeros beyond the matrix are stored, too."""
    rows, blocks = np.arange(n * copies), np.repeat(np.arange(n), copies)
    width = (2 * half_bandwidth + 1) * copies
    first = np.maximum(blocks - half_bandwidth, 0) * copies
    last = (np.minimum(blocks + half_bandwidth, n - 1) + 1) * copies
    places = (each.astype(np.uint64) for each in (rows * width - (blocks - half_bandwidth) * copies, first, last))
    return Layout(np.uint64(n * copies), np.uint64(n * copies * width), *places)
