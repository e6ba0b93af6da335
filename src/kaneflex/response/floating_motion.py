"""Coupled motion in the plane by the floating frames of its bodies, and by the names that a rigid motion has for them.

Functions that read a rigid motion by its scalars, such as joint and spring forces, thus also read a coupled one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Self, cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates, applied, turning
from kaneflex.mechanism.parts import floating_coordinates
from kaneflex.mechanism.planar import GROUND, BodyPoint, wrapped
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model.system import BODY, System
from kaneflex.multibody.time.sections import DeformingMotion, PlanarSection
from kaneflex.scene.quantities import Address

if TYPE_CHECKING:
    from kaneflex.multibody.time.trajectory import CoupledTrajectory

_FRAME = {
    "x": (0, 0), "y": (0, 1), "phi": (0, 2), "v_x": (1, 0), "v_y": (1, 1), "omega": (1, 2), "a_x": (2, 0),
    "a_y": (2, 1), "epsilon": (2, 2),
}  # fmt: skip
"""Scalar of a body's frame -> order of the rate, row."""


@dataclass(frozen=True, eq=False)
class FloatingMotion(DeformingMotion):
    """Scalars of the floating frames, reactions and loads of a coupled motion.

    Attributes
    ----------
    system : System
    rigid : RigidMotion
        Rigid mechanism at these instants, which knows drives and loads.
    trajectory : CoupledTrajectory
    """

    system: System
    rigid: RigidMotion
    trajectory: CoupledTrajectory

    @classmethod
    def of(cls, system: System, rigid: RigidMotion, trajectory: CoupledTrajectory) -> Self:
        """Motion of a trajectory."""
        return cls(rigid.motion, rigid.times, np.zeros((len(rigid.times), 0)), system, rigid, trajectory)

    @property
    def recorded(self) -> np.ndarray:
        return self.trajectory.record

    def recording(self, record: np.ndarray) -> Self:
        return replace(self, trajectory=replace(self.trajectory, record=record))

    def taken(self, instants: np.ndarray) -> Self:
        contacts, frictions, t = self.trajectory.contacts, self.trajectory.frictions, self.trajectory
        trajectory = replace(
            t, rows=t.rows[instants], record=t.record[instants],
            contacts=contacts and contacts.taken(instants), frictions=frictions and frictions.taken(instants),
        )  # fmt: skip
        rigid = self.rigid.taken(instants)
        return replace(self, rigid=rigid, times=rigid.times, values=self.values[instants], trajectory=trajectory)

    # ---- scalars by name --------------------------------------------------------------------------------------

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        if name in self.reactions:
            return self.reactions[name]
        if owner in self.mechanism.springs:
            return self._spring(owner, key)
        if owner in self.mechanism.contacts:  # of single states it counts as open
            return self.contact(owner)[1] if self.trajectory.contacts else np.zeros(len(self.times))
        if owner in self.system.start and key in _FRAME:
            order, row = _FRAME[key]
            return self.body(owner)[order][row]
        if owner in self.system.start and key in ("c", "s"):
            return (np.cos if key == "c" else np.sin)(self.body(owner)[0][2])
        body, _, link = owner.rpartition(".")
        if link == "link" and key in ("a_x", "a_y"):
            specific_force = self.frame(body).acceleration((0.0, 0.0)) - np.array(self.mechanism.gravity)[:, None]
            return self.frame(body).to_body(specific_force)["xy".index(key[-1])]
        return self._load_sizes[name] if name in self._load_sizes else self.rigid[name]

    @cached_property
    def reactions(self) -> dict[str, np.ndarray]:
        """Reactions of all joints and forces or torques of drives, zero for free ones; series (n_times,)."""
        found = dict(zip(self.system.constraints, self.trajectory.multipliers.T, strict=True))
        none = np.zeros(len(self.times))
        rubbing = {f"{name}.friction": self.friction(name) for name in self.mechanism.frictions}
        return {f"{name}.drive": none for name in self.mechanism.drives} | found | rubbing

    def _spring(self, name: str, key: str) -> np.ndarray:
        """Torque of a torsional spring, tension of another one, or a component of its force on its second point."""
        springs = self.system.mechanism.springs
        found = self.system.engine.instants(self.recorded).springs[:, [*springs].index(name)]
        return found[:, 1 if key == "tension" or not springs[name].ends else 2 + "xy".index(key[-1])]

    @cached_property
    def _load_sizes(self) -> dict[str, np.ndarray]:
        """Magnitudes of the loads."""
        sizes = self.system.engine.instants(self.recorded).sizes
        return dict(zip(self.system.mechanism.loads, sizes.T, strict=True))

    # ---- frames and sections ----------------------------------------------------------------------------------

    def body(self, name: str) -> Rates:
        """Position x, y [m] and angle phi [rad] of a body's frame with rates, (3, n_times) each."""
        k, t = self.system.start[name], self.trajectory
        rows = slice(k, k + BODY)
        return t.q[:, rows].T, t.v[:, rows].T, t.a[:, rows].T

    def moving_place(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        """Global position x, y [m] and section angle [rad] of a point, including deformation, with rates; (3, n_times)
        each. A point beside the axis of an elastic link turns with the section."""
        frame, side = self.section_frame(BodyPoint(body, "", at))
        if body == GROUND:
            still = np.zeros((3, len(self.times)))
            return still + np.array([[at[0]], [at[1]], [0.0]]), still, still
        phi = self[f"{body}.phi"]
        angle = phi + frame.deformed.angle[0] if isinstance(frame, PlanarSection) else phi
        turned, p = (angle, frame.omega, frame.epsilon), np.reshape(side.at, (2, 1)) + np.zeros((2, len(phi)))
        moved = frame.place(p), frame.velocity(p), frame.acceleration(p)
        return cast(Rates, tuple(np.vstack([part, own]) for part, own in zip(moved, turned, strict=True)))

    def joined(self, address: Address) -> Rates:
        """Position and section angle of a point of a body or the ground with rates, (3, n_times) each."""
        return self.moving_place(address.body, self.mechanism.point(address))

    def coordinate(self, joint: str) -> Rates:
        """Coordinate of a joint between the deformed bodies [rad, or m along its guide] with its rates; or of a freely
        moving body."""
        body, _, part = joint.partition(".")
        if part:
            k, found = self.system.start[body] + floating_coordinates(body).index(joint), self.trajectory
            return found.q[:, k], found.v[:, k], found.a[:, k]
        of = self.system.mechanism.joints[joint]
        if not of.slides:
            first, second = (self.moving_place(side.body, side.at) for side in of.sides)
            return cast(Rates, tuple(end[2] - start[2] for start, end in zip(first, second, strict=True)))
        (base, one), (rider, other) = (self.section_frame(side) for side in of.sides)
        return cast(Rates, tuple(np.array(of.direction) @ part for part in base.apart(one.at, rider, other.at)))

    def courses(self, joints: Iterable[str]) -> np.ndarray:
        """Coordinates of joints, and their rates, (3, n_times, joints), see :meth:`coordinate`."""
        found = [np.array(self.coordinate(name)) for name in joints]
        return np.stack(found, axis=-1) if found else np.zeros((3, len(self.times), 0))

    def clearance(self, name: str) -> np.ndarray:
        """Position of a pin or block in its joint, see :meth:`kaneflex.response.motion.Motion.clearance`."""
        loose = self.mechanism.loose[name]
        first, second = (self.joined(side)[0] for side in loose.sides)
        x, y, angle = second - first
        if loose.direction is None:
            return np.array([x, y, angle])
        along = applied(turning(first[2]), loose.direction)
        tilt = wrapped(angle)  # bodies may start full turns apart
        return np.array([along[0] * x + along[1] * y, along[0] * y - along[1] * x, tilt])

    def contact(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Gap [m] and normal force [N] of a contact; unknown of single states."""
        record = self.trajectory.contacts
        if record is None:
            return np.full(len(self.times), np.nan), np.full(len(self.times), np.nan)
        k = record.names.index(name)
        return record.gap[:, k], record.force[:, k]

    def friction(self, name: str) -> np.ndarray:
        """Friction force or torque [N or N m]; unknown of single states."""
        record = self.trajectory.frictions
        return np.full(len(self.times), np.nan) if record is None else record.force[:, record.names.index(name)]
