"""Periodic motions by their harmonics: Fourier collocation, corrected through the mean of the equations.

M(t) z'' + C(t) z' + K(t) z = F(t) is to hold at N instants of a cycle, with z a trigonometric polynomial through its
values there (Hill's method in time, as in the alternating frequency/time scheme of Cameron and Griffin 1989). With
K = L L^T at each instant and z = L^-T y the stiffness becomes the identity, and most of what varies is gone. What is
left is solved for by conjugate residuals (Eisenstat, Elman and Schultz 1983, GCR), each correction one of the mean
equations, which its modes decouple into scalar ones, one for each harmonic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaneflex.integrate.instants import (
    ROUNDING,
    add_product,
    conjugate,
    factorise,
    into_modes,
    mean_products,
    out_of_modes,
    residual,
    solve_upper,
)  # fmt: skip
from kaneflex.integrate.streams import Table
from kaneflex.integrate.system import AffineSystem

FEWEST, MOST = 64, 8192
"""Instants of a cycle that are tried."""
_TELLING = 512
"""Instants from which on the harmonics' decay says how many would be needed."""
_MOST_NUMBERS = 4e7
"""In each of the matrices, at all instants: 320 MB."""
_MODES = 16
"""Of the mean equations whose harmonics are solved for; what is left of larger systems follows its loads."""
_SUBSPACE, _SPARE, _SAMPLES = 4, 4, 16
"""Iterations that find these modes, vectors beyond them, and instants whose mean they are of."""
_CORRECTIONS = 40
"""On one grid, at most."""
_SLOWEST, _SLOWEST_ESTIMATE = 0.85, 0.97
"""Contraction of a correction, over some of them, from which time steps are cheaper, and an estimate too dear."""
_PATIENCE = 8
_OVER_TAIL = 0.2
"""Of what the grid leaves out: a remainder that is worth no further correction on it."""
SURE = 0.02
"""Share of a motion's error to which it is estimated."""


def _dot(a: np.ndarray, b: np.ndarray) -> float:
    """Not by BLAS, whose threads would wait for each other in products as small as these."""
    return float(np.einsum("it,it->", a, b))


@dataclass(frozen=True, eq=False)
class Grid:
    """The equations at the instants of one cycle.

    half_bandwidth: of the matrices
    omega: 2 pi / period [rad/s]
    M, C, K: shape (n (2 w + 1), N), slots as in `AffineSystem`; F: shape (n, N)
    factor: L as `factorise` has it; where K is not positive definite everywhere, the root of its mean diagonal
    """

    half_bandwidth: int
    omega: float
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    F: np.ndarray
    factor: np.ndarray
    coarser: Grid | None = None

    @classmethod
    def of(
        cls, system: AffineSystem, table: Table, t0: float, period: float, instants: int, coarser: Grid | None = None
    ) -> Grid:
        """The equations at so many instants, an even number, from t0 on."""
        rows = np.ascontiguousarray(table(t0 + period / instants * np.arange(instants)).T)
        mass, damping, stiffness, load = (getattr(system, name) @ rows for name in ("M", "C", "K", "F"))
        w = system.half_bandwidth
        factor = np.zeros((system.n * (w + 1), instants))
        if not factorise(w, stiffness, factor):
            factor[:] = 0.0
            diagonal = np.abs(stiffness[w :: 2 * w + 1]).mean(axis=1)
            factor[w :: w + 1] = 1.0 / np.sqrt(diagonal + (diagonal.max() or 1.0) * ROUNDING)[:, None]
        return cls(w, 2.0 * np.pi / period, mass, damping, stiffness, load, factor, coarser)

    @property
    def instants(self) -> int:
        return self.F.shape[1]

    @cached_property
    def frequencies(self) -> np.ndarray:
        """Angular frequency [rad/s] of each harmonic, shape (N / 2 + 1,)."""
        return self.omega * np.arange(self.instants // 2 + 1)

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Modes of the mean equations in y, shape (n, m), the slowest first, and their mass, damping and stiffness.

        The means are those of FEWEST instants: more would hardly change them.
        """
        if self.coarser is not None:
            return self.coarser.modes
        n = len(self.F)
        shapes = np.eye(n) if n <= _MODES else self._slowest()
        every = max(1, self.instants // FEWEST)
        mass, damping, stiffness = (shapes.T @ mean for mean in self._means(shapes, every))
        _, found = np.linalg.eigh(0.5 * (mass + mass.T))
        found = found[:, ::-1][:, :_MODES]
        return shapes @ found, *(np.einsum("ji,jk,ki->i", found, each, found) for each in (mass, damping, stiffness))

    @cached_property
    def answers(self) -> np.ndarray:
        """What each mode of the mean answers to a unit load in every harmonic, complex, shape (m, N / 2 + 1)."""
        _, mass, damping, stiffness = self.modes
        rate = self.frequencies.copy()
        rate[-1] = 0.0  # the highest harmonic of an even number has no derivative at the instants
        with np.errstate(divide="ignore", invalid="ignore"):
            return 1.0 / (stiffness[:, None] - np.outer(mass, self.frequencies**2) + 1j * np.outer(damping, rate))

    def _slowest(self) -> np.ndarray:
        """An orthonormal basis of about the slowest modes, by subspace iteration (Bathe 2013)."""
        n = len(self.F)
        basis = np.linalg.qr(np.random.default_rng(0).standard_normal((n, min(n, _MODES + _SPARE))))[0]
        for _ in range(_SUBSPACE):
            basis = np.linalg.qr(self._means(basis, max(1, self.instants // _SAMPLES))[0])[0]
        return basis

    def _means(self, shapes: np.ndarray, every: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Means over one instant in so many of L^-1 M L^-T times shapes (n, m), and of C and K, each (n, m)."""
        matrices = (np.ascontiguousarray(each[:, ::every]) for each in (self.factor, self.M, self.C, self.K))
        return mean_products(self.half_bandwidth, *matrices, np.ascontiguousarray(shapes.T))

    def rates(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """z' and z'' at the instants of the trigonometric polynomial through z (n, N)."""
        n, harmonics, rate = len(z), np.fft.rfft(z, axis=1), 1j * self.frequencies
        both = np.empty((2 * n, len(rate)), dtype=complex)
        np.multiply(harmonics, rate, out=both[:n])
        np.multiply(both[:n], rate, out=both[n:])
        both[:n, -1] = 0.0  # the highest harmonic of an even number has no derivative at the instants
        found = np.fft.irfft(both, self.instants, axis=1)
        return found[:n], found[n:]

    def forces(self, z: np.ndarray) -> np.ndarray:
        """M z'' + C z' + K z, shape (n, N)."""
        return residual(self.half_bandwidth, self.M, self.C, self.K, z, *self.rates(z))

    def correction(self, rest: np.ndarray) -> np.ndarray:
        """What the mean equations answer to loads (n, N), in y; overwrites them."""
        taken = into_modes(self.half_bandwidth, self.factor, self.modes[0], rest)
        harmonics = np.fft.rfft(taken, axis=1)
        harmonics *= self.answers
        return out_of_modes(self.modes[0], taken, np.fft.irfft(harmonics, self.instants, axis=1), rest)

    def displacements(self, y: np.ndarray) -> np.ndarray:
        """L^-T y."""
        z = y.copy()
        solve_upper(self.half_bandwidth, self.factor, z)
        return z

    def size(self, z: np.ndarray) -> float:
        """Root of twice the strain energy, added up over the instants: the length of y."""
        product = np.zeros_like(z)
        add_product(self.half_bandwidth, self.K, z, product)
        return math.sqrt(abs(_dot(z, product)))

    def tail(self, z: np.ndarray) -> float:
        """Share of the motion's energy norm in the highest quarter of its harmonics: about what the grid leaves out."""
        product = np.zeros_like(z)
        add_product(self.half_bandwidth, self.M, z, product)
        harmonics = np.fft.rfft(z, axis=1)
        kinetic = self.frequencies**2 * np.einsum("ik,ik->k", harmonics.conj(), np.fft.rfft(product, axis=1)).real
        add_product(self.half_bandwidth, self.K, z, np.multiply(product, 0.0, out=product))
        energy = np.abs(kinetic) + np.abs(np.einsum("ik,ik->k", harmonics.conj(), np.fft.rfft(product, axis=1)).real)
        return float(np.sqrt(energy[3 * self.instants // 8 :].sum() / (energy.sum() or 1.0)))


@dataclass(frozen=True, eq=False)
class Orbit:
    """A periodic motion, or where the search for it ended.

    grid: the last one; z: the motion at its instants, shape (n, N)
    corrections: of all grids
    last: the remainder after the last one, as a share of the motion, in the energy norm
    tail: share of the motion in the highest quarter of its harmonics
    reason: why the motion is not found this way, empty where it is
    """

    grid: Grid
    z: np.ndarray
    corrections: int
    last: float
    tail: float
    reason: str = ""

    @property
    def error(self) -> float:
        """Estimated, relative, in the energy norm."""
        return max(self.last, self.tail)

    @property
    def said(self) -> str:
        """How it was found, in words."""
        corrections = f"{self.corrections} correction{'s' if self.corrections > 1 else ''}"
        left = f"{self.last:.1e} of the motion, its highest harmonics {self.tail:.1e}"
        return f"spectral: {self.z.shape[1]} instants of the cycle, {corrections} leave {left}"

    def at(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """z, z', z'' at `count` instants of the cycle, each (count, n)."""
        harmonics, rate = np.fft.rfft(self.z, axis=1), 1j * self.grid.frequencies
        harmonics[:, -1] *= 0.5  # half of it belongs to the harmonic -N / 2
        parts = np.concatenate((harmonics, harmonics * rate, harmonics * rate**2))
        z, v, a = np.split(_sampled(parts, self.grid.instants, count).T, 3, axis=1)
        return z, v, a


def _sampled(harmonics: np.ndarray, instants: int, count: int) -> np.ndarray:
    """A trigonometric polynomial, harmonics (rows, instants / 2 + 1) with half the last one, at `count` instants.

    A harmonic that so few instants can't tell from a lower one is added to it.
    """
    both = np.zeros((len(harmonics), count), dtype=complex)
    for first in range(0, harmonics.shape[1], count):
        block = harmonics[:, first : first + count]
        both[:, : block.shape[1]] += block
    # the negative ones are their conjugates
    both[:, 0] -= 0.5 * harmonics[:, 0]
    return 2.0 * np.fft.ifft(both, axis=1).real * (count / instants)


def at_instants(z: np.ndarray, count: int) -> np.ndarray:
    """The trigonometric polynomial through z (n, N) at as many other instants of the cycle: (n, count)."""
    harmonics = np.fft.rfft(z, axis=1)
    if z.shape[1] % 2 == 0:
        harmonics[:, -1] *= 0.5
    return _sampled(harmonics, z.shape[1], count)


def improved(grid: Grid, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """z, z', z'' (n, N) with what the equations of the grid still ask for, to a share SURE of it.

    None where corrections contract too slowly.
    """
    found = _corrected(grid, z, 0.0, SURE)
    return None if found.reason else (found.z, *grid.rates(found.z))


def periodic_orbit(system: AffineSystem, table: Table, t0: float, period: float, tolerance: float) -> Orbit:
    """The motion of the period [s], with an error of about `tolerance` of it, in the energy norm.

    Its grid is refined until the highest quarter of the harmonics, and what the corrections left, are below that.
    """
    instants, corrections, z, before, grid = FEWEST, 0, None, 1.0, None
    while True:
        grid = Grid.of(system, table, t0, period, instants, grid)
        z = None if z is None else at_instants(z, instants)
        found = _corrected(grid, z, tolerance)
        corrections += found.corrections
        if found.reason or found.error <= tolerance:
            break
        fewer = math.log2(max(before / found.tail, 1.0 + 1e-9))  # a resonance may keep the tail of a coarse grid up
        more = 1.0 if instants < _TELLING else max(math.log2(found.tail / tolerance) / fewer, 1.0)
        if math.log2(instants) + more > math.log2(MOST) or 2 * grid.M.size > _MOST_NUMBERS:
            share = f"{found.tail:.1g} of the motion is in the highest quarter of {instants // 2}"
            reason = f"its harmonics die away too slowly: {share}"
            return replace(found, corrections=corrections, reason=reason)
        z, before, instants = found.z, found.tail, 2 * instants
    return replace(found, corrections=corrections)


def _corrected(grid: Grid, z: np.ndarray | None, tolerance: float, share: float = 0.0) -> Orbit:
    """The motion on one grid, from one that is near if there is any: as far as this grid is worth it.

    share: of the first remainder, that is enough.
    """
    rest = grid.correction(grid.F.copy() if z is None else grid.F - grid.forces(z))
    left = math.sqrt(_dot(rest, rest))
    size = left if z is None else grid.size(z)
    z = np.zeros_like(rest) if z is None else z
    if not np.isfinite(left):
        return Orbit(grid, z, 0, left, 1.0, "the mean equations have no periodic motion")
    steps, changes = np.empty((2, _CORRECTIONS, *rest.shape))
    slowest = _SLOWEST_ESTIMATE if share else _SLOWEST
    history, tail = [left / (size or 1.0)], np.inf
    for count in range(_CORRECTIONS):
        steps[count] = grid.displacements(rest)
        changes[count] = grid.correction(grid.forces(steps[count]))
        history.append(math.sqrt(conjugate(steps, changes, count, rest, z)) / (size or 1.0))
        if history[-1] <= max(0.1 * history[0], tolerance):
            tail = grid.tail(z)
            if history[-1] <= max(tolerance, share * history[0], 0.0 if share else _OVER_TAIL * tail):
                return Orbit(grid, z, count + 1, history[-1], tail)
        if count >= _PATIENCE and history[-1] > slowest**_PATIENCE * history[-1 - _PATIENCE]:
            break
    factor = (history[-1] / history[0]) ** (1.0 / (len(history) - 1))
    reason = f"a correction leaves {factor:.2f} of the remainder"
    return Orbit(grid, z, len(history) - 1, history[-1], tail, reason)
