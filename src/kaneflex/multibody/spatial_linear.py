"""Equations of a mechanism in space linearised about a motion, in coordinates of its independent speeds.

y are the deviations from the motion. For a ball, y is the rotation vector in axes that move with the motion, so that a
steadily spinning body has constant matrices. With theta = N y of all balls, a neighbouring motion has the speeds

    u = u_0 + y' + W y,   W y = omega_0 x theta,

and the accelerations of the system, u' = f(y, y', p) with the inputs p, give

    M y'' + C y' + K y = B p,   C = M (W - f_y'),   K = M (W' - f_y),   B = M f_p.

These derivatives are central differences, as those of :mod:`kaneflex.multibody.linearisation` in the plane.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from kaneflex.fem.spatial_bodies import skew
from kaneflex.multibody.linear_equations import OFFSETS, STEP, WEIGHTS, Linear
from kaneflex.multibody.spatial_choice import choose
from kaneflex.multibody.spatial_curves import Curve
from kaneflex.multibody.spatial_system import SpatialSystem, State
from kaneflex.multibody.spatial_tables import BALL, KIND, SPEED, Tables

_APART = 1e-15
"""Spacing of fictitious instants, which only order the neighbours, as a share of their time, or of 1 s."""


@dataclass(frozen=True, eq=False)
class Neighbours(Curve):
    """Neighbouring states of a motion, four for every coordinate y, rate y' and input, at fictitious successive times.

    Attributes
    ----------
    system : SpatialSystem
    base : State
    found : ndarray (4 n, ...)
        Their rows.
    steps : ndarray (n,)
        Step of each for one of :data:`OFFSETS`.
    """

    system: SpatialSystem
    base: State
    found: np.ndarray
    steps: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """Fictitious times of the neighbours [s]."""
        return self.base.t + _APART * max(1.0, abs(self.base.t)) * np.arange(len(self.found))

    def __call__(self, t: float) -> State:
        here = self.system.instants(self.rows(np.array([t])))
        return State(t, here.q[0], here.u[0], here.du[0], here.sizes[0], self.base.choice)

    def rows(self, times: np.ndarray) -> np.ndarray:
        return self.found[np.minimum(np.searchsorted(self.times, times), len(self.found) - 1)]

    @property
    def weights(self) -> np.ndarray:
        """Weights of the neighbours (4 n,); every four of them give a derivative."""
        return (WEIGHTS / self.steps[:, None]).ravel()

    def slopes(self, values: np.ndarray) -> np.ndarray:
        """Derivatives (m, n) of values (4 n, m) of the neighbours by y, y' and the inputs."""
        return np.einsum("ci,cim->mc", self.weights.reshape(-1, 4), values.reshape(len(self.steps), 4, -1))


def neighbours(system: SpatialSystem, base: State, columns: Sequence[int] | np.ndarray | None = None) -> Neighbours:
    """Neighbours of a state on the constraints by all of y, y' and the inputs, or by some of these.

    Raises ArithmeticError if loops don't close near it.
    """
    base = system.project(base.t, base.q, base.u, base.choice)
    which, inputs = base.choice.independent, len(system.inputs)
    n, (N, W) = len(which), spinning(system, base)
    away = np.concatenate([_steps(system, base), _pushes(system, base)])
    chosen = np.arange(2 * n + inputs) if columns is None else np.asarray(columns)
    out = np.zeros((4 * len(chosen), len(system.work.kept)))
    given = np.tile(np.concatenate([base.q, base.u]), (len(out), 1))
    for part, column in zip(given.reshape(len(chosen), 4, -1), chosen, strict=True):
        x = OFFSETS[:, None] * away[column]
        if column < n:
            part[:, : system.coordinates] = system.advanced(base.q, x * N[column])
            part[:, system.coordinates + which] += x * W[:, column]
        elif column < 2 * n:
            part[:, system.coordinates + which[column - n]] += x[:, 0]
    moved = 4 * int((chosen < 2 * n).sum())
    system.near(base.choice, np.full(moved, base.t), given[:moved], out[:moved])
    try:
        for row, column in zip(range(moved, len(out)), np.repeat(chosen[chosen >= 2 * n], 4), strict=True):
            system.inputs[column - 2 * n] = OFFSETS[row % 4] * away[column]
            system.near(base.choice, np.array([base.t]), given[row : row + 1], out[row : row + 1])
            system.inputs[:] = 0.0
    finally:
        system.inputs[:] = 0.0
    return Neighbours(system, base, out, away[chosen])


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
    n, found = len(which), system.instants(beside.found)
    system.project(base.t, base.q, base.u, base.choice)
    N, W = spinning(system, base)
    M = N @ system.mass(base.sizes) @ N.T
    f_y, f_v, f_p = np.split(beside.slopes(found.du[:, which]), [n, 2 * n], axis=1)
    spin, faster = _turning(system, base.u), _turning(system, base.du)
    W_rate = (faster @ N.T + spin @ growth(beside, N))[which]
    return Linear(base, names_of(system, base), M, M @ (W - f_v), M @ (W_rate - f_y), M @ f_p)


def growth(beside: Neighbours, N: np.ndarray) -> np.ndarray:
    """Derivative N' along the motion, (speeds, n): by y alone the speeds change by (N y)' and omega x theta."""
    speeds = beside.system.instants(beside.found).u
    return beside.slopes(speeds)[:, : len(N)] - _turning(beside.system, beside.base.u) @ N.T


def at_rest(system: SpatialSystem, t: float, q: np.ndarray) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """Names of y with M and K at an undeformed position, K from the strain of shapes and springs, without the effect
    of their forces."""
    from scipy.linalg import block_diag

    choice, still = choose(system, q, prefer=True), np.zeros(system.speeds)
    base = system.project(t, q, still, choice)
    N, M = system.basis(choice).copy(), system.mass(base.sizes).copy()
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
    """Matrix H of the rates H omega of a rotation vector, see :func:`kaneflex.multibody.spatial_bushings.cushion`."""
    theta, cross = np.linalg.norm(phi), skew(phi)
    curved = (1.0 - 0.5 * theta / np.tan(0.5 * theta)) / theta**2 if theta > 1e-4 else 1.0 / 12.0
    return np.eye(3) - 0.5 * cross + curved * cross @ cross
