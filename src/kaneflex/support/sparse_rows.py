"""Sparse matrices by rows, read without importing scipy, which takes longer than solving the scene engine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_array


_FEW = 200_000
"""Entries below which the product by a dense matrix takes less time than importing scipy."""


@dataclass(frozen=True, eq=False)
class SparseRows:
    """Arrays of scipy's ``csr_array``: row i has data[k] in column indices[k] for indptr[i] <= k < indptr[i + 1]."""

    data: np.ndarray
    indices: np.ndarray
    indptr: np.ndarray
    shape: tuple[int, int]

    @cached_property
    def matrix(self) -> csr_array:
        """Matrix of scipy to compute with."""
        from scipy.sparse import csr_array

        return csr_array((self.data, self.indices, self.indptr), shape=self.shape)

    @cached_property
    def dense(self) -> np.ndarray:
        """All entries, zeros too."""
        found = np.zeros(self.shape)
        found[rows_of(self), self.indices] = self.data
        return found

    def __matmul__(self, other: np.ndarray) -> np.ndarray:
        return (self.dense if self.shape[0] * self.shape[1] < _FEW else self.matrix) @ other


def rows_of(matrix: SparseRows | csr_array) -> np.ndarray:
    """Row of each stored number."""
    return np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))


class Entries(NamedTuple):
    """Nonzero entries of a sum of scalar x matrix: row, column, value, and index of the scalar."""

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    scalars: np.ndarray


def coefficients(slot: np.ndarray, found: Entries, shape: tuple[int, int]) -> SparseRows:
    """Matrix (slots x scalars) whose product with the scalars' values gives the values of the slots."""
    order = np.lexsort((found.scalars, slot))
    ends = np.cumsum(np.bincount(slot, minlength=shape[0]))
    return SparseRows(found.values[order], found.scalars[order], np.append(0, ends), shape)
