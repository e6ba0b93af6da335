"""Scalars of a coupled motion's floating frames, by the names that a rigid motion has for its bodies.

Functions that read a rigid motion by its scalars, such as joint and spring forces, thus also read a coupled one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.body_frame import rotate
from kaneflex.mechanism.contacts import apart
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import cross
from kaneflex.mechanism.rigid_motion import RigidMotion

if TYPE_CHECKING:
    from kaneflex.response.coupled_motion import CoupledMotion


@dataclass(frozen=True, eq=False)
class FloatingScalars(RigidMotion):
    """Scalars of the floating frames, reactions and loads of a coupled motion."""

    coupled: CoupledMotion

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        own = self.coupled.system
        if name in self.coupled.reactions:
            return self.coupled.reactions[name]
        if owner in self.coupled.model.scene.springs:
            return self._spring(owner, key)
        if owner in self.coupled.model.scene.contacts:
            return self._contact(owner)[key]
        if owner in own.start and key in _FRAME:
            order, row = _FRAME[key]
            return self.coupled.body(owner)[order][row]
        if owner in own.start and key in ("c", "s"):
            return (np.cos if key == "c" else np.sin)(self.coupled.body(owner)[0][2])
        body, _, link = owner.rpartition(".")
        if link == "link" and key in ("a_x", "a_y"):
            gravity = np.array(self.coupled.model.scene.gravity)[:, None]
            specific_force = self.frame(body).acceleration((0.0, 0.0)) - gravity
            return self.frame(body).to_body(specific_force)["xy".index(key[-1])]
        size = self.coupled.load_sizes[name] if name in self.coupled.load_sizes else self.coupled.rigid[name]
        return size + self.coupled.shift.get(name, 0.0)

    def _spring(self, name: str, key: str) -> np.ndarray:
        """Torque of a torsional spring, tension of another one, or a component of its force on its second point."""
        tension = self.coupled.spring_tension(name)
        if key in ("torque", "tension"):
            return tension
        start, end = (self.coupled.joined(address)[0][:2] for address in self.coupled.model.scene.springs[name].between)
        gap = end - start
        length = np.hypot(*gap)
        return -tension * np.divide(gap["xy".index(key[-1])], length, out=np.zeros_like(length), where=length > 0)

    def _contact(self, name: str) -> dict[str, np.ndarray]:
        """Global force of a contact on its second side, and its moments on both sides about their points."""
        record, contact = self.coupled.trajectory.contacts, mechanism_of(self.coupled.model.scene).contacts[name]
        force = np.zeros(len(self.times)) if record is None else record.force[:, record.names.index(name)]
        if contact.kind == "angle":
            turn, none = contact.direction[0] * force, np.zeros(len(self.times))
            return {"force_x": none, "force_y": none, "moment": -turn, "moment_second": turn}
        (x, y, angle), second = (self.coupled.moving_place(side.body, side.at)[0] for side in contact.sides)
        gap = second[0] - x, second[1] - y
        direction = rotate(np.cos(angle), np.sin(angle), contact.direction)
        _, normal = apart(contact.kind, gap, np.hypot(*gap) + np.finfo(float).tiny, direction, contact.reach)
        own = self.coupled.reactions.get(f"{name}.friction", 0.0 * force)
        push = force * normal[0] - own * normal[1], force * normal[1] + own * normal[0]
        arm = contact.radius * own  # friction acts at the contact point on the second side's circle
        return {"force_x": push[0], "force_y": push[1], "moment": arm - cross(gap, push), "moment_second": -arm}


_FRAME = {
    "x": (0, 0), "y": (0, 1), "v_x": (1, 0), "v_y": (1, 1), "omega": (1, 2), "a_x": (2, 0), "a_y": (2, 1),
    "epsilon": (2, 2),
}  # fmt: skip
"""Scalar of a body's frame -> order of the rate, row."""
