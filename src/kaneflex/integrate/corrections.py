"""Compiled parts of the spectral solver: corrections of a motion, by what the mean equations answer to its remainder.

Arrays are as in `kaneflex.integrate.instants`.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import fourier, instants, lanes, matrices
from kaneflex.integrate.fourier import fill_rates, filtered, transform
from kaneflex.integrate.instants import multiply, solve_lower, solve_upper
from kaneflex.integrate.lanes import FASTMATH, LANES, lane_sum, load, stay_apart, store, transpose, transpose_back
from kaneflex.integrate.matrices import compiled
from kaneflex.support.fingerprint import made_of

FOUND, NO_MOTION, TOO_SLOW = 0, 1, 2
"""How corrections ended."""
PATIENCE = 8
"""Corrections over which their contraction counts."""
# Compiled loops that take the equations and their work arrays one by one, however many: numba hands over tuples of
# arrays no faster, and types and copies each of them anew. `corrected` is one loop over what it allocates once.


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
def _signals(blocks):
    """Four of eight rows: real and imaginary part, and what a transform needs beside them."""
    shape = (LANES, LANES * blocks)
    return np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape)


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
def _answer(n, w, factor, shapes, gains, circle, rest, taken, signals):
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
    re, im, spare_re, spare_im = signals
    for square in range(taken.shape[1] // LANES):
        _to_instants(taken, square, re)
        filtered(re, im, spare_re, spare_im, circle[0], circle[1], gains[square])
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
def _forces(n, w, sums, circle, omega, rates, z, v, a, signals, out):
    """M z'' + C z' + K z, at all instants."""
    stay_apart()
    re, im, spare_re, spare_im = signals
    for square in range(z.shape[1] // LANES):
        _to_instants(z, square, re)
        filtered(re, im, spare_re, spare_im, circle[0], circle[1], rates)
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
    stay_apart()
    product, total = np.empty((1, n, LANES)), 0.0
    for b in range(len(z)):
        multiply(n, w, sums, 2 * n * (2 * w + 1), b, z, 0, product)
        for i in range(n):
            total += lane_sum(load(product, (0, i)) * load(z, (b, i)))
    return np.sqrt(abs(total))


@compiled
def _tail(n, w, sums, circle, omega, z, signals, inert, strained):
    """Share of the motion's energy norm in the highest quarter of its harmonics: about what the grid leaves out."""
    stay_apart()
    count = LANES * len(z)
    alike = (omega * len(z)) ** 2  # of about one size: the rounding of one would else spoil the other
    for b in range(len(z)):
        multiply(n, w, sums, 0, b, z, b, inert)
        for i in range(n):
            store(inert, (b, i), alike * load(inert, (b, i)))
        multiply(n, w, sums, 2 * n * (2 * w + 1), b, z, b, strained)
    kinetic, strain = np.zeros(count), np.zeros(count)
    re, im, spare_re, spare_im = signals
    for square in range(z.shape[1] // LANES):
        z_re, z_im, _, _ = _signals(len(z))
        for both in range(2):
            if both == 0:
                _to_instants(z, square, re)
                for t in range(count):
                    store(im, t, 0.0)
            else:
                _to_instants(inert, square, re)
                _to_instants(strained, square, im)
            re, im, spare_re, spare_im = transform(re, im, spare_re, spare_im, circle[0], circle[1])
            if both == 0:
                re, im, z_re, z_im = z_re, z_im, re, im
        for k in range(count // 2 + 1):
            other = (count - k) % count
            # two real signals in one: the even part of what comes of them is the first one's, the odd the other's
            x, y, p, q = load(z_re, k), load(z_im, k), load(re, k), load(im, k)
            u, v = load(re, other), load(im, other)
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
    stay_apart()
    for k in range(count):
        along = 0.0
        for t in range(rest.size):
            along += changes[k, t] * changes[count, t]
        for t in range(rest.size):
            changes[count, t] -= along * changes[k, t]
            steps[count, t] -= along * steps[k, t]
    length, along = 0.0, 0.0
    for t in range(rest.size):
        length += changes[count, t] * changes[count, t]
        along += changes[count, t] * rest[t]
    scale = 1.0 / length if length > 0.0 else 0.0
    along *= scale
    scale, square = np.sqrt(scale), 0.0
    for t in range(rest.size):
        z[t] += along * steps[count, t]
        rest[t] -= along * changes[count, t]
        changes[count, t] *= scale
        steps[count, t] *= scale
        square += rest[t] * rest[t]
    return square


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True)
@made_of(lanes.__file__, matrices.__file__, fourier.__file__, instants.__file__)
def corrected(n, w, sums, factor, shapes, modes, circle, omega, start, tolerance, share, over_tail, slowest, most):
    """The motion on one grid, from `start`, (n, N) or empty, as far as this grid is worth it.

    shapes: of the modes of the mean, (n, m); modes: their mass, damping and stiffness, (3, squares, LANES)
    share: of the first remainder, that is enough
    over_tail: of what the grid leaves out, that is worth no further correction
    slowest: what PATIENCE corrections may leave, or they are given up; most: of them

    Returns z, (n, N), the remainder's size after each correction as a share of the motion's, the tail and how it ended.
    """
    blocks, padded = len(sums), squares(n)
    shape, count = (blocks, padded, LANES), LANES * blocks
    loads = 3 * n * (2 * w + 1)
    signals, taken = _signals(blocks), np.zeros((blocks, modes.shape[1] * LANES, LANES))
    gains, rates = np.empty((modes.shape[1], 2, count, LANES)), np.empty((2, count, LANES))
    fill_rates(omega, rates)
    for square in range(modes.shape[1]):
        _fill_gains(modes, square, omega, gains[square])
    v, a, flat_z, flat_rest = np.zeros(shape), np.zeros(shape), np.zeros(padded * count), np.zeros(padded * count)
    z = flat_z.reshape(shape)
    steps, changes = np.empty((most, flat_z.size)), np.empty((most, flat_z.size))
    history, tail, ended, size = np.zeros(most + 1), np.inf, TOO_SLOW, 0.0
    if start.size:
        for i in range(n):
            for lane in range(LANES):
                for b in range(blocks):
                    z[b, i, lane] = start[i, lane * blocks + b]
        size = _strain(n, w, sums, z)
    # the first round finds what is left of the loads, each of the others corrects it
    done = 0
    for rounds in range(most + 1):
        done = rounds
        row = max(done - 1, 0)
        step, change = steps[row].reshape(shape), changes[row].reshape(shape)
        for t in range(flat_rest.size):
            steps[row, t], changes[row, t] = flat_rest[t] if done > 0 else flat_z[t], 0.0
        if done > 0:
            for b in range(blocks):
                solve_upper(n, w, factor, b, step)
        if done > 0 or start.size:
            _forces(n, w, sums, circle, omega, rates, step, v, a, signals, change)
        if done == 0:
            for b in range(blocks):
                for i in range(n):
                    store(change, (b, i), load(sums, (b, loads + i)) - load(change, (b, i)))
        _answer(n, w, factor, shapes, gains, circle, change, taken, signals)
        if done == 0:
            square = 0.0
            for t in range(flat_rest.size):
                flat_rest[t] = changes[0, t]
                square += flat_rest[t] * flat_rest[t]
            size = size if start.size else np.sqrt(square)
            size = size if size > 0.0 else 1.0
            history[0] = np.sqrt(square) / size
            if not np.isfinite(square):
                ended = NO_MOTION
                break
            continue
        left = np.sqrt(_conjugate(steps, changes, row, flat_rest, flat_z)) / size
        history[done] = left
        if left <= max(0.1 * history[0], tolerance):
            tail = _tail(n, w, sums, circle, omega, z, signals, v, a)
            if left <= max(tolerance, share * history[0], over_tail * tail):
                ended = FOUND
                break
        if done > PATIENCE and left > slowest * history[done - PATIENCE]:
            break
    found = np.empty((n, count))
    for i in range(n):
        for lane in range(LANES):
            for b in range(blocks):
                found[i, lane * blocks + b] = z[b, i, lane]
    return found, history[: done + 1], tail, ended
