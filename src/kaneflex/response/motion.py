"""What a finished motion offers to whoever reads it: sensors, section forces, events, pictures."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.energy import Energy
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model
from kaneflex.response.section_forces import LinkForces

Section = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Axial force N [N, tension positive], shear force V [N] and bending moment M [N m], each (n_times,)."""


@dataclass(frozen=True, eq=False)
class Motion(ABC):
    """The motion of a model over some instants, whoever computed it.

    Points are given by their body and their place in its axes, undeformed, ``at`` [m]. Displacements are measured from
    the rigid mechanism, whose drives stand where they stand in this motion.

    Attributes
    ----------
    model : Model
    rigid : RigidMotion
        The rigid mechanism at these instants.
    coordinates : tuple of three ndarray (n, n_times)
        Elastic coordinates of the mechanism and their two rates; a subclass holds or finds them.
    whole : Motion or None
        The motion that these instants were sampled from: it says how often a body has turned around.
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
        """What :func:`kaneflex.solve.initial.start_coordinates` names, and its rates, each (n, n_times)."""
        return self.coordinates[:2]

    @property
    def energy(self) -> Energy | None:
        """Energy of the run, where it was integrated with the motion; of one-way presets the rigid mechanism's."""
        return self.model.energy

    @property
    @abstractmethod
    def has_rigid_forces(self) -> bool:
        """Whether there are forces of the rigid mechanism beside those of the deforming one."""

    @abstractmethod
    def taken(self, instants: np.ndarray) -> Motion:
        """The motion at some of its instants, by their numbers."""

    @abstractmethod
    def displacement(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        """Displacement (x, y) and rotation of a point in its body's axes, and their rates there; each (3, n_times)."""

    @abstractmethod
    def nodes(self, link: str) -> np.ndarray:
        """u, v, theta of an elastic link's nodes in the axes of its equations, less foreshortening; (3 n, n_times)."""

    @abstractmethod
    def reaction(self, name: str) -> np.ndarray:
        """A component of a joint's force on its second body, or of a drive, as the motion's scalars name it."""

    @abstractmethod
    def spring_tension(self, name: str) -> np.ndarray:
        """Tension of a spring with its damper [N], or what a torsional one opposes to the turning of its joint [N m].
        """

    def modal(self, body: str) -> Rates:
        """Modal coordinates of a body and their two rates, (n, n_times) each; only under preset coupled it has any."""
        raise LookupError(body)

    def contact(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Gap [m] and normal force [N] of a contact, (n_times,) each; only bodies that move each other have any."""
        raise LookupError(name)

    def clearance(self, name: str) -> np.ndarray:
        """How a pin or a block stands in a joint with a clearance, (3, n_times).

        Its place against the other side, x and y in m, and the angle between both [rad]: of a pin in global axes, of a
        block along its guide, across it to the left, and its tilt.
        """
        raise LookupError(name)

    def friction(self, name: str) -> np.ndarray:
        """What friction exerts on the second side of a joint or contact [N or N m], (n_times,); as ``contact``."""
        raise LookupError(name)

    def section(self, link: str, x: float, after: bool = False) -> Section:
        """Section forces x [m] from a link's start; of what acts there between the ends, just before it or after it."""
        if link in self.model.links:
            return self._elastic_section(link, x, after)
        return LinkForces(self.model.scene, self.scalars).section(link, x, after)

    @property
    def scalars(self) -> RigidMotion:
        """Frames of the bodies and what acts on them in this motion, by the names that a rigid motion has for it."""
        return self.rigid

    @property
    def rigid_forces(self) -> RigidMotion:
        """The rigid mechanism with what its joints exert, where ``has_rigid_forces`` says that these are known."""
        return self.rigid

    @abstractmethod
    def _elastic_section(self, link: str, x: float, after: bool) -> Section: ...

    def rigid_section(self, link: str, x: float, after: bool = False) -> Section:
        """Section forces of the rigid mechanism."""
        return LinkForces(self.model.scene, self.rigid_forces).section(link, x, after)

    def turned(self, body: str) -> np.ndarray:
        """Angle of a body in the rigid motion [rad], continuous over turns."""
        frame = self.rigid.frame(body)
        angle = np.arctan2(frame.s, frame.c)
        if self.whole is None:
            there = np.isfinite(angle)  # a coupled mechanism may go where the rigid one doesn't close
            angle[there] = np.unwrap(angle[there])
            return angle
        near = np.interp(self.times, self.whole.times, self.whole.turned(body))
        return near + np.remainder(angle - near + np.pi, 2 * np.pi) - np.pi

    def angle(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """Angle of a body at a point, elastic rotation included [rad]."""
        if body == "ground":
            return np.zeros(len(self.times))
        return self.turned(body) + self.displacement(body, at)[0][2]

    def place(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
        """Global place of a point, its displacement included [m], (2, n_times)."""
        frame = self.rigid.frame(body)
        if body == "ground":
            return frame.place(at)
        d = self.displacement(body, at)[0][: len(at)]
        return frame.place(np.reshape(at, (-1, 1)) + d)

    def point(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates | None:
        """x, y [m] and angle [rad] of a displaced point in the plane with their rates, (3, n_times), where they are
        known without the rigid mechanism, which may not close there."""
        return None

    def seen_from(self, body: str, vector: np.ndarray) -> np.ndarray:
        """Of a global vector, (2 or 3, n_times), the components in the axes that sensors on a body have.

        Those of a body that deforms turn with the rigid motion, those of one that others carry with it.
        """
        x, y = self.rigid.frame(body).to_body(vector)
        if body == "ground" or self.model.scene.bodies[body].deforms:
            return np.array([x, y])
        turned = self.displacement(body)[0][2]  # small, as all displacements are
        return np.array([x + turned * y, y - turned * x])

    def slide(self, joint: str) -> np.ndarray:
        """Coordinate of a guide: how far its second body is along it [m]."""
        of = self.model.scene.joints[joint]
        (first, here), (second, there) = ((each.body, self.model.scene.point(each)) for each in of.addresses)
        along = self.rigid.frame(first).to_global(of.direction)
        return (along * (self.place(second, there) - self.place(first, here))).sum(axis=0)

    def _in_axes(self, body: str, moved: Rates) -> Rates:
        """Of a global displacement its components in the rigid body's axes, and the rates of these."""
        local = self.rigid.frame(body).components(*(part[:2] for part in moved))
        return tuple(np.vstack([d, part[2]]) for d, part in zip(local, moved, strict=True))

    def _still(self) -> Rates:
        """The displacement of what does not deform, nor is carried by what does."""
        still = np.zeros((6 if self.model.scene.is_spatial else 3, len(self.times)))
        return still, still, still


def beside_axis(moved: Rates, y: float) -> Rates:
    """Displacement of a point at a distance y [m] from the axis, which moves with its section, from the axis' own."""
    return tuple(part + np.array([[-y], [0.0], [0.0]]) * part[2] for part in moved) if y else moved
