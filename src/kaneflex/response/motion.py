"""Interface of a finished motion for sensors, section forces, events and pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import wrapped
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.section_forces import LinkForces

Section = np.ndarray
"""Axial force N (tension positive), shear force V [N] and bending moment M [N m] in link axes, exerted by the part
beyond a section on the part before it, (3, n_times); in space N, V_y, V_z, T, M_y, M_z."""


@dataclass(frozen=True, eq=False)
class Motion(ABC):
    """Motion of a model over some instants.

    Points are given by their body and their undeformed position in its axes, ``at`` [m]. Displacements are relative to
    the rigid mechanism, whose drives have the coordinates of this motion.

    Attributes
    ----------
    model : Model
    rigid : RigidMotion
        Rigid mechanism at these instants.
    coordinates : tuple of three ndarray (n, n_times)
        Elastic coordinates of the mechanism and their two rates; provided by a subclass.
    whole : Motion or None
        Motion that these instants were sampled from, which counts full turns of bodies.
    """

    model: Model
    rigid: RigidMotion
    whole: Motion | None = field(default=None, kw_only=True)

    @property
    def times(self) -> np.ndarray:
        """Instants [s], (n_times,)."""
        return self.rigid.times

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates named by :func:`kaneflex.solve.initial.start_coordinates`, and their rates, each (n, n_times)."""
        return self.coordinates[:2]

    @property
    def has_rigid_forces(self) -> bool:
        """True if forces of the rigid mechanism are available, too."""
        return False

    @abstractmethod
    def taken(self, instants: np.ndarray) -> Motion:
        """Motion at some of its instants, by their indices."""

    @abstractmethod
    def displacement(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> Rates:
        """Displacement (x, y) and rotation of a point in its body's axes, and their rates there; each (3, n_times)."""

    def nodes(self, link: str) -> np.ndarray:
        """Displacements u, v, theta of an elastic link's nodes in the axes of its equations, without foreshortening;
        (3 n, n_times). Unknown in coupled motions in space."""
        raise LookupError(link)

    def reaction(self, name: str) -> np.ndarray:
        """Component of a joint's force on its second body, or force of a drive, by its name in the motion's scalars."""
        return self.scalars[name]

    def spring_tension(self, name: str) -> np.ndarray:
        """Tension of a spring and damper [N], or torque of a torsional one against the rotation of its joint [N m]."""
        between = self.model.scene.springs[name].torsional_at is None
        return self.scalars[f"{name}.{'tension' if between else 'torque'}"]

    def modal(self, body: str) -> Rates:
        """Modal coordinates of a body and their two rates, (n, n_times) each; exist under preset coupled only."""
        return cast(Rates, self.scalars.modal(body))

    def contact(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Gap [m] and normal force [N] of a contact, (n_times,) each; exist in coupled motions only."""
        gap, force = self.scalars.contact(name)
        return gap, force

    def clearance(self, name: str) -> np.ndarray:
        """Position of a pin or block in a joint with clearance, (3, n_times).

        Relative to the other side: x and y in m, and the angle [rad]. For a pin in global axes; for a block along its
        guide, across it to the left, and its tilt. For a ball in space x, y and z, global.
        """
        return np.asarray(self.scalars.clearance(name))

    def friction(self, name: str) -> np.ndarray:
        """Friction force or torque on the second side of a joint or contact [N or N m], (n_times,)."""
        return np.asarray(self.scalars.friction(name))

    def section(self, link: str, x: float, after: bool = False) -> Section:
        """Section forces x [m] from a link's start; at a load, ``after`` selects the side."""
        return self._link_forces.section(link, x, after)

    @property
    def scalars(self) -> Any:
        """Frames of the bodies and forces on them in this motion, by the names of a rigid motion's scalars."""
        return self.rigid

    @property
    def rigid_forces(self) -> RigidMotion:
        """Rigid mechanism with its joint forces; valid if ``has_rigid_forces``."""
        return self.rigid

    @cached_property
    def of_rigid(self) -> Motion:
        """Motion of the rigid mechanism alone, with its own forces; valid if ``has_rigid_forces``."""
        return RigidForces(self.model, self.rigid_forces)

    @cached_property
    def _link_forces(self) -> LinkForces:
        return LinkForces(mechanism_of(self.model.scene), self.scalars)

    def turned(self, body: str) -> np.ndarray:
        """Angle of a body in the rigid motion [rad], continuous over turns."""
        frame = self.rigid.frame(body)
        angle = np.arctan2(frame.s, frame.c)
        if self.whole is None:
            there = np.isfinite(angle)  # the rigid mechanism may not close where the coupled one does
            angle[there] = np.unwrap(angle[there])
            return angle
        near = np.interp(self.times, self.whole.times, self.whole.turned(body))
        return near + wrapped(angle - near)

    def angle(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> np.ndarray:
        """Angle of a body at a point, elastic rotation included [rad]."""
        if body == "ground":
            return np.zeros(len(self.times))
        return self.turned(body) + self.displacement(body, at)[0][2]

    def place(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> np.ndarray:
        """Global position of a point including its displacement [m], (2, n_times)."""
        frame = self.rigid.frame(body)
        if body == "ground":
            return frame.place(at)
        d = self.displacement(body, at)[0][: len(at)]
        return frame.place(np.reshape(at, (-1, 1)) + d)

    def rate(self, body: str, at: tuple[float, ...], order: int) -> tuple[np.ndarray, np.ndarray]:
        """Global velocity (``order`` 1) or acceleration (2) of a displaced point, and that of its section's angle."""
        frame, moved, n = self.rigid.frame(body), self.displacement(body, at), len(at)
        p, *rates = (np.reshape(at, (-1, 1)) + moved[0][:n], *(part[:n] for part in moved[1 : order + 1]))
        turn = moved[order][2] if n == 2 else frame.to_global(moved[order][3:])
        if order == 1:
            return frame.velocity(p, *rates), frame.omega + turn
        return frame.acceleration(p, *rates), frame.epsilon + turn

    def seen_from(self, body: str, vector: np.ndarray) -> np.ndarray:
        """Components of a global vector, (2 or 3, n_times), in the axes of sensors on a body.

        For deforming bodies these turn with the rigid motion, for carried ones with the body.
        """
        own = self.rigid.frame(body).to_body(vector)
        if body == "ground" or self.model.scene.bodies[body].deforms:
            return own
        return own - _turned(self.displacement(body)[0], own)

    def slide(self, joint: str) -> np.ndarray:
        """Coordinate of a guide: position of its second body along it [m]."""
        of = self.model.scene.joints[joint]
        first, second = (self.place(each.body, self.model.scene.point(each)) for each in of.addresses)
        along = self.rigid.frame(of.addresses[0].body).to_global(of.direction)
        return (along * (second - first)).sum(axis=0)

    def _in_axes(self, body: str, moved: Rates) -> Rates:
        """Components of a global displacement in the rigid body's axes, with their rates."""
        local = self.rigid.frame(body).components(*(part[:2] for part in moved))
        return tuple(np.vstack([d, part[2]]) for d, part in zip(local, moved, strict=True))

    def _still(self) -> Rates:
        """Zero displacement."""
        still = np.zeros((self.rigid.freedoms, len(self.times)))
        return still, still, still


class RigidForces(Motion):
    """Motion of a rigid mechanism, without displacements."""

    def taken(self, instants: np.ndarray) -> RigidForces:
        return replace(self, rigid=self.rigid.taken(instants))

    def displacement(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> Rates:
        return self._still()


def displacement_of_arm(moved: Rates, arm: Sequence[float]) -> Rates:
    """Displacement of a point at an arm [m] from another one, whose displacement is ``moved`` and with which it turns;
    (3, n_times) each, in space (6, n_times)."""
    if not any(arm):
        return moved
    n, end = len(arm), np.reshape(arm, (-1, 1))
    return cast(Rates, tuple(np.vstack([part[:n] + _turned(part, end), part[n:]]) for part in moved))


def _turned(moved: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Displacement of an arm's end by a small rotation, the last component or components of ``moved``."""
    return moved[2] * np.array([-arm[1], arm[0]]) if len(moved) == 3 else np.cross(moved[3:], arm, axis=0)
