"""Positions, rotations and motions of sections of deforming bodies in space, from a motion's scalars."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numba import njit

from kaneflex.generated import spatial_shapes as shape_laws
from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.spatial import Side
from kaneflex.mechanism.spatial_frame import SpatialFrame, applied, cross
from kaneflex.multibody.dynamics.spatial_work import Instants
from kaneflex.multibody.model.spatial_layout import Deformable
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.support.fingerprint import made_of

_RATES = (("", "m"), ("_rate", "m/s"), ("_accel", "m/s^2"))


def modal_scalars(body: str, count: int) -> Iterator[tuple[str, str]]:
    """Names and units of a body's modal coordinates, then of their rates and accelerations."""
    for tail, unit in _RATES:
        yield from ((f"{body}.shape_{k}{tail}", unit) for k in range(count))


def modal_series(system: SpatialSystem, found: Instants) -> list[np.ndarray]:
    """Modal coordinates, rates and accelerations of all deforming bodies, (n_times, count) each."""
    series, first, modal = list[np.ndarray](), 0, system.engine.modal
    for shapes in system.layout.shapes.values():
        own = slice(first, first + shapes.count)
        q, u = (places[own] for places in modal)
        series += [found.q[:, q], found.u[:, u], found.du[:, u]]
        first += shapes.count
    return series


@dataclass(frozen=True, eq=False)
class Deformed:
    """Motion of a point relative to its body's axes, in these, (3, n_times) each.

    Attributes
    ----------
    moved : Rates
        Its displacement.
    turned : ndarray (3, 3, n_times)
        Axes of its section, columns.
    turning : tuple of two ndarray
        Their angular velocity and its rate.
    """

    moved: Rates
    turned: np.ndarray
    turning: tuple[np.ndarray, np.ndarray]


def deformed(shapes: Deformable, side: Side, amplitudes: Rates) -> Deformed:
    """Motion of a point of a deforming body; a point beside its carrier moves rigidly with the section there."""
    place = shapes.carrier(side.at)
    (rows, G), beside = shapes.at(place), np.subtract(side.at, place)
    q, u, b = amplitudes
    d, d_rate, d_accel = (rows[:3] @ of for of in (q, u, b))

    def second(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return (one * (G @ other)).sum(axis=1)

    d += 0.5 * second(q, q)
    d_rate += second(q, u)
    d_accel += second(q, b) + second(u, u)
    turned, T, gamma = (np.ascontiguousarray(np.moveaxis(part, 0, -1))
                        for part in sections((rows[3:6] @ q).T, (rows[3:6] @ u).T))  # fmt: skip
    omega = applied(T, rows[3:6] @ u)
    alpha = applied(T, rows[3:6] @ b) + gamma
    arm = applied(turned, beside)
    carried = cross(omega, arm)
    moved = (d + arm - beside[:, None], d_rate + carried,
             d_accel + cross(alpha, arm) + cross(omega, carried))  # fmt: skip
    return Deformed(moved, turned, (omega, alpha))


def sections(theta: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes R and T (n, 3, 3) of sections that stand at theta (n, 3) and turn by T theta', and T' theta' (n, 3)."""
    found = np.zeros((len(theta), 21))
    _turn(np.hstack([theta, rate]), found)
    return found[:, :9].reshape(-1, 3, 3), found[:, 9:18].reshape(-1, 3, 3), found[:, 18:]


@njit(cache=True, error_model="numpy")
@made_of(shape_laws.__file__)
def _turn(angles, found):
    """Evaluate `spatial_shapes.section` for rows of angles and their rates, (n_times, 6), into `found`, (., 21)."""
    for k in range(len(angles)):
        shape_laws.section(angles[k], 0, found[k], 0)


@dataclass(frozen=True, eq=False)
class SectionFrame(SpatialFrame):
    """Axes of a section of a deforming body, with their origin at one of its points."""

    at: np.ndarray
    deformed: Deformed

    @cached_property
    def axes(self) -> np.ndarray:
        return np.einsum("ijt,jkt->ikt", self._frame.axes, self.deformed.turned)

    @property
    def omega(self) -> np.ndarray:
        return self._frame.omega + self._frame.to_global(self.deformed.turning[0])

    @property
    def epsilon(self) -> np.ndarray:
        frame, (omega, alpha) = self._frame, self.deformed.turning
        return frame.epsilon + cross(frame.omega, frame.to_global(omega)) + frame.to_global(alpha)

    @cached_property
    def _frame(self) -> SpatialFrame:
        return SpatialFrame(self.motion, self.body)

    def _vector(self, *names: str) -> np.ndarray:
        """Place, velocity and acceleration of the point."""
        moved = self.deformed.moved
        place = self.at[:, None] + moved[0]
        if names[0] == "x":
            return self._frame.place(place)
        if names[0] == "v_x":
            return self._frame.velocity(place, moved[1])
        return self._frame.acceleration(place, *moved[1:])
