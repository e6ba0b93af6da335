"""Motion of a coupled trajectory, in the plane and in space.

It has two descriptions. *In the floating frames*: motion of the frames and small deformation in them, from which
positions and section forces follow. *Relative to the rigid mechanism*, whose drives have the coordinates of the coupled
motion: displacements, so that sensors have the same meaning under every preset.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self, cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates, applied, turning
from kaneflex.mechanism.parts import floating_coordinates
from kaneflex.mechanism.planar import GROUND, BodyPoint, whole_turns, wrapped
from kaneflex.mechanism.rigid_bodies import FIXED
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import Side
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.sections import DeformingMotion, PlanarSection
from kaneflex.response.dalembert import Balanced, balanced
from kaneflex.response.motion import Motion, Section


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

    def courses(self, joints: Iterable[str]) -> np.ndarray:
        """Coordinates of joints, and their rates, (3, n_times, joints), see :meth:`coordinate`."""
        found = [np.array(self.coordinate(name)) for name in joints]
        return np.stack(found, axis=-1) if found else np.zeros((3, len(self.times), 0))

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


@dataclass(frozen=True, eq=False)
class CoupledMotion(Motion):
    """Motion of a coupled trajectory; displacements are relative to the rigid mechanism.

    ``moving``: frames of the bodies with their shapes, forces and loads.
    """

    moving: DeformingMotion

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        return self.moving.state

    @property
    def has_rigid_forces(self) -> bool:
        """True if rigid forces exist: not if free joints follow the deformation, as the rigid mechanism would then
        vibrate with them."""
        scene = self.model.scene
        return bool(self.moving.shapes) and self.model.module.determined and not (scene.contacts or scene.frictions)

    @cached_property
    def rigid_forces(self) -> RigidMotion:
        motion = cast(Any, self.model.motion)
        system, record = motion.module.system, motion.curve.record(self.times)
        return FloatingMotion.of(system, self.rigid, record)

    @property
    def scalars(self) -> Any:
        return self.moving

    def taken(self, instants: np.ndarray) -> CoupledMotion:
        rigid, moving = self.rigid.taken(instants), self.moving.taken(instants)
        return replace(self, rigid=rigid, moving=moving, whole=self.whole or self)

    # ---- in the floating frames -------------------------------------------------------------------------------

    def nodes(self, link: str) -> np.ndarray:
        return self.moving.shapes[link].basis @ self.moving.modal(link)[0]

    def section(self, link: str, x: float, after: bool = False) -> Section:
        elastic = self.model.scene.bodies[link].elastic
        return self._balances[link].section(x, after) if elastic else super().section(link, x, after)

    @cached_property
    def _balances(self) -> Mapping[str, Balanced]:
        return balanced(self.moving)

    def place(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> np.ndarray:
        """Global position of a point in this motion, known even where the rigid mechanism does not close."""
        frame, p = self._section(body, at)
        return frame.place(p)

    def rate(self, body: str, at: tuple[float, ...], order: int) -> tuple[np.ndarray, np.ndarray]:
        frame, p = self._section(body, at)
        return (frame.acceleration(p), frame.epsilon) if order == 2 else (frame.velocity(p), frame.omega)

    def angle(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> np.ndarray:
        """Angle of a body at a point in this motion, with the full turns that sensors leave out."""
        left_out = self._turns_left_out.get(body, 0.0)
        return np.asarray(self.scalars.moving_place(body, at)[0][2] - left_out)

    def slide(self, joint: str) -> np.ndarray:
        return np.asarray(self.scalars.coordinate(joint)[0])

    def seen_from(self, body: str, vector: np.ndarray) -> np.ndarray:
        deforms = body != GROUND and self.model.scene.bodies[body].deforms
        return (self.rigid if deforms or body == GROUND else self.moving).frame(body).to_body(vector)

    def _section(self, body: str, at: tuple[float, ...]) -> tuple[Any, Any]:
        """Axes of the section at a point, and the point in these."""
        frame, side = self.moving.section_frame(Side(body, at))
        return frame, side.at

    # ---- relative to the rigid mechanism ----------------------------------------------------------------------

    def displacement(self, body: str, at: tuple[float, ...] = (0.0, 0.0)) -> Rates:
        carried = self.model.frame
        if carried is not None and not self.model.scene.bodies[body].deforms and body not in carried.bodies:
            return self._still()
        frame, (section, p) = self.rigid.frame(body), self._section(body, at)
        found = tuple(map(np.vstack, zip(frame.apart(at, section, p), frame.turned(section), strict=True)))
        for part in found:
            part[self._held(body, at)] = 0.0
        return cast(Rates, found)

    def turned(self, body: str) -> np.ndarray:
        """Angle of the rigid motion with the turns counted by the run, including earlier ones."""
        frame = self.rigid.frame(body)
        angle = np.arctan2(frame.s, frame.c)
        return angle + whole_turns(self.moving[f"{body}.phi"] - self._turns_left_out[body] - angle)

    @cached_property
    def _turns_left_out(self) -> Mapping[str, float]:
        """Body -> initial full turns [rad] that sensors leave out, to start within half a turn of zero."""
        angles = {name: float(pose[2]) for name, pose in self.model.module.start.poses.items()}
        return {name: float(whole_turns(each - math.atan2(math.sin(each), math.cos(each))))
                for name, each in angles.items()}  # fmt: skip

    def _held(self, body: str, at: tuple[float, ...]) -> list[int]:
        """Components among x, y and the angle that joints keep as in the rigid mechanism, up to rounding."""
        interfaces, link = self.model.interfaces, self.model.links.get(body)
        at_node = None if link is None or any(at[1:]) else link.node_at(at[0])
        if interfaces is None or at_node is None or (body, at_node) not in interfaces.displaced:
            return []
        node = body, at_node
        fixed = interfaces.displaced[node] == FIXED
        clamped = interfaces.turned[node] == FIXED
        return [0, 1] * fixed + [2] * clamped

    @cached_property
    def coordinates(self) -> Rates:
        """Amplitudes of all shapes, and their two rates."""
        parts = [(np.zeros((0, len(self.times))),) * 3, *map(self.moving.modal, self.moving.shapes)]
        return cast(Rates, tuple(np.concatenate(part) for part in zip(*parts, strict=True)))


def coupled_motion(model: Model, moved: RigidMotion, trajectory: Any, whole: Motion | None = None) -> CoupledMotion:
    """Motion of a run; ``moved``: the model's motion at its instants, in space of the bodies that deform."""
    if model.coupled is not None:
        moving = FloatingMotion.of(model.coupled, moved, trajectory.record)
        return CoupledMotion(model, moved, moving, whole=whole)
    deforming = cast(DeformingMotion, moved)
    return CoupledMotion(model, deforming.motion.rigid.later(deforming.times), deforming, whole=whole)
