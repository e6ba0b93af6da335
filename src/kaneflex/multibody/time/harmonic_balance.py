"""Initial state of a periodic motion of driven elastic bodies by harmonic collocation and Newton's method.

z are the coordinates of the shapes, which are the only independent ones if drives and loops determine all joints. At N
instants of a cycle, the engine evaluates the accelerations a(z, z'), and z'' = a(z, z') is required there of
trigonometric polynomials z (Fourier collocation, as in :mod:`kaneflex.integrate.spectral` for linear equations). Each
correction solves the equations linearised about the cycle,

    M(t) dz'' + C(t) dz' + K(t) dz = M(t) (a - z''),

by GMRES (Saad and Schultz 1986), preconditioned by their solution on a coarse grid for the low harmonics, which include
resonances, and by that of their mean for the high ones. Undamped motions converge like damped ones.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lu_factor, lu_solve
from scipy.sparse.linalg import LinearOperator, gmres

from kaneflex.integrate.spectral import at_instants, rates
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.time.planar_linear import Instant, PlanarEquations

_DRAGS, _NEAR = (8.0, 1.0, 0.125, 0.0), 0.03
"""Damping for continuation to a motion far from the undeformed one, relative to the cycle's angular velocity;
precision on the way."""
_WAYS = (32, (0.0,)), (64, (0.0,)), (64, _DRAGS)
"""Instants of a first grid, and the drags there, as they are tried."""
_ROUGH, _FINEST = 0.1, 4096
"""Share of the highest harmonics above which a first grid is rejected; instants of the finest one."""
_LARGEST = 1536
"""Unknowns on a first grid: its dense factors take 0.3 s then."""
_STEPS, _FRESH = 8, 0.2
"""Newton's steps on a grid, and the contraction of one above which the next one linearises again."""
_SOLVED, _VECTORS = 1e-3, 30
"""Share to which each correction is solved for, and GMRES' vectors."""

States = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Instants [s] -> q and v (instants, size) of the undeformed bodies."""


def orbit_start(
    system: CoupledSystem, bare: States, t0: float, period: float, precision: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Initial state q and v (size,) at t0 [s] of the motion of ``period`` [s], to ``precision`` of its deformation.

    None if the search fails: coordinates other than shapes are independent, forces depend on the history, corrections
    don't converge, or the harmonics don't decrease.
    """
    system.compile()
    system.fold(*(part[0] for part in bare(np.array([t0]))))
    engine = system.engine
    engine.choose(t0)
    which, places = engine.independent.tolist(), {column: k for k, column in system.shape_columns.items()}
    remembers = len(engine.contacts) or len(engine.holds)
    if remembers or not which or not places.keys() >= set(which):
        return None
    search = _Search(system, bare, t0, period, np.array([places[k] for k in which]))
    try:
        z = search.found(precision)
        if z is not None:
            start = search.projected(search.states(1), z[:, :1], rates(z, search.omega)[0][:, :1])
            return start.q[0], start.v[0]
    except (ArithmeticError, np.linalg.LinAlgError):
        pass
    return None


@dataclass(frozen=True, eq=False)
class _Search:
    """Search of :func:`orbit_start`; ``modal``: places in q of the independent shapes."""

    system: CoupledSystem
    bare: States
    t0: float
    period: float
    modal: np.ndarray

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
        z, tangent = np.zeros((len(self.modal), 0)), None
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
            try:
                rest = self.projected(states, z, v).a[:, self.modal].T - a - drag * v
                tangent = tangent or _Tangent.of(self, states, z, v, a, drag)
            except ArithmeticError:
                return z, None
            step = tangent.answer(rest)
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

    def states(self, instants: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Given number of instants of the cycle [s], with q and v of the undeformed bodies."""
        times = self.t0 + self.period / instants * np.arange(instants)
        return times, *self.bare(times)

    def projected(self, states: tuple[np.ndarray, np.ndarray, np.ndarray], z: np.ndarray, v: np.ndarray) -> Unfolded:
        """States with z and v (k, N) in their shapes, loops closed."""
        times, q, rate = states
        q[:, self.modal], rate[:, self.modal] = z.T, v.T
        return self.system.states(times, q, rate)


@dataclass(frozen=True, eq=False)
class _Tangent:
    """The equations linearised about a motion at the instants of the first grid.

    matrices: M, C and K (3, k, k, N); factors: of all of them together.
    """

    search: _Search
    matrices: np.ndarray
    factors: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(
        cls, search: _Search, states: tuple[np.ndarray, np.ndarray, np.ndarray],
        z: np.ndarray, v: np.ndarray, a: np.ndarray, drag: float,
    ) -> _Tangent:  # fmt: skip
        """About z, z' and z'' (k, N), with a damping of drag M [1/s] besides."""
        k, instants = z.shape
        matrices = np.zeros((3, k, k, instants))
        for j, (t, *state) in enumerate(zip(*states, strict=True)):
            search.system.fold(*state)
            if j == 0:
                search.system.engine.choose(t)  # as at first, whatever the states did since
            instant = Instant(float(t), z[:, j], v[:, j], a[:, j])
            matrices[..., j] = PlanarEquations(search.system.engine).matrices(instant)
        matrices[1] += drag * matrices[0]
        still = np.eye(instants)
        turning = [part.T for part in (*rates(still, search.omega)[::-1], still)]
        whole = sum(np.einsum("abi,ij->aibj", A, D) for A, D in zip(matrices, turning, strict=True))
        return cls(search, matrices, lu_factor(whole.reshape(k * instants, -1)))

    def answer(self, rest: np.ndarray) -> np.ndarray:
        """Correction dz (k, N) for residual accelerations (k, N)."""
        shape, (_, k, _, coarse) = rest.shape, self.matrices.shape
        M, C, K = at_instants(self.matrices.reshape(-1, coarse), shape[1]).reshape(3, k, k, -1)
        load = np.einsum("abj,bj->aj", M, rest).ravel()
        if shape[1] == coarse:
            return lu_solve(self.factors, load).reshape(shape)

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
            answer = lu_solve(self.factors, held.ravel()).reshape(held.shape)
            out[:, :low] = np.fft.rfft(answer)[:, :low] * (shape[1] / coarse)
            return np.fft.irfft(out, shape[1]).ravel()

        A, P = (LinearOperator((load.size, load.size), each, dtype=float) for each in (forces, near))
        return gmres(A, load, rtol=_SOLVED, restart=_VECTORS, maxiter=1, M=P)[0].reshape(shape)


def _tail(z: np.ndarray) -> float:
    """Share of z (k, N) in the highest quarter of its harmonics."""
    squares = (abs(np.fft.rfft(z)) ** 2).sum(axis=0)
    return float(np.sqrt(squares[3 * len(squares) // 4 :].sum() / max(squares.sum(), 1e-300)))
