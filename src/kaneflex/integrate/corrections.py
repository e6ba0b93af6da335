"""Compiled parts of the spectral solver: corrections of a motion, as responses of the mean equations to its residual.

Arrays are as in `kaneflex.integrate.instants`.
"""

import numpy as np
from numba import njit

from kaneflex.integrate import conventions, fourier, instants, lanes
from kaneflex.integrate.conventions import (
    FASTMATH,
    FOUND,
    HIGH,
    LANES,
    NO_MOTION,
    ODD,
    ONCE,
    ORDER,
    PATIENCE,
    SIGNALS,
    TOO_SLOW,
)
from kaneflex.integrate.fourier import to_harmonics, to_instants
from kaneflex.integrate.instants import multiply_upper, solve_lower, solve_upper
from kaneflex.integrate.lanes import compiled, lane_sum, load, mirrored, root, stay_apart, store
from kaneflex.support.fingerprint import made_of

# Compiled loops that take the equations and their work arrays one by one, however many: numba hands over tuples of
# arrays no faster, and types and copies each of them anew. They allocate nothing: that would take long to compile.


@compiled
def _fill_gains(modes, omega, circle, gains):
    """Half of what each mode answers to a unit load in every harmonic: its two parts, (m, 2, blocks, LANES)."""
    blocks = gains.shape[2]
    for k in range(modes.shape[1]):
        mass, damping, stiffness = modes[0, k], modes[1, k], modes[2, k]
        still_part, moved_part = gains[k, 0], gains[k, 1]
        for b in range(blocks):
            rate = omega * load(circle, (ORDER, b))
            still, moved = stiffness - mass * rate * rate, damping * omega * load(circle, (ODD, b))
            size = 0.5 / (LANES * blocks * (still * still + moved * moved))
            store(still_part, b, still * size)
            store(moved_part, b, 0.0 - moved * size)


@compiled
def _take(n, shapes, x, b, taken):
    """Shares of the modes `shapes`, (n, m), in a row of x to `taken`; where these are not all modes, x loses them."""
    m = shapes.shape[1]
    for k in range(m):
        total = 0.0 * load(x, (b, 0))
        for i in range(n):
            total += shapes[i, k] * load(x, (b, i))
        store(taken, (b, k), total)
        if m < n:
            for i in range(n):
                store(x, (b, i), load(x, (b, i)) - shapes[i, k] * total)


@compiled
def _answer(n, w, factor, shapes, gains, circle, across, rest, taken, signals):
    """Response of the mean equations to the loads `rest`, in y, in place.

    Modes that are not in `shapes`, (n, m), respond quasi-statically, without mass.
    """
    stay_apart()
    blocks, m = len(rest), shapes.shape[1]
    for b in range(blocks):
        solve_lower(n, w, factor, b, rest)
        _take(n, shapes, rest, b, taken)
    found, answer = signals[0], signals[1]
    re, im, to_re, to_im = found[0], found[1], answer[0], answer[1]
    for k in range(0, m, 2):
        other = min(k + 1, m - 1)
        own, beside = gains[k], gains[other]
        to_harmonics(taken, (k, other), circle, across, found, answer)
        for b in range(blocks):
            back, around = blocks - 1 - b, (blocks - b) % blocks
            x, y = load(re, b), load(im, b)
            p, q = mirrored(load(re, around), load(re, back)), mirrored(load(im, around), load(im, back))
            c, s, d, t = load(own[0], b), load(own[1], b), load(beside[0], b), load(beside[1], b)
            store(to_re, b, (c + d) * x - (s + t) * y + (c - d) * p + (s - t) * q)
            store(to_im, b, (c + d) * y + (s + t) * x + (s - t) * p - (c - d) * q)
        to_instants(answer, found, circle, across, taken, (k, other))
    for b in range(blocks):
        for i in range(n):
            total = 0.0 * load(taken, (b, 0))
            if m < n:
                total = load(rest, (b, i))
            for k in range(m):
                total += shapes[i, k] * load(taken, (b, k))
            store(rest, (b, i), total)


@compiled
def _forces(n, w, sums, circle, across, omega, z, v, a, signals, out):
    """M z'' + C z' + K z, at all instants."""
    stay_apart()
    blocks, scale = len(z), 1.0 / (LANES * len(z))
    found, slow, fast = signals[0], signals[1], signals[2]
    re, im, v_re, v_im, a_re, a_im = found[0], found[1], slow[0], slow[1], fast[0], fast[1]
    for i in range(0, n, 2):
        pair = i, min(i + 1, n - 1)
        to_harmonics(z, pair, circle, across, found, slow)
        for b in range(blocks):
            x, y, order = load(re, b), load(im, b), load(circle, (ORDER, b))
            rate, square = scale * omega * load(circle, (ODD, b)), 0.0 - scale * omega * omega * order * order
            store(v_re, b, 0.0 - rate * y)
            store(v_im, b, rate * x)
            store(a_re, b, square * x)
            store(a_im, b, square * y)
        to_instants(slow, found, circle, across, v, pair)
        to_instants(fast, found, circle, across, a, pair)
    width = 2 * w + 1
    damping, stiffness = n * width, 2 * n * width
    for b in range(blocks):
        for i in range(n):
            slot = i * width - i + w
            total = 0.0 * load(z, (b, i))
            for j in range(max(0, i - w), min(n, i + w + 1)):
                total += load(sums, (b, slot + j)) * load(a, (b, j))
                total += load(sums, (b, damping + slot + j)) * load(v, (b, j))
                total += load(sums, (b, stiffness + slot + j)) * load(z, (b, j))
            store(out, (b, i), total)


@compiled
def _product(x, y):
    """Sum of the products of the entries of two motions."""
    stay_apart()
    total = 0.0 * load(x, (0, 0))
    for t in range(x.shape[0] * x.shape[1]):
        total += load(x, (0, t)) * load(y, (0, t))
    return lane_sum(total)


@compiled
def _tail(n, shapes, modes, circle, across, omega, y, signals, rest, taken):
    """Share of the motion's energy norm in the highest quarter of its harmonics: about what the grid leaves out.

    The strain energy is the square of y, the kinetic energy that of the mean equations, in their modes.
    rest, taken: work, for what is not in the modes, and what is
    """
    stay_apart()
    blocks, m = len(y), shapes.shape[1]
    for b in range(blocks):
        for i in range(n):
            store(rest, (b, i), load(y, (b, i)))
        _take(n, shapes, rest, b, taken)
    found, spare = signals[0], signals[1]
    re, im = found[0], found[1]
    whole = high = 0.0 * load(y, (0, 0))
    for row in range(0, m if m == n else m + n, 2):
        x, first, count, inertia = (taken, row, m, omega * omega) if row < m else (rest, row - m, n, 0.0)
        other = min(first + 1, count - 1)
        mass, mass_of_other = inertia * modes[0, min(first, m - 1)], inertia * modes[0, min(other, m - 1)]
        alone = 0.0 if other == first else 1.0
        to_harmonics(x, (first, other), circle, across, found, spare)
        for b in range(blocks):
            back, around = blocks - 1 - b, (blocks - b) % blocks
            p, q = mirrored(load(re, around), load(re, back)), mirrored(load(im, around), load(im, back))
            u, v, order = load(re, b), load(im, b), load(circle, (ORDER, b))
            energy = (1.0 + mass * order * order) * ((u + p) * (u + p) + (v - q) * (v - q))
            energy += alone * (1.0 + mass_of_other * order * order) * ((v + q) * (v + q) + (p - u) * (p - u))
            whole += load(circle, (ONCE, b)) * energy
            high += load(circle, (HIGH, b)) * energy
    total = lane_sum(whole)
    return root(lane_sum(high) / (total if total > 0.0 else 1.0))


@compiled
def _combined(directions, images, done, y, rest):
    """Add to y what takes most from the remainder; the length of what is left in `rest`.

    The newest image of a direction is made orthogonal to those of the `done` others, and of length 1.
    """
    stay_apart()
    direction, image, size = directions[done], images[done], rest.shape[0] * rest.shape[1]
    for k in range(done):
        along, before, other = _product(images[k], image), directions[k], images[k]
        for t in range(size):
            store(direction, (0, t), load(direction, (0, t)) - along * load(before, (0, t)))
            store(image, (0, t), load(image, (0, t)) - along * load(other, (0, t)))
    length = root(_product(image, image))
    scale = 1.0 / length if length > 0.0 else 0.0
    share = scale * _product(image, rest)
    for t in range(size):
        store(direction, (0, t), scale * load(direction, (0, t)))
        store(image, (0, t), scale * load(image, (0, t)))
        store(y, (0, t), load(y, (0, t)) + share * load(direction, (0, t)))
        store(rest, (0, t), load(rest, (0, t)) - share * load(image, (0, t)))
    return root(_product(rest, rest))


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True, _nrt=False)
@made_of(conventions.__file__, lanes.__file__, fourier.__file__, instants.__file__)
def corrected(
    n,
    w,
    sums,
    factor,
    shapes,
    modes,
    circle,
    across,
    omega,
    tolerance,
    share,
    over_tail,
    slowest,
    start,
    vectors,
    directions,
    images,
    taken,
    signals,
    history,
):
    """Motion on one grid, to the accuracy of the grid, in place of vectors[0], (blocks, n, LANES).

    Each direction is the response of the mean equations to what is left of the loads. They are combined so that the
    least is left, as by GMRES, as generalised conjugate residuals (Eisenstat, Elman and Schultz 1983).

    shapes: of the modes of the mean, (n, m); modes: their mass, damping and stiffness, (3, m)
    circle, across: as `kaneflex.integrate.fourier.turns` has them
    share: of the first residual, that is enough
    over_tail: share of the grid's truncation error below which corrections end
    slowest: what PATIENCE corrections may leave, or they are given up
    start: a motion that is near, without instants where there is none
    vectors, directions, images, taken, signals: work, of VECTORS, twice one for each correction, (blocks, m, LANES),
        and SIGNALS and one for each mode, (2, blocks, LANES)
    history: filled with the remainder's size after each correction as a share of the motion's; as long as they may get

    Returns how it ended, the number of corrections and the tail.
    """
    blocks, size, loads = len(sums), len(sums) * n, 3 * n * (2 * w + 1)
    z, v, a, y, rest, gains = vectors[0], vectors[1], vectors[2], vectors[3], vectors[4], signals[SIGNALS:]
    _fill_gains(modes, omega, circle, gains)
    near, tail, ended, done = len(start) > 0, np.inf, TOO_SLOW, 0
    for t in range(size):
        store(y, (0, t), 0.0)
        store(rest, (0, t), 0.0)
    if near:
        for t in range(size):
            store(z, (0, t), load(start, (0, t)))
        for b in range(blocks):
            multiply_upper(n, w, factor, b, z, y)
        _forces(n, w, sums, circle, across, omega, z, v, a, signals, rest)
    for b in range(blocks):
        for i in range(n):
            store(rest, (b, i), load(sums, (b, loads + i)) - load(rest, (b, i)))
    _answer(n, w, factor, shapes, gains, circle, across, rest, taken, signals)
    first = root(_product(rest, rest))
    length = root(_product(y, y)) if near else first
    length = length if length > 0.0 else 1.0
    history[0] = first / length
    if not first < np.inf:
        return NO_MOTION, 0, tail
    enough = max(tolerance, share * history[0])
    for done in range(1, len(history)):
        direction, image = directions[done - 1], images[done - 1]
        for t in range(size):
            store(direction, (0, t), load(rest, (0, t)))
            store(z, (0, t), load(rest, (0, t)))
        for b in range(blocks):
            solve_upper(n, w, factor, b, z)
        _forces(n, w, sums, circle, across, omega, z, v, a, signals, image)
        _answer(n, w, factor, shapes, gains, circle, across, image, taken, signals)
        left = _combined(directions, images, done - 1, y, rest) / length
        history[done] = left
        # the tail hardly changes any more after the first time: it is asked for again where it is to end the search
        if left <= (max(0.1 * history[0], tolerance) if tail == np.inf else max(enough, over_tail * tail)):
            tail = _tail(n, shapes, modes, circle, across, omega, y, signals, v, taken)
            if left <= max(enough, over_tail * tail):
                ended = FOUND
                break
        if done > PATIENCE and left > slowest * history[done - PATIENCE]:
            break
    for t in range(size):
        store(z, (0, t), load(y, (0, t)))
    for b in range(blocks):
        solve_upper(n, w, factor, b, z)
    return ended, done, tail
