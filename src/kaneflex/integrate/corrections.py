"""Compiled parts of the spectral solver: corrections of a motion, by what the mean equations answer to its remainder.

Arrays are as in `kaneflex.integrate.instants`.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import fourier, instants, lanes, matrices
from kaneflex.integrate.fourier import fill_rates, filtered, transform
from kaneflex.integrate.instants import multiply, solve_lower, solve_upper
from kaneflex.integrate.lanes import (
    FASTMATH,
    LANES,
    absolute,
    lane_sum,
    load,
    root,
    stay_apart,
    store,
    transpose,
    transpose_back,
)
from kaneflex.integrate.matrices import compiled
from kaneflex.support.fingerprint import made_of

FOUND, NO_MOTION, TOO_SLOW = 0, 1, 2
"""How corrections ended."""
PATIENCE = 8
"""Corrections over which their contraction counts."""
# Compiled loops that take the equations and their work arrays one by one, however many: numba hands over tuples of
# arrays no faster, and types and copies each of them anew. They allocate nothing: that would take long to compile.


@compiled
def _to_instants(x, square, signal):
    """Eight rows of x as the transforms read them."""
    for b in range(len(x)):
        transpose(x, b * x.shape[1] + square * LANES, signal, b * LANES)


@compiled
def _from_instants(x, square, signal):
    """The inverse of `_to_instants`."""
    for b in range(len(x)):
        transpose_back(x, b * x.shape[1] + square * LANES, signal, b * LANES)


@compiled
def _fill_gains(modes, square, omega, gains):
    """What each of eight modes answers to a unit load in every harmonic: real and imaginary part, (2, N, LANES)."""
    count = gains.shape[1]
    for k in range(count):
        rate = omega * (k if 2 * k <= count else k - count)
        still = load(modes, (2, square)) - rate * rate * load(modes, (0, square))
        # the highest harmonic of an even number has no derivative at the instants
        moved = (rate if 2 * k != count else 0.0) * load(modes, (1, square))
        size = 1.0 / (count * (still * still + moved * moved))
        store(gains, (0, k), still * size)
        store(gains, (1, k), 0.0 - moved * size)


@compiled
def _answer(n, w, factor, shapes, gains, cosine, sine, rest, taken, signals):
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
    re, im, spare_re, spare_im = signals[0], signals[1], signals[2], signals[3]
    for square in range(taken.shape[1] // LANES):
        _to_instants(taken, square, re)
        filtered(re, im, spare_re, spare_im, cosine, sine, gains[square])
        _from_instants(taken, square, re)
    for b in range(len(rest)):
        for i in range(n):
            total = 0.0 * load(taken, (b, 0))
            if m < n:
                total = load(rest, (b, i))
            for k in range(m):
                total += shapes[i, k] * load(taken, (b, k))
            store(rest, (b, i), total)


@compiled
def _forces(n, w, sums, cosine, sine, omega, rates, z, v, a, signals, out):
    """M z'' + C z' + K z, at all instants."""
    stay_apart()
    re, im, spare_re, spare_im = signals[0], signals[1], signals[2], signals[3]
    for square in range(z.shape[1] // LANES):
        _to_instants(z, square, re)
        filtered(re, im, spare_re, spare_im, cosine, sine, rates)
        _from_instants(v, square, re)
        _from_instants(a, square, im)
    width = 2 * w + 1
    damping, stiffness, slower = n * width, 2 * n * width, 1.0 / (omega * len(z))
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
def _tail(n, w, sums, cosine, sine, omega, z, signals, inert, strained):
    """Share of the motion's energy norm in the highest quarter of its harmonics: about what the grid leaves out."""
    stay_apart()
    count = LANES * len(z)
    alike = (omega * len(z)) ** 2  # of about one size: the rounding of one would else spoil the other
    for b in range(len(z)):
        multiply(n, w, sums, 0, b, z, b, inert)
        for i in range(n):
            store(inert, (b, i), alike * load(inert, (b, i)))
        multiply(n, w, sums, 2 * n * (2 * w + 1), b, z, b, strained)
    re, im, spare_re, spare_im = signals[0], signals[1], signals[2], signals[3]
    z_re, z_im, kinetic, strain = signals[4], signals[5], signals[6], signals[7]
    for k in range(count):
        store(kinetic, k, 0.0)
        store(strain, k, 0.0)
    for square in range(z.shape[1] // LANES):
        for both in range(2):
            if both == 0:
                _to_instants(z, square, re)
                for t in range(count):
                    store(im, t, 0.0)
            else:
                _to_instants(inert, square, re)
                _to_instants(strained, square, im)
            re, im, spare_re, spare_im = transform(re, im, spare_re, spare_im, cosine, sine)
            if both == 0:
                re, im, z_re, z_im = z_re, z_im, re, im
        for k in range(count // 2 + 1):
            other = (count - k) % count
            # two real signals in one: the even part of what comes of them is the first one's, the odd the other's
            x, y, p, q = load(z_re, k), load(z_im, k), load(re, k), load(im, k)
            u, v = load(re, other), load(im, other)
            store(kinetic, k, load(kinetic, k) + x * (p + u) + y * (q - v))
            store(strain, k, load(strain, k) + x * (q + v) + y * (u - p))
    high = whole = 0.0
    for k in range(count // 2 + 1):
        moving, resting = absolute(lane_sum(load(kinetic, k))), absolute(lane_sum(load(strain, k)))
        energy = (k / len(z)) ** 2 * moving + resting
        whole += energy
        high += energy if 8 * k >= 3 * count else 0.0
    return root(high / (whole if whole > 0.0 else 1.0))


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
    n, w, sums, factor, shapes, modes, cosine, sine, omega, tolerance, share, over_tail, slowest, near, z,
    rest, v, a, taken, steps, changes, signals, gains, rates, history,
):
    """The motion on one grid, in place of z, (blocks, rows, LANES), as far as this grid is worth it.

    shapes: of the modes of the mean, (n, m); modes: their mass, damping and stiffness, (3, squares, LANES)
    share: of the first remainder, that is enough
    over_tail: of what the grid leaves out, that is worth no further correction
    slowest: what PATIENCE corrections may leave, or they are given up
    near: whether z is a motion to start from; else it is zero, as are the padding of all that has its shape, and taken
    history: filled with the remainder's size after each correction as a share of the motion's; as long as they may get

    Returns how it ended, the number of corrections and the tail.
    """
    blocks, size, loads = len(sums), z.shape[0] * z.shape[1], 3 * n * (2 * w + 1)
    fill_rates(omega, rates)
    for square in range(modes.shape[1]):
        _fill_gains(modes, square, omega, gains[square])
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
            _forces(n, w, sums, cosine, sine, omega, rates, step, v, a, signals, change)
        if done == 0:
            for b in range(blocks):
                for i in range(n):
                    store(change, (b, i), load(sums, (b, loads + i)) - load(change, (b, i)))
        _answer(n, w, factor, shapes, gains, cosine, sine, change, taken, signals)
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
            tail = _tail(n, w, sums, cosine, sine, omega, z, signals, v, a)
            if left <= max(tolerance, share * history[0], over_tail * tail):
                ended = FOUND
                break
        if done > PATIENCE and left > slowest * history[done - PATIENCE]:
            break
    return ended, done, tail
