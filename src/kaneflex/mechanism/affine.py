"""Affine matrices: sums of (product of motion scalars) x (constant matrix).

In link axes every elastic matrix has this form. The rotation of a joint's displacements into global axes keeps it,
with cos and sin of a body's angle as further scalars. Products and time derivatives of such sums are such sums,
so the assembly reads like its formula.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from kaneflex.support.sparse_rows import Entries

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from scipy.sparse import csr_array

Monomial = tuple[str, ...]
"""Sorted names of scalars, repeated for powers: ("rod.c", "rod.omega", "rod.omega") is c omega^2."""

Matrix: TypeAlias = "np.ndarray | csr_array"
_FEW = 10_000
"""Largest number of entries of a dense matrix: an operation on a sparse one costs as much as thousands of entries."""


def dense_if_small(matrix: Matrix | list) -> Matrix:
    """Dense array of a small matrix, else a sparse one."""
    if hasattr(matrix, "toarray"):
        return matrix.toarray() if matrix.shape[0] * matrix.shape[1] <= _FEW else sparse(matrix)
    matrix = np.asarray(matrix, dtype=float)
    return matrix if matrix.size <= _FEW else sparse(matrix)


def sparse(matrix: Matrix) -> csr_array:
    """Sparse matrix by rows, of any size."""
    from scipy.sparse import csr_array  # takes 0.2 s: imported only for large matrices

    return csr_array(matrix)


def from_entries(shape: tuple[int, int], rows: ArrayLike, columns: ArrayLike, values: ArrayLike) -> Matrix:
    """Matrix from entries, summing duplicates: a dense array if it is small, else sparse."""
    if shape[0] * shape[1] > _FEW:
        from scipy.sparse import coo_array

        return sparse(coo_array((np.ravel(values), (np.ravel(rows), np.ravel(columns))), shape=shape))
    matrix = np.zeros(shape)
    np.add.at(matrix, (np.asarray(rows, dtype=int), np.asarray(columns, dtype=int)), values)
    return matrix


def entries(matrix: Matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns and values of the nonzero entries."""
    if not isinstance(matrix, np.ndarray):
        matrix = matrix.tocoo()
        used = matrix.data != 0.0
        return matrix.row[used], matrix.col[used], matrix.data[used]
    rows, columns = np.nonzero(matrix)
    return rows, columns, matrix[rows, columns]


def _is_nonzero(matrix: Matrix) -> bool:
    """True if any entry is not zero."""
    return bool(np.count_nonzero(matrix) if isinstance(matrix, np.ndarray) else matrix.count_nonzero())


def _add(terms: dict[Monomial, Matrix], monomial: Monomial, matrix: Matrix) -> None:
    """Add a term to existing ones."""
    terms[monomial] = terms[monomial] + matrix if monomial in terms else matrix


def solve(matrix: Matrix, right: np.ndarray) -> np.ndarray:
    """Solution x of A x = right."""
    if right.dtype == object:  # no unknowns, which libraries reject
        return solve(matrix, np.eye(len(right))) @ right
    if isinstance(matrix, np.ndarray):
        return np.linalg.solve(matrix, right)
    from scipy.sparse.linalg import splu

    return splu(matrix.tocsc()).solve(right)


def as_array(matrix: Matrix) -> np.ndarray:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


@dataclass(frozen=True)
class Affine:
    """Sum over k of monomial_k(t) A_k, with constant matrices A_k of equal shape, sparse if large."""

    shape: tuple[int, int]
    terms: Mapping[Monomial, Matrix]

    @staticmethod
    def zero(rows: int, columns: int) -> Affine:
        return Affine((rows, columns), {})

    @staticmethod
    def constant(matrix: Matrix | list) -> Affine:
        return Affine.term((), matrix)

    @staticmethod
    def term(monomial: Iterable[str], matrix: Matrix | list) -> Affine:
        """Single term: a product of scalars times a matrix."""
        matrix = dense_if_small(matrix)
        return Affine(matrix.shape, {tuple(sorted(monomial)): matrix})

    def __add__(self, other: Affine) -> Affine:
        terms = dict(self.terms)
        for monomial, matrix in other.terms.items():
            _add(terms, monomial, matrix)
        return Affine(self.shape, terms)

    def __mul__(self, factor: float) -> Affine:
        return Affine(self.shape, {monomial: factor * matrix for monomial, matrix in self.terms.items()})

    __rmul__ = __mul__

    def __matmul__(self, other: Affine) -> Affine:
        terms: dict[Monomial, Matrix] = {}
        large = self.shape[0] * other.shape[1] > _FEW  # sparse for any factors
        for left, a in self.terms.items():
            a = sparse(a) if large else a
            for right, b in other.terms.items():
                ab = a @ (sparse(b) if large else b)
                if _is_nonzero(ab):
                    _add(terms, tuple(sorted(left + right)), ab)
        return Affine((self.shape[0], other.shape[1]), {monomial: dense_if_small(ab) for monomial, ab in terms.items()})

    @property
    def T(self) -> Affine:
        return Affine(self.shape[::-1], {monomial: dense_if_small(matrix.T) for monomial, matrix in self.terms.items()})

    @cached_property
    def rate(self) -> Affine:
        """Time derivative: c' = -omega s, s' = omega c, omega' = epsilon for each body, value' = rate and rate' = accel
        for quantities tabulated with their rates; constants stay constant."""
        terms: dict[Monomial, Matrix] = {}
        for monomial, matrix in self.terms.items():
            for k, name in enumerate(monomial):
                rest = monomial[:k] + monomial[k + 1 :]
                factor, names = _rate_of(name)
                _add(terms, tuple(sorted(rest + names)), factor * matrix)
        return Affine(self.shape, terms)

    def only(self, keep: Callable[[Monomial], bool]) -> Affine:
        """Terms whose monomial satisfies a condition."""
        return Affine(self.shape, {monomial: matrix for monomial, matrix in self.terms.items() if keep(monomial)})

    def fixed(self, constants: Mapping[str, float]) -> Affine:
        """Matrix with constant scalars replaced by their values; terms that vanish are omitted."""
        terms: dict[Monomial, Matrix] = {}
        for monomial, matrix in self.terms.items():
            factor = math.prod(constants[name] for name in monomial if name in constants)
            if factor and _is_nonzero(matrix):
                rest = tuple(name for name in monomial if name not in constants)
                _add(terms, rest, matrix if factor == 1.0 else factor * matrix)
        return Affine(self.shape, terms)

    def congruent(self, basis: Matrix) -> Affine:
        """Projection B^T A B with a constant basis B, term by term."""
        return Affine((basis.shape[1],) * 2, {m: dense_if_small(basis.T @ a @ basis) for m, a in self.terms.items()})

    def projected(self, basis: Matrix) -> Affine:
        """Projection B^T A with a constant basis B, term by term (a load in reduced coordinates)."""
        shape = (basis.shape[1], self.shape[1])
        return Affine(shape, {m: dense_if_small(basis.T @ a) for m, a in self.terms.items()})

    @cached_property
    def monomials(self) -> tuple[Monomial, ...]:
        return tuple(sorted(self.terms))

    def value(self, scalars: Mapping[str, float]) -> Matrix:
        """Value of the matrix for given scalars."""
        factors = (math.prod(sorted(scalars[name] for name in monomial)) for monomial in self.terms)
        parts = (float(factor) * matrix for factor, matrix in zip(factors, self.terms.values(), strict=True))
        return sum(parts, from_entries(self.shape, (), (), ()))

    def pattern(self) -> Matrix:
        """Sum of absolute values, nonzero where an entry can be nonzero at some time."""
        return sum(map(abs, self.terms.values()), from_entries(self.shape, (), (), ()))


def numbered_entries(affine: Affine, monomials: Sequence[Monomial]) -> Entries:
    """Entries of all terms, with the given numbering of monomials."""
    number = {monomial: k for k, monomial in enumerate(monomials)}
    none = np.zeros(0, dtype=int)
    found = [(none, none, np.zeros(0), none)]
    for monomial, matrix in affine.terms.items():
        rows, columns, values = entries(matrix)
        found.append((rows, columns, values, np.full(len(values), number[monomial])))
    return Entries(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def _rate_of(name: str) -> tuple[float, tuple[str, ...]]:
    body, _, kind = name.rpartition(".")
    if kind == "c":
        return -1.0, (f"{body}.omega", f"{body}.s")
    if kind == "s":
        return 1.0, (f"{body}.omega", f"{body}.c")
    if kind == "omega":
        return 1.0, (f"{body}.epsilon",)
    if kind in ("value", "rate"):  # quantities tabulated with their rates
        return 1.0, (f"{body}.{'rate' if kind == 'value' else 'accel'}",)
    raise ValueError(f"the rate of the scalar {name} is not a scalar of the motion")


_IN_CACHE = 1000
"""Rows of a table that are multiplied at once: more leave the processor's cache, and take ten times as long."""


@dataclass(frozen=True, eq=False)
class Products:
    """Monomials by the columns of their scalars in the motion's table."""

    places: Sequence[Sequence[int]]

    @classmethod
    def of(cls, monomials: Sequence[Monomial], column: Mapping[str, int]) -> Products:
        """Monomials of scalars that have a column in the motion's table."""
        return cls([sorted(column[name] for name in monomial) for monomial in monomials])

    @property
    def pattern(self) -> np.ndarray:
        """End of each monomial in the list of scalars, then this list, for compiled loops."""
        ends = np.cumsum([len(each) for each in self.places])
        return np.concatenate([ends, *self.places]).astype(np.uint64)

    def at(self, table: np.ndarray) -> np.ndarray:
        """Shape (n_times, n_monomials) from the motion's table, shape (n_times, n_scalars)."""
        out = np.ones((len(table), len(self.places)))
        for first in range(0, len(table), _IN_CACHE):
            rows = slice(first, first + _IN_CACHE)
            for product, scalars in zip(out[rows].T, self.places, strict=True):
                for scalar in scalars:
                    product *= table[rows, scalar]
        return out
