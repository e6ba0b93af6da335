"""Products of the motion's scalars that matrices are sums of, at many instants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from kaneflex.mechanism.affine import Monomial
from kaneflex.support.machine_code import Kernel

_multiply_rows = Kernel("mechanism.kernels", "multiply_rows")


@dataclass(frozen=True, eq=False)
class Products:
    """Monomials as the compiled loops read them: ``pattern`` has where each ends among their scalars, then those."""

    count: int
    pattern: np.ndarray

    @classmethod
    def of(cls, monomials: Sequence[Monomial], column: Mapping[str, int]) -> Products:
        """Monomials of scalars that have a column in the motion's table."""
        places = [sorted(column[name] for name in monomial) for monomial in monomials]
        ends = np.cumsum([len(each) for each in places])
        return cls(len(places), np.concatenate([ends, *places]).astype(np.uint64))

    def at(self, table: np.ndarray) -> np.ndarray:
        """Shape (n_times, count) from the motion's table, shape (n_times, n_scalars)."""
        out = np.empty((len(table), self.count))
        _multiply_rows(table, self.pattern, out)
        return out
