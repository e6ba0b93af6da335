"""Motion of a mechanism in the plane by the frames of its bodies, from a record of the engine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self, cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates, applied, turning
from kaneflex.mechanism.parts import floating_coordinates
from kaneflex.mechanism.planar import GROUND, BodyPoint, wrapped
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.sections import DeformingMotion, PlanarSection


@dataclass(frozen=True, eq=False)
class FloatingMotion(DeformingMotion):
    """Scalars of the floating frames, reactions and loads of a coupled motion.

    Attributes
    ----------
    system : System
    rigid : RigidMotion
        Rigid mechanism at these instants, which knows the drives.
    record : ndarray (n_times, kept)
        Record of the instants, see :class:`kaneflex.multibody.dynamics.arrays.Instants`.
    """

    system: System
    rigid: RigidMotion
    record: np.ndarray

    @classmethod
    def of(cls, system: System, rigid: RigidMotion, record: np.ndarray) -> Self:
        """Motion of a record."""
        return cls(rigid.motion, rigid.times, np.zeros((len(rigid.times), 0)), system, rigid, record)

    def recording(self, record: np.ndarray) -> Self:
        return replace(self, record=record)

    def taken(self, instants: np.ndarray) -> Self:
        return self.of(self.system, self.rigid.taken(instants), self.record[instants])

    # ---- scalars by name --------------------------------------------------------------------------------------

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        if name in self.system.scalars:
            return self.record[:, self.system.scalars[name].column]
        if key in ("c", "s") and owner in self.mechanism.bodies:
            return (np.cos if key == "c" else np.sin)(self[f"{owner}.phi"])
        if key == "drive":  # of a free one
            return np.zeros(len(self.times))
        body, _, link = owner.rpartition(".")
        if link == "link" and key in ("a_x", "a_y"):
            specific_force = self.frame(body).acceleration((0.0, 0.0)) - np.array(self.mechanism.gravity)[:, None]
            return self.frame(body).to_body(specific_force)["xy".index(key[-1])]
        return self.rigid[name]

    # ---- frames and sections ----------------------------------------------------------------------------------

    def body(self, name: str) -> Rates:
        """Position x, y [m] and angle phi [rad] of a body's frame with rates, (3, n_times) each."""
        node, found = self.system.layout.node_of[name], self.instants
        return found.r[:, node].T, found.twist[:, node].T, found.rate[:, node].T

    def moving_place(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        """Global position x, y [m] and section angle [rad] of a point, including deformation, with rates; (3, n_times)
        each. A point beside the axis of an elastic link turns with the section."""
        frame, side = self.section_frame(BodyPoint(body, "", at))
        bent = frame.deformed.angle[0] if isinstance(frame, PlanarSection) else 0.0
        angle = np.zeros(len(self.times)) if body == GROUND else self[f"{body}.phi"] + bent
        moved = frame.place(side.at), frame.velocity(side.at), frame.acceleration(side.at)
        turned = angle, frame.omega, frame.epsilon
        return cast(Rates, tuple(np.vstack([part, own]) for part, own in zip(moved, turned, strict=True)))

    def coordinate(self, joint: str) -> Rates:
        """Coordinate of a joint between the deformed bodies [rad, or m along its guide] with its rates; or of a freely
        moving body."""
        body, _, part = joint.partition(".")
        if part:
            k = floating_coordinates(body).index(joint)
            return cast(Rates, tuple(rate[k] for rate in self.body(body)))
        of = self.mechanism.joints[joint]
        if not of.slides:
            first, second = (self.moving_place(side.body, side.at) for side in of.sides)
            return cast(Rates, tuple(end[2] - start[2] for start, end in zip(first, second, strict=True)))
        (base, one), (rider, other) = (self.section_frame(side) for side in of.sides)
        return cast(Rates, tuple(np.array(of.direction) @ part for part in base.apart(one.at, rider, other.at)))

    def clearance(self, name: str) -> np.ndarray:
        """Position of a pin or block in its joint, see :meth:`kaneflex.response.motion.Motion.clearance`."""
        loose, point = self.mechanism.loose[name], self.mechanism.point
        first, second = (self.moving_place(side.body, point(side))[0] for side in loose.sides)
        x, y, angle = second - first
        if loose.direction is None:
            return np.array([x, y, angle])
        along = applied(turning(first[2]), loose.direction)
        tilt = wrapped(angle)  # bodies may start full turns apart
        return np.array([along[0] * x + along[1] * y, along[0] * y - along[1] * x, tilt])
