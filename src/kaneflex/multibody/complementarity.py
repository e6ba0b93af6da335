"""Linear complementarity problems of small size: what rigid sides exert on each other where several of them touch.

u = W x + b: u are rates of gaps, then of slips, or their accelerations, and x impulses, or forces. Of gaps x >= 0,
u >= 0 and x . u = 0. Of slips |x| <= L, and x = -L sgn(u) where u isn't zero (Coulomb); L is mu times what presses, the
x of a gap, and what holds beside that. With x = y - z of a slip, both no less than zero, and its size s, that is

    W x + b >= 0,  s + (W x + b) >= 0 by y,  s - (W x + b) >= 0 by z,  L - y - z >= 0 by s

(Stewart & Trinkle 1996, Int. J. Numer. Methods Eng. 39, 2673). For impulses there is always a solution that Lemke's
method comes to unless restitution asks for more than a wedge gives (Anitescu & Potra 1997, Nonlinear Dyn. 14, 231); for
forces there may be none. Lemke 1965, Manage. Sci. 11, 681; ties are broken lexicographically, so that it ends (Cottle,
Pang & Stone 1992, The Linear Complementarity Problem, ch. 4). Where W is singular, as with more contacts than a body
needs, x is one of many and the u of gaps the only one.

Lemke's covering vector is that of rows scaled to a diagonal of one, so that units don't choose the way it goes. Where
it finds no solution all choices of modes are tried, each of them a system of linear equations: a gap is open or closed,
a slip is stuck or goes one way or the other. So two methods that share nothing say that there is none. Of more than
MOST_CHOICES choices Lemke's method alone decides.
"""

from __future__ import annotations

import math

from numba import njit

from kaneflex.multibody.tables import (
    ACTS, COMPLEMENT, CONTACTS, DRIVES, HOLDS, OPTIONS, TOUCHING, apart, larger,
)  # fmt: skip

(
    OLD, NEW, IMPULSES, FORCES, ACCELERATIONS, WANTED, MAY, RATIO, BESIDE, PRESSES, STICKS, RESTED_BEFORE, QUIET,
    SCALES, VECTORS,
) = range(15)  # fmt: skip
"""Vectors over the rows of contacts that touch, then of holds: rates before and after, impulses, forces at rest,
accelerations, the problem's b, which rows may exert something; of a hold its mu, what holds besides, and the row that
presses it on or -1; of a contact whether it doesn't bounce, whether it rested, and a rate that is none; what makes rows
alike."""
_NOTHING = 1e-13
"""Of the largest b: a u that is no less than its negative."""
_FLAT = 1e-9
"""What is left of a row, which has begun with 1, where others determine it."""
_TIE = 1e-12
"""By which two ways to go on are the same."""
_ASTRAY = 1e-9
"""Of the largest b: a u below zero that is rounding where there is no way to go on."""
MOST_CHOICES = 7776
"""Choices of modes that are tried: 2 of a gap and 3 of a slip, so those of five contacts with friction."""


def room_of(contacts: int, holds: int) -> int:
    """How many numbers the problem takes."""
    rows, size = contacts + holds, contacts + 3 * holds
    return rows * (rows + VECTORS) + size * (2 * size + 2)


@njit(**OPTIONS)
def most(m):
    """How many rows there may be."""
    return m.plan[ACTS] - m.plan[CONTACTS] + m.plan[DRIVES] - m.plan[HOLDS]


@njit(**OPTIONS)
def vector(m, which):
    """Where one of the vectors is; W is at COMPLEMENT."""
    return m.plan[COMPLEMENT] + most(m) * (most(m) + which)


@njit(**OPTIONS)
def listed(m):
    """Where in whole numbers the contacts and holds are whose rows they are; after them there is room for as many."""
    return m.plan[TOUCHING] + most(m)


@njit(**OPTIONS)
def complement(m, x, u, gaps, slips):
    """Fill the vectors x and u; rows whose MAY is 0 stay at x = 0, whatever their u. False: there is no solution."""
    apart()
    w, rows, W = m.w, gaps + slips, m.plan[COMPLEMENT]
    size, scales, x, u = gaps + 3 * slips, vector(m, SCALES), vector(m, x), vector(m, u)
    end, basis = vector(m, VECTORS) + 2 * size + 1, listed(m) + most(m)
    asked, largest = _fill(m, gaps, slips, size)
    found = not asked or _lemke(m, size)
    for i in range(rows):
        w[x + i] = 0.0
    if not found and not _by_modes(m, x, gaps, slips, largest):
        return False
    for i in range(size if asked and found else 0):
        k = m.pivots[basis + i] - size
        if 0 <= k < size:
            row, sign = _row(k, gaps)
            if sign != 0.0:
                w[x + row] += sign * largest * w[scales + row] * w[end + (2 * size + 2) * i]
    for i in range(rows):
        w[u + i] = w[vector(m, WANTED) + i]
        for j in range(rows):
            w[u + i] += w[W + rows * i + j] * w[x + j]
    return True


@njit(**OPTIONS)
def _row(k, gaps):
    """The row of an unknown of the problem, and its sign there; 0 of a slip's size."""
    if k < gaps:
        return k, 1.0
    kind = (k - gaps) % 3
    return gaps + (k - gaps) // 3, 1.0 if kind == 0 else -1.0 if kind == 1 else 0.0


@njit(**OPTIONS)
def _cover(m, i, rows):
    """A row of Lemke's covering vector, which would be 1 if W had a diagonal of 1."""
    own = abs(m.w[m.plan[COMPLEMENT] + (rows + 1) * i])
    return m.w[vector(m, SCALES) + i] * math.sqrt(own) if own > 1e-300 else 0.7


@njit(**OPTIONS)
def _fill(m, gaps, slips, size):
    """Fill the problem of z >= 0 and M z + q >= 0; whether z = 0 doesn't solve it, and by what q is divided to be at
    most 1."""
    apart()
    w, rows, wide, T = m.w, gaps + slips, 2 * size + 2, vector(m, VECTORS)
    scales, largest, cover = vector(m, SCALES), 0.0, 0.0
    for i in range(rows):
        own = abs(w[m.plan[COMPLEMENT] + (rows + 1) * i])
        w[scales + i] = math.ldexp(1.0, -math.frexp(own)[1] // 2) if own > 1e-300 else 1.0  # which rounds nothing
        cover = larger(cover, _cover(m, i, rows))
        if w[vector(m, MAY) + i] != 0.0:
            largest = larger(largest, abs(w[vector(m, WANTED) + i]) * w[scales + i])
            if i >= gaps:
                largest = larger(largest, w[vector(m, BESIDE) + i] / w[scales + i])
    largest, asked = math.ldexp(1.0, math.frexp(largest)[1]), False
    for k in range(size):
        i, sign = _row(k, gaps)
        for j in range(wide):
            w[T + wide * k + j] = 0.0
        m.pivots[listed(m) + most(m) + k] = k
        q, own = T + wide * k + 2 * size + 1, -_cover(m, i, rows) / cover
        w[T + wide * k + k], w[T + wide * k + 2 * size] = 1.0, own if sign != 0.0 else 1.0 / own
        if w[vector(m, MAY) + i] == 0.0:
            w[q], w[T + wide * k + size + k] = 1.0, -1.0
            continue
        if sign == 0.0:
            w[q] = w[vector(m, BESIDE) + i] / w[scales + i] / largest
            asked = asked or w[q] > 0.0
            w[T + wide * k + size + k - 2] = w[T + wide * k + size + k - 1] = 1.0
            n = int(w[vector(m, PRESSES) + i])
            if n >= 0 and w[vector(m, MAY) + n] != 0.0:
                w[T + wide * k + size + n] = -w[vector(m, RATIO) + i] * w[scales + n] / w[scales + i]
            continue
        w[q] = sign * w[vector(m, WANTED) + i] * w[scales + i] / largest
        asked = asked or (i < gaps and w[q] < -_NOTHING)
        for j in range(size):
            n, other = _row(j, gaps)
            if w[vector(m, MAY) + n] != 0.0:
                between = sign * other * w[m.plan[COMPLEMENT] + rows * i + n] * w[scales + i] * w[scales + n]
                w[T + wide * k + size + j] = -between
        if i >= gaps:
            w[T + wide * k + size + gaps + 3 * (i - gaps) + 2] = -1.0
    return asked, largest


@njit(**OPTIONS)
def _lemke(m, size):
    """Solve it: which unknowns are not zero, after the list, and their values in the last column; False: there is no
    solution."""
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
        if left <= _NOTHING or row < 0:  # where rows are as good as the same, nothing is left before it leaves
            return left <= _ASTRAY
    return False


@njit(**OPTIONS)
def _by_modes(m, x, gaps, slips, largest):
    """Solve the problem by the choice of modes that violates it least and fill x, which is zero; False: all violate it
    by more than rounding. ``largest``: of the scaled b."""
    apart()
    w, rows, T, scales = m.w, gaps + slips, vector(m, VECTORS), vector(m, SCALES)
    choices, least, best = 1, _ASTRAY, -1
    for i in range(rows):
        choices *= 2 if i < gaps else 3
        if choices > MOST_CHOICES:
            return False
    for k in range(choices + 1):
        choice = k if k < choices else best
        if choice < 0:
            return False
        if _chosen(m, choice, gaps, slips) and _solved(w, T, rows) and k < choices:
            off = _violation(m, choice, gaps, slips, largest)
            if off < least:
                least, best = off, choice
    for i in range(rows):
        w[x + i] = w[scales + i] * w[T + (rows + 1) * i + rows]
    return True


@njit(**OPTIONS)
def _mode(choice, i, gaps):
    """Mode of a row: of a gap 0 open, 1 closed; of a slip 0 stuck, 1 and 2 by u above and below zero."""
    left = choice
    for k in range(i):
        left = left // 2 if k < gaps else left // 3
    return left % 2 if i < gaps else left % 3


@njit(**OPTIONS)
def _entry(m, i, j, rows):
    """W where its diagonal is about 1."""
    scales = vector(m, SCALES)
    return m.w[m.plan[COMPLEMENT] + rows * i + j] * m.w[scales + i] * m.w[scales + j]


@njit(**OPTIONS)
def _limit(m, i):
    """What a slip's x is at most, scaled: a constant, and a ratio of the x that presses it on."""
    w, scales, n = m.w, vector(m, SCALES), int(m.w[vector(m, PRESSES) + i])
    beside = w[vector(m, BESIDE) + i] / w[scales + i]
    if n < 0 or w[vector(m, MAY) + n] == 0.0:
        return beside, 0.0
    return beside, w[vector(m, RATIO) + i] * w[scales + n] / w[scales + i]


@njit(**OPTIONS)
def _chosen(m, choice, gaps, slips):
    """Fill the equations of a choice of modes, right sides in the last column; False: another choice has the same."""
    apart()
    w, rows, T = m.w, gaps + slips, vector(m, VECTORS)
    for i in range(rows):
        mode, own = _mode(choice, i, gaps), T + (rows + 1) * i
        for j in range(rows + 1):
            w[own + j] = 0.0
        if w[vector(m, MAY) + i] == 0.0 and mode != 0:
            return False
        if w[vector(m, MAY) + i] != 0.0 and mode == (1 if i < gaps else 0):
            for j in range(rows):
                w[own + j] = _entry(m, i, j, rows)
            w[own + rows] = -w[vector(m, WANTED) + i] * w[vector(m, SCALES) + i]
            continue
        w[own + i] = 1.0
        if i >= gaps and mode != 0:
            beside, ratio = _limit(m, i)
            sign = 2.0 * mode - 3.0
            w[own + rows] = sign * beside
            if ratio != 0.0:
                w[own + int(w[vector(m, PRESSES) + i])] = -sign * ratio
    return True


@njit(**OPTIONS)
def _solved(w, T, rows):
    """Solve equations whose right sides, and then answers, are the last column; False: they are singular."""
    apart()
    wide = rows + 1
    for k in range(rows):
        top = k
        for i in range(k + 1, rows):
            if abs(w[T + wide * i + k]) > abs(w[T + wide * top + k]):
                top = i
        if abs(w[T + wide * top + k]) <= _FLAT:
            return False
        for j in range(k, wide):
            here, there = T + wide * k + j, T + wide * top + j
            w[here], w[there] = w[there], w[here]
        for i in range(rows):
            factor = w[T + wide * i + k] / w[T + wide * k + k]
            if i != k and factor != 0.0:
                for j in range(k, wide):
                    w[T + wide * i + j] -= factor * w[T + wide * k + j]
    for k in range(rows):
        w[T + wide * k + rows] /= w[T + wide * k + k]
    return True


@njit(**OPTIONS)
def _violation(m, choice, gaps, slips, largest):
    """By how much the answer of a choice violates the problem's inequalities, as a share of b or of the answer."""
    apart()
    w, rows, answer, off, size = m.w, gaps + slips, vector(m, VECTORS) + gaps + slips, 0.0, largest
    for i in range(rows):
        size = larger(size, abs(w[answer + (rows + 1) * i]))
    for i in range(rows):
        mode, x, u = _mode(choice, i, gaps), w[answer + (rows + 1) * i], w[vector(m, WANTED) + i]
        if w[vector(m, MAY) + i] == 0.0:
            continue
        u *= w[vector(m, SCALES) + i]
        for j in range(rows):
            u += _entry(m, i, j, rows) * w[answer + (rows + 1) * j]
        if i < gaps:
            off = larger(off, -u if mode == 0 else -x)
        elif mode != 0:
            off = larger(off, -u if mode == 1 else u)
        else:
            beside, ratio = _limit(m, i)
            if ratio != 0.0:
                beside += ratio * larger(w[answer + (rows + 1) * int(w[vector(m, PRESSES) + i])], 0.0)
            off = larger(off, abs(x) - beside)
    return off / size


@njit(**OPTIONS)
def _leaves(m, T, size, entering):
    """The row whose unknown comes to zero first as another one grows; -1: none does."""
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
    """Have an unknown take the place of another one."""
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
