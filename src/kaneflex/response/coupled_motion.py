"""Motion of a coupled trajectory.

It has two descriptions. *In the floating frames*: motion of the frames and small deformation in them, from which
positions and section forces follow. *Relative to the rigid mechanism*, whose drives have the coordinates of the coupled
motion: displacements, so that sensors have the same meaning under every preset.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.energy import Energy
from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.time.trajectory import by_themselves
from kaneflex.response.dalembert import Balanced, balanced
from kaneflex.response.floating_motion import FloatingMotion
from kaneflex.response.motion import Section, beside


@dataclass(frozen=True, eq=False)
class CoupledMotion(FloatingMotion):
    """Motion of a coupled trajectory; displacements are relative to the rigid mechanism."""

    @property
    def state(self) -> tuple[np.ndarray, np.ndarray]:
        of = self.system.engine.columns
        return self.trajectory.rows[:, of["q"]].T, self.trajectory.rows[:, of["u"]].T

    @property
    def energy(self) -> Energy:
        return self.trajectory.energy

    @property
    def has_rigid_forces(self) -> bool:
        """True if rigid forces exist: not if free joints follow the deformation, as the rigid mechanism would then
        vibrate with them."""
        scene = self.model.scene
        deforms = self.system.engine.shapes.any() and not (scene.contacts or scene.frictions)
        return bool(deforms) and self.model.module.determined

    @cached_property
    def rigid_forces(self) -> RigidMotion:
        reference = self.model.module
        rows = reference.system.states(reference.rows(self.times, reference.first))
        trajectory = by_themselves(rows, reference.system.unfold(rows))
        return CoupledMotion(replace(self.model, coupled=reference.system), self.rigid, trajectory).floating

    @property
    def scalars(self) -> RigidMotion:
        return self.floating

    def taken(self, instants: np.ndarray) -> CoupledMotion:
        rigid = self.rigid.taken(instants)
        picked = {key: getattr(self.trajectory, key)[instants] for key in ("rows", "q", "v", "a", "multipliers")}
        shift = {name: part[instants] for name, part in self.shift.items()}
        contacts, frictions = self.trajectory.contacts, self.trajectory.frictions
        trajectory = replace(
            self.trajectory, **picked, contacts=contacts and contacts.taken(instants),
            frictions=frictions and frictions.taken(instants),
        )  # fmt: skip
        return replace(self, rigid=rigid, trajectory=trajectory, shift=shift, whole=self.whole or self)

    def _elastic_section(self, link: str, x: float, after: bool) -> Section:
        return self._balances[link].section(x, after)

    @cached_property
    def _balances(self) -> dict[str, Balanced]:
        return balanced(self)

    # ---- relative to the rigid mechanism ----------------------------------------------------------------------

    def displacement(self, body: str, at: tuple[float, float] = (0.0, 0.0)) -> Rates:
        frame = self.model.frame
        if body in self.system.links:
            return beside(self._in_axes(body, self._moved(body, (at[0], 0.0))), (0.0, at[1]))
        if frame is None or body in frame.bodies or self.model.scene.bodies[body].modal is not None:
            return self._in_axes(body, self._moved(body, at))
        return self._still()

    def turned(self, body: str) -> np.ndarray:
        """Angle of the rigid motion with the turns counted by the run, including earlier ones."""
        frame = self.rigid.frame(body)
        angle = np.arctan2(frame.s, frame.c)
        return angle + whole_turns(self.body(body)[0][2] - self._turns_left_out[body] - angle)

    def _moved(self, body: str, at: tuple[float, float]) -> Rates:
        """Global displacement and rotation of a point relative to the rigid mechanism with rates, (3, n_times) each."""
        frame = self.rigid.frame(body)
        moved = self.moving_place(body, at)
        before = frame.place(at), frame.velocity(at), frame.acceleration(at)
        phi, turned = self.body(body)[0][2], moved[0][2]
        c, s = frame.to_body((np.cos(phi), np.sin(phi)))
        angles = turned - phi + np.arctan2(s, c), moved[1][2] - frame.omega, moved[2][2] - frame.epsilon
        parts = [np.vstack([new[:2] - old, angle]) for new, old, angle in zip(moved, before, angles, strict=True)]
        for part in parts:
            part[self._held(body, at[0])] = 0.0
        return tuple(parts)

    def _held(self, body: str, x: float) -> list[int]:
        """Components among x, y and the angle that joints keep as in the rigid mechanism, up to rounding."""
        interfaces, link = self.model.interfaces, self.system.links.get(body)
        at = None if link is None else link.node_at(x)
        if interfaces is None or at is None or (body, at) not in interfaces.displaced:
            return []
        node = body, at
        fixed = interfaces.displaced[node] in interfaces.fixed
        clamped = interfaces.turned[node] in interfaces.clamped
        return [0, 1] * fixed + [2] * clamped

    @cached_property
    def coordinates(self) -> Rates:
        names = self.model.equations.coordinates
        rows: dict[str, Rates] = {}
        for name, link in self.system.links.items():
            for node, x in enumerate(link.nodes):
                local = self.displacement(name, (x, 0.0))
                for k, dof in enumerate(("u", "v", "theta")):
                    rows[f"{name}.{node}.{dof}"] = tuple(part[k] for part in local)
        joints = self.model.interfaces.joint if self.model.interfaces is not None else {}
        displaced = self.model.interfaces.displaced if self.model.interfaces is not None and joints else {}
        for (body, node), group in displaced.items():
            moved = self._moved(body, (self.system.links[body].nodes[node], 0.0))
            for k, axis in enumerate("xy"):
                rows[f"{joints[group]}.{axis}"] = tuple(part[k] for part in moved)
        for name in self.model.frame.bodies if self.model.frame is not None else ():
            rows |= self._carried_rows(name)
        found = (np.array([rows[name][order] for name in names]) for order in range(3))
        return tuple(part.reshape(len(names), len(self.times)) for part in found)

    def _carried_rows(self, name: str) -> dict[str, Rates]:
        """Displacement of a carried rigid body's start, its rotation, and its slide along its guide."""
        moved = self._moved(name, (0.0, 0.0))
        rows = {f"{name}.{key}": tuple(part[k] for part in moved) for k, key in enumerate(("x", "y", "turn"))}
        for joint in self.model.scene.joints.values():
            if joint.kind == "prismatic" and name in (address.body for address in joint.addresses):
                local = self._in_axes(joint.addresses[0].body, moved)
                rows[f"{name}.slide"] = tuple(np.array(joint.direction) @ part[:2] for part in local)
        return rows
