"""Sparse matrices by rows, read without importing scipy, which takes longer than solving the scene engine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csr_array


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

    def __matmul__(self, other: np.ndarray) -> np.ndarray:
        return self.matrix @ other


def rows_of(matrix: SparseRows | csr_array) -> np.ndarray:
    """Row of each stored number."""
    return np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
