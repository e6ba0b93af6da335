"""Small linear complementarity problems for forces or impulses of several rigid contacts with Coulomb friction.

u = W x + b: u are rates of gaps, then of slips, or their accelerations, and x impulses or forces. For gaps x >= 0, u >=
0 and x . u = 0. For slips |x| <= L, and x = -L sgn(u) if u is not zero (Coulomb); L is mu times the gap's x, plus a
constant. With x = y - z for a slip, both nonnegative, and its speed s, this is

    W x + b >= 0,  s + (W x + b) >= 0 by y,  s - (W x + b) >= 0 by z,  L - y - z >= 0 by s

(Stewart & Trinkle 1996, Int. J. Numer. Methods Eng. 39, 2673). For impulses Lemke's method always finds a solution,
unless restitution exceeds what a wedge allows (Anitescu & Potra 1997, Nonlinear Dyn. 14, 231); for forces there may be
none. Lemke 1965, Manage. Sci. 11, 681; ties are broken lexicographically, which guarantees termination (Cottle, Pang &
Stone 1992, The Linear Complementarity Problem, ch. 4). If W is singular, for example with redundant contacts, x is one
of many solutions, but the u of gaps is unique.

Lemke's covering vector is that of rows scaled to a unit diagonal, so that units don't affect the path. If it finds no
solution, all combinations of modes are tried, each a system of linear equations: a gap is open or closed, a slip sticks
or slips in one direction. Thus two independent methods must fail. Beyond MOST_CHOICES combinations Lemke's method alone
decides.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.dynamics import dense_lu
from kaneflex.multibody.compile.types import OPTIONS, apart, larger
from kaneflex.multibody.model.codes import BESIDE, MAY, PRESSES, RATIO, SCALES, TRIED, VECTORS, WANTED
from kaneflex.multibody.model.layout import ACTS, COMPLEMENT, CONTACTS, DRIVES, HOLDS, TOUCHING, VIRTUAL

_NOTHING = 1e-13
"""Share of the largest b below which a negative u counts as zero."""
_FLAT = 1e-9
"""Remaining share of a row below which it is dependent."""
_TIE = 1e-12
"""Difference of ratios that counts as a tie."""
_ASTRAY = 1e-9
"""Share of the largest b below which a negative u is accepted as rounding without a pivot."""
MOST_CHOICES = 7776
"""Largest number of tried mode combinations: 2 per gap and 3 per slip, so those of five contacts with friction."""


@njit(**OPTIONS)
def most(m):
    """Largest number of rows."""
    return m.plan[ACTS] - m.plan[CONTACTS] + m.plan[DRIVES] - m.plan[HOLDS]


@njit(**OPTIONS)
def vector(m, which):
    """Place of one of the vectors; W is at COMPLEMENT."""
    return m.plan[COMPLEMENT] + most(m) * (most(m) + which)


@njit(**OPTIONS)
def listed(m):
    """Place of the indices of the rows' contacts and frictions among whole numbers; workspace of three times the size
    follows."""
    return m.plan[TOUCHING] + m.plan[VIRTUAL] + most(m)


@njit(**OPTIONS)
def moved(m, i, x, rows):
    """Rate of a row by forces x, W x, and the sum of the sizes of its terms."""
    total = size = 0.0
    for j in range(rows):
        term = m.w[m.plan[COMPLEMENT] + rows * i + j] * m.w[x + j]
        total += term
        size += abs(term)
    return total, size


@njit(**OPTIONS)
def complement(m, x, u, gaps, slips):
    """Solve for the vectors x and u; rows with MAY = 0 keep x = 0. False: no solution."""
    apart()
    w, rows, size, x, u = m.w, gaps + slips, gaps + 3 * slips, vector(m, x), vector(m, u)
    largest = _scale(m, gaps, rows)
    asked = _fill(m, gaps, rows, largest)
    found = not asked or _lemke(m, size)
    for i in range(rows):
        w[x + i] = 0.0
    if not found and not _by_modes(m, x, gaps, slips, largest):
        return False
    end, basis = vector(m, VECTORS) + 2 * size + 1, listed(m) + most(m)
    for i in range(size if asked and found else 0):
        k = m.pivots[basis + i] - size
        if 0 <= k < size:
            row, sign = _row(k, gaps)
            w[x + row] += sign * largest * w[vector(m, SCALES) + row] * w[end + (2 * size + 2) * i]
    for i in range(rows):
        w[u + i] = w[vector(m, WANTED) + i] + moved(m, i, x, rows)[0]
    return True


@njit(**OPTIONS)
def _row(k, gaps):
    """Row of an unknown of the problem, and its sign; 0 for a slip's speed."""
    if k < gaps:
        return k, 1.0
    kind = (k - gaps) % 3
    return gaps + (k - gaps) // 3, 1.0 if kind == 0 else -1.0 if kind == 1 else 0.0


@njit(**OPTIONS)
def _scale(m, gaps, rows):
    """Find the scales of the rows; returns the scale of b. All are powers of two, which are exact."""
    w, scales, largest = m.w, vector(m, SCALES), 0.0
    for i in range(rows):
        own = abs(w[m.plan[COMPLEMENT] + (rows + 1) * i])
        w[scales + i] = math.ldexp(1.0, -math.frexp(own)[1] // 2) if own > 1e-300 else 1.0
        if w[vector(m, MAY) + i] != 0.0:
            largest = larger(largest, abs(_wanted(m, i)))
            if i >= gaps:
                largest = larger(largest, _limit(m, i)[0])
    return math.ldexp(1.0, math.frexp(largest)[1])


@njit(**OPTIONS)
def _entry(m, i, j, rows):
    """Scaled entry of W, with diagonal about 1."""
    scales = vector(m, SCALES)
    return m.w[m.plan[COMPLEMENT] + rows * i + j] * m.w[scales + i] * m.w[scales + j]


@njit(**OPTIONS)
def _wanted(m, i):
    """Scaled entry of b."""
    return m.w[vector(m, WANTED) + i] * m.w[vector(m, SCALES) + i]


@njit(**OPTIONS)
def _limit(m, i):
    """Bound of a slip's x, scaled: a constant, and the ratio to its normal force."""
    w, scales, n = m.w, vector(m, SCALES), int(m.w[vector(m, PRESSES) + i])
    beside = w[vector(m, BESIDE) + i] / w[scales + i]
    if n < 0 or w[vector(m, MAY) + n] == 0.0:
        return beside, 0.0
    return beside, w[vector(m, RATIO) + i] * w[scales + n] / w[scales + i]


@njit(**OPTIONS)
def _cover(m, i, rows):
    """Entry of Lemke's covering vector, 1 for a unit diagonal of W."""
    own = abs(_entry(m, i, i, rows))
    return math.sqrt(own) if own > 1e-300 else 0.7


@njit(**OPTIONS)
def _fill(m, gaps, rows, largest):
    """Tableau of z >= 0, M z + q >= 0; True if z = 0 is not a solution. ``largest``: scale of q."""
    apart()
    w, size, cover, asked = m.w, 3 * rows - 2 * gaps, 0.0, False
    wide = 2 * size + 2
    for i in range(rows):
        cover = larger(cover, _cover(m, i, rows))
    for k in range(size):
        i, sign = _row(k, gaps)
        T = vector(m, VECTORS) + wide * k
        for j in range(wide):
            w[T + j] = 0.0
        m.pivots[listed(m) + most(m) + k] = k
        own = -_cover(m, i, rows) / cover
        w[T + k], w[T + 2 * size] = 1.0, own if sign != 0.0 else 1.0 / own
        if w[vector(m, MAY) + i] == 0.0:
            w[T + wide - 1], w[T + size + k] = 1.0, -1.0
        elif sign == 0.0:
            beside, ratio = _limit(m, i)
            w[T + wide - 1] = beside / largest
            asked = asked or beside > 0.0
            w[T + size + k - 2] = w[T + size + k - 1] = 1.0
            if ratio != 0.0:
                w[T + size + int(w[vector(m, PRESSES) + i])] = -ratio
        else:
            w[T + wide - 1] = sign * _wanted(m, i) / largest
            asked = asked or (i < gaps and w[T + wide - 1] < -_NOTHING)
            for j in range(size):
                n, other = _row(j, gaps)
                if w[vector(m, MAY) + n] != 0.0:
                    w[T + size + j] = -sign * other * _entry(m, i, n, rows)
            if i >= gaps:
                w[T + size + gaps + 3 * (i - gaps) + 2] = -1.0
    return asked


@njit(**OPTIONS)
def _lemke(m, size):
    """Solve by Lemke's method: basic unknowns after the list, values in the last column; False: no solution."""
    apart()
    w, wide, T, basis = m.w, 2 * size + 2, vector(m, VECTORS), listed(m) + most(m)
    row, lowest = 0, 0.0
    for i in range(size):
        ratio = -w[T + wide * i + wide - 1] / w[T + wide * i + 2 * size]
        if i == 0 or ratio <= lowest:
            row, lowest = i, ratio
    if w[T + wide * row + wide - 1] >= -_NOTHING:
        return True
    entering = 2 * size
    for _ in range(50 * (size + 2)):
        _pivot(w, T, size, row, entering)
        leaving, m.pivots[basis + row] = m.pivots[basis + row], entering
        if leaving == 2 * size:
            return True
        entering = leaving + size if leaving < size else leaving - size
        row, left = _leaves(m, T, size, entering), 0.0
        for i in range(size):
            if m.pivots[basis + i] == 2 * size:
                left = w[T + wide * i + wide - 1]
        if left <= _NOTHING or row < 0:  # with nearly equal rows the artificial variable may vanish before it leaves
            return left <= _ASTRAY
    return False


@njit(**OPTIONS)
def _by_modes(m, x, gaps, slips, largest):
    """Solve by the mode combination with the least violation and fill x, initially zero; False: all violations exceed
    rounding. ``largest``: largest scaled b."""
    apart()
    w, rows, choices, least, best = m.w, gaps + slips, 1, _ASTRAY, -1
    for i in range(rows):
        choices *= 2 if i < gaps else 3
        if choices > MOST_CHOICES:
            return False
    for k in range(choices + 1):
        choice = k if k < choices else best
        if choice < 0:
            return False
        if _try(m, choice, gaps, rows) and k < choices:
            off = _violation(m, choice, gaps, rows, largest)
            if off < least:
                least, best = off, choice
    for i in range(rows):
        w[x + i] = w[vector(m, SCALES) + i] * w[vector(m, TRIED) + i]
    return True


@njit(**OPTIONS)
def _mode(choice, i, gaps):
    """Mode of a row: gap 0 open, 1 closed; slip 0 sticking, 1 and 2 for u above and below zero."""
    left = choice
    for k in range(i):
        left = left // 2 if k < gaps else left // 3
    return left % 2 if i < gaps else left % 3


@njit(**OPTIONS)
def _try(m, choice, gaps, rows):
    """Solve the equations of a mode combination for x at TRIED; False: they are singular, or another combination has
    the same."""
    apart()
    w, T, x, pivots = m.w, vector(m, VECTORS), vector(m, TRIED), listed(m) + most(m)
    for i in range(rows):
        mode, own, may = _mode(choice, i, gaps), T + rows * i, w[vector(m, MAY) + i] != 0.0
        if not may and mode != 0:
            return False
        moves = may and mode == (1 if i < gaps else 0)
        for j in range(rows):
            w[own + j] = _entry(m, i, j, rows) if moves else 0.0
        w[x + i] = -_wanted(m, i) if moves else 0.0
        if moves:
            continue
        w[own + i] = 1.0
        if i >= gaps and mode != 0:
            beside, ratio = _limit(m, i)
            w[x + i] = (2.0 * mode - 3.0) * beside
            if ratio != 0.0:
                w[own + int(w[vector(m, PRESSES) + i])] = (3.0 - 2.0 * mode) * ratio
    if not dense_lu.factorise(w, T, rows, m.pivots, pivots):
        return False
    for i in range(rows):
        if abs(w[T + (rows + 1) * i]) * _FLAT >= 1.0:
            return False
    dense_lu.substitute(w, T, rows, m.pivots, pivots, x)
    return True


@njit(**OPTIONS)
def _violation(m, choice, gaps, rows, largest):
    """Violation of the problem's inequalities by a combination's solution, relative to b or to the solution."""
    apart()
    w, answer, off, size = m.w, vector(m, TRIED), 0.0, largest
    for i in range(rows):
        size = larger(size, abs(w[answer + i]))
    for i in range(rows):
        if w[vector(m, MAY) + i] == 0.0:
            continue
        mode, x, u = _mode(choice, i, gaps), w[answer + i], _wanted(m, i)
        for j in range(rows):
            u += _entry(m, i, j, rows) * w[answer + j]
        if i < gaps:
            off = larger(off, -u if mode == 0 else -x)
        elif mode != 0:
            off = larger(off, -u if mode == 1 else u)
        else:
            beside, ratio = _limit(m, i)
            if ratio != 0.0:
                beside += ratio * larger(w[answer + int(w[vector(m, PRESSES) + i])], 0.0)
            off = larger(off, abs(x) - beside)
    return off / size


@njit(**OPTIONS)
def _leaves(m, T, size, entering):
    """Row of the unknown that first reaches zero as another one grows; -1: none."""
    apart()
    w, wide, basis, best = m.w, 2 * size + 2, listed(m) + most(m), -1
    for i in range(size):
        own = w[T + wide * i + entering]
        if own <= _FLAT:
            continue
        if best < 0:
            best = i
            continue
        for k in range(-1, size):
            j = wide - 1 if k < 0 else k
            one, two = w[T + wide * i + j] / own, w[T + wide * best + j] / w[T + wide * best + entering]
            if abs(one - two) > _TIE * (abs(one) + abs(two) + (1.0 if k < 0 else 0.0)):
                if one < two:
                    best = i
                break
            if m.pivots[basis + i] == 2 * size:
                best = i
            if m.pivots[basis + best] == 2 * size:
                break
    return best


@njit(**OPTIONS)
def _pivot(w, T, size, row, column):
    """Exchange two unknowns of the tableau."""
    apart()
    wide = 2 * size + 2
    own = T + wide * row
    by = 1.0 / w[own + column]
    for j in range(wide):
        w[own + j] *= by
    for i in range(size):
        share = w[T + wide * i + column]
        if i != row and share != 0.0:
            for j in range(wide):
                w[T + wide * i + j] -= share * w[own + j]
