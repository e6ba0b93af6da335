"""Compiled parts of the spectral solver: corrections of a motion, by what the mean equations answer to its remainder.

Arrays are as in `kaneflex.integrate.instants`.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import fourier, instants, lanes, matrices
from kaneflex.integrate.fourier import answered, differentiated, transform
from kaneflex.integrate.instants import multiply, solve_lower, solve_upper
from kaneflex.integrate.lanes import FASTMATH, LANES, lane_sum, load, store, transpose, transpose_back
from kaneflex.integrate.matrices import compiled
from kaneflex.support.fingerprint import made_of

FOUND, NO_MOTION, TOO_SLOW = 0, 1, 2
"""How corrections ended."""
_PATIENCE = 8
"""Corrections over which their contraction counts."""


@compiled
def squares(n):
    """Rows of a vector of n numbers, in whole squares."""
    return (n + LANES - 1) // LANES * LANES


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
def _resampled(n, start, circle, signals, z):
    """The trigonometric polynomial through start, (n, N or fewer instants), at all instants."""
    count, fewer = LANES * len(z), start.shape[1]
    cosine, sine = circle[0][:: count // fewer].copy(), circle[1][:: count // fewer].copy()
    few = _signals(fewer // LANES)
    for square in range(z.shape[1] // LANES):
        few[0][:] = few[1][:] = 0.0
        numbers = few[0].ravel()
        for i in range(square * LANES, min(n, (square + 1) * LANES)):
            for t in range(fewer):
                numbers[LANES * t + i - square * LANES] = start[i, t]
        if fewer == count:
            _from_instants(z, square, few[0])
            continue
        x, y, _, _ = transform(few[0], few[1], few[2], few[3], cosine, sine)
        re, im, spare_re, spare_im = signals
        re[:] = im[:] = 0.0
        for k in range(fewer // 2):
            store(re, k, load(x, k) * (1.0 / fewer))
            store(im, k, load(y, k) * (1.0 / fewer))
            store(re, count - 1 - k, load(x, fewer - 1 - k) * (1.0 / fewer))
            store(im, count - 1 - k, load(y, fewer - 1 - k) * (1.0 / fewer))
        highest = load(re, count - fewer // 2) * 0.5  # half of it belongs to the harmonic fewer / 2
        store(re, fewer // 2, highest)
        store(re, count - fewer // 2, highest)
        _, found, _, _ = transform(im, re, spare_im, spare_re, circle[0], circle[1])
        _from_instants(z, square, found)


@compiled
def _signals(blocks):
    """Four of eight rows: real and imaginary part, and what a transform needs beside them."""
    shape = (LANES, LANES * blocks)
    return np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape)


@compiled
def _gains(modes, square, omega, count):
    """What each of eight modes answers to a unit load in every harmonic: real and imaginary part, shape (N, LANES)."""
    gain_re, gain_im = np.empty((count, LANES)), np.empty((count, LANES))
    for k in range(count):
        rate = omega * (k if 2 * k <= count else k - count)
        still = load(modes, (2, square)) - rate * rate * load(modes, (0, square))
        # the highest harmonic of an even number has no derivative at the instants
        moved = (rate if 2 * k != count else 0.0) * load(modes, (1, square))
        size = 1.0 / (count * (still * still + moved * moved))
        store(gain_re, k, still * size)
        store(gain_im, k, 0.0 - moved * size)
    return gain_re, gain_im


@compiled
def _answer(n, w, factor, shapes, gains, circle, rest, taken, signals):
    """What the mean equations answer to the loads `rest`, in y, in their place.

    Those modes of them that are not in `shapes`, (n, m), answer at once, as if they had no mass.
    """
    m = shapes.shape[1]
    for b in range(len(rest)):
        solve_lower(n, w, factor, b, rest)
        for k in range(m):
            total = 0.0 * load(rest, (b, 0))
            for i in range(n):
                total += shapes[i, k] * load(rest, (b, i))
            store(taken, (b, k), total)
    if m == n:
        rest[:] = 0.0
    else:
        _add_modes(n, shapes, -1.0, taken, rest)
    re, im, spare_re, spare_im = signals
    for square in range(taken.shape[1] // LANES):
        _to_instants(taken, square, re)
        im[:] = 0.0
        answered(re, im, spare_re, spare_im, circle[0], circle[1], gains[square, 0], gains[square, 1])
        _from_instants(taken, square, re)
    _add_modes(n, shapes, 1.0, taken, rest)


@compiled
def _add_modes(n, shapes, sign, taken, rest):
    for b in range(len(rest)):
        for i in range(n):
            total = load(rest, (b, i))
            for k in range(shapes.shape[1]):
                total += sign * shapes[i, k] * load(taken, (b, k))
            store(rest, (b, i), total)


@compiled
def _forces(n, w, sums, circle, omega, z, v, a, signals, out):
    """M z'' + C z' + K z, at all instants."""
    re, im, spare_re, spare_im = signals
    for square in range(z.shape[1] // LANES):
        _to_instants(z, square, re)
        im[:] = 0.0
        differentiated(re, im, spare_re, spare_im, circle[0], circle[1], omega)
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
def _strain(n, w, sums, z):
    """Root of twice the strain energy, added up over the instants: the length of y."""
    product, total = np.empty((1, n, LANES)), 0.0
    for b in range(len(z)):
        multiply(n, w, sums, 2 * n * (2 * w + 1), b, z, 0, product)
        for i in range(n):
            total += lane_sum(load(product, (0, i)) * load(z, (b, i)))
    return np.sqrt(abs(total))


@compiled
def _tail(n, w, sums, circle, omega, z, signals, inert, strained):
    """Share of the motion's energy norm in the highest quarter of its harmonics: about what the grid leaves out."""
    count = LANES * len(z)
    alike = (omega * len(z)) ** 2  # of about one size: the rounding of one would else spoil the other
    for b in range(len(z)):
        multiply(n, w, sums, 0, b, z, b, inert)
        for i in range(n):
            store(inert, (b, i), alike * load(inert, (b, i)))
        multiply(n, w, sums, 2 * n * (2 * w + 1), b, z, b, strained)
    kinetic, strain = np.zeros(count), np.zeros(count)
    others = _signals(len(z))
    for square in range(z.shape[1] // LANES):
        _to_instants(z, square, signals[0])
        signals[1][:] = 0.0
        z_re, z_im, _, _ = transform(signals[0], signals[1], signals[2], signals[3], circle[0], circle[1])
        _to_instants(inert, square, others[0])
        _to_instants(strained, square, others[1])
        both_re, both_im, _, _ = transform(others[0], others[1], others[2], others[3], circle[0], circle[1])
        for k in range(count // 2 + 1):
            other = (count - k) % count
            # two real signals in one: the even part of what comes of them is the first one's, the odd the other's
            x, y, p, q = load(z_re, k), load(z_im, k), load(both_re, k), load(both_im, k)
            u, v = load(both_re, other), load(both_im, other)
            kinetic[k] += lane_sum(x * (p + u) + y * (q - v))
            strain[k] += lane_sum(x * (q + v) + y * (u - p))
    high = whole = 0.0
    for k in range(count // 2 + 1):
        energy = (k / len(z)) ** 2 * abs(kinetic[k]) + abs(strain[k])
        whole += energy
        high += energy if 8 * k >= 3 * count else 0.0
    return np.sqrt(high / (whole if whole > 0.0 else 1.0))


@compiled
def _conjugate(steps, changes, count, rest, z):
    """One step of GCR with row `count`, made orthogonal to those before; the square of what is left."""
    step, change = steps[count], changes[count]
    for k in range(count):
        along = 0.0
        for t in range(rest.size):
            along += changes[k, t] * change[t]
        for t in range(rest.size):
            change[t] -= along * changes[k, t]
            step[t] -= along * steps[k, t]
    length, along = 0.0, 0.0
    for t in range(rest.size):
        length += change[t] * change[t]
        along += change[t] * rest[t]
    scale = 1.0 / length if length > 0.0 else 0.0
    along *= scale
    scale, square = np.sqrt(scale), 0.0
    for t in range(rest.size):
        z[t] += along * step[t]
        rest[t] -= along * change[t]
        change[t] *= scale
        step[t] *= scale
        square += rest[t] * rest[t]
    return square


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)
@made_of(lanes.__file__, matrices.__file__, fourier.__file__, instants.__file__)
def corrected(n, w, sums, factor, shapes, modes, circle, omega, start, tolerance, share, over_tail, slowest, most):
    """The motion on one grid, from `start`, at N or fewer instants or empty, as far as this grid is worth it.

    shapes: of the modes of the mean, (n, m); modes: their mass, damping and stiffness, (3, squares, LANES)
    share: of the first remainder, that is enough
    over_tail: of what the grid leaves out, that is worth no further correction
    slowest: contraction of a correction from which they are given up; most: of them

    Returns z, (n, N), the remainder's size after each correction as a share of the motion's, the tail and how it ended.
    """
    blocks, padded = len(sums), squares(n)
    count = LANES * blocks
    loads = 3 * n * (2 * w + 1)
    signals, taken = _signals(blocks), np.zeros((blocks, modes.shape[1] * LANES, LANES))
    gains = np.empty((modes.shape[1], 2, count, LANES))
    for square in range(modes.shape[1]):
        gains[square, 0], gains[square, 1] = _gains(modes, square, omega, count)
    z, rest = np.zeros((blocks, padded, LANES)), np.zeros((blocks, padded, LANES))
    v, a = np.zeros((blocks, padded, LANES)), np.zeros((blocks, padded, LANES))
    step, change = np.zeros((blocks, padded, LANES)), np.zeros((blocks, padded, LANES))
    size = 0.0
    if start.size:
        _resampled(n, start, circle, signals, z)
        size = _strain(n, w, sums, z)
        _forces(n, w, sums, circle, omega, z, v, a, signals, rest)
    for b in range(blocks):
        for i in range(n):
            store(rest, (b, i), load(sums, (b, loads + i)) - load(rest, (b, i)))
    _answer(n, w, factor, shapes, gains, circle, rest, taken, signals)
    left = np.sqrt((rest * rest).sum())
    size = size if start.size else left
    size = size if size > 0.0 else 1.0
    history, tail, ended = np.empty(most + 1), np.inf, TOO_SLOW
    history[0] = left / size
    done = 0
    if not np.isfinite(left):
        ended, most = NO_MOTION, 0
    steps, changes = np.empty((most, z.size)), np.empty((most, z.size))
    while done < most:
        step[:] = rest
        for b in range(blocks):
            solve_upper(n, w, factor, b, step)
        _forces(n, w, sums, circle, omega, step, v, a, signals, change)
        _answer(n, w, factor, shapes, gains, circle, change, taken, signals)
        steps[done] = step.ravel()
        changes[done] = change.ravel()
        left = np.sqrt(_conjugate(steps, changes, done, rest.ravel(), z.ravel())) / size
        done += 1
        history[done] = left
        if left <= max(0.1 * history[0], tolerance):
            tail = _tail(n, w, sums, circle, omega, z, signals, v, a)
            if left <= max(tolerance, share * history[0], over_tail * tail):
                ended = FOUND
                break
        if done > _PATIENCE and left > slowest**_PATIENCE * history[done - _PATIENCE]:
            break
    found = np.empty((n, count))
    for i in range(n):
        for lane in range(LANES):
            for b in range(blocks):
                found[i, lane * blocks + b] = z[b, i, lane]
    return found, history[: done + 1], tail, ended
