"""Periodic motions by their harmonics: Fourier collocation, with corrections by the mean equations.

M(t) z'' + C(t) z' + K(t) z = F(t) is to hold at N instants of a cycle, with z a trigonometric polynomial through its
values there (Hill's method in time, as in the alternating frequency/time scheme of Cameron and Griffin 1989). With
K = L L^T at each instant and z = L^-T y the stiffness becomes the identity, and most of what varies is gone. What is
left is solved for by conjugate residuals, each correction one of the mean equations, which its modes decouple into
scalar ones, one for each harmonic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaneflex.integrate.conventions import (
    LANES,
    NO_MOTION,
    PATIENCE,
    SIGNALS,
    TOO_SLOW,
    VECTORS,
    aligned,
    turns,
)
from kaneflex.integrate.system import AffineSystem, Table
from kaneflex.support.machine_code import Kernel

FEWEST, MOST = 64, 8192
"""Smallest and largest number of instants per cycle."""
_TELLING = 1024
"""Instants from which on the harmonics' decay says how many would be needed: below, it is that of resonances."""
_FAR = 30.0
"""Times the tolerance that FEWEST leave out from which on twice as many are no use."""
_NEAR = 3.0
"""Times the tolerance that a grid leaves out up to which less than twice as many instants are tried."""
_MOST_NUMBERS = 4e7
"""In each of the matrices, at all instants: 320 MB."""
MODES = 16
"""Largest number of modes of the mean equations; further modes of larger systems respond quasi-statically."""
_SUBSPACE, SPARE, _SAMPLES = 4, 4, 16
"""Iterations that find these modes, vectors beyond them, and instants whose mean they are of."""
_CORRECTIONS = 40
"""Largest number of corrections on one grid."""
_SLOWEST, _SLOWEST_ESTIMATE = 0.85, 0.97
"""Contraction of a correction, over some of them, from which time steps are cheaper, and an estimate too dear."""
_OVER_TAIL = 0.2
"""Share of the grid's truncation error below which corrections on it end."""
SURE = 0.02
"""Share of a motion's error to which it is estimated."""

_corrected = Kernel("integrate.corrections", "corrected")
_equations, _mean_products = (Kernel("integrate.instants", name) for name in ("equations", "mean_products"))


@dataclass(frozen=True, eq=False)
class Grid:
    """The equations at the instants of one cycle, as `equations` has them.

    omega: 2 pi / period [rad/s]
    sums: M, C and K by their slots, then F, shape (N / LANES, 3 n (2 w + 1) + n, LANES)
    factor: of K, shape (N / LANES, n (w + 1), LANES)
    modes: of the mean equations in y, shape (n, m), and their mass, damping and stiffness, (3, m)
    """

    n: int
    half_bandwidth: int
    omega: float
    sums: np.ndarray
    factor: np.ndarray
    modes: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, system: AffineSystem, rows: np.ndarray, period: float, coarser: Grid | None = None) -> Grid:
        """The equations with the scalars of equally spaced instants, (N, n_scalars), N a power of two or three times
        one; modes: of `coarser`."""
        rows = np.ascontiguousarray(rows, dtype=float)
        n, w, blocks = system.n, system.half_bandwidth, len(rows) // LANES
        sums, factor = aligned(blocks, len(system.sums[0]) - 1, LANES), aligned(blocks, n * (w + 1), LANES)
        _equations(n, w, system.sums, rows, aligned(rows.shape[1], LANES), sums, factor)
        modes = _modes(n, w, sums, factor) if coarser is None else coarser.modes
        return cls(n, w, 2.0 * np.pi / period, sums, factor, modes)

    @property
    def instants(self) -> int:
        return LANES * len(self.sums)

    @property
    def frequencies(self) -> np.ndarray:
        """Angular frequency [rad/s] of each harmonic, shape (N / 2 + 1,)."""
        return self.omega * np.arange(self.instants // 2 + 1)

    @property
    def slowest(self) -> float:
        """Angular frequency [rad/s] of the slowest vibration of the mean equations; 0 where there is none."""
        mass, _, stiffness = self.modes[1][:, 0]
        return float(np.sqrt(np.abs(stiffness) / mass)) if mass > 0.0 else 0.0

    @property
    def fastest(self) -> float:
        """About the angular frequency [rad/s] of the fastest vibration, at the first instant."""
        width = 2 * self.half_bandwidth + 1
        mass, stiffness = (self.sums[0, k + self.half_bandwidth : k + self.n * width : width, 0]
                           for k in (0, 2 * self.n * width))  # fmt: skip
        with np.errstate(divide="ignore", invalid="ignore"):
            squares = np.abs(stiffness / mass)
        return float(np.sqrt(squares[np.isfinite(squares)].max(initial=0.0)))

    def rates(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See :func:`rates`."""
        return rates(z, self.omega)

    def corrected(
        self, start: np.ndarray | None, tolerance: float, share: float = 0.0, over_tail: float = _OVER_TAIL,
        slowest: float = _SLOWEST,
    ) -> Orbit:  # fmt: skip
        """Motion on this grid, to the accuracy of the grid, optionally from an approximate motion.

        start: at the instants of this grid or of a coarser one, (n, N)
        share: of the first remainder, that is enough
        """
        blocks, n, m = len(self.sums), self.n, self.modes[1].shape[1]
        near = np.empty((0, n, LANES))
        if start is not None:
            near = np.ascontiguousarray(at_instants(start, self.instants).reshape(n, LANES, -1).transpose(2, 0, 1))
        circle, across = turns(self.instants)
        system = (n, self.half_bandwidth, self.sums, self.factor, *self.modes, circle, across, self.omega)
        limits = (tolerance, share, over_tail, slowest**PATIENCE)
        motion, directions, images = (aligned(k, blocks, n, LANES) for k in (VECTORS, _CORRECTIONS, _CORRECTIONS))
        signals, taken = aligned(SIGNALS + m, 2, blocks, LANES), aligned(blocks, m, LANES)
        left, reason = np.empty(_CORRECTIONS + 1), ""
        ended, done, tail = _corrected(*system, *limits, near, motion, directions, images, taken, signals, left)
        left = left[: done + 1]
        if ended == NO_MOTION:
            reason = "the mean equations have no periodic motion"
        if ended == TOO_SLOW:
            factor = (left[-1] / left[0]) ** (1.0 / (len(left) - 1))
            reason = f"corrections of the harmonics converge too slowly (factor {factor:.2f} each)"
        return Orbit(self, motion[0], ((self.instants, len(left) - 1),), left[-1], tail, reason)


def rates(z: np.ndarray, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """z' and z'' at the instants of the trigonometric polynomials through z (n, N), with 2 pi / period [rad/s]."""
    instants = z.shape[1]
    harmonics, rate = np.fft.rfft(z, axis=1), 1j * omega * np.arange(instants // 2 + 1)
    slow, fast = harmonics * rate, harmonics * rate**2
    slow[:, -1] = 0.0  # the highest harmonic of an even number has no derivative at the instants
    return np.fft.irfft(slow, instants, axis=1), np.fft.irfft(fast, instants, axis=1)


def _modes(n: int, w: int, sums: np.ndarray, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes of the mean equations in y, the slowest first, as `Grid` has them.

    The means are those of FEWEST instants: more would hardly change them.
    """

    def means(shapes: np.ndarray, instants: int) -> np.ndarray:
        every = max(1, len(sums) * LANES // instants)
        found, work = np.zeros((3, n, shapes.shape[1])), aligned(2, len(sums), n, LANES)
        _mean_products(n, w, sums, factor, every, np.ascontiguousarray(shapes.T), work, found)
        found /= len(sums) // every * LANES
        return found

    shapes = np.eye(n)
    if n > MODES:  # about the slowest, by subspace iteration (Bathe 2013)
        shapes = np.linalg.qr(np.cos(np.outer(np.arange(1, n + 1), np.arange(1, min(n, MODES + SPARE) + 1))))[0]
        for _ in range(_SUBSPACE):
            shapes = np.linalg.qr(means(shapes, _SAMPLES)[0])[0]
    matrices = shapes.T @ means(shapes, FEWEST)
    found = np.linalg.eigh(0.5 * (matrices[0] + matrices[0].T))[1][:, ::-1][:, :MODES]
    return np.ascontiguousarray(shapes @ found), ((found.T @ matrices) * found.T).sum(axis=2)


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion, or where the search for it ended.

    grid: the last one; lanes: the motion at its instants, shape (N / LANES, n, LANES)
    grids: instants of all grids on the way, and the corrections on them
    last: the remainder after the last one, as a share of the motion, in the energy norm
    tail: share of the motion in the highest quarter of its harmonics
    reason: why the motion is not found this way, empty where it is
    """

    grid: Grid
    lanes: np.ndarray
    grids: tuple[tuple[int, int], ...]
    last: float
    tail: float
    reason: str = ""

    @cached_property
    def z(self) -> np.ndarray:
        """The motion at the instants of the grid, shape (n, N)."""
        return self.lanes.transpose(1, 2, 0).reshape(self.grid.n, -1)

    @property
    def error(self) -> float:
        """Estimated, relative, in the energy norm."""
        return max(self.last, self.tail)

    @property
    def said(self) -> str:
        """Description of the solution."""
        corrections = "1 correction" if (n := sum(dict(self.grids).values())) == 1 else f"{n} corrections"
        left = f"residual {self.last:.1e}, highest harmonics {self.tail:.1e} of the motion"
        return f"spectral: {self.grid.instants} instants per cycle, {corrections}; {left}"

    def at(self, count: int) -> np.ndarray:
        """z, z', z'' at `count` instants of the cycle, shape (3, n, count)."""
        harmonics, rate = np.fft.rfft(self.z, axis=1), 1j * self.grid.frequencies
        harmonics[:, -1] *= 0.5  # half of it belongs to the harmonic -N / 2
        parts = np.concatenate((harmonics, harmonics * rate, harmonics * rate**2))
        return _sampled(parts, self.grid.instants, count).reshape(3, -1, count)


def _sampled(harmonics: np.ndarray, instants: int, count: int) -> np.ndarray:
    """A trigonometric polynomial, harmonics (rows, instants / 2 + 1) with half the last one, at `count` instants.

    A harmonic that so few instants can't tell from a lower one is added to it.
    """
    if count > instants:
        return np.fft.irfft(harmonics, count, axis=1) * (count / instants)
    both = np.zeros((len(harmonics), count), dtype=complex)
    for first in range(0, harmonics.shape[1], count):
        block = harmonics[:, first : first + count]
        both[:, : block.shape[1]] += block
    # the negative ones are their conjugates
    both[:, 0] -= 0.5 * harmonics[:, 0]
    return 2.0 * np.fft.ifft(both, axis=1).real * (count / instants)


def at_instants(z: np.ndarray, count: int) -> np.ndarray:
    """The trigonometric polynomial through z (n, N) at as many other instants of the cycle: (n, count)."""
    if z.shape[1] == count:
        return z
    harmonics = np.fft.rfft(z, axis=1)
    if z.shape[1] % 2 == 0:
        harmonics[:, -1] *= 0.5
    return _sampled(harmonics, z.shape[1], count)


def improved(grid: Grid, z: np.ndarray, tolerance: float = 0.0, share: float = SURE) -> Orbit | None:
    """The motion z (n, N) with what the equations of the grid still ask for, to a share of it, or of the motion.

    None where corrections contract too slowly.
    """
    found = grid.corrected(z, tolerance, share, 0.0, _SLOWEST_ESTIMATE)
    return None if found.reason else found


def periodic_orbit(system: AffineSystem, table: Table, t0: float, period: float, tolerance: float) -> Orbit:
    """The motion of the period [s], with an error of about `tolerance` of it, in the energy norm.

    Its grid is refined until the highest quarter of the harmonics, and what the corrections left, are below that.
    """
    instants, grids, near, before, grid = FEWEST, tuple[tuple[int, int], ...](), None, 1.0, None
    while True:
        grid = Grid.of(system, table(t0 + period / instants * np.arange(instants)), period, grid)
        found = grid.corrected(near, tolerance)
        grids += found.grids
        if found.reason or found.error <= tolerance:
            break
        fewer = math.log2(max(before / found.tail, 1.0 + 1e-9))  # a resonance may keep the tail of a coarse grid up
        more = 1.0 if instants < _TELLING else max(math.log2(found.tail / tolerance) / fewer, 1.0)
        times = 4.0 if instants == FEWEST and found.tail > _FAR * tolerance else 2.0
        if found.tail < _NEAR * tolerance:  # half as many more, or by a third to the next power of two
            times = 4.0 / 3.0 if instants % 3 == 0 else 1.5
        if math.log2(instants) + more > math.log2(MOST) or 2 * grid.sums.size > 3 * _MOST_NUMBERS:
            share = f"{found.tail:.1g} of the motion is in the highest quarter of {instants // 2}"
            reason = f"the harmonics decay too slowly: {share}"
            found = replace(found, reason=reason)
            break
        near, before, instants = found.z, found.tail, round(times * instants)
    return replace(found, grids=grids)
