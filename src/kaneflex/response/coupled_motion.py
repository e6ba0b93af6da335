"""Motion of a coupled trajectory, in the plane and in space.

It has two descriptions. *In the floating frames*: motion of the frames and small deformation in them, from which
positions and section forces follow. *Relative to the rigid mechanism*, whose drives have the coordinates of the coupled
motion: displacements, so that sensors have the same meaning under every preset.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, cast

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.planar import GROUND, whole_turns
from kaneflex.mechanism.rigid_bodies import FIXED
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import Side
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.time.floating_motion import FloatingMotion
from kaneflex.multibody.time.sections import DeformingMotion
from kaneflex.response.dalembert import Balanced, balanced
from kaneflex.response.motion import Motion, Section


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
        return bool(self.moving.shapes) and self.model.motion.is_determined and not (scene.contacts or scene.frictions)

    @cached_property
    def rigid_forces(self) -> RigidMotion:
        rigid = cast(FloatingMotion, self.rigid)
        return FloatingMotion.of(rigid.system, rigid, rigid.record)

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
        poses = cast(Any, self.model.motion).start.poses
        angles = {name: float(pose[2]) for name, pose in poses.items()}
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
