"""Matrices that are sums of (product of motion scalars) x (constant matrix).

In link axes every elastic matrix has this form, and the rotation of a joint's displacements into global axes
keeps it: cos and sin of a body's angle are scalars like the others. Products and time derivatives of such
sums are again such sums, so the assembly can be written as the formula that it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from kaneflex.support.sparse_rows import SparseRows

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from scipy.sparse import csr_array

Monomial = tuple[str, ...]
"""Sorted names of scalars, repeated for powers: ("rod.c", "rod.omega", "rod.omega") is c omega^2."""

Matrix: TypeAlias = "np.ndarray | csr_array"
_FEW = 10_000
"""Entries up to which a matrix is kept as an array: an operation on a sparse one costs what thousands of entries do."""


def kept(matrix: Matrix | list) -> Matrix:
    """The matrix as an array if it is small, else sparse."""
    if hasattr(matrix, "toarray"):
        return matrix.toarray() if matrix.shape[0] * matrix.shape[1] <= _FEW else sparse(matrix)
    matrix = np.asarray(matrix, dtype=float)
    return matrix if matrix.size <= _FEW else sparse(matrix)


def sparse(matrix: Matrix) -> csr_array:
    """The matrix by rows, whatever its size."""
    from scipy.sparse import csr_array  # 0.2 s: only where a matrix is large

    return csr_array(matrix)


def from_entries(shape: tuple[int, int], rows: ArrayLike, columns: ArrayLike, values: ArrayLike) -> Matrix:
    """The matrix with these entries, of which those at one place are added up: an array if it is small, else sparse."""
    if shape[0] * shape[1] > _FEW:
        from scipy.sparse import coo_array

        return sparse(coo_array((np.ravel(values), (np.ravel(rows), np.ravel(columns))), shape=shape))
    matrix = np.zeros(shape)
    np.add.at(matrix, (np.asarray(rows, dtype=int), np.asarray(columns, dtype=int)), values)
    return matrix


def entries(matrix: Matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns and values of what is not zero."""
    if not isinstance(matrix, np.ndarray):
        matrix = matrix.tocoo()
        used = matrix.data != 0.0
        return matrix.row[used], matrix.col[used], matrix.data[used]
    rows, columns = np.nonzero(matrix)
    return rows, columns, matrix[rows, columns]


def _is_there(matrix: Matrix) -> bool:
    """Whether an entry is not zero."""
    return bool(np.count_nonzero(matrix) if isinstance(matrix, np.ndarray) else matrix.count_nonzero())


def _add(terms: dict[Monomial, Matrix], monomial: Monomial, matrix: Matrix) -> None:
    """Add a term to those that there are."""
    terms[monomial] = terms[monomial] + matrix if monomial in terms else matrix


def solve(matrix: Matrix, right: np.ndarray) -> np.ndarray:
    """x of A x = right."""
    if right.dtype == object:  # unknowns, which no library solves for
        return solve(matrix, np.eye(len(right))) @ right
    if isinstance(matrix, np.ndarray):
        return np.linalg.solve(matrix, right)
    from scipy.sparse.linalg import splu

    return splu(matrix.tocsc()).solve(right)


def _nothing(shape: tuple[int, int]) -> Matrix:
    return np.zeros(shape) if shape[0] * shape[1] <= _FEW else from_entries(shape, (), (), ())


def as_array(matrix: Matrix) -> np.ndarray:
    return matrix if isinstance(matrix, np.ndarray) else matrix.toarray()


@dataclass(frozen=True)
class Affine:
    """sum_k monomial_k(t) A_k with constant matrices A_k of one shape, sparse where they are large."""

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
        """One scalar (product) times a matrix."""
        matrix = kept(matrix)
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
        large = self.shape[0] * other.shape[1] > _FEW  # of which few entries are not zero, whatever the factors are
        for left, a in self.terms.items():
            a = sparse(a) if large else a
            for right, b in other.terms.items():
                ab = a @ (sparse(b) if large else b)
                if _is_there(ab):
                    _add(terms, tuple(sorted(left + right)), ab)
        return Affine((self.shape[0], other.shape[1]), {monomial: kept(ab) for monomial, ab in terms.items()})

    @property
    def T(self) -> Affine:
        return Affine(self.shape[::-1], {monomial: kept(matrix.T) for monomial, matrix in self.terms.items()})

    @cached_property
    def rate(self) -> Affine:
        """Time derivative: c' = -omega s, s' = omega c, omega' = epsilon of each body, value' = rate and rate' = accel
        of what is tabulated with its rates; constants stay constant."""
        terms: dict[Monomial, Matrix] = {}
        for monomial, matrix in self.terms.items():
            for k, name in enumerate(monomial):
                rest = monomial[:k] + monomial[k + 1 :]
                factor, names = _rate_of(name)
                _add(terms, tuple(sorted(rest + names)), factor * matrix)
        return Affine(self.shape, terms)

    def only(self, keep: Callable[[Monomial], bool]) -> Affine:
        """The terms whose monomial is kept."""
        return Affine(self.shape, {monomial: matrix for monomial, matrix in self.terms.items() if keep(monomial)})

    def fixed(self, constants: Mapping[str, float]) -> Affine:
        """The same with its constant scalars at their values; what is then zero by structure is left out."""
        terms: dict[Monomial, Matrix] = {}
        for monomial, matrix in self.terms.items():
            factor = math.prod(constants[name] for name in monomial if name in constants)
            if factor and _is_there(matrix):
                rest = tuple(name for name in monomial if name not in constants)
                _add(terms, rest, matrix if factor == 1.0 else factor * matrix)
        return Affine(self.shape, terms)

    def congruent(self, basis: Matrix) -> Affine:
        """B^T A B for a constant basis B, term by term."""
        return Affine((basis.shape[1],) * 2, {m: kept(basis.T @ a @ basis) for m, a in self.terms.items()})

    def projected(self, basis: Matrix) -> Affine:
        """B^T A for a constant basis B, term by term (a load in reduced coordinates)."""
        shape = (basis.shape[1], self.shape[1])
        return Affine(shape, {m: kept(basis.T @ a) for m, a in self.terms.items()})

    @cached_property
    def monomials(self) -> tuple[Monomial, ...]:
        return tuple(sorted(self.terms))

    def value(self, scalars: Mapping[str, float]) -> Matrix:
        """The matrix for given values of the scalars."""
        factors = (math.prod(sorted(scalars[name] for name in monomial)) for monomial in self.terms)
        parts = (float(factor) * matrix for factor, matrix in zip(factors, self.terms.values(), strict=True))
        return sum(parts, _nothing(self.shape))

    def pattern(self) -> Matrix:
        """Sum of absolute values: where an entry can be non-zero at some time."""
        return sum(map(abs, self.terms.values()), _nothing(self.shape))


class Entries(NamedTuple):
    """What is not zero in the terms of an :class:`Affine`: row, column, value, and the number of its monomial."""

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    monomials: np.ndarray


def numbered_entries(affine: Affine, monomials: Sequence[Monomial]) -> Entries:
    """The entries of all terms; their monomials are numbered as given."""
    number = {monomial: k for k, monomial in enumerate(monomials)}
    none = np.zeros(0, dtype=int)
    found = [(none, none, np.zeros(0), none)]
    for monomial, matrix in affine.terms.items():
        rows, columns, values = entries(matrix)
        found.append((rows, columns, values, np.full(len(values), number[monomial])))
    return Entries(*(np.concatenate(parts) for parts in zip(*found, strict=True)))


def coefficients(slot: np.ndarray, found: Entries, shape: tuple[int, int]) -> SparseRows:
    """Entries by their slots (slots x monomials): its product with the monomials' values is what the slots hold."""
    order = np.lexsort((found.monomials, slot))
    ends = np.cumsum(np.bincount(slot, minlength=shape[0]))
    return SparseRows(found.values[order], found.monomials[order], np.append(0, ends), shape)


def _rate_of(name: str) -> tuple[float, tuple[str, ...]]:
    body, _, kind = name.rpartition(".")
    if kind == "c":
        return -1.0, (f"{body}.omega", f"{body}.s")
    if kind == "s":
        return 1.0, (f"{body}.omega", f"{body}.c")
    if kind == "omega":
        return 1.0, (f"{body}.epsilon",)
    if kind in ("value", "rate"):  # of what is tabulated with its rates
        return 1.0, (f"{body}.{'rate' if kind == 'value' else 'accel'}",)
    raise ValueError(f"the rate of the scalar {name} is not a scalar of the motion")
