"""Equations of a mechanism in space for linear models and equilibria."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from kaneflex.mechanism.spatial_frame import skew
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import State
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
class SpatialEquations(Equations):
    """Equations of a system in space."""

    system: SpatialSystem

    def _stiffness(self) -> np.ndarray:
        from scipy.linalg import block_diag

        system, K = self.system, np.zeros((self.engine.size, self.engine.size))
        K[np.ix_(system.modal_speeds, system.modal_speeds)] = block_diag(*(
            shapes.stiffness for shapes in system.layout.shapes.values()
        ))  # fmt: skip
        return K

    def _springs(self, sections: np.ndarray, moved: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        from scipy.spatial.transform import Rotation

        system, axes = self.system, self.system.work.axes
        tables, place, v, w = system.tables, sections[:, :3], moved[:, :, 3:6], moved[:, :, 9:12]
        for (first, second, axis, _), numbers in zip(tables.springs, tables.stiffness, strict=True):
            if axis < 0:
                yield pulled(place, v, np.array([first, second]), numbers)
            else:
                yield (w[:, second] - w[:, first]) @ axes[axis][:, None], numbers[:1]
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
