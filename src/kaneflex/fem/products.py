"""Products of the motion's scalars at many instants, compiled once for every scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from kaneflex.mechanism.affine import Monomial


@njit(cache=True, error_model="numpy")
def _fill(values: np.ndarray, factors: np.ndarray, ends: np.ndarray, columns: np.ndarray, out: np.ndarray) -> None:
    for row in range(out.shape[0]):
        place = 0
        for k in range(out.shape[1]):
            product = factors[k]
            while place < ends[k]:
                product *= values[row, columns[place]]
                place += 1
            out[row, k] = product


@dataclass(frozen=True, eq=False)
class Products:
    """Monomials as the compiled loop reads them.

    factors: shape (n,), product of each monomial's constants
    ends, columns: monomial k is the product of the table's columns[ends[k - 1]:ends[k]]
    """

    factors: np.ndarray
    ends: np.ndarray
    columns: np.ndarray

    @classmethod
    def of(
        cls, monomials: Sequence[Monomial], column: Mapping[str, int], constants: Mapping[str, float]
    ) -> Products:
        """Of scalars that have a column in the motion's table, or else are constants."""
        varying = [sorted(column[name] for name in monomial if name in column) for monomial in monomials]
        fixed = [np.prod([constants[name] for name in monomial if name not in column]) for monomial in monomials]
        columns = np.array([place for places in varying for place in places], dtype=np.int64)
        return cls(np.array(fixed, dtype=float), np.cumsum([len(places) for places in varying]), columns)

    def at(self, values: np.ndarray) -> np.ndarray:
        """Shape (n_times, n) from the motion's table, shape (n_times, n_scalars)."""
        out = np.empty((len(values), len(self.factors)))
        _fill(values, self.factors, self.ends, self.columns, out)
        return out
