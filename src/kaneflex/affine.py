"""Matrices that are sums of (product of motion scalars) x (constant matrix).

In link axes every elastic matrix has this form, and the rotation of a joint's displacements into global axes
keeps it: cos and sin of a body's angle are scalars like the others. Products and time derivatives of such
sums are again such sums, so the assembly can be written as the formula that it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

Monomial = tuple[str, ...]
"""Sorted names of scalars, repeated for powers: ("rod.c", "rod.omega", "rod.omega") is c omega^2."""


@dataclass(frozen=True)
class Affine:
    """sum_k monomial_k(t) A_k with constant sparse matrices A_k of one shape."""

    shape: tuple[int, int]
    terms: Mapping[Monomial, csr_array]

    @staticmethod
    def zero(rows: int, columns: int) -> Affine:
        return Affine((rows, columns), {})

    @staticmethod
    def constant(matrix: csr_array | np.ndarray) -> Affine:
        return Affine.term((), matrix)

    @staticmethod
    def term(monomial: Iterable[str], matrix: csr_array | np.ndarray) -> Affine:
        """One scalar (product) times a matrix."""
        matrix = csr_array(np.asarray(matrix) if isinstance(matrix, list) else matrix)
        return Affine(matrix.shape, {tuple(sorted(monomial)): matrix})

    def __add__(self, other: Affine) -> Affine:
        terms = dict(self.terms)
        for monomial, matrix in other.terms.items():
            terms[monomial] = terms[monomial] + matrix if monomial in terms else matrix
        return Affine(self.shape, terms)

    def __mul__(self, factor: float) -> Affine:
        return Affine(self.shape, {monomial: factor * matrix for monomial, matrix in self.terms.items()})

    __rmul__ = __mul__

    def __matmul__(self, other: Affine) -> Affine:
        product = Affine.zero(self.shape[0], other.shape[1])
        for left, a in self.terms.items():
            for right, b in other.terms.items():
                ab = a @ b
                if ab.count_nonzero():
                    product += Affine.term(left + right, ab)
        return product

    @property
    def T(self) -> Affine:
        return Affine(self.shape[::-1], {monomial: matrix.T.tocsr() for monomial, matrix in self.terms.items()})

    def rate(self) -> Affine:
        """Time derivative: c' = -omega s, s' = omega c, omega' = epsilon of each body; constants stay constant."""
        total = Affine.zero(*self.shape)
        for monomial, matrix in self.terms.items():
            for k, name in enumerate(monomial):
                rest = monomial[:k] + monomial[k + 1 :]
                factor, names = _rate_of(name)
                total += Affine.term(rest + names, factor * matrix)
        return total

    def only(self, keep: Callable[[Monomial], bool]) -> Affine:
        """The terms whose monomial is kept."""
        return Affine(self.shape, {monomial: matrix for monomial, matrix in self.terms.items() if keep(monomial)})

    def congruent(self, basis: np.ndarray | csr_array) -> Affine:
        """B^T A B for a constant basis B, term by term."""
        return Affine((basis.shape[1],) * 2, {m: csr_array(basis.T @ a @ basis) for m, a in self.terms.items()})

    def projected(self, basis: np.ndarray | csr_array) -> Affine:
        """B^T A for a constant basis B, term by term (a load in reduced coordinates)."""
        shape = (basis.shape[1], self.shape[1])
        return Affine(shape, {m: csr_array(basis.T @ a) for m, a in self.terms.items()})

    @cached_property
    def monomials(self) -> tuple[Monomial, ...]:
        return tuple(sorted(self.terms))

    def at(self, scalars: Mapping[str, float]) -> csr_array:
        """The matrix for given values of the scalars."""
        total = csr_array(self.shape)
        for monomial, matrix in self.terms.items():
            total = total + float(np.prod([scalars[name] for name in monomial])) * matrix
        return csr_array(total)

    def pattern(self) -> csr_array:
        """Sum of absolute values: where an entry can be non-zero at some time."""
        total = csr_array(self.shape)
        for matrix in self.terms.values():
            total = total + abs(matrix)
        return csr_array(total)


def _rate_of(name: str) -> tuple[float, tuple[str, ...]]:
    body, _, kind = name.rpartition(".")
    if kind == "c":
        return -1.0, (f"{body}.omega", f"{body}.s")
    if kind == "s":
        return 1.0, (f"{body}.omega", f"{body}.c")
    if kind == "omega":
        return 1.0, (f"{body}.epsilon",)
    raise ValueError(f"the rate of the scalar {name} is not a scalar of the motion")
