"""Symbolic solution of sparse linear systems, block by block.

The constraint equations of a mechanism are sparse: sorted into block-triangular form they fall into blocks
of one or two unknowns. Each block is solved by Cramer's rule, so that the only divisors are the blocks'
determinants, whose product is the determinant of the whole system: nothing is divided by that can vanish
where the mechanism itself is regular (a symbolic LU divides by sin(q)/sin(q) at a dead centre).
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sm
from sympy.utilities.iterables import strongly_connected_components

from kaneflex.derive.ir.program import Steps


class StructurallySingular(ValueError):
    """The equations can't determine the unknowns, whatever the numbers: names both sides of the mismatch."""

    def __init__(self, spare_equations: Sequence[str], open_unknowns: Sequence[str]):
        self.spare_equations = tuple(spare_equations)
        self.open_unknowns = tuple(open_unknowns)
        groups = {"nothing determines": self.open_unknowns, "redundant:": self.spare_equations}
        found = "; ".join(f"{words} {', '.join(names)}" for words, names in groups.items() if names)
        super().__init__(f"structurally singular: {found}")


def solve_blocks(
    equations: Sequence[tuple[str, sm.Expr]], unknowns: Sequence[sm.Symbol], steps: Steps
) -> dict[sm.Symbol, sm.Expr]:
    """Solve ``equations == 0``, linear in the unknowns, and record the solution as steps.

    Parameters
    ----------
    equations : sequence of (name, Expr)
        Names are for error messages only.
    unknowns : sequence of Symbol
        As many as there are equations; each becomes a step of the same name.
    steps : Steps
        Where the assignments go.

    Returns
    -------
    dict
        Unknown -> its symbol, or the number or symbol that it turned out to be.

    Raises
    ------
    StructurallySingular
        If no pairing of equations with unknowns exists.
    """
    coefficients = [[equation.diff(unknown) for unknown in unknowns] for _, equation in equations]
    values: dict[sm.Symbol, sm.Expr] = {}
    for rows, columns in _block_order(equations, unknowns, coefficients):
        block = [unknowns[j] for j in columns]
        matrix = sm.Matrix([[coefficients[i][j].xreplace(values) for j in columns] for i in rows])
        absent = dict.fromkeys(block, sm.S.Zero)
        known = sm.Matrix([-equations[i][1].xreplace(values).xreplace(absent) for i in rows])
        solve = _cramer if len(block) <= _LARGEST else _eliminate
        values |= solve(matrix, known, block, steps)
    return values


_LARGEST = 6
"""Unknowns of a dyad's block, the most that determinants are written out for at once."""


def _eliminate(matrix: sm.Matrix, known: sm.Matrix, block: list[sm.Symbol], steps: Steps) -> dict[sm.Symbol, sm.Expr]:
    """Gauss's elimination by entries that are 1 or -1, which needs no division; determinants for what is left.

    The pivot is the one that fills in least (Markowitz 1957): most rows of joints say that two points move alike.
    """
    matrix, known = matrix.as_mutable(), known.as_mutable()
    rows, columns = list(range(len(block))), list(range(len(block)))
    order: list[tuple[int, int]] = []
    while len(columns) > 1:
        filled = {i: [j for j in columns if matrix[i, j] != 0] for i in rows}
        uses = {j: [i for i in rows if matrix[i, j] != 0] for j in columns}
        pivots = [(i, j) for i in rows for j in filled[i] if matrix[i, j] in (1, -1)]
        if not pivots:
            break
        i, j = min(pivots, key=lambda at: ((len(filled[at[0]]) - 1) * (len(uses[at[1]]) - 1), at))
        for other in uses[j]:
            if other == i:
                continue
            factor = matrix[other, j] * matrix[i, j]
            for column in filled[i]:
                entry = sm.S.Zero if column == j else matrix[other, column] - factor * matrix[i, column]
                matrix[other, column] = steps.assign(f"{block[j]}_row_{other}_{column}", entry)
            rest = known[other] - factor * known[i]
            known[other] = steps.assign(f"{block[j]}_known_{other}", rest)
        order.append((i, j))
        rows.remove(i)
        columns.remove(j)
    left = matrix.extract(rows, columns)
    values = _cramer(left, known.extract(rows, [0]), [block[j] for j in columns], steps)
    for i, j in reversed(order):
        rest = sum(matrix[i, c] * values[block[c]] for c in range(len(block)) if c != j and block[c] in values)
        values[block[j]] = steps.assign(block[j], (known[i] - rest) * matrix[i, j])
    return values


def _cramer(matrix: sm.Matrix, known: sm.Matrix, block: list[sm.Symbol], steps: Steps) -> dict[sm.Symbol, sm.Expr]:
    if len(block) == 1:
        return {block[0]: steps.assign(block[0], known[0] / matrix[0, 0])}
    inverse = steps.assign(f"inverse_det_{block[0]}", 1 / determinant(matrix))
    values = {}
    for k, unknown in enumerate(block):
        replaced = matrix.copy()
        replaced[:, k] = known
        values[unknown] = steps.assign(unknown, determinant(replaced) * inverse)
    return values


def determinant(matrix: sm.Matrix) -> sm.Expr:
    """Laplace expansion along the sparsest row: no division, and cheap for the small sparse blocks met here."""
    size = matrix.shape[0]
    if size == 1:
        return matrix[0, 0]
    row = min(range(size), key=lambda i: sum(matrix[i, j] != 0 for j in range(size)))
    total = sm.S.Zero
    for j in range(size):
        if matrix[row, j] != 0:
            total += (-1) ** (row + j) * matrix[row, j] * determinant(matrix.minor_submatrix(row, j))
    return total


def _block_order(equations, unknowns, coefficients) -> list[tuple[list[int], list[int]]]:
    """Rows and columns of the diagonal blocks, in an order in which they can be solved (Dulmage & Mendelsohn 1958)."""
    contains = [[j for j, entry in enumerate(row) if entry != 0] for row in coefficients]
    match = _matching(contains)
    if len(equations) != len(unknowns) or len(match) < len(unknowns):
        raise StructurallySingular(
            [name for i, (name, _) in enumerate(equations) if i not in match.values()],
            [str(unknown) for j, unknown in enumerate(unknowns) if j not in match],
        )
    # Equation i needs equation k if it contains the unknown that k determines.
    rows = range(len(equations))
    needs = [(i, match[j]) for i in rows for j in contains[i]]
    determined = {i: j for j, i in match.items()}
    blocks = [sorted(block) for block in strongly_connected_components((list(rows), needs))]
    return [(block, [determined[i] for i in block]) for block in blocks]


def _matching(contains: list[list[int]]) -> dict[int, int]:
    """Largest pairing unknown -> equation, by augmenting paths (Kuhn 1955)."""
    match: dict[int, int] = {}

    def pair(i: int, tried: set[int]) -> bool:
        for j in contains[i]:
            if j not in tried:
                tried.add(j)
                if j not in match or pair(match[j], tried):
                    match[j] = i
                    return True
        return False

    for i in range(len(contains)):
        pair(i, set())
    return match
