"""The floating frames of a coupled motion by the names that the scalars of a rigid motion have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion

if TYPE_CHECKING:
    from kaneflex.response.coupled_motion import CoupledMotion


@dataclass(frozen=True, eq=False)
class FloatingScalars(RigidMotion):
    """Scalars of the floating frames, of the reactions and of the loads of a coupled motion."""

    coupled: CoupledMotion

    def __getitem__(self, name: str) -> np.ndarray:
        owner, _, key = name.rpartition(".")
        own = self.coupled.system
        if name in self.coupled.reactions:
            return self.coupled.reactions[name]
        if owner in self.coupled.model.scene.springs:
            return self._spring(owner, key)
        if owner in own.start and key in _FRAME:
            order, row = _FRAME[key]
            return self.coupled.body(owner)[order][row]
        if owner in own.start and key in ("c", "s"):
            return (np.cos if key == "c" else np.sin)(self.coupled.body(owner)[0][2])
        body, _, link = owner.rpartition(".")
        if link == "link" and key in ("a_x", "a_y"):
            felt = self.frame(body).acceleration((0.0, 0.0)) - np.array(self.coupled.model.scene.gravity)[:, None]
            return self.frame(body).to_body(felt)["xy".index(key[-1])]
        return self.coupled.rigid[name] + self.coupled.shift.get(name, 0.0)

    def _spring(self, name: str, key: str) -> np.ndarray:
        """Torque of a torsional spring, or a component of the force on its second point."""
        tension = self.coupled.spring_tension(name)
        if key == "torque":
            return tension
        start, end = (self.coupled.joined(address)[0][:2] for address in self.coupled.model.scene.springs[name].between)
        gap = end - start
        length = np.hypot(*gap)
        return -tension * np.divide(gap["xy".index(key[-1])], length, out=np.zeros_like(length), where=length > 0)


_FRAME = {
    "x": (0, 0), "y": (0, 1), "v_x": (1, 0), "v_y": (1, 1), "omega": (1, 2), "a_x": (2, 0), "a_y": (2, 1),
    "epsilon": (2, 2),
}  # fmt: skip
"""Scalar of a body's frame -> order of the rate, row."""
