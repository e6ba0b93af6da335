"""Compiled linear equations of a tree of bodies with further rows: loops, springs between bodies, laws of loads.

    (S + sum_r a_r b_r^T) x = r,   g_c . x = 0

with S = M + h C + h^2 K of the tree (:mod:`kaneflex.multibody.dynamics.articulated`). A row has a generalised force a
along all coordinates; a spring's b is h c a + h^2 k a, a load's the derivatives of its size. Constraints have a = b =
g. The responses of the tree to all a lead to as many equations as rows (Sherman, Morrison & Woodbury; Schur
complement).
"""

from __future__ import annotations

from numba import njit
from numba.types import CPointer, complex128, float64, int64

from kaneflex.multibody.compile.values import after
from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.dynamics.articulated import SPACE_PAIR, SPACE_REAL, factorise, solve
from kaneflex.multibody.model.layout import OPTIONS, Fixed, Handed, N, apart, together

HARD, LENT, ALL = range(3)
"""Numbers of rows at ``rows``: constraints, these with rows that remove virtual inertia, and all."""


def _with_rows(name: str, tree: Handed, dtype) -> Handed:
    """Type of factors with rows.

    a, damped, stiff (n_rows, n): force, and the vectors whose sum h damped + h^2 stiff is b, of rows behind LENT ones;
    b; given: accelerations; columns: responses to every a; square: factors of the rows' equations, and a right-hand
    side.
    """
    of = CPointer(dtype)
    return Handed(name, tree=tree, counts=Fixed(1), rows=CPointer(int64), a=N, damped=N, stiff=N, b=of, given=of,
                  columns=of, square=of, pivots=CPointer(int64))  # fmt: skip


REAL_ROWS = _with_rows("Factors with rows", SPACE_REAL, float64)
PAIR_ROWS = _with_rows("Complex factors with rows", SPACE_PAIR, complex128)


@njit(**OPTIONS)
def _product(free, b, y, n):
    """b . y over the coordinates that are free."""
    together()
    total = 0.0 * y[0]
    for s in range(n):
        if free[s] != 0:
            total += b[s] * y[s]
    return total


@njit(**OPTIONS)
def factorise_rows(f, h):
    """Factorise with the tree's matrices and the rows in place; False: a pivot vanishes."""
    apart()
    n, count, square = f.counts[0], f.rows[ALL], f.square
    if not factorise(f.tree):
        return False
    for r in range(count):
        a, b, column = after(f.a, n * r), after(f.b, n * r), after(f.columns, n * r)
        for s in range(n):
            f.tree.y[s] = a[s]
            if r < f.rows[HARD]:
                b[s] = a[s]
            elif r >= f.rows[LENT]:
                b[s] = h * (f.damped[n * r + s] + h * f.stiff[n * r + s])
        _solve_tree(f)
        for s in range(n):
            column[s] = f.tree.y[s]
    for q in range(count):
        for r in range(count):
            own = 1.0 if q == r and q >= f.rows[HARD] else 0.0
            square[count * q + r] = own + _product(f.tree.free, after(f.b, n * q), after(f.columns, n * r), n)
    return dense_lu.factorise(square, 0, count, f.pivots, 0)


@njit(**OPTIONS)
def _solve_tree(f):
    """Response of the tree alone to the forces at y."""
    tree = f.tree
    nothing = 0.0 * tree.y[0]
    for b in range(tree.counts[0]):
        tree.x[b] = nothing, nothing, nothing, nothing, nothing, nothing
    solve(tree)


@njit(**OPTIONS)
def solve_rows(f):
    """Solve with the factors: from forces at the tree's y, the answers in place."""
    apart()
    n, count, y, z = f.counts[0], f.rows[ALL], f.tree.y, after(f.square, f.rows[ALL] ** 2)
    _solve_tree(f)
    for q in range(count):
        z[q] = _product(f.tree.free, after(f.b, n * q), y, n)
    dense_lu.substitute(f.square, 0, count, f.pivots, 0, count * count)
    for r in range(count):
        column, share = after(f.columns, n * r), z[r]
        for s in range(n):
            y[s] -= share * column[s]
