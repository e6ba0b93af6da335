"""Coupled equations linearised about an instant of a motion, in independent coordinates, in the plane and in space.

The residual D(t, y, y', y'', p) of the equations of motion (generalised forces M a - f of the independent coordinates
y, with sizes of loads and prescribed accelerations p) is zero on the motion. Small motions about it satisfy

    M y'' + C y' + K y = B p,   M = dD/dy'', C = dD/dy', K = dD/dy, B = -dD/dp:

these derivatives include geometric stiffening and the loops' kinematics. The residual is smooth and accurate to
rounding: central differences of fourth order have an error of 1e-11 of the largest entry.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

OFFSETS, WEIGHTS = np.array([2.0, 1.0, -1.0, -2.0]), np.array([-1.0, 8.0, -8.0, 1.0]) / 12.0
"""Offsets and weights of central differences of fourth order."""
STEP = 1e-4
"""Step in positions, in sizes of the mechanism and rad; steps in accelerations and forces may be larger, since the
equations are affine in them."""
_NEWTON, _BALANCED = 50, 1e-12
"""Newton steps to an equilibrium in each load step, and length of the last one, in sizes of the mechanism or rad."""
_FARTHEST, _LOAD_STEPS = 0.1, 256
"""Largest Newton step, since longer ones may lead to a distant equilibrium, and inverse of the smallest load step."""

At = TypeVar("At")
"""Instant of a motion, planar or in space."""


@dataclass(frozen=True, eq=False)
class Linear(Generic[At]):
    """Linear equations M y'' + C y' + K y = B p about an instant of a motion.

    Attributes
    ----------
    instant : At
    names : tuple of str
        Names of y: JOINT.angle, JOINT.position, BODY.axial_K, BODY.transverse_K; BODY.x, y, phi of a floating body; in
        space BODY.shape_K, and turn_x, turn_y, turn_z of a ball or a floating body.
    M, C, K : ndarray (n, n)
    B : ndarray (n, inputs)
        Columns for the magnitudes of loads, then for prescribed accelerations.
    """

    instant: At
    names: tuple[str, ...]
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    B: np.ndarray


def state_matrix(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """State matrix A of x' = A x, x = (y, y'), (2 n, 2 n)."""
    n = len(M)
    return np.vstack([np.eye(n, 2 * n, n), -np.linalg.solve(M, np.hstack([K, C]))])


class Equations(ABC, Generic[At]):
    """Equations of motion of a mechanism as functions of deviations x = (y, y', y'', p) from an instant.

    Methods raise ArithmeticError if loops don't close nearby.

    Attributes
    ----------
    names : tuple of str
        Names of the n independent coordinates y.
    shapes : ndarray (n,)
        Mask of those that are amplitudes of shapes.
    measure : ndarray (n,)
        Their units: 1 rad, or the mechanism's size.
    """

    names: tuple[str, ...]
    shapes: np.ndarray
    measure: np.ndarray

    @abstractmethod
    def scales(self, base: At) -> tuple[float, float, np.ndarray]:
        """Largest rate and acceleration in measures, and sizes of steps of the inputs (inputs,)."""

    @abstractmethod
    def residuals(self, base: At, x: np.ndarray, times: np.ndarray | None = None) -> np.ndarray:
        """Residuals, and values that :meth:`turning` needs, (k, n + more), at deviations x (k, 3 n + inputs), at the
        time of the instant or at others [s]."""

    @abstractmethod
    def rates(self, base: At) -> tuple[np.ndarray, np.ndarray]:
        """Rates and accelerations of y, (n,) each."""

    @abstractmethod
    def moved(self, base: At, x: np.ndarray) -> At:
        """Instant on the constraints with deviation x (3 n,)."""

    @abstractmethod
    def mass(self, base: At) -> np.ndarray:
        """Mass matrix M of y, (n, n)."""

    @abstractmethod
    def rests(self, base: At) -> tuple[np.ndarray, Iterable[tuple[np.ndarray, np.ndarray]]]:
        """Stiffness (n, n) by the strain of shapes, and every spring's relative displacements in unit motions of y,
        (n, parts), with their stiffnesses."""

    @abstractmethod
    def deformed(self, base: At, y: np.ndarray, v: np.ndarray, a: np.ndarray) -> At:
        """Instant with other y, y' and y'' (n,), where all of y are shapes; loops are not closed yet."""

    @abstractmethod
    def lacking(self, states: Sequence[At]) -> np.ndarray:
        """Residuals at the accelerations of instants, (k, n)."""

    @abstractmethod
    def apart(self, start: At, *others: At) -> np.ndarray:
        """y and y' of other instants less those of a start, without whole turns, (k, 2 n)."""

    @abstractmethod
    def beside(self, start: At, x: np.ndarray) -> At:
        """Start with y and y' changed by ``x`` (2 n,), on the constraints, with its accelerations by the equations."""

    def turning(self, base: At, by_y: np.ndarray) -> np.ndarray:
        """Change of the accelerations y'' by y where axes of y move, (n, n), from the derivatives by y of what
        :meth:`residuals` has beyond residuals (more, n)."""
        return np.zeros(2 * (len(self.names),))

    def neighbours(
        self, base: At, columns: Sequence[int] | np.ndarray | None = None
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

    def derivatives(self, base: At, columns: Sequence[int] | np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Values of :meth:`residuals` at an instant (n + more,), and their derivatives by x or some of its columns."""
        x, _, weights = self.neighbours(base, columns)
        found = self.residuals(base, np.vstack([x, np.zeros(x.shape[1])]))
        return found[-1], np.einsum("cj,cjn->nc", weights, found[:-1].reshape(*weights.shape, found.shape[1]))

    def slopes(
        self, base: At, columns: Sequence[int] | np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residual D (n,) at an instant and its derivatives by x (n, 3 n + inputs), or by some of its columns."""
        found, slope = self.derivatives(base, columns)
        return found[: len(self.names)], slope[: len(self.names)]

    def matrices(self, base: At) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Matrices M, C and K about an instant."""
        n, M, slope = len(self.names), self.mass(base), self.derivatives(base, range(2 * len(self.names)))[1]
        return M, slope[:n, n:], slope[:n, :n] + M @ self.turning(base, slope[n:, :n])

    def linear(self, base: At) -> Linear[At]:
        """Linear equations about an instant."""
        first = 3 * len(self.names)
        by_inputs = self.slopes(base, range(first, first + len(self.scales(base)[2])))[1]
        return Linear(base, self.names, *self.matrices(base), -by_inputs)

    @property
    def _unknown(self) -> np.ndarray:
        """Columns of x that an equilibrium determines: shapes, and accelerations of all other coordinates."""
        n = len(self.shapes)
        return np.where(self.shapes, 0, 2 * n) + np.arange(n)

    def equilibrium(self, base: At, rates: tuple[np.ndarray, np.ndarray] | None = None) -> At | None:
        """Steady deformation under the loads and accelerations at an instant, by Newton's method; None if not found.

        Other coordinates and their rates are those of the instant; their accelerations follow from the equations.
        ``rates``: speeds and accelerations of the shapes, zero by default.
        """
        shapes, columns, n = self.shapes, self._unknown, len(self.shapes)

        def corrected(state: At, left: np.ndarray) -> At | None:
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

    def followed(self, still: At) -> tuple[Any, np.ndarray, np.ndarray]:
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

    def at_rest(self, base: At) -> tuple[np.ndarray, np.ndarray]:
        """Matrices M and K at an instant at rest, K from the strain of shapes and springs without the effect of their
        forces."""
        if not len(self.names):  # everything is prescribed
            return np.zeros((0, 0)), np.zeros((0, 0))
        K, springs = self.rests(base)
        for parts, stiffness in springs:
            K = K + (stiffness * parts) @ parts.T
        return self.mass(base), K


def pulled(
    places: np.ndarray, v: np.ndarray, ends: np.ndarray, numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Relative displacements (n, parts) of a spring's ends in unit motions ``v`` (n, sections, 2 or 3), along its line
    if it has a length or a damper, with their stiffnesses; numbers: stiffness, damping, length."""
    (first, second), (stiffness, damping, length) = ends, numbers
    parts, apart = v[:, second] - v[:, first], places[second] - places[first]
    if damping or length:
        parts = parts @ (apart / np.linalg.norm(apart))[:, None]
    return parts, np.full(parts.shape[1], stiffness)
