"""What a cycle makes of every disturbance, by steps that hold the equations still at the instants of a grid.

A step from half an interval before an instant to half of one after it takes M, C and K for constant. Its exponential is
that of the three-stage Radau IIA method, R(x) = (1 + 2 x / 5 + x^2 / 20) / (1 - 3 x / 5 + 3 x^2 / 20 - x^3 / 60)
(Hairer and Wanner 1996, section IV.5), by the partial fractions of R: one real matrix of n unknowns and one complex one
where the method itself has 3 n. What the equations change within a step is left out, to the second order of its length
(Magnus 1954): they change with the motion, disturbances with the vibrations, which are much faster.
"""

import math
from functools import reduce

import numpy as np
from numba import njit

from kaneflex.integrate import lanes, matrices
from kaneflex.integrate.lanes import FASTMATH, LANES, aligned, load, store
from kaneflex.integrate.spectral import Grid
from kaneflex.support.fingerprint import made_of

FEWEST, MOST, PER_PERIOD = 256, 1024, 4
"""Steps of a cycle, at least and at most, and in a period of the slowest vibration: R is off by a hundredth there."""
_POLES = np.roots([-1.0 / 60.0, 3.0 / 20.0, -3.0 / 5.0, 1.0])
_POLES = np.array([_POLES[abs(_POLES.imag) < 1e-9][0].real, _POLES[_POLES.imag > 1e-9][0]])
_SHARES = (1.0 + 0.4 * _POLES + 0.05 * _POLES**2) / (-0.6 + 0.3 * _POLES - 0.05 * _POLES**2) * (1.0, 2.0)
"""Residues of R at the real pole and, doubled, at one of the others: R(x) is the real part of their sum."""


def monodromy(grid: Grid) -> np.ndarray:
    """Matrix (2 n, 2 n) that moves (z, h z') over a cycle, from half a step h before its start on."""
    every = max(1, grid.instants // FEWEST)
    instants = grid.instants // every
    wanted = PER_PERIOD * grid.slowest / grid.omega
    repeats = math.ceil(min(max(FEWEST, wanted), MOST) / instants)
    step = 2.0 * math.pi / (grid.omega * instants * repeats)
    poles = np.array([_POLES[0].real, _POLES[1].real, _POLES[1].imag])
    shares = np.array([_SHARES[0].real, _SHARES[1].real, _SHARES[1].imag])
    n, w = grid.n, grid.half_bandwidth
    state, entries, vectors = aligned(2 * n, 2 * n, LANES), aligned(5, n * (2 * w + 1), LANES), aligned(3, n, LANES)
    state[...] = np.eye(2 * n)[..., None]
    eighths(n, w, grid.sums, every, repeats, step, poles, shares, entries, vectors, state)
    return reduce(lambda before, then: then @ before, state.transpose(2, 1, 0))


# Compiled in one piece: one real and one complex matrix side by side, whose entries stay in registers; what is left of
# a step in functions of its own would be called for each column of each step.
@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True, _nrt=False)
@made_of(lanes.__file__, matrices.__file__)
def eighths(n, w, sums, every, repeats, step, poles, shares, entries, vectors, state):
    """Where each eighth of the cycle moves every state (z, h z'), in place: shape (2 n states, 2 n, LANES).

    every, repeats: of the blocks one in so many is read, and so many steps are taken with it
    entries, vectors: work, (5, n (2 w + 1), LANES) and (3, n, LANES)

    With x' = A x and u = (p - h A)^-1 x it is (p^2 M + p h C + h^2 K) h u' = p M h x' - h^2 K x, p u = x + h u'.
    """
    width = 2 * w + 1
    slots, states = n * width, 2 * n
    p, p_re, p_im = poles[0], poles[1], poles[2]
    q_re, q_im = p_re * p_re - p_im * p_im, 2.0 * p_re * p_im
    r, r_re, r_im = shares[0], shares[1], shares[2]
    size = 1.0 / (p_re * p_re + p_im * p_im)
    mass, stiffness, real, re, im = entries[0], entries[1], entries[2], entries[3], entries[4]
    x, x_re, x_im = vectors[0], vectors[1], vectors[2]
    for b in range(0, len(sums), every):
        for k in range(slots):
            m, c = load(sums, (b, k)), step * load(sums, (b, slots + k))
            s = step * step * load(sums, (b, 2 * slots + k))
            store(mass, k, m)
            store(stiffness, k, s)
            store(real, k, p * p * m + p * c + s)
            store(re, k, q_re * m + p_re * c + s)
            store(im, k, q_im * m + p_im * c)
        # both are L U, without pivoting, with the reciprocal pivots on the diagonal
        for k in range(n):
            row = k * width - k + w
            one = 1.0 / load(real, row + k)
            store(real, row + k, one)
            d_re, d_im = load(re, row + k), load(im, row + k)
            length = 1.0 / (d_re * d_re + d_im * d_im)
            d_re, d_im = d_re * length, 0.0 - d_im * length
            store(re, row + k, d_re)
            store(im, row + k, d_im)
            for i in range(k + 1, min(n, k + w + 1)):
                low = i * width - i + w
                share = load(real, low + k) * one
                a_re, a_im = load(re, low + k), load(im, low + k)
                s_re, s_im = a_re * d_re - a_im * d_im, a_re * d_im + a_im * d_re
                store(real, low + k, share)
                store(re, low + k, s_re)
                store(im, low + k, s_im)
                for j in range(k + 1, min(n, k + w + 1)):
                    u_re, u_im = load(re, row + j), load(im, row + j)
                    store(real, low + j, load(real, low + j) - share * load(real, row + j))
                    store(re, low + j, load(re, low + j) - s_re * u_re + s_im * u_im)
                    store(im, low + j, load(im, low + j) - s_re * u_im - s_im * u_re)
        for _ in range(repeats):
            for column in range(states):
                for i in range(n):
                    slot = i * width - i + w
                    inert = elastic = 0.0 * load(real, 0)
                    for j in range(max(0, i - w), min(n, i + w + 1)):
                        inert += load(mass, slot + j) * load(state, (column, n + j))
                        elastic += load(stiffness, slot + j) * load(state, (column, j))
                    known, known_re, known_im = p * inert - elastic, p_re * inert - elastic, p_im * inert
                    for j in range(max(0, i - w), i):
                        known -= load(real, slot + j) * load(x, j)
                        a_re, a_im, y_re, y_im = load(re, slot + j), load(im, slot + j), load(x_re, j), load(x_im, j)
                        known_re = known_re - a_re * y_re + a_im * y_im
                        known_im = known_im - a_re * y_im - a_im * y_re
                    store(x, i, known)
                    store(x_re, i, known_re)
                    store(x_im, i, known_im)
                for back in range(n):
                    i = n - 1 - back
                    slot = i * width - i + w
                    known, known_re, known_im = load(x, i), load(x_re, i), load(x_im, i)
                    for j in range(i + 1, min(n, i + w + 1)):
                        known -= load(real, slot + j) * load(x, j)
                        a_re, a_im, y_re, y_im = load(re, slot + j), load(im, slot + j), load(x_re, j), load(x_im, j)
                        known_re = known_re - a_re * y_re + a_im * y_im
                        known_im = known_im - a_re * y_im - a_im * y_re
                    a_re, a_im = load(re, slot + i), load(im, slot + i)
                    known = known * load(real, slot + i)
                    known_re, known_im = known_re * a_re - known_im * a_im, known_re * a_im + known_im * a_re
                    store(x, i, known)
                    store(x_re, i, known_re)
                    store(x_im, i, known_im)
                    # u = (x + h u') / p
                    z = load(state, (column, i))
                    u, y_re = (z + known) * (1.0 / p), z + known_re
                    u_re, u_im = (y_re * p_re + known_im * p_im) * size, (known_im * p_re - y_re * p_im) * size
                    store(state, (column, i), r_im * u_im - r_re * u_re - r * u)
                    store(state, (column, n + i), r_im * known_im - r_re * known_re - r * known)
