"""Initial state of a periodic motion of driven elastic bodies by harmonic collocation and Newton's method.

z are the coordinates of the shapes, which are the only independent ones if drives and loops determine all joints. At N
instants of a cycle, the residuals D(z, z', z'') of the equations of motion vanish for trigonometric polynomials z
(Fourier collocation, as in :mod:`kaneflex.integrate.spectral` for linear equations). Each correction solves the
equations linearised about the cycle,

    M(t) dz'' + C(t) dz' + K(t) dz = -D,

by GMRES (Saad and Schultz 1986), preconditioned by their solution on a coarse grid for the low harmonics, which include
resonances, and by that of their mean for the high ones. Undamped motions converge like damped ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.gmres import gmres
from kaneflex.integrate.grid import rates
from kaneflex.integrate.spectral import at_instants
from kaneflex.multibody.model.state import State
from kaneflex.multibody.time.linearisation import Equations

HARMONICS = 1e-6
"""Tolerance of a periodic start by harmonics, as a share of the deformation."""
_DRAGS, _NEAR = (8.0, 1.0, 0.125, 0.0), 0.03
"""Damping for continuation to a motion far from the undeformed one, relative to the cycle's angular velocity;
precision on the way."""
_WAYS = (32, (0.0,)), (64, (0.0,)), (64, _DRAGS)
"""Instants of a first grid, and the drags there, as they are tried."""
_ROUGH, _FINEST = 0.1, 4096
"""Share of the highest harmonics above which a first grid is rejected; instants of the finest one."""
_LARGEST = 2304
"""Unknowns on a first grid: its dense inverse takes 1 s then."""
_STEPS, _FRESH = 8, 0.2
"""Newton's steps on a grid, and the contraction of one above which the next one linearises again."""
_SOLVED, _VECTORS = 1e-3, 30
"""Share to which each correction is solved for, and least number of GMRES' vectors, else eight a coordinate."""


def orbit_start(
    equations: Equations, undeformed: Callable[[np.ndarray], Sequence[State]], t0: float, period: float,
    precision: float,
) -> State | None:
    """Initial state at t0 [s] of the motion of ``period`` [s], to ``precision`` of its deformation.

    None if the search fails: coordinates other than shapes are independent, corrections don't converge, or the
    harmonics don't decrease. ``undeformed``: instants of the undeformed mechanism by times [s].
    """
    if not len(equations.names) or not equations.shapes.all():
        return None
    search = _Search(equations, undeformed, t0, period)
    try:
        z = search.found(precision)
        if z is not None:
            x = np.concatenate([z[:, 0], rates(z, search.omega)[0][:, 0]])
            return equations.beside(search.states(1)[0], x)
    except (ArithmeticError, np.linalg.LinAlgError):
        pass
    return None


@dataclass(frozen=True, eq=False)
class _Search:
    """Search of :func:`orbit_start`."""

    equations: Equations
    undeformed: Callable[[np.ndarray], Sequence[State]]
    t0: float
    period: float

    @property
    def omega(self) -> float:
        return 2.0 * np.pi / self.period

    def found(self, precision: float) -> np.ndarray | None:
        """Solution z (k, N) at the instants of a sufficiently fine grid; None without convergence."""
        z, tangent = self.begun(precision)
        while tangent is not None and z.shape[1] < _FINEST:
            if _tail(z) <= precision:
                return z
            z, tangent = self.corrected(at_instants(z, 2 * z.shape[1]), tangent, precision)
        return None

    def begun(self, precision: float) -> tuple[np.ndarray, _Tangent | None]:
        """Solution z (k, N) on a first grid, and its tangent; None without convergence."""
        z, tangent = np.zeros((len(self.equations.names), 0)), None
        for instants, drags in _WAYS:
            if instants * len(z) > _LARGEST:
                break
            z = np.zeros((len(z), instants))
            for drag in drags:
                z, tangent = self.corrected(z, None, _NEAR if drag else precision, drag * self.omega)
                if tangent is None:
                    break
            if tangent is not None and _tail(z) <= _ROUGH:
                break
            tangent = None
        return z, tangent

    def corrected(
        self, z: np.ndarray, tangent: _Tangent | None, precision: float, drag: float = 0.0
    ) -> tuple[np.ndarray, _Tangent | None]:
        """Newton's corrections of z (k, N) up to the accuracy of its grid, with the last tangent; None without
        convergence."""
        last, states = np.inf, self.states(z.shape[1])
        for _ in range(_STEPS):
            v, a = rates(z, self.omega)
            moved = [self.equations.deformed(state, *each) for state, *each in zip(states, z.T, v.T, a.T, strict=True)]
            try:
                tangent = tangent or _Tangent.of(self, moved, drag)
                load = -self.equations.lacking(moved).T
            except ArithmeticError:
                return z, None
            if drag:
                load -= drag * np.einsum("abj,bj->aj", tangent.matrices[0], v)
            step = tangent.answer(load)
            z = z + step
            size = abs(step).max() / max(abs(z).max(), 1e-300)
            if size <= max(precision, _tail(z)):  # the residual after the step is much smaller
                return z, tangent
            if not size <= 2.0 * last:
                break
            if z.shape[1] == tangent.matrices.shape[-1] and size > _FRESH * last:
                tangent = None
            last = size
        return z, None

    def states(self, instants: int) -> Sequence[State]:
        """Undeformed mechanism at a number of instants of the cycle."""
        return self.undeformed(self.t0 + self.period / instants * np.arange(instants))


@dataclass(frozen=True, eq=False)
class _Tangent:
    """The equations linearised about a motion at the instants of the first grid.

    matrices: M, C and K (3, k, k, N); inverse: of all of them together.
    """

    search: _Search
    matrices: np.ndarray
    inverse: np.ndarray

    @classmethod
    def of(cls, search: _Search, states: Sequence[State], drag: float) -> _Tangent:
        """About instants of a motion, with a damping of drag M [1/s] besides."""
        matrices = np.moveaxis(np.array([search.equations.matrices(state) for state in states]), 0, -1)
        k, instants = matrices.shape[2:]
        matrices[1] += drag * matrices[0]
        still = np.eye(instants)
        turning = [part.T for part in (*rates(still, search.omega)[::-1], still)]
        whole = sum(np.einsum("abi,ij->aibj", A, D) for A, D in zip(matrices, turning, strict=True))
        return cls(search, matrices, np.linalg.inv(whole.reshape(k * instants, -1)))

    def answer(self, loads: np.ndarray) -> np.ndarray:
        """Correction dz (k, N) by loads (k, N)."""
        load, shape, (_, k, _, coarse) = loads.ravel(), loads.shape, self.matrices.shape
        M, C, K = at_instants(self.matrices.reshape(-1, coarse), shape[1]).reshape(3, k, k, -1)
        if shape[1] == coarse:
            return (self.inverse @ load).reshape(shape)

        def forces(z: np.ndarray) -> np.ndarray:
            moved = z.reshape(shape)
            v, a = rates(moved, self.search.omega)
            return sum(np.einsum("abj,bj->aj", A, x) for A, x in ((M, a), (C, v), (K, moved))).ravel()

        orders = self.search.omega * np.arange(shape[1] // 2 + 1)[:, None, None]
        mean = self.matrices.mean(axis=-1)
        of_mean = np.linalg.inv(mean[2] + 1j * orders * mean[1] - orders**2 * mean[0])

        def near(z: np.ndarray) -> np.ndarray:
            harmonics, low = np.fft.rfft(z.reshape(shape)), coarse // 2
            held = np.fft.irfft(harmonics[:, :low], coarse) * (coarse / shape[1])
            out = np.einsum("hab,bh->ah", of_mean, harmonics)
            answer = (self.inverse @ held.ravel()).reshape(held.shape)
            out[:, :low] = np.fft.rfft(answer)[:, :low] * (shape[1] / coarse)
            return np.fft.irfft(out, shape[1]).ravel()

        return gmres(forces, load, _SOLVED, max(_VECTORS, 8 * k), near)[0].reshape(shape)


def _tail(z: np.ndarray) -> float:
    """Share of z (k, N) in the highest quarter of its harmonics."""
    squares = (abs(np.fft.rfft(z)) ** 2).sum(axis=0)
    return float(np.sqrt(squares[3 * len(squares) // 4 :].sum() / max(squares.sum(), 1e-300)))
