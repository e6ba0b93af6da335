"""Equations of a mechanism in space linearised about a motion, in coordinates of its independent speeds.

y are the deviations from the motion. For a ball, y is the rotation vector in axes that move with the motion, so that a
steadily spinning body has constant matrices. With theta = N y of all balls, a neighbouring motion has the speeds

    u = u_0 + y' + W y,   W y = omega_0 x theta,

and the accelerations of the system, u' = f(y, y', p) with the inputs p, give

    M y'' + C y' + K y = B p,   C = M (W - f_y'),   K = M (W' - f_y),   B = M f_p.

M times these derivatives are those of the residual r(y, y', p) of the equations of motion with the accelerations of
the motion itself, as r = M (f - u_0') there. They are central differences, as those of
:mod:`kaneflex.multibody.time.linearisation` in the plane.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.fem.spatial_bodies import skew
from kaneflex.multibody.dynamics.spatial_entries import LACKED, NEAR
from kaneflex.multibody.model.independent_speeds import choose
from kaneflex.multibody.model.spatial_layout import BALL, KIND, SPEED, Tables
from kaneflex.multibody.model.spatial_system import SpatialSystem, State
from kaneflex.multibody.time.linear_equations import OFFSETS, STEP, WEIGHTS, Linear
from kaneflex.multibody.time.spatial_curves import Curve

_APART = 1e-15
"""Spacing of fictitious instants, which only order the neighbours, as a share of their time, or of 1 s."""


@dataclass(frozen=True, eq=False)
class Neighbours(Curve):
    """Neighbouring states of a motion, four for every coordinate y, rate y' and input, at fictitious successive times.

    Attributes
    ----------
    system : SpatialSystem
    base : State
    given : ndarray (4 n, coordinates + 2 speeds + inputs)
        Their coordinates, independent speeds, the accelerations of the base, and inputs.
    steps : ndarray (n,)
        Step of each for one of :data:`OFFSETS`.
    """

    system: SpatialSystem
    base: State
    given: np.ndarray
    steps: np.ndarray

    @cached_property
    def found(self) -> np.ndarray:
        """Their rows (4 n, ...)."""
        return self._near(NEAR, len(self.system.work.kept))

    @cached_property
    def lacking(self) -> np.ndarray:
        """Residuals of the equations of motion with the accelerations of the base, then all speeds (4 n, n_y + speeds).

        These take no mass matrices.
        """
        return self._near(LACKED, len(self.base.choice.independent) + self.system.speeds)

    def _near(self, what: int, size: int) -> np.ndarray:
        out = np.zeros((len(self.given), size))
        self.system.near(self.base.choice, np.full(len(out), self.base.t), self.given, out, what)
        return out

    @property
    def times(self) -> np.ndarray:
        """Fictitious times of the neighbours [s]."""
        return self.base.t + _APART * max(1.0, abs(self.base.t)) * np.arange(len(self.given))

    def __call__(self, t: float) -> State:
        here = self.system.instants(self.rows(np.array([t])))
        return State(t, here.q[0], here.u[0], here.du[0], here.sizes[0], self.base.choice)

    def rows(self, times: np.ndarray) -> np.ndarray:
        return self.found[np.minimum(np.searchsorted(self.times, times), len(self.given) - 1)]

    @property
    def weights(self) -> np.ndarray:
        """Weights of the neighbours (4 n,); every four of them give a derivative."""
        return (WEIGHTS / self.steps[:, None]).ravel()

    def slopes(self, values: np.ndarray) -> np.ndarray:
        """Derivatives (m, n) of values (4 n, m) of the neighbours by y, y' and the inputs."""
        return np.einsum("ci,cim->mc", self.weights.reshape(-1, 4), values.reshape(len(self.steps), 4, -1))

    @cached_property
    def forces(self) -> np.ndarray:
        """Derivatives M f_y, M f_y' and M f_p of the residuals (n_y, n): M f is zero in all of the motion."""
        return self.slopes(self.lacking[:, : len(self.base.choice.independent)])

    @cached_property
    def mass(self) -> np.ndarray:
        """Mass matrix M of y, (n_y, n_y)."""
        base = self.base
        self.system.project(base.t, base.q, base.u, base.choice)
        N = self.system.basis(base.choice)
        return np.asarray(N @ self.system.mass() @ N.T)


def neighbours(system: SpatialSystem, base: State, columns: Sequence[int] | np.ndarray | None = None) -> Neighbours:
    """Neighbours of a state on the constraints by all of y, y' and the inputs, or by some of these.

    Their values raise ArithmeticError if loops don't close near it.
    """
    base = system.project(base.t, base.q, base.u, base.choice)
    which, inputs = base.choice.independent, len(system.inputs)
    n, (N, W) = len(which), spinning(system, base)
    away = np.concatenate([_steps(system, base), _pushes(system, base)])
    chosen = np.arange(2 * n + inputs) if columns is None else np.asarray(columns)
    moved = np.zeros((4 * len(chosen), 2 * n + inputs))
    moved[np.arange(len(moved)), np.repeat(chosen, 4)] = np.outer(away[chosen], OFFSETS).ravel()
    y, rates, pushed = np.split(moved, [n, 2 * n], axis=1)
    u, du = (np.tile(part, (len(moved), 1)) for part in (base.u, base.du))
    u[:, which] += rates + y @ W.T
    return Neighbours(system, base, np.hstack([system.advanced(base.q, y @ N), u, du, pushed]), away[chosen])


def _steps(system: SpatialSystem, base: State) -> np.ndarray:
    """Steps in y and y': accelerations are of second degree in the latter."""
    own, rate = system.measure[base.choice.independent], max(1.0, (abs(base.u) / system.measure).max(initial=0.0))
    return np.concatenate([STEP * own, 1e-2 * rate * own])


def _pushes(system: SpatialSystem, base: State) -> np.ndarray:
    """Steps in sizes of loads and prescribed accelerations, which enter linearly."""
    largest = max(1.0, (abs(base.du) / system.measure).max(initial=0.0))
    weight = abs(system.work.h).max(initial=1.0)
    return np.concatenate([
        np.full(len(base.sizes), weight), largest * system.measure[system.driven_speeds]
    ])  # fmt: skip


def _turning(system: SpatialSystem, u: np.ndarray) -> np.ndarray:
    """Matrix of omega x of every ball, (speeds, speeds)."""
    found = np.zeros((system.speeds, system.speeds))
    for s in system.tables.nodes[system.tables.nodes[:, KIND] == BALL, SPEED].tolist():
        found[s : s + 3, s : s + 3] = skew(u[s : s + 3])
    return found


def spinning(system: SpatialSystem, base: State) -> tuple[np.ndarray, np.ndarray]:
    """Partial velocities N (n, speeds) of y', and W (n, n), at the position of ``work`` on the constraints."""
    N = system.basis(base.choice).copy()
    return N, (_turning(system, base.u) @ N.T)[base.choice.independent]


def names_of(system: SpatialSystem, base: State) -> tuple[str, ...]:
    """Names of y: JOINT.angle or JOINT.position, JOINT.turn_x of a joint that ends in a ball, BODY.shape_k; BODY.x and
    turn_x of a free body."""
    speeds = (system.layout.speeds[k] for k in base.choice.independent)
    return tuple(name.replace(".omega_", ".turn_").replace(".shapes.", ".shape_") for name in speeds)


def linear(beside: Neighbours) -> Linear[State]:
    """Linear equations about a state from all of its neighbours."""
    system, base, which = beside.system, beside.base, beside.base.choice.independent
    M, n = beside.mass, len(which)
    N, W = spinning(system, system.project(base.t, base.q, base.u, base.choice))
    by_y, by_rate, by_input = np.split(beside.forces, [n, 2 * n], axis=1)
    spin, faster = _turning(system, base.u), _turning(system, base.du)
    W_rate = (faster @ N.T + spin @ growth(beside, N))[which]
    return Linear(base, names_of(system, base), M, M @ W - by_rate, M @ W_rate - by_y, by_input)


def growth(beside: Neighbours, N: np.ndarray) -> np.ndarray:
    """Derivative N' along the motion, (speeds, n): by y alone the speeds change by (N y)' and omega x theta."""
    speeds = beside.lacking[:, len(N) :]
    return beside.slopes(speeds)[:, : len(N)] - _turning(beside.system, beside.base.u) @ N.T


def at_rest(system: SpatialSystem, t: float, q: np.ndarray) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names of y with M and K at an undeformed position, K from the strain of shapes and springs, without the effect
    of their forces."""
    from scipy.linalg import block_diag

    choice, still = choose(system, q, prefer=True), np.zeros(system.speeds)
    base = system.project(t, q, still, choice)
    N, M = system.basis(choice).copy(), system.mass().copy()
    sections, axes, moved = system.work.sections.copy(), system.work.axes.copy(), []
    for row in N:
        system.project(t, base.q, row, choice)
        moved.append(system.work.sections - sections)
    K = np.zeros_like(M)
    K[np.ix_(system.modal_speeds, system.modal_speeds)] = block_diag(*(
        shapes.stiffness for shapes in system.layout.shapes.values()
    ))  # fmt: skip
    K = N @ K @ N.T
    for parts, stiffness in _parts(system.tables, sections, axes, np.array(moved)):
        K += (stiffness * parts) @ parts.T
    return names_of(system, base), N @ M @ N.T, K


def _parts(
    tables: Tables, sections: np.ndarray, axes: np.ndarray, moved: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Relative displacements of every spring's ends in small motions ``moved`` (n, sections, 15), (n, parts), and the
    stiffness of each."""
    from scipy.spatial.transform import Rotation

    place, v, w = sections[:, :3], moved[:, :, 3:6], moved[:, :, 9:12]
    for (first, second), (stiffness, damping, free) in zip(tables.springs, tables.stiffness, strict=True):
        parts, apart = v[:, second] - v[:, first], place[second] - place[first]
        if damping or free:
            parts = parts @ (apart / np.linalg.norm(apart))[:, None]
        yield parts, np.full(parts.shape[1], stiffness)
    for (first, second, axis, _), (stiffness, *_) in zip(tables.twists, tables.torsion, strict=True):
        yield (w[:, second] - w[:, first]) @ axes[axis][:, None], np.array([stiffness])
    for (first, second, one, other), numbers in zip(tables.bushings, tables.cushions, strict=True):
        E = axes[one : one + 3]
        slid = v[:, second] - v[:, first] - np.cross(w[:, first], place[second] - place[first])
        phi = Rotation.from_matrix(E @ axes[other : other + 3].T).as_rotvec()
        turned = (w[:, second] - w[:, first]) @ E.T @ _turned(phi).T
        yield np.hstack([slid @ E.T, turned]), numbers[:6]


def _turned(phi: np.ndarray) -> np.ndarray:
    """Matrix H of the rates H omega of a rotation vector, see
    :func:`kaneflex.multibody.dynamics.spatial_bushings.cushion`."""
    theta, cross = np.linalg.norm(phi), skew(phi)
    curved = (1.0 - 0.5 * theta / np.tan(0.5 * theta)) / theta**2 if theta > 1e-4 else 1.0 / 12.0
    return np.eye(3) - 0.5 * cross + curved * cross @ cross
