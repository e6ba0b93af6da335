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

import numpy as np

from kaneflex.integrate.grid import Grid
from kaneflex.integrate.system import AffineSystem, Table

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
_CORRECTIONS = 40
"""Largest number of corrections on one grid."""
_PATIENCE = 8
"""Corrections over which their contraction counts."""
_SLOWEST, _SLOWEST_ESTIMATE = 0.85, 0.97
"""Contraction of a correction, over some of them, from which time steps are cheaper, and an estimate too dear."""
_OVER_TAIL = 0.2
"""Share of the grid's truncation error below which corrections on it end."""
SURE = 0.02
"""Share of a motion's error to which it is estimated."""


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion, or where the search for it ended.

    grid: the last one; z: the motion at its instants, shape (n, N)
    grids: instants of all grids on the way, and the corrections on them
    last: the remainder after the last one, as a share of the motion, in the energy norm
    tail: share of the motion in the highest quarter of its harmonics
    reason: why the motion is not found this way, empty where it is
    """

    grid: Grid
    z: np.ndarray
    grids: tuple[tuple[int, int], ...]
    last: float
    tail: float
    reason: str = ""

    @property
    def error(self) -> float:
        """Estimated, relative, in the energy norm."""
        return max(self.last, self.tail)

    @property
    def description(self) -> str:
        """Description of the solution."""
        corrections = "1 correction" if (n := sum(dict(self.grids).values())) == 1 else f"{n} corrections"
        left = f"residual {self.last:.1e}, highest harmonics {self.tail:.1e} of the motion"
        return f"spectral: {self.grid.instants} instants per cycle, {corrections}; {left}"

    def at(self, count: int) -> np.ndarray:
        """z, z', z'' at `count` instants of the cycle, shape (3, n, count)."""
        harmonics, rate = _harmonics(self.z), 1j * self.grid.frequencies
        parts = np.concatenate((harmonics, harmonics * rate, harmonics * rate**2))
        return _sampled(parts, self.grid.instants, count).reshape(3, -1, count)


def _harmonics(z: np.ndarray) -> np.ndarray:
    """Harmonics of the trigonometric polynomials through z (n, N), shape (n, N / 2 + 1), with half the last one: the
    other half belongs to the harmonic -N / 2."""
    harmonics = np.fft.rfft(z)
    if z.shape[1] % 2 == 0:
        harmonics[:, -1] *= 0.5
    return harmonics


def _sampled(harmonics: np.ndarray, instants: int, count: int) -> np.ndarray:
    """A trigonometric polynomial through so many instants at `count` instants of the cycle, by its `_harmonics`.

    A harmonic that so few instants can't tell from a lower one is added to it.
    """
    if count > instants:
        return np.fft.irfft(harmonics, count) * (count / instants)
    both = np.zeros((len(harmonics), count), dtype=complex)
    for first in range(0, harmonics.shape[1], count):
        block = harmonics[:, first : first + count]
        both[:, : block.shape[1]] += block
    # the negative ones are their conjugates
    both[:, 0] -= 0.5 * harmonics[:, 0]
    return 2.0 * np.fft.ifft(both).real * (count / instants)


def at_instants(z: np.ndarray, count: int) -> np.ndarray:
    """The trigonometric polynomial through z (n, N) at as many other instants of the cycle: (n, count)."""
    return z if z.shape[1] == count else _sampled(_harmonics(z), z.shape[1], count)


def improved(grid: Grid, z: np.ndarray, tolerance: float = 0.0, share: float = SURE) -> Orbit | None:
    """The motion z (n, N) with what the equations of the grid still ask for, to a share of it, or of the motion.

    None where corrections contract too slowly.
    """
    found = corrected(grid, z, tolerance, share, 0.0, _SLOWEST_ESTIMATE)
    return None if found.reason else found


def periodic_orbit(system: AffineSystem, table: Table, t0: float, period: float, tolerance: float) -> Orbit:
    """The motion of the period [s], with an error of about `tolerance` of it, in the energy norm.

    Its grid is refined until the highest quarter of the harmonics, and what the corrections left, are below that.
    """
    instants, grids, near, before, grid = FEWEST, tuple[tuple[int, int], ...](), None, 1.0, None
    while True:
        grid = Grid.of(system, table(t0 + period / instants * np.arange(instants)), period, grid)
        found = corrected(grid, near, tolerance)
        grids += found.grids
        if found.reason or found.error <= tolerance:
            break
        fewer = math.log2(max(before / found.tail, 1.0 + 1e-9))  # a resonance may keep the tail of a coarse grid up
        more = 1.0 if instants < _TELLING else max(math.log2(found.tail / tolerance) / fewer, 1.0)
        times = 4.0 if instants == FEWEST and found.tail > _FAR * tolerance else 2.0
        if found.tail < _NEAR * tolerance:  # half as many more, or by a third to the next power of two
            times = 4.0 / 3.0 if instants % 3 == 0 else 1.5
        if math.log2(instants) + more > math.log2(MOST) or 2 * grid.matrices.size > 3 * _MOST_NUMBERS:
            share = f"{found.tail:.1g} of the motion is in the highest quarter of {instants // 2}"
            reason = f"the harmonics decay too slowly: {share}"
            found = replace(found, reason=reason)
            break
        near, before, instants = found.z, found.tail, round(times * instants)
    return replace(found, grids=grids)


def corrected(
    grid: Grid, start: np.ndarray | None, tolerance: float, share: float = 0.0, over_tail: float = _OVER_TAIL,
    slowest: float = _SLOWEST,
) -> Orbit:  # fmt: skip
    """Motion on one grid, to the accuracy of the grid.

    Each direction is the response of the mean equations to what is left of the loads. They are combined so that the
    least is left, as by GMRES, as generalised conjugate residuals (Eisenstat, Elman and Schultz 1983).

    start: a motion that is near, at the instants of this grid or of a coarser one, (n, N)
    share: of the first remainder, that is enough
    over_tail: share of the grid's truncation error below which corrections end
    slowest: contraction of a correction, over some of them, from which they are given up
    """
    z, zero = None if start is None else at_instants(start, grid.instants), np.zeros_like(grid.loads)
    y, rest = zero.copy() if z is None else grid.y_of(z), grid.response(grid.remainder(grid.loads, z))
    size = float(np.linalg.norm(rest if start is None else y))
    size = size if size > 0.0 else 1.0
    left = [float(np.linalg.norm(rest)) / size]
    if not left[0] < np.inf:
        return Orbit(grid, y, ((grid.instants, 0),), left[0], np.inf, "the mean equations have no periodic motion")
    enough, tail, found = max(tolerance, share * left[0]), np.inf, False
    kept = list[tuple[np.ndarray, np.ndarray, float]]()
    while not found and len(left) <= _CORRECTIONS:
        if len(left) > _PATIENCE + 1 and left[-1] > slowest**_PATIENCE * left[-1 - _PATIENCE]:
            break
        direction, image = rest.copy(), -grid.response(grid.remainder(zero, grid.z_of(rest)))
        for other, its_image, its_square in kept:
            along = np.vdot(its_image, image) / its_square
            direction -= along * other
            image -= along * its_image
        square = float(np.vdot(image, image)) or 1.0
        kept.append((direction, image, square))
        along = np.vdot(image, rest) / square
        y += along * direction
        rest -= along * image
        left.append(float(np.linalg.norm(rest)) / size)
        # the tail hardly changes any more after the first time: it is asked for again where it is to end the search
        if left[-1] <= (max(0.1 * left[0], tolerance) if tail == np.inf else max(enough, over_tail * tail)):
            tail = grid.tail(y)
            found = left[-1] <= max(enough, over_tail * tail)
    reason, corrections = "", len(left) - 1
    if not found:
        factor = (left[-1] / left[0]) ** (1.0 / corrections)
        reason = f"corrections of the harmonics converge too slowly (factor {factor:.2f} each)"
    return Orbit(grid, grid.z_of(y), ((grid.instants, corrections),), left[-1], tail, reason)
