"""Equations of a mechanism in space in coordinates of its independent speeds, for linear models and equilibria.

y are the deviations from the motion. For a ball, y is the rotation vector in axes that move with the motion, so that a
steadily spinning body has constant matrices. With theta = N y of all balls, a neighbouring motion has the speeds and
accelerations

    u = u_0 + y' + W y,   u' = u_0' + y'' + W y' + W' y,   W y = omega_0 x theta.

Residuals M u' - f are computed without W' y, whose part M W' of K is added to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.spatial_frame import skew
from kaneflex.multibody.dynamics.spatial_entries import LACKED
from kaneflex.multibody.model.spatial_layout import BALL, COORDINATE, KIND, SLIDE, SPEED, TURN
from kaneflex.multibody.model.spatial_system import Choice, SpatialSystem, State
from kaneflex.multibody.time.linearisation import Equations, pulled
from kaneflex.multibody.time.spatial_curves import Curve

_APART = 1e-15
"""Spacing of fictitious instants, which only order the neighbours, as a share of their time, or of 1 s."""


@dataclass(frozen=True, eq=False)
class Neighbours(Curve):
    """Neighbouring states of a motion at fictitious successive times.

    Attributes
    ----------
    system : SpatialSystem
    start : State
        State of the motion itself.
    given : ndarray (k, coordinates + 2 speeds + inputs)
        Their coordinates, independent speeds and accelerations, and inputs.
    """

    system: SpatialSystem
    start: State
    given: np.ndarray

    @property
    def times(self) -> np.ndarray:
        """Fictitious times of the neighbours [s]."""
        return self.start.t + _APART * max(1.0, abs(self.start.t)) * np.arange(len(self.given))

    def rows(self, times: np.ndarray) -> np.ndarray:
        out = np.zeros((len(times), len(self.system.work.kept)))
        given = self.given[np.minimum(np.searchsorted(self.times, times), len(self.given) - 1)]
        self.system.near(self.start.choice, np.full(len(out), self.start.t), given, out)
        return out


@dataclass(frozen=True, eq=False)
class SpatialEquations(Equations[State]):
    """Equations of a system with a choice of speeds."""

    system: SpatialSystem
    choice: Choice

    @cached_property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """JOINT.angle or JOINT.position, JOINT.turn_x of a spherical joint, BODY.shape_k; BODY.x and BODY.turn_x of a
        free body."""
        speeds = (self.system.layout.speeds[k] for k in self.choice.independent)
        return tuple(name.replace(".omega_", ".turn_").replace(".shapes.", ".shape_") for name in speeds)

    @cached_property
    def shapes(self) -> np.ndarray:  # type: ignore[override]
        return np.isin(self.choice.independent, self.system.modal_speeds)

    @cached_property
    def measure(self) -> np.ndarray:  # type: ignore[override]
        return self.system.measure[self.choice.independent]

    def _on(self, base: State) -> State:
        """The same instant on the constraints, with the choice of speeds and the accelerations that are given."""
        return replace(self.system.project(base.t, base.q, base.u, self.choice), du=base.du)

    def scales(self, base: State) -> tuple[float, float, np.ndarray]:
        system = self.system
        self._on(base)
        rate, acceleration = (
            max(1.0, (abs(part) / system.measure).max(initial=0.0)) for part in (base.u, base.du)
        )
        force = np.full(len(base.sizes), abs(system.work.h).max(initial=1.0))
        return rate, acceleration, np.concatenate([force, acceleration * system.measure[system.driven_speeds]])

    def given(self, base: State, x: np.ndarray) -> np.ndarray:
        """Coordinates, speeds, accelerations and inputs of neighbours at deviations x (k, 3 n + inputs)."""
        base, which = self._on(base), self.choice.independent
        N, W = self.spinning(base)
        y, v, a, inputs = np.split(x, len(which) * np.arange(1, 4), axis=1)
        u, du = (np.tile(part, (len(x), 1)) for part in (base.u, base.du))
        u[:, which] += v + y @ W.T
        du[:, which] += a + v @ W.T
        added = np.zeros((len(x), len(self.system.inputs)))
        added[:, : inputs.shape[1]] = inputs
        return np.hstack([self.system.advanced(base.q, y @ N), u, du, added])

    def residuals(self, base: State, x: np.ndarray, times: np.ndarray | None = None) -> np.ndarray:
        """Residuals, then all speeds, (k, n + speeds); these take no mass matrices."""
        return self._lacked(np.full(len(x), base.t) if times is None else times, self.given(base, x))

    def _lacked(self, times: np.ndarray, given: np.ndarray) -> np.ndarray:
        out = np.zeros((len(times), len(self.names) + self.system.speeds))
        self.system.near(self.choice, times, given, out, LACKED)
        return out

    def rates(self, base: State) -> tuple[np.ndarray, np.ndarray]:
        return base.u[self.choice.independent], base.du[self.choice.independent]

    def moved(self, base: State, x: np.ndarray) -> State:
        which = self.choice.independent
        found = self.beside(base, x[: 2 * len(which)])
        found.du[which] = base.du[which] + x[2 * len(which) :]
        return found

    def deformed(self, base: State, y: np.ndarray, v: np.ndarray, a: np.ndarray) -> State:
        system, which = self.system, self.choice.independent
        q, u, du = base.q.copy(), base.u.copy(), base.du.copy()
        q[system.modal_coordinates[np.searchsorted(system.modal_speeds, which)]], u[which], du[which] = y, v, a
        return replace(base, q=q, u=u, du=du)

    def lacking(self, states: Sequence[State]) -> np.ndarray:
        given = np.array([np.concatenate([each.q, each.u, each.du]) for each in states])
        return self._lacked(np.array([each.t for each in states]), given)[:, : len(self.names)]

    def apart(self, start: State, *others: State) -> np.ndarray:
        which, (_, W), found = self.choice.independent, self._moving(start), []
        for other in others:
            y = self._turned(start.q, other.q)[which]
            found.append(np.concatenate([y, (other.u - start.u)[which] - W @ y]))
        return np.array(found)

    def beside(self, start: State, x: np.ndarray) -> State:
        which, (N, W), (y, rate) = self.choice.independent, self._moving(start), np.split(x, 2)
        u = start.u.copy()
        u[which] += rate + W @ y
        return self.system.project(start.t, self.system.advanced(start.q, (y @ N)[None])[0], u, self.choice)

    def _moving(self, start: State) -> tuple[np.ndarray, np.ndarray]:
        """N and W of :meth:`spinning` at an instant."""
        self._on(start)
        return self.spinning(start)

    def _turned(self, q: np.ndarray, other: np.ndarray) -> np.ndarray:
        """Difference of coordinates as a step of all speeds, without whole turns, (speeds,)."""
        from scipy.spatial.transform import Rotation

        found = np.zeros(self.system.speeds)
        for kind, k, s in self.system.tables.nodes[:, [KIND, COORDINATE, SPEED]].tolist():
            if kind == BALL:
                first, second = (Rotation.from_quat(np.roll(each[k : k + 4], -1)) for each in (q, other))
                found[s : s + 3] = (first.inv() * second).as_rotvec()
            elif kind in (TURN, SLIDE):
                found[s] = other[k] - q[k]
                found[s] -= whole_turns(found[s]) * (kind == TURN)
        found[self.system.modal_speeds] = (other - q)[self.system.modal_coordinates]
        return found

    def mass(self, base: State) -> np.ndarray:
        self._on(base)
        N = self.system.basis(self.choice)
        return np.asarray(N @ self.system.mass() @ N.T)

    def spinning(self, base: State) -> tuple[np.ndarray, np.ndarray]:
        """Partial velocities N (n, speeds) of y', and W (n, n), at the position of ``work`` on the constraints."""
        N = self.system.basis(self.choice).copy()
        return N, (_omega(self.system, base.u) @ N.T)[self.choice.independent]

    def turning(self, base: State, by_y: np.ndarray) -> np.ndarray:
        """W', (n, n)."""
        spin, faster = _omega(self.system, base.u), _omega(self.system, base.du)
        if not spin.any() and not faster.any():
            return super().turning(base, by_y)
        N = self.spinning(self._on(base))[0]
        # N' along the motion: by y alone the speeds change by (N y)' and omega x theta
        return (faster @ N.T + spin @ (by_y - spin @ N.T))[self.choice.independent]

    def rests(self, base: State) -> tuple[np.ndarray, Iterator[tuple[np.ndarray, np.ndarray]]]:
        from scipy.linalg import block_diag

        system = self.system
        self._on(base)
        N = system.basis(self.choice).copy()
        sections, axes, moved = system.work.sections.copy(), system.work.axes.copy(), []
        for row in N:
            system.project(base.t, base.q, row, self.choice)
            moved.append(system.work.sections - sections)
        K = np.zeros((system.speeds, system.speeds))
        K[np.ix_(system.modal_speeds, system.modal_speeds)] = block_diag(*(
            shapes.stiffness for shapes in system.layout.shapes.values()
        ))  # fmt: skip
        return N @ K @ N.T, self._springs(sections, axes, np.array(moved))

    def _springs(
        self, sections: np.ndarray, axes: np.ndarray, moved: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        from scipy.spatial.transform import Rotation

        tables, place, v, w = self.system.tables, sections[:, :3], moved[:, :, 3:6], moved[:, :, 9:12]
        for ends, numbers in zip(tables.springs, tables.stiffness, strict=True):
            yield pulled(place, v, ends, numbers)
        for (first, second, axis, _), (stiffness, *_) in zip(tables.twists, tables.torsion, strict=True):
            yield (w[:, second] - w[:, first]) @ axes[axis][:, None], np.array([stiffness])
        for (first, second, one, other), numbers in zip(tables.bushings, tables.cushions, strict=True):
            E = axes[one : one + 3]
            slid = v[:, second] - v[:, first] - np.cross(w[:, first], place[second] - place[first])
            phi = Rotation.from_matrix(E @ axes[other : other + 3].T).as_rotvec()
            turned = (w[:, second] - w[:, first]) @ E.T @ _turned(phi).T
            yield np.hstack([slid @ E.T, turned]), numbers[:6]


def _omega(system: SpatialSystem, u: np.ndarray) -> np.ndarray:
    """Matrix of omega x of every ball, (speeds, speeds)."""
    found = np.zeros((system.speeds, system.speeds))
    for s in system.tables.nodes[system.tables.nodes[:, KIND] == BALL, SPEED].tolist():
        found[s : s + 3, s : s + 3] = skew(u[s : s + 3])
    return found


def _turned(phi: np.ndarray) -> np.ndarray:
    """Matrix H of the rates H omega of a rotation vector, see
    :func:`kaneflex.multibody.dynamics.spatial_bushings.cushion`."""
    theta, cross = np.linalg.norm(phi), skew(phi)
    curved = (1.0 - 0.5 * theta / np.tan(0.5 * theta)) / theta**2 if theta > 1e-4 else 1.0 / 12.0
    return np.eye(3) - 0.5 * cross + curved * cross @ cross
