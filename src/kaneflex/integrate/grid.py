"""The equations M z'' + C z' + K z = F at equally spaced instants of a cycle, and corrections of a motion there.

Arrays have the instants along their last axis. Matrices are bands: entry (i, j) of a matrix with half-bandwidth w is
``band[i, j - i + w]``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.lib.stride_tricks import as_strided

from kaneflex.integrate.system import AffineSystem

MODES = 16
"""Largest number of modes of the mean equations; further modes of larger systems respond quasi-statically."""
_ITERATIONS, SPARE = 4, 4
"""Subspace iterations that find these modes, and vectors beyond them."""
_FEW, _MANY = 16, 64
"""Instants whose mean counts during these iterations, and at their end."""
_ROUNDING = 1e-13
"""Share of a diagonal entry that counts as zero."""


@dataclass(frozen=True, eq=False)
class Grid:
    """The equations at N instants of one cycle.

    omega: 2 pi / period [rad/s]
    matrices: M, C and K, shape (3, n, 2 w + 1, N)
    loads: F, shape (n, N)
    factor: Cholesky factor L of the symmetric part of K, shape (n, w + 1, N), entry (i, j) in slot j - i + w, the
        diagonal as its reciprocal. Where K is not positive definite at all instants, L is the root of the mean of K's
        diagonal.
    modes: of the mean equations in y = L^T z, shape (n, m), and their mass, damping and stiffness, (3, m)
    """

    omega: float
    matrices: np.ndarray
    loads: np.ndarray
    factor: np.ndarray
    modes: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, system: AffineSystem, rows: np.ndarray, period: float, coarser: Grid | None = None) -> Grid:
        """The equations with the scalars of equally spaced instants, shape (N, n_scalars), N even.

        coarser: a grid with the same modes
        """
        n, w, instants = system.n, system.half_bandwidth, len(rows)
        sums = system.stacked @ np.ascontiguousarray(rows.T)
        matrices = sums[:-n].reshape(3, n, 2 * w + 1, instants)
        factor = _cholesky(matrices[2])
        modes = _modes(matrices, factor) if coarser is None else coarser.modes
        return cls(2.0 * np.pi / period, matrices, sums[-n:], factor, modes)

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return self.matrices.shape[1]

    @property
    def instants(self) -> int:
        """Number of instants."""
        return self.matrices.shape[-1]

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
        mass, _, stiffness = self.matrices[:, :, self.matrices.shape[2] // 2, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            squares = np.abs(stiffness / mass)
        return float(np.sqrt(squares[np.isfinite(squares)].max(initial=0.0)))

    def y_of(self, z: np.ndarray) -> np.ndarray:
        """y = L^T z, shape (n, N)."""
        w, y = self.factor.shape[1] - 1, z / self.factor[:, -1]
        for i in range(1, self.n):
            first = max(0, i - w)
            y[first:i] += self.factor[i, first - i + w : w] * z[i]
        return y

    def z_of(self, y: np.ndarray) -> np.ndarray:
        """z = L^-T y, shape (n, N)."""
        return _solve_upper(self.factor, y)

    def remainder(self, loads: np.ndarray, z: np.ndarray | None = None) -> np.ndarray:
        """L^-1 (loads - M z'' - C z' - K z), shape (n, N)."""
        if z is not None:
            w, (n, instants) = self.factor.shape[1] - 1, z.shape
            states = np.zeros((3, n + 2 * w, instants))  # with zeros beside the band
            states[2, w : w + n] = z
            states[1, w : w + n], states[0, w : w + n] = rates(z, self.omega)
            one, row, each = states.strides
            windows = as_strided(states, (3, n, 2 * w + 1, instants), (one, row, row, each))
            loads = loads - np.einsum("midt,midt->it", self.matrices, windows)
        return _solve_lower(self.factor, loads)

    @cached_property
    def _gains(self) -> np.ndarray:
        """Response of each mode to a unit load in every harmonic, shape (m, N / 2 + 1)."""
        mass, damping, stiffness = self.modes[1][..., None]
        odd = self.frequencies.copy()
        odd[-1] = 0.0  # the highest harmonic has no derivative at the instants
        return 1.0 / (stiffness - mass * self.frequencies**2 + 1j * damping * odd)

    def response(self, rest: np.ndarray) -> np.ndarray:
        """Response y of the mean equations to loads L rest; modes that are not known respond quasi-statically."""
        shapes = self.modes[0]
        share = shapes.T @ rest
        moved = np.fft.irfft(self._gains * np.fft.rfft(share), self.instants)
        return shapes @ moved if len(share) == self.n else rest + shapes @ (moved - share)

    def tail(self, y: np.ndarray) -> float:
        """Share of the energy norm of a motion y in the highest quarter of its harmonics: about what the grid leaves
        out.

        The strain energy is the square of y, the kinetic energy that of the mean equations, in their modes.
        """
        shapes, (mass, _, _) = self.modes
        share = shapes.T @ y
        energy = ((1.0 + np.outer(mass, self.frequencies**2)) * _squares(share)).sum(axis=0)
        if len(share) < self.n:
            energy += _squares(y - shapes @ share).sum(axis=0)
        whole, high = energy.sum(), energy[-(-3 * self.instants // 8) :].sum()
        return float(np.sqrt(high / (whole if whole > 0.0 else 1.0)))


def rates(z: np.ndarray, omega: float) -> tuple[np.ndarray, np.ndarray]:
    """z' and z'' at the instants of the trigonometric polynomials through z (n, N), with 2 pi / period [rad/s]."""
    (n, instants), harmonics = z.shape, np.fft.rfft(z)
    rate = 1j * omega * np.arange(instants // 2 + 1)
    both = np.concatenate((harmonics * rate, harmonics * rate**2))
    both[:n, -1] = 0.0  # the highest harmonic of an even number has no derivative at the instants
    found = np.fft.irfft(both, instants)
    return found[:n], found[n:]


def dense(band: np.ndarray) -> np.ndarray:
    """A band (n, 2 w + 1, k) as k matrices, shape (k, n, n)."""
    n, w = len(band), band.shape[1] // 2
    found = np.zeros((band.shape[2], n, n))
    for d in range(-min(w, n - 1), min(w, n - 1) + 1):
        rows = np.arange(max(0, -d), n - max(0, d))
        found[:, rows, rows + d] = band[rows, d + w].T
    return found


def _squares(y: np.ndarray) -> np.ndarray:
    """Squares of the harmonics of a motion."""
    harmonics = np.fft.rfft(y)
    return harmonics.real**2 + harmonics.imag**2


def _cholesky(stiffness: np.ndarray) -> np.ndarray:
    """Factor of K, shape (n, 2 w + 1, N), as `Grid` has it (Golub and Van Loan 2013, 4.3.5)."""
    n, w = len(stiffness), stiffness.shape[1] // 2
    rest = stiffness[:, : w + 1].copy()
    for d in range(1, w + 1):  # the symmetric part
        rest[d:, w - d] = 0.5 * (stiffness[d:, w - d] + stiffness[:-d, w + d])
    for j in range(n):
        pivot = rest[j, w]
        if not (pivot > _ROUNDING * np.abs(stiffness[j, w])).all():
            return _diagonal_factor(stiffness)
        pivot[:] = 1.0 / np.sqrt(pivot)
        below = range(j + 1, min(n, j + w + 1))
        column = pivot * [rest[i, j - i + w] for i in below] if below else rest[:0, 0]
        for i, entry in zip(below, column, strict=True):
            rest[i, j - i + w] = entry
            rest[i, j + 1 - i + w :] -= entry * column[: i - j]
    return rest


def _diagonal_factor(stiffness: np.ndarray) -> np.ndarray:
    """The root of the mean of K's diagonal, in the place of its factor."""
    w = stiffness.shape[1] // 2
    mean = np.abs(stiffness[:, w]).mean(axis=1)
    largest = mean.max()
    factor = np.zeros_like(stiffness[:, : w + 1])
    factor[:, w] = 1.0 / np.sqrt(mean + (largest if largest > 0.0 else 1.0) * _ROUNDING)[:, None]
    return factor


def _solve_lower(factor: np.ndarray, x: np.ndarray) -> np.ndarray:
    """L^-1 x, shape (n, ..., N)."""
    w, found = factor.shape[1] - 1, x.copy()
    found[0] *= factor[0, w]
    for i in range(1, len(x)):
        first = max(0, i - w)
        found[i] -= np.einsum("kt,k...t->...t", factor[i, first - i + w : w], found[first:i])
        found[i] *= factor[i, w]
    return found


def _solve_upper(factor: np.ndarray, x: np.ndarray) -> np.ndarray:
    """L^-T x, shape (n, ..., N)."""
    w, found = factor.shape[1] - 1, x.copy()
    for i in range(len(x) - 1, 0, -1):
        first = max(0, i - w)
        found[i] *= factor[i, w]
        found[first:i] -= np.einsum("kt,...t->k...t", factor[i, first - i + w : w], found[i])
    found[0] *= factor[0, w]
    return found


def _modes(matrices: np.ndarray, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Modes of the mean equations in y, the slowest first, as `Grid` has them.

    The means are those of a few instants: more would hardly change them.
    """
    n, instants = len(factor), factor.shape[-1]

    def means(shapes: np.ndarray, of: np.ndarray, count: int) -> np.ndarray:
        """Means of L^-1 A L^-T shapes over the instants, for A each of the matrices."""
        every = max(1, instants // count)
        own = factor[..., ::every]
        x = _solve_upper(own, np.broadcast_to(shapes[..., None], (*shapes.shape, own.shape[-1])))
        return np.array([_solve_lower(own, _product(each[..., ::every], x)).mean(axis=-1) for each in of])

    shapes = np.eye(n)
    if n > MODES:  # about the slowest, by subspace iteration (Bathe 2013)
        shapes = np.linalg.qr(np.cos(np.outer(np.arange(1, n + 1), np.arange(1, min(n, MODES + SPARE) + 1))))[0]
        for _ in range(_ITERATIONS):
            shapes = np.linalg.qr(means(shapes, matrices[:1], _FEW)[0])[0]
    reduced = shapes.T @ means(shapes, matrices, _MANY)
    found = np.linalg.eigh(0.5 * (reduced[0] + reduced[0].T))[1][:, ::-1][:, :MODES]
    return np.ascontiguousarray(shapes @ found), ((found.T @ reduced) * found.T).sum(axis=2)


def _product(band: np.ndarray, x: np.ndarray) -> np.ndarray:
    """A matrix times x, shape (n, columns, N)."""
    n, w, found = len(x), band.shape[1] // 2, np.zeros(x.shape)
    for d in range(-min(w, n - 1), min(w, n - 1) + 1):
        rows, columns = slice(max(0, -d), n - max(0, d)), slice(max(0, d), n + min(0, d))
        found[rows] += band[rows, d + w, None] * x[columns]
    return found
