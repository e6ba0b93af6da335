"""Articulated factorisation of trees of bodies with shapes against dense matrices, in the plane and in space."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from numba import njit
from numba.types import CPointer, boolean, complex128, float64

from kaneflex.multibody.compile.library import entered
from kaneflex.multibody.compile.types import ENTRY, OUTER, Fixed, Handed
from kaneflex.multibody.compile.values import Vectors
from kaneflex.multibody.dynamics import articulated
from kaneflex.multibody.model.layout import Handle


def factors(dtype, d: int) -> Handed:
    """Type of the record of a tree's arrays."""
    of, real, numbers = Vectors(dtype, d), Vectors(float64, d), CPointer(dtype)
    return Handed(f"Factors of {dtype} in {d}", counts=Fixed(1), bodies=Fixed(8), free=Fixed(1), I=of, E=of, L=numbers,
                  U=of, D=numbers, S=real, phi=real, place=Vectors(float64, 3), arm=Vectors(float64, 3), x=of,
                  y=numbers, room=of)  # fmt: skip


KINDS = {(d, of): factors(kind, d) for d in (3, 6) for of, kind in ((float, float64), (complex, complex128))}
PARENTS, SHAPES, FREEDOMS = (-1, 0, 0, 2, -1), (2, 0, 3, 1, 2), (1, 2, 3, 1, 3)
OUTBOARD = (False, True, False, True, False)
"""Five bodies: a branch, one without shapes, one on its parent's axes instead of a section that deforms, two roots."""


@njit(**ENTRY)
def _solve(a):
    return articulated.factorise(a) and articulated.solve(a) is None


def _shift(d: int, r: np.ndarray) -> np.ndarray:
    """Matrix (d, d) from a twist to that of the point r from there."""
    X = np.eye(d)
    if d == 3:
        X[:2, 2] = -r[1], r[0]
    else:
        x, y, z = r
        X[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return X


class _Tree:
    """Random tree with the arrays of its factors, and the dense matrix of all coordinates."""

    def __init__(self, d: int, dtype: type, locked: tuple[int, ...] = ()) -> None:
        rng, count = np.random.default_rng(5), len(PARENTS)
        sizes = [f + n for f, n in zip(FREEDOMS, SHAPES, strict=True)]
        first = np.cumsum([0, *sizes])
        self.n, self.d, self.dtype = int(first[-1]), d, dtype
        modal = [int(first[b]) + FREEDOMS[b] for b in range(count)]
        coupling, square = np.cumsum([0, *SHAPES]), np.cumsum([0, *(n * n for n in SHAPES)])
        rows = [SHAPES[up] if out else 0 for up, out in zip(PARENTS, OUTBOARD, strict=True)]
        phi_at = np.cumsum([0, *rows])
        self.bodies = np.array([
            [SHAPES[b], FREEDOMS[b], first[b], modal[b], PARENTS[b], phi_at[b] if OUTBOARD[b] else -1, coupling[b],
             square[b]] for b in range(count)
        ])  # fmt: skip
        self.S, self.phi = rng.normal(size=(self.n, d)), rng.normal(size=(int(phi_at[-1]), d))
        self.place, self.arm = rng.normal(size=(2, count, 3))
        self.free = np.ones(self.n, np.int64)
        self.free[list(locked)] = 0
        self.own = rng.uniform(0.5, 1.0, self.n)  # of the joints' coordinates
        self.I, self.E, self.L, self.J = [], [], [], []
        for b in range(count):
            A = rng.normal(size=(2, d + SHAPES[b], d + SHAPES[b]))
            whole = A[0] @ A[0].T + np.eye(len(A[0]))
            if dtype is complex:
                whole = whole + 0.1j * (A[1] + A[1].T)
            self.I.append(whole[:d, :d])
            self.E.append(whole[d:, :d])
            self.L.append(whole[d:, d:])
            J, up = np.zeros((d, self.n)), PARENTS[b]
            if up >= 0:
                J = _shift(d, self.place[b]) @ self.J[up]
                for j in range(rows[b]):
                    J[:, modal[up] + j] += self.phi[phi_at[b] + j]
                J = _shift(d, self.arm[b]) @ J
            for j in range(FREEDOMS[b]):
                J[:, first[b] + j] += self.S[first[b] + j]
            self.J.append(J)
        self.modal = modal

    def dense(self) -> np.ndarray:
        A = np.zeros((self.n, self.n), self.dtype)
        for b, J in enumerate(self.J):
            own = slice(self.modal[b], self.modal[b] + SHAPES[b])
            A += J.T @ self.I[b] @ J
            A[own] += self.E[b] @ J
            A[:, own] += (self.E[b] @ J).T
            A[own, own] += self.L[b]
        joints = np.setdiff1d(np.arange(self.n), [m + j for m, n in zip(self.modal, SHAPES, strict=True)
                                                  for j in range(n)])  # fmt: skip
        A[joints, joints] += self.own[joints]
        return A

    def solve(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates of bodies and coordinates for forces on both, by the compiled recursion."""
        x, y, count = x.astype(self.dtype), y.astype(self.dtype), len(PARENTS)
        I, E = (np.concatenate(part).astype(self.dtype) for part in (self.I, self.E))
        L = np.concatenate([np.ravel(part) for part in self.L]).astype(self.dtype)
        handle = Handle(
            np.array([count]), self.bodies, self.free, I, E, L, np.zeros((self.n, self.d), self.dtype),
            self.own.astype(self.dtype), self.S, self.phi, self.place, self.arm, x, y,
            np.zeros((max(SHAPES), self.d), self.dtype),
        )  # fmt: skip
        kind = KINDS[self.d, self.dtype]
        read = entered({_solve: boolean(kind)})

        @njit(**OUTER)
        def addresses():
            return read()

        assert ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p)(*addresses())(handle.address)
        return x, y


@pytest.mark.exhaustive(share=4)
@pytest.mark.parametrize(("d", "dtype"), [*KINDS][::-1])  # every run solves in real numbers
def test_solution_is_that_of_the_dense_matrix(d, dtype):
    tree, rng = _Tree(d, dtype, locked=(3, 5)), np.random.default_rng(7)
    forces, along = rng.normal(size=(len(PARENTS), d)), rng.normal(size=tree.n)
    twists, rates = tree.solve(forces, along)
    A, free = tree.dense(), tree.free == 1
    asked = along + sum(J.T @ f for J, f in zip(tree.J, forces, strict=True))
    expected = np.zeros(tree.n, dtype)
    expected[free] = np.linalg.solve(A[np.ix_(free, free)], asked[free])
    assert abs(rates[free] - expected[free]).max() < 1e-12 * abs(expected).max()
    taken = A[~free] @ expected - asked[~free]  # by drives of the coordinates that are not free
    assert abs(rates[~free] - taken).max() < 1e-12 * abs(taken).max()
    assert abs(twists - [J @ expected for J in tree.J]).max() < 1e-12 * abs(twists).max()
