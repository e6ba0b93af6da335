"""Positions, rotations and motions of sections of deforming bodies, from a motion's scalars."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, cast

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.generated.spatial_shapes import section
from kaneflex.mechanism.body_frame import BodyFrame, Rates, acceleration, applied, cross, turning, velocity
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial_frame import SpatialFrame
from kaneflex.multibody.dynamics.arrays import Instants
from kaneflex.multibody.model import layout as at
from kaneflex.support.array_kernels import on_arrays


@dataclass(frozen=True, eq=False)
class Deformed:
    """Motion of a point relative to its body's axes, in these, (2 or 3, n_times) each.

    Attributes
    ----------
    moved : Rates
        Its displacement.
    angle : ndarray
        Rotation of its section: in the plane (1, n_times), in space a vector (3, n_times).
    turned : ndarray
        Axes of its section as columns, (D, D, n_times).
    turning : tuple of two ndarray
        Angular velocity and its rate.
    """

    moved: Rates
    angle: np.ndarray
    turned: np.ndarray
    turning: tuple[np.ndarray, np.ndarray]


def deformed(shapes: Any, at: np.ndarray, amplitudes: Rates) -> Deformed:
    """Motion of a point of a deforming body; a point beside its carrier moves rigidly with the section there."""
    place, n = shapes.carrier(at), len(at)
    (rows, G), arm = shapes.at(place), np.subtract(at, place[:n])
    q, u, b = amplitudes
    d, d_rate, d_accel = (rows[:n] @ of for of in (q, u, b))
    for k in np.flatnonzero(G[:n].any(axis=(1, 2))):
        by_q = G[k] @ q
        d[k] += 0.5 * np.einsum("jt,jt->t", q, by_q)
        d_rate[k] += np.einsum("jt,jt->t", u, by_q)
        d_accel[k] += np.einsum("jt,jt->t", b, by_q) + np.einsum("jt,jt->t", u, G[k] @ u)
    theta, rate, accel = (rows[n:] @ of for of in (q, u, b))
    turned, omega, epsilon = turn_in_space(theta, rate, accel) if n == 3 else (turning(theta[0]), rate[0], accel[0])
    if arm.any():
        carried = applied(turned, arm)
        d += carried - arm[:, None]
        d_rate += velocity(omega, carried)
        d_accel += acceleration(omega, epsilon, carried)
    return Deformed((d, d_rate, d_accel), theta, turned, (omega, epsilon))


def turn_in_space(theta: np.ndarray, rate: np.ndarray, accel: np.ndarray) -> list[np.ndarray]:
    """Axes of a section, its angular velocity and acceleration."""
    turned, T, gamma = (np.ascontiguousarray(np.moveaxis(part, 0, -1)) for part in sections(theta.T, rate.T))
    return [turned, applied(T, rate), applied(T, accel) + gamma]


def sections(theta: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes R and T (n, 3, 3) of sections that stand at theta (n, 3) and turn by T theta', and T' theta' (n, 3)."""
    found = np.zeros((21, len(theta)))
    on_arrays(section)(np.vstack([theta.T, rate.T]), 0, found, 0)
    return found[:9].T.reshape(-1, 3, 3), found[9:18].T.reshape(-1, 3, 3), found[18:].T


class DeformingMotion(RigidMotion, ABC):
    """Motion of bodies that deform, by the names of a rigid motion's scalars; ``system``: that of the record."""

    motion: Any
    system: Any
    record: Any
    """Record of the instants, (n_times, kept)."""

    @property
    def mechanism(self) -> Any:
        """NumericMechanism or SpatialMechanism."""
        return self.system.mechanism

    @cached_property
    def instants(self) -> Instants:
        """Record of the instants by names."""
        return self.system.engine.instants(self.record)

    @abstractmethod
    def taken(self, instants: np.ndarray) -> Self: ...

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates of the equations and their rates, (n, n_times) each."""
        found = self.instants
        return found.q.T, self.system.engine.rates_of(found.q, found.u).T

    @property
    def shapes(self) -> Mapping[str, Any]:
        """Shapes of the bodies that deform."""
        shapes: Mapping[str, Any] = self.system.engine.layout.shapes
        return shapes

    def modal(self, body: str) -> Rates:
        """Amplitudes of a body's shapes, their rates and accelerations, (count, n_times) each."""
        found, (places, speeds) = self.instants, self.system.engine.amplitudes(body)
        return found.q[:, places].T, found.u[:, speeds].T, found.du[:, speeds].T

    def contact(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Gap [m or rad] and normal force [N or N m] of a contact."""
        return self[f"{name}.gap"], self[f"{name}.force"]

    def friction(self, name: str) -> np.ndarray:
        """Friction force or torque on the second side of a joint or contact [N or N m]."""
        return self[f"{name}.friction"]

    @abstractmethod
    def recording(self, record: np.ndarray) -> Self:
        """Motion with another record of its instants."""

    @cached_property
    def quiet(self) -> Self:
        """The same states with accelerations and reactions without axial vibration of the links.

        Axial shapes are not accelerated, as far as the joints allow: the axial force is then that of the remaining
        motion, up to the squared ratio of frequencies. The motion is unchanged if masses differ too much for a
        solution, and at instants at which friction sticks or rigid sides rest on each other.
        """
        engine, of, record, seen = self.system.engine, self.system.record, self.record.copy(), self.instants
        still = [speed for body, shapes in self.shapes.items()
                 for speed in engine.amplitudes(body)[1][: shapes.counts[0]].tolist()]  # fmt: skip
        if not still:
            return self
        rows = engine.rows_of(self.times, seen.q, seen.u, seen.du)
        modes = seen.touching[:, :, -at.MODE_SIZE :]
        rows[:, engine.columns["modes"]] = modes.reshape(len(rows), -1)
        try:
            found = self.system.nearby(rows, still)
        except ArithmeticError:
            return self
        for columns in (of.a, of.forces):
            record[:, columns] = np.where(self._locked(modes[:, :, 0])[:, None], record[:, columns], found[:, columns])
        return self.recording(record)

    def _locked(self, modes: np.ndarray) -> np.ndarray:
        """True at instants with sticking friction, or rigid sides at rest on each other, (n_times,), by the modes of
        frictions and contacts, (n_times, rows).

        Such a constraint may hold a link's end along its axis, or lock the loops of the rigid bodies: without axial
        acceleration the link would have to bend violently instead.
        """
        engine, contacts = self.system.engine, self.system.mechanism.contacts.values()
        rigid = len(engine.frictions) + np.flatnonzero([contact.law == "newton" for contact in contacts])
        return (modes == at.STICKING).any(axis=1) | (modes[:, rigid] != at.OPEN).any(axis=1)

    def link(self, name: str) -> Link:
        """Finite elements of an elastic link."""
        return cast(Link, self.shapes[name].link)

    def section_frame(self, side: Any) -> tuple[Any, Any]:
        """Axes of the section at a point, and the point in these."""
        if side.body not in self.shapes:
            return super().section_frame(side)
        frame = self.frame(side.body)
        at = np.asarray(side.at, float)
        kind, origin = (PlanarSection, (0.0, 0.0)) if len(at) == 2 else (SpatialSection, side.arm)
        return kind(self, side.body, frame, at, self.deformed(side.body, at)), replace(side, at=origin)

    def deformed(self, body: str, at: np.ndarray) -> Deformed:
        """Motion of a point of a deforming body relative to its body's axes."""
        return deformed(self.shapes[body], at, self.modal(body))


@dataclass(frozen=True, eq=False)
class SectionFrame(BodyFrame):
    """Axes of a section of a deforming body, with their origin at one of its points.

    ``frame``: the body's axes.
    """

    frame: Any
    at: np.ndarray
    deformed: Deformed

    def _vector(self, *names: str) -> np.ndarray:
        """Place, velocity and acceleration of the point."""
        moved = self.deformed.moved
        place = self.at[:, None] + moved[0]
        if names[0] == "x":
            return self.frame.place(place)
        if names[0] == "v_x":
            return self.frame.velocity(place, moved[1])
        return self.frame.acceleration(place, *moved[1:])


    @cached_property
    def axes(self) -> np.ndarray:
        return np.einsum("ijt,jkt->ikt", self.frame.axes, self.deformed.turned)


class PlanarSection(SectionFrame):
    """Section of a planar body."""

    def _scalar(self, key: str) -> np.ndarray:
        if key in ("c", "s"):
            return self.axes["cs".index(key), 0]
        return getattr(self.frame, key) + self.deformed.turning[key == "epsilon"]


class SpatialSection(SectionFrame, SpatialFrame):
    """Section of a body in space."""

    @property
    def omega(self) -> np.ndarray:
        return self.frame.omega + self.frame.to_global(self.deformed.turning[0])

    @property
    def epsilon(self) -> np.ndarray:
        frame, (omega, alpha) = self.frame, self.deformed.turning
        return frame.epsilon + cross(frame.omega, frame.to_global(omega)) + frame.to_global(alpha)
