"""Compiled parts of the spectral solver: corrections of a motion, by what the mean equations answer to its remainder.

Arrays are as in `kaneflex.integrate.instants`.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import fourier, instants, lanes, matrices
from kaneflex.integrate.fourier import HIGH, ODD, ONCE, ORDER, to_harmonics, to_instants
from kaneflex.integrate.instants import multiply, multiply_upper, solve_lower, solve_upper
from kaneflex.integrate.lanes import (
    FASTMATH,
    LANES,
    absolute,
    lane_sum,
    load,
    root,
    stay_apart,
    store,
)
from kaneflex.integrate.matrices import compiled
from kaneflex.support.fingerprint import made_of

FOUND, NO_MOTION, TOO_SLOW = 0, 1, 2
"""How corrections ended."""
VECTORS, SIGNALS = 4, 4
"""Motions, and rows of signals, that a correction works with."""
PATIENCE = 8
"""Corrections over which their contraction counts."""
# Compiled loops that take the equations and their work arrays one by one, however many: numba hands over tuples of
# arrays no faster, and types and copies each of them anew. They allocate nothing: that would take long to compile.


@compiled
def _fill_gains(modes, omega, circle, gains):
    """What each mode answers to a unit load in every harmonic: real and imaginary part, (2 m, blocks, LANES)."""
    count = LANES * gains.shape[1]
    for k in range(modes.shape[1]):
        mass, damping, stiffness = modes[0, k], modes[1, k], modes[2, k]
        for b in range(gains.shape[1]):
            rate = omega * load(circle, (ORDER, b))
            still, moved = stiffness - mass * rate * rate, damping * omega * load(circle, (ODD, b))
            size = 1.0 / (count * (still * still + moved * moved))
            store(gains, (2 * k, b), still * size)
            store(gains, (2 * k + 1, b), 0.0 - moved * size)


@compiled
def _answer(n, w, factor, shapes, gains, circle, eighths, rest, taken, signals):
    """What the mean equations answer to the loads `rest`, in y, in their place.

    Those modes of them that are not in `shapes`, (n, m), answer at once, as if they had no mass.
    """
    stay_apart()
    m = shapes.shape[1]
    for b in range(len(rest)):
        solve_lower(n, w, factor, b, rest)
        for k in range(m):
            total = 0.0 * load(rest, (b, 0))
            for i in range(n):
                total += shapes[i, k] * load(rest, (b, i))
            store(taken, (b, k), total)
            if m < n:  # what is left of the loads when these modes' share is taken away
                for i in range(n):
                    store(rest, (b, i), load(rest, (b, i)) - shapes[i, k] * total)
    re, im = signals[0], signals[1]
    for k in range(m):
        to_harmonics(taken, k, circle, eighths, signals)
        for b in range(len(rest)):
            x, y, c, s = load(re, b), load(im, b), load(gains, (2 * k, b)), load(gains, (2 * k + 1, b))
            store(re, b, c * x - s * y)
            store(im, b, c * y + s * x)
        to_instants(signals, circle, eighths, k, taken, taken[:0])
    for b in range(len(rest)):
        for i in range(n):
            total = 0.0 * load(taken, (b, 0))
            if m < n:
                total = load(rest, (b, i))
            for k in range(m):
                total += shapes[i, k] * load(taken, (b, k))
            store(rest, (b, i), total)


@compiled
def _forces(n, w, sums, circle, eighths, omega, z, v, a, signals, out):
    """M z'' + C z' + K z, at all instants."""
    stay_apart()
    re, im = signals[0], signals[1]
    alike = omega * len(z)  # rates of about one size: what rounds the one would else spoil the other
    for i in range(n):
        to_harmonics(z, i, circle, eighths, signals)
        for b in range(len(z)):
            order = load(circle, (ORDER, b))
            # z' omega N / 8 is the real part, z'' the imaginary one
            rate = (alike * omega * load(circle, (ODD, b)) - omega * omega * order * order) * (1.0 / (LANES * len(z)))
            x, y = load(re, b), load(im, b)
            store(re, b, 0.0 - rate * y)
            store(im, b, rate * x)
        to_instants(signals, circle, eighths, i, v, a)
    width = 2 * w + 1
    damping, stiffness, slower = n * width, 2 * n * width, 1.0 / alike
    for b in range(len(z)):
        for i in range(n):
            slot = i * width - i + w
            inert = slow = 0.0 * load(z, (b, i))
            for j in range(max(0, i - w), min(n, i + w + 1)):
                inert += load(sums, (b, slot + j)) * load(a, (b, j))
                inert += load(sums, (b, stiffness + slot + j)) * load(z, (b, j))
                slow += load(sums, (b, damping + slot + j)) * load(v, (b, j))
            store(out, (b, i), inert + slower * slow)


@compiled
def _strain(n, w, sums, z, product):
    """Root of twice the strain energy, added up over the instants: the length of y."""
    stay_apart()
    total = 0.0 * load(z, (0, 0))
    for b in range(len(z)):
        multiply(n, w, sums, 2 * n * (2 * w + 1), b, z, b, product)
        for i in range(n):
            total += load(product, (b, i)) * load(z, (b, i))
    return root(absolute(lane_sum(total)))


@compiled
def _tail(n, w, factor, shapes, modes, circle, eighths, omega, z, signals, y, taken):
    """Share of the motion's energy norm in the highest quarter of its harmonics: about what the grid leaves out.

    The strain energy is the square of y, the kinetic energy that of the mean equations, in their modes.
    """
    stay_apart()
    blocks, m = len(z), shapes.shape[1]
    for b in range(blocks):
        multiply_upper(n, w, factor, b, z, y)
        for k in range(m):
            total = 0.0 * load(y, (b, 0))
            for i in range(n):
                total += shapes[i, k] * load(y, (b, i))
            store(taken, (b, k), total)
            if m < n:
                for i in range(n):
                    store(y, (b, i), load(y, (b, i)) - shapes[i, k] * total)
    re, im = signals[0], signals[1]
    whole = high = 0.0 * load(z, (0, 0))
    for row in range(m if m == n else m + n):
        x, which = (taken, row) if row < m else (y, row - m)
        mass = modes[0, row] * omega * omega if row < m else 0.0
        to_harmonics(x, which, circle, eighths, signals)
        for b in range(blocks):
            u, v, order = load(re, b), load(im, b), load(circle, (ORDER, b))
            energy = (1.0 + mass * order * order) * (u * u + v * v)
            whole += load(circle, (ONCE, b)) * energy
            high += load(circle, (HIGH, b)) * energy
    total = lane_sum(whole)
    return root(lane_sum(high) / (total if total > 0.0 else 1.0))


@compiled
def _conjugate(steps, changes, count, rest, z):
    """One step of GCR with row `count`, made orthogonal to those before; the square of what is left."""
    stay_apart()
    size, newest, step = z.shape[0] * z.shape[1], changes[count], steps[count]
    nothing = 0.0 * load(z, (0, 0))
    for k in range(count):
        change, earlier, product = changes[k], steps[k], nothing
        for t in range(size):
            product += load(change, (0, t)) * load(newest, (0, t))
        along = lane_sum(product)
        for t in range(size):
            store(newest, (0, t), load(newest, (0, t)) - along * load(change, (0, t)))
            store(step, (0, t), load(step, (0, t)) - along * load(earlier, (0, t)))
    square, product = nothing, nothing
    for t in range(size):
        square += load(newest, (0, t)) * load(newest, (0, t))
        product += load(newest, (0, t)) * load(rest, (0, t))
    length = lane_sum(square)
    scale = 1.0 / length if length > 0.0 else 0.0
    along = lane_sum(product) * scale
    scale, square = root(scale), nothing
    for t in range(size):
        store(z, (0, t), load(z, (0, t)) + along * load(step, (0, t)))
        left = load(rest, (0, t)) - along * load(newest, (0, t))
        store(rest, (0, t), left)
        square += left * left
        store(newest, (0, t), scale * load(newest, (0, t)))
        store(step, (0, t), scale * load(step, (0, t)))
    return lane_sum(square)


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True, _nrt=False)
@made_of(lanes.__file__, matrices.__file__, fourier.__file__, instants.__file__)
def corrected(
    n, w, sums, factor, shapes, modes, circle, eighths, omega, tolerance, share, over_tail, slowest, near,
    vectors, taken, signals, history,
):
    """The motion on one grid, as far as this grid is worth it, in place of vectors[0], (blocks, n, LANES).

    shapes: of the modes of the mean, (n, m); modes: their mass, damping and stiffness, (3, m)
    circle, eighths: as `kaneflex.integrate.fourier.turns` has them
    share: of the first remainder, that is enough
    over_tail: of what the grid leaves out, that is worth no further correction
    slowest: what PATIENCE corrections may leave, or they are given up
    near: whether vectors[0] is a motion to start from; else it is zero
    vectors, taken, signals: work, of VECTORS and two for each correction, of (blocks, m, LANES), and of SIGNALS and two
        for each mode, (blocks, LANES)
    history: filled with the remainder's size after each correction as a share of the motion's; as long as they may get

    Returns how it ended, the number of corrections and the tail.
    """
    blocks, size, loads = len(sums), len(sums) * n, 3 * n * (2 * w + 1)
    z, rest, v, a, gains = vectors[0], vectors[1], vectors[2], vectors[3], signals[SIGNALS:]
    steps, changes = vectors[VECTORS : VECTORS + len(history) - 1], vectors[VECTORS + len(history) - 1 :]
    _fill_gains(modes, omega, circle, gains)
    tail, ended, length, done = np.inf, TOO_SLOW, 0.0, 0
    if near:
        length = _strain(n, w, sums, z, v)
    # the first round finds what is left of the loads, each of the others corrects it
    for rounds in range(len(history)):
        done = rounds
        row = max(done - 1, 0)
        step, change = steps[row], changes[row]
        for t in range(size):
            store(step, (0, t), load(rest, (0, t)) if done > 0 else load(z, (0, t)))
            store(change, (0, t), 0.0)
        if done > 0:
            for b in range(blocks):
                solve_upper(n, w, factor, b, step)
        if done > 0 or near:
            _forces(n, w, sums, circle, eighths, omega, step, v, a, signals, change)
        if done == 0:
            for b in range(blocks):
                for i in range(n):
                    store(change, (b, i), load(sums, (b, loads + i)) - load(change, (b, i)))
        _answer(n, w, factor, shapes, gains, circle, eighths, change, taken, signals)
        if done == 0:
            squares = 0.0 * load(z, (0, 0))
            for t in range(size):
                store(rest, (0, t), load(change, (0, t)))
                squares += load(change, (0, t)) * load(change, (0, t))
            first = root(lane_sum(squares))
            length = length if near else first
            length = length if length > 0.0 else 1.0
            history[0] = first / length
            if not first < np.inf:
                ended = NO_MOTION
                break
            continue
        left = root(_conjugate(steps, changes, row, rest, z)) / length
        history[done] = left
        if left <= max(0.1 * history[0], tolerance):
            tail = _tail(n, w, factor, shapes, modes, circle, eighths, omega, z, signals, v, taken)
            if left <= max(tolerance, share * history[0], over_tail * tail):
                ended = FOUND
                break
        if done > PATIENCE and left > slowest * history[done - PATIENCE]:
            break
    return ended, done, tail
