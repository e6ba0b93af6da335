"""Integrals of products of a spatial element's shape functions, which are numbers, and the module that holds them.

With s = x/length the functions of ``shapes.beam_shape`` over (v_1, l theta_1, v_2, l theta_2) are of the form
n + c bubble: n, Hermite's cubics, and the bubble, which vanishes at both nodes, are the same for every section, and

    c = (beta - 1) P + alpha Q,    beta = 1/(1 + phi),  alpha = (1 - beta) growth/6

alone knows of shear and of the growth of E I over the element, relative to its mean. So the integral over an element of
two functions' product with a power of s is a table of numbers, one row and one column more than the nodes have, and one
loop fills an element's matrix with it, whichever theory it is of. n, bubble, P and Q are found here, not typed in; the
module integrates them when it is imported.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from sympy import Expr, ImmutableMatrix, Poly, S, Symbol, cancel, diff

from kaneflex.derive.elements.shapes import E_I, E_I_rise, beam_section, beam_shape, beta_s, length, x
from kaneflex.derive.printers import module_text

s, growth = Symbol("s", real=True), Symbol("growth", real=True)

POWERS = {
    ("LINEAR", "LINEAR"): 2, ("LINEAR", "DEFLECTION"): 2, ("DEFLECTION", "DEFLECTION"): 2,
    ("LINEAR", "ROTATION"): 2, ("ROTATION", "ROTATION"): 2,
    ("CURVATURE", "CURVATURE"): 2, ("SLOPE", "SLOPE"): 4, ("GRADIENT", "GRADIENT"): 4, ("SHEAR", "SHEAR"): 1,
}  # fmt: skip
"""Functions whose products are integrated -> with how many powers of s, from 1 on."""
LOAD_POWERS = {"LINEAR": 3, "DEFLECTION": 3, "ROTATION": 2}
"""The same of functions alone."""


@dataclass(frozen=True)
class Family:
    """Shape functions over the nodes' coordinates as rows of polynomials in s, the bubble last.

    rows: LINEAR (1 at one node) and GRADIENT, its derivative by s; DEFLECTION v, SLOPE l v', ROTATION l theta,
    CURVATURE l^2 theta'. P, Q: rows of the bubble's size c.
    """

    rows: dict[str, tuple[Expr, ...]]
    P: tuple[Expr, ...]
    Q: tuple[Expr, ...]


@cache
def family() -> Family:
    """Polynomials that make up the planar element's shape functions."""
    shape = beam_shape(beam_section(varying=True), shear=True)
    strains = {name: row for name, row, _ in shape.strains}
    deflection = _scaled(shape.displacement[1, :], 0)
    c = deflection.applyfunc(lambda entry: entry.coeff(s, 3))
    P = c.subs({beta_s: 1, growth: 0})
    Q = ((c - beta_s * P) * 6 / (growth * (1 - beta_s))).applyfunc(cancel)
    assert not (P.free_symbols | Q.free_symbols), "the bubble's size is not beta P + alpha Q"
    c -= P
    shear = _scaled(strains["shear"], 1)
    assert (shear + P / 2 - growth * Q / 12).expand().is_zero_matrix, "the shear strain is not -1/2 (P - growth/6 Q)"
    rows = {"LINEAR": (1 - s, s, S.Zero), "GRADIENT": (-S.One, S.One, S.Zero)}
    rows["DEFLECTION"] = _apart(deflection, c)
    rows["SLOPE"] = _apart(_scaled(shape.slope, 1), c)
    rows["ROTATION"] = _apart(_scaled(shape.rotation, 1), c)
    rows["CURVATURE"] = _apart(_scaled(strains["bending"], 2), c)
    return Family(rows, tuple(P), tuple(Q))


def _scaled(row: ImmutableMatrix, power: int) -> ImmutableMatrix:
    """length^power times a row of the plane, by (v_1, l theta_1, v_2, l theta_2) and s."""
    units = (0, 1, 0, 1)
    entries = [row[k] * length ** (power - unit) for k, unit in zip((1, 2, 4, 5), units, strict=True)]
    return ImmutableMatrix([entries]).subs({x: s * length, E_I_rise: growth * E_I}).expand()


def _apart(row: ImmutableMatrix, c: ImmutableMatrix) -> tuple[Expr, ...]:
    """n and the bubble of row = n + c bubble."""
    bubble = cancel(diff(row[0], beta_s) / diff(c[0], beta_s))
    rest = (row - c * bubble).expand()
    assert not (rest.free_symbols | bubble.free_symbols) - {s}, "a shape function is not n + c bubble"
    return (*rest, bubble)


def shape_integrals_text() -> str:
    """The module of the functions, of the tables of their integrals and of the loops that read them."""
    shapes = {name: tuple(map(_coefficients, row)) for name, row in family().rows.items()}
    shapes["SHEAR"] = (*[(0,)] * 4, (1,))
    tables = [f"{left}_{right} = products({count}, '{left}', '{right}')" for (left, right), count in POWERS.items()]
    tables += [f"{name} = alone({count}, '{name}')" for name, count in LOAD_POWERS.items()]
    return module_text.module(
        "Integrals of products of a spatial element's shape functions",
        _ABOUT,
        [
            "# Rows and columns of an element's nodes: u, theta_x; v, theta_z; w, theta_y.",
            *(f"{rows} = np.array({nodes})" for rows, nodes in _ROWS.items()),
            "# What the loops take of functions that have no bubble.",
            "STRAIGHT = (0.0, 0.0, 1.0)",
            "# Of the bubble's size.",
            *(f"{name} = np.array({tuple(map(float, getattr(family(), name)))})" for name in "PQ"),
            module_text.literal("SHAPES", shapes, "functions by their polynomials in s, lowest powers first"),
            _INTEGRALS,
            *tables,
        ],
        [_LOOPS],
        before=["import numpy as np"],
    )


def _coefficients(polynomial: Expr) -> tuple[float, ...]:
    return tuple(int(c) if c.is_Integer else float(c) for c in reversed(Poly(polynomial, s).all_coeffs()))


_ROWS = {"U": (0, 6), "T": (3, 9), "V": (1, 5, 7, 11), "W": (2, 4, 8, 10)}

_ABOUT = (
    "Entry [k, i, j] of a table is int_0^1 s^k f_i g_j ds with s = x/length and the functions that it is named by:",
    "DEFLECTION v, SLOPE l v', ROTATION l theta, CURVATURE l^2 theta' over (v_1, l theta_1, v_2, l theta_2); LINEAR is",
    "1 at one node, GRADIENT its derivative. The last row and column are those of a bubble, whose size by the nodes is",
    "c = (beta - 1) P + alpha Q, 0 without shear: beta = 1/(1 + phi), alpha = (1 - beta) growth/6 with the flexibility",
    "in shear phi and the growth of E I over the element by its mean.",
)

_INTEGRALS = '''
def products(count, left, right):
    """The table of two functions' products, for so many powers of s."""
    rows, columns = SHAPES[left], SHAPES[right]
    return np.array([[[integral(k, f, g) for g in columns] for f in rows] for k in range(count)])


def alone(count, name):
    """The table of functions alone."""
    return np.array([[integral(k, f, (1,)) for f in SHAPES[name]] for k in range(count)])


def integral(k, f, g):
    """int_0^1 s^k f g ds, exact up to the division at last: 1 to 10 divide 2520."""
    powers = ((i + j + k + 1, a * b) for i, a in enumerate(f) for j, b in enumerate(g))
    return sum(2520 // power * number for power, number in powers) / 2520

'''

_LOOPS = '''@njit(forceinline=True, **OPTIONS)
def entry(table, k, i, j, m, n, r, c):
    """An entry of a table with the bubbles of its row and column, whose own are the last, m and n.

    r, c: (beta - 1, alpha, turn) of the functions that the rows and the columns belong to."""
    of_row = r[0] * P[i] + r[1] * Q[i]
    of_column = c[0] * P[j] + c[1] * Q[j]
    return table[k, i, j] + table[k, i, n] * of_column + of_row * (table[k, m, j] + table[k, m, n] * of_column)


@njit(forceinline=True, **OPTIONS)
def turned(i, r):
    """Every other coordinate is a rotation: turn is length for theta_z = v' and -length for theta_y = -w'."""
    return r[2] if i % 2 == 1 else 1.0


@njit(forceinline=True, **OPTIONS)
def fill_square(out, first, table, rows, r, f):
    """Store the sum of f[k] times table[k] at these rows of out and the same columns; not the first is added there."""
    m = rows.shape[0]
    for i in range(m):
        for j in range(m):
            value = 0.0
            for k in range(len(f)):
                value += f[k] * entry(table, k, i, j, m, m, r, r)
            value *= turned(i, r) * turned(j, r)
            out[rows[i], rows[j]] = value if first else out[rows[i], rows[j]] + value


@njit(forceinline=True, **OPTIONS)
def fill_both(out, first, table, rows, columns, r, c, f, g):
    """The same with f at these rows and columns of out, and transposed with g at their transposes."""
    m = rows.shape[0]
    n = columns.shape[0]
    for i in range(m):
        for j in range(n):
            value = 0.0
            transposed = 0.0
            for k in range(len(f)):
                integral = entry(table, k, i, j, m, n, r, c) * (turned(i, r) * turned(j, c))
                value += f[k] * integral
                transposed += g[k] * integral
            out[rows[i], columns[j]] = value if first else out[rows[i], columns[j]] + value
            out[columns[j], rows[i]] = transposed if first else out[columns[j], rows[i]] + transposed


@njit(forceinline=True, **OPTIONS)
def fill_load(out, first, table, rows, r, f):
    """The same of functions alone at these rows of out."""
    m = rows.shape[0]
    for i in range(m):
        value = 0.0
        for k in range(len(f)):
            value += f[k] * (table[k, i] + table[k, m] * (r[0] * P[i] + r[1] * Q[i]))
        value *= turned(i, r)
        out[rows[i]] = value if first else out[rows[i]] + value
'''
