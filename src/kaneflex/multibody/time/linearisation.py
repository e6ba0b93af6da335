"""Coupled equations linearised about an instant of a motion, in independent coordinates, in the plane and in space.

The residual D(t, y, y', y'', p) of the equations of motion (generalised forces M a - f of the independent coordinates
y, with sizes of loads and prescribed accelerations p) is zero on the motion. Small motions about it satisfy

    M y'' + C y' + K y = B p,   M = dD/dy'', C = dD/dy', K = dD/dy, B = -dD/dp:

these derivatives include geometric stiffening and the loops' kinematics. The residual is smooth and accurate to
rounding: central differences of fourth order have an error of 1e-11 of the largest entry.

y are the deviations from the motion. For a ball in space, y is the rotation vector in axes that move with the motion,
so that a steadily spinning body has constant matrices. With theta = N y of all balls, a neighbouring motion has the
speeds and accelerations

    u = u_0 + y' + W y,   u' = u_0' + y'' + W y' + W' y,   W y = omega_0 x theta.

Residuals M u' - f are computed without W' y, whose part M W' of K is added to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.spatial_frame import skew
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.time.spring_displacements import displacements

OFFSETS, WEIGHTS = np.array([2.0, 1.0, -1.0, -2.0]), np.array([-1.0, 8.0, -8.0, 1.0]) / 12.0
"""Offsets and weights of central differences of fourth order."""
STEP = 1e-4
"""Step in positions, in sizes of the mechanism and rad; steps in accelerations and forces may be larger, since the
equations are affine in them."""
_NEWTON, _BALANCED = 50, 1e-12
"""Newton steps to an equilibrium in each load step, and length of the last one, in sizes of the mechanism or rad."""
_FARTHEST, _LOAD_STEPS = 0.1, 256
"""Largest Newton step, since longer ones may lead to a distant equilibrium, and inverse of the smallest load step."""


@dataclass(frozen=True, eq=False)
class Linear:
    """Linear equations M y'' + C y' + K y = B p about an instant of a motion.

    Attributes
    ----------
    instant : State
    names : tuple of str
        Names of y: JOINT.angle, JOINT.position, BODY.axial_K, BODY.transverse_K; BODY.x, y, phi of a floating body; in
        space BODY.shape_K, and turn_x, turn_y, turn_z of a ball or a floating body.
    M, C, K : ndarray (n, n)
    B : ndarray (n, inputs)
        Columns for the magnitudes of loads, then for prescribed accelerations.
    """

    instant: State
    names: tuple[str, ...]
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    B: np.ndarray


def state_matrix(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """State matrix A of x' = A x, x = (y, y'), (2 n, 2 n)."""
    n = len(M)
    return np.vstack([np.eye(n, 2 * n, n), -np.linalg.solve(M, np.hstack([K, C]))])


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of motion of a mechanism as functions of deviations x = (y, y', y'', p) from an instant.

    Methods raise ArithmeticError if loops don't close nearby.

    Attributes
    ----------
    system : System
    choice : Choice
        Its n independent speeds y'.
    """

    system: Any
    choice: Choice

    @property
    def engine(self) -> Engine:
        return self.system.engine

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of y: JOINT.angle or JOINT.position, JOINT.turn_x of a spherical joint, the shapes of a body; BODY.x
        and BODY.phi or BODY.turn_x of a free body."""
        names = (self.engine.layout.coordinates[k][0] for k in self.choice.independent)
        return tuple(name.replace(".omega_", ".turn_").replace(".shapes.", ".shape_") for name in names)

    @cached_property
    def shapes(self) -> np.ndarray:
        """Mask of those that are amplitudes of shapes, (n,)."""
        return self.engine.shapes[self.choice.independent]

    @cached_property
    def measure(self) -> np.ndarray:
        """Their units (n,): 1 rad, or the mechanism's size."""
        return self.engine.measure[self.choice.independent]

    def _on(self, base: State) -> State:
        """The same instant on the constraints, by its independent speeds and accelerations; the tables have it."""
        self.engine.demand(self.choice, np.array([base.t]), np.concatenate([base.q, base.u, base.du])[None])
        return self.engine.state(base.t, self.choice)

    def scales(self, base: State) -> tuple[float, float, np.ndarray]:
        """Largest rate and acceleration in measures, and sizes of steps of the inputs (inputs,)."""
        on, engine = self._on(base), self.engine
        rate, acceleration = (max(1.0, (abs(part) / engine.measure).max(initial=0.0)) for part in (on.u, on.du))
        push = np.full(engine.inputs, max(1.0, abs(engine.motion[3]).max(initial=0.0)))
        push[len(on.sizes) :] = acceleration
        return rate, acceleration, push

    def spinning(self, base: State) -> tuple[State, np.ndarray, np.ndarray]:
        """The instant on the constraints, partial velocities N (n, speeds) of y' there, and W (n, n)."""
        on, which = self._on(base), self.choice.independent
        N = self.engine.basis(self.choice)
        return on, N, (spin_of(self.engine, on.u) @ N.T)[which]

    def given(self, base: State, x: np.ndarray) -> np.ndarray:
        """Coordinates, speeds, accelerations and inputs of neighbours at deviations x (k, 3 n + inputs)."""
        (on, N, W), which = self.spinning(base), self.choice.independent
        y, v, a, inputs = np.split(x, len(which) * np.arange(1, 4), axis=1)
        u, du = (np.tile(part, (len(x), 1)) for part in (on.u, on.du))
        u[:, which] += v + y @ W.T
        du[:, which] += a + v @ W.T
        added = np.zeros((len(x), self.engine.inputs))
        added[:, : inputs.shape[1]] = inputs
        return np.hstack([self.engine.advanced(on.q, y @ N), u, du, added])

    def residuals(self, base: State, x: np.ndarray, times: np.ndarray | None = None) -> np.ndarray:
        """Residuals, then all speeds, (k, n + speeds), at deviations x (k, 3 n + inputs), at the time of the instant or
        at others [s]."""
        return self.engine.demand(
            self.choice, np.full(len(x), base.t) if times is None else times, self.given(base, x)
        )

    def rates(self, base: State) -> tuple[np.ndarray, np.ndarray]:
        """Rates and accelerations of y, (n,) each."""
        return base.u[self.choice.independent], base.du[self.choice.independent]

    def moved(self, base: State, x: np.ndarray) -> State:
        """Instant on the constraints with deviation x (3 n,)."""
        self.residuals(base, x[None])
        return self.engine.state(base.t, self.choice)

    def deformed(self, base: State, y: np.ndarray, v: np.ndarray, a: np.ndarray) -> State:
        """Instant with other y, y' and y'' (n,), where all of y are shapes; loops are not closed yet."""
        (own, speeds), which = self.engine.own.T, self.choice.independent
        q, u, du = base.q.copy(), base.u.copy(), base.du.copy()
        q[own[np.searchsorted(speeds, which)]], u[which], du[which] = y, v, a
        return replace(base, q=q, u=u, du=du)

    def lacking(self, states: Sequence[State]) -> np.ndarray:
        """Residuals at the accelerations of instants, (k, n)."""
        given = np.array([np.concatenate([each.q, each.u, each.du]) for each in states])
        return self.engine.demand(self.choice, np.array([each.t for each in states]), given)[:, : len(self.names)]

    def apart(self, start: State, *others: State) -> np.ndarray:
        """y and y' of other instants less those of a start, without whole turns, (k, 2 n)."""
        (_, _, W), which, found = self.spinning(start), self.choice.independent, []
        for other in others:
            y = self._turned(start.q, other.q)[which]
            found.append(np.concatenate([y, (other.u - start.u)[which] - W @ y]))
        return np.array(found).reshape(len(others), -1)

    def _turned(self, q: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Difference of coordinates as a step of all speeds, without whole turns, (speeds,)."""
        (own, speeds), found = self.engine.own.T, np.zeros(self.engine.size)
        found[speeds] = (other - q)[own]
        turns = self.engine.turns & ~self.engine.shapes
        found[turns] -= whole_turns(found[turns])
        for k, s in self.engine.balls.tolist():
            from scipy.spatial.transform import Rotation

            first, second = (Rotation.from_quat(np.roll(each[k : k + 4], -1)) for each in (q, other))
            found[s : s + 3] = (first.inv() * second).as_rotvec()
        return found

    def beside(self, start: State, x: np.ndarray) -> State:
        """Start with y and y' changed by ``x`` (2 n,), on the constraints, with its accelerations by the equations."""
        (on, N, W), which, (y, rate) = self.spinning(start), self.choice.independent, np.split(x, 2)
        u = on.u.copy()
        u[which] += rate + W @ y
        return self.system.project(start.t, self.engine.advanced(on.q, (y @ N)[None])[0], u, self.choice)

    def mass(self, base: State) -> np.ndarray:
        """Mass matrix M of y, (n, n), by unit accelerations, in which the residual is linear."""
        n, scale = len(self.names), self.scales(base)[1] * self.measure
        found = self.residuals(base, np.vstack([np.zeros(3 * n), np.eye(n, 3 * n, 2 * n) * scale[:, None]]))[:, :n]
        return (found[1:] - found[0]).T / scale

    def turning(self, base: State, by_y: np.ndarray) -> np.ndarray:
        """W', (n, n): change of the accelerations y'' by y where axes of y move, from the derivatives by y of all
        speeds (speeds, n)."""
        spin, faster = (spin_of(self.engine, part) for part in (base.u, base.du))
        if not spin.any() and not faster.any():
            return np.zeros(2 * (len(self.names),))
        N = self.spinning(base)[1]
        # N' along the motion: by y alone the speeds change by (N y)' and omega x theta
        return (faster @ N.T + spin @ (by_y - spin @ N.T))[self.choice.independent]

    def rests(self, base: State) -> tuple[np.ndarray, Iterator[tuple[np.ndarray, np.ndarray]]]:
        """Stiffness (n, n) by the strain of shapes, and every spring's relative displacements in unit motions of y,
        (n, parts), with their stiffnesses."""
        n, sections = len(self.names), []
        N = self.spinning(base)[1]
        for unit in np.vstack([np.zeros(3 * n), np.eye(n, 3 * n, n)]):
            self.residuals(base, unit[None])
            sections.append(self.engine.work.sections.copy())
        moved = np.array(sections[1:]) - sections[0]
        return N @ self.engine.stiffness @ N.T, displacements(self.engine, sections[0], moved)

    def neighbours(
        self, base: State, columns: Sequence[int] | np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Deviations of four neighbours for each of all or some columns of x, (4 k, 3 n + inputs), their distances and
        weights in its derivative, (k, 4)."""
        rate, acceleration, push = self.scales(base)
        own = self.measure
        steps = np.concatenate([STEP * own, 1e-2 * rate * own, acceleration * own, push])
        chosen = np.arange(len(steps)) if columns is None else np.asarray(columns, dtype=int)
        x, away = np.zeros((4 * len(chosen), len(steps))), np.outer(steps[chosen], OFFSETS)
        x[np.arange(len(x)), np.repeat(chosen, 4)] = away.ravel()
        return x, away, WEIGHTS / steps[chosen, None]

    def derivatives(self, base: State, columns: Sequence[int] | np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Values of :meth:`residuals` at an instant (n + more,), and their derivatives by x or some of its columns."""
        x, _, weights = self.neighbours(base, columns)
        found = self.residuals(base, np.vstack([x, np.zeros(x.shape[1])]))
        return found[-1], np.einsum("cj,cjn->nc", weights, found[:-1].reshape(*weights.shape, found.shape[1]))

    def slopes(
        self, base: State, columns: Sequence[int] | np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residual D (n,) at an instant and its derivatives by x (n, 3 n + inputs), or by some of its columns."""
        found, slope = self.derivatives(base, columns)
        return found[: len(self.names)], slope[: len(self.names)]

    def matrices(self, base: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrices M, C and K about an instant."""
        n, M, slope = len(self.names), self.mass(base), self.derivatives(base, range(2 * len(self.names)))[1]
        return M, slope[:n, n:], slope[:n, :n] + M @ self.turning(base, slope[n:, :n])

    def linear(self, base: State) -> Linear:
        """Linear equations about an instant."""
        first = 3 * len(self.names)
        by_inputs = self.slopes(base, range(first, first + len(self.scales(base)[2])))[1]
        return Linear(base, self.names, *self.matrices(base), -by_inputs)

    @property
    def _unknown(self) -> np.ndarray:
        """Columns of x that an equilibrium determines: shapes, and accelerations of all other coordinates."""
        n = len(self.shapes)
        return np.where(self.shapes, 0, 2 * n) + np.arange(n)

    def equilibrium(self, base: State, rates: tuple[np.ndarray, np.ndarray] | None = None) -> State | None:
        """Steady deformation under the loads and accelerations at an instant, by Newton's method; None if not found.

        Other coordinates and their rates are those of the instant; their accelerations follow from the equations.
        ``rates``: speeds and accelerations of the shapes, zero by default.
        """
        shapes, columns, n = self.shapes, self._unknown, len(self.shapes)

        def corrected(state: State, left: np.ndarray) -> State | None:
            """Instant with the residual ``left``; None if short steps don't converge."""
            last = np.inf
            try:
                for _ in range(_NEWTON):
                    found, slope = self.slopes(state, columns)
                    x = np.zeros(3 * n)
                    x[columns] = np.linalg.solve(slope, left - found)
                    state, size = self.moved(state, x), (abs(x[:n]) / self.measure).max(initial=0.0)
                    if size < _BALANCED and size >= 0.5 * last:  # down to rounding: axial forces need all digits
                        return state
                    if not size < _FARTHEST:
                        break
                    last = size
            except (ArithmeticError, np.linalg.LinAlgError):
                pass
            return None

        v, a = self.rates(base)
        x = np.zeros((3, n))
        x[1, shapes], x[2] = -v[shapes], -a
        if rates is not None:
            x[1:, shapes] += rates
        try:
            state = self.moved(base, x.ravel())
            load = self.slopes(state, [])[0]
        except ArithmeticError:
            return None
        done, share = 0.0, 1.0  # the whole load is tried first, then halves as often as needed
        while done < 1.0:
            found = corrected(state, (1.0 - done - share) * load)
            if found is None:
                share *= 0.5
                if share * _LOAD_STEPS < 1.0:
                    return None
            else:
                state, done = found, done + share
                share = min(2.0 * share, 1.0 - done)
        return state

    def followed(self, still: State) -> tuple[Any, np.ndarray, np.ndarray]:
        """Residual of the unknowns of an equilibrium by instants [s] near that of ``still``, (k,) and (k, n) -> (k, n);
        its derivative there (n, n), and units of the unknowns (n,).

        Other coordinates keep their accelerations.
        """
        (v, a), free, columns, n = self.rates(still), ~self.shapes, self._unknown, len(self.shapes)

        def residual(later: np.ndarray, unknown: np.ndarray) -> np.ndarray:
            x = np.zeros((len(later), 3 * n))
            x[:, columns] = unknown
            x[:, :n][:, free] += later[:, None] * v[free] + 0.5 * later[:, None] ** 2 * a[free]
            x[:, n : 2 * n][:, free] = later[:, None] * a[free]
            return self.residuals(still, x, later)[:, :n]

        units = self.measure * np.where(self.shapes, 1.0, self.scales(still)[1])
        return residual, self.slopes(still, columns)[1], units

    def at_rest(self, base: State) -> tuple[np.ndarray, np.ndarray]:
        """Matrices M and K at an instant at rest, K from the strain of shapes and springs without the effect of their
        forces."""
        if not len(self.names):  # everything is prescribed
            return np.zeros((0, 0)), np.zeros((0, 0))
        K, springs = self.rests(base)
        for parts, stiffness in springs:
            K = K + (stiffness * parts) @ parts.T
        return self.mass(base), K


def prepare(system: Any, state: State) -> tuple[Equations, State]:
    """Equations of a system at a state, and that state: by its choice of speeds; in the plane by another one, of which
    free drives are independent if possible."""
    if not system.in_space:
        state = replace(state, choice=system.engine.chosen_at(state, system.engine.free_drives))
    return Equations(system, state.choice), state


def spin_of(engine: Engine, u: np.ndarray) -> np.ndarray:
    """Matrix of omega x of every ball, (speeds, speeds)."""
    found = np.zeros((engine.size, engine.size))
    for s in engine.balls[:, 1].tolist():
        found[s : s + 3, s : s + 3] = skew(u[s : s + 3])
    return found
