"""Monodromy matrix of a cycle, by steps with constant equations at the instants of a grid.

A step from half an interval before to half an interval after an instant treats M, C and K as constant. Its exponential
is that of the three-stage Radau IIA method, R(x) = (1 + 2 x / 5 + x^2 / 20) / (1 - 3 x / 5 + 3 x^2 / 20 - x^3 / 60)
(Hairer and Wanner 1996, section IV.5), by the partial fractions of R: one real and one complex matrix of n unknowns
instead of 3 n unknowns. Changes of the equations within a step are neglected, to the second order of its length
(Magnus 1954): they vary with the motion, disturbances with the vibrations, which are much faster.
"""

import math
from functools import reduce

import numpy as np

from kaneflex.integrate.conventions import LANES, aligned
from kaneflex.integrate.spectral import Grid
from kaneflex.support.machine_code import Kernel

FEWEST, MOST, PER_PERIOD = 256, 1024, 4
"""Smallest and largest number of steps per cycle, and number per period of the slowest vibration (error of R 1e-2)."""
_POLES = np.roots([-1.0 / 60.0, 3.0 / 20.0, -3.0 / 5.0, 1.0])
_POLES = np.array([_POLES[abs(_POLES.imag) < 1e-9][0].real, _POLES[_POLES.imag > 1e-9][0]])
_SHARES = (1.0 + 0.4 * _POLES + 0.05 * _POLES**2) / (-0.6 + 0.3 * _POLES - 0.05 * _POLES**2) * (1.0, 2.0)
"""Residues of R at the real pole and, doubled, at one of the others: R(x) is the real part of their sum."""


_eighths = Kernel("integrate.instants", "eighths")


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
    _eighths(n, w, grid.sums, every, repeats, step, poles, shares, entries, vectors, state)
    return reduce(lambda before, then: then @ before, state.transpose(2, 1, 0))
