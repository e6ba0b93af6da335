"""Detection of runs that leave their branch at a singular position, by a jump of the energy balance.

Branches of a loop's motion cross where its bars are aligned. Both satisfy the loop equations, so that no residual
detects a wrong branch; but closing the loops on it changes speeds and thus the energy.
"""

from __future__ import annotations

import numpy as np

from kaneflex.mechanism.energy import LARGEST_JUMP
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.initial_state import least_singular_values
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.trajectory import CoupledTrajectory

_PART_OF_A_DRIFT = 0.02
"""Share of the energy error that, lost between two instants at a singular position, identifies this as its cause."""
_NEAR = 0.25
"""Least singular value of the loops, relative to the run's largest, below which a singular position is near; it is
proportional to the distance."""
_CURE = "use solve.integrator = radau, which passes such positions"
_INSTANTS, _BETWEEN = 20, 9
"""Instants of a run for the regularity of its loops; instants between two stored ones to find a singular position."""


def jump(system: System, path: CoupledTrajectory, share: float = LARGEST_JUMP) -> tuple[int, float] | None:
    """Last stored instant before a jump at a singular position, and its time [s]; None without one.

    ``share``: jump of the energy balance, relative to the exchanged energy.
    """
    suspects, engine = path.energy.jumps(share), system.engine
    joints = engine.open_speeds[~engine.shapes[engine.open_speeds]]
    if not len(suspects) or not len(joints) or not engine.count(at.JOINT_ROWS):
        return None

    def regularity(rows: np.ndarray) -> np.ndarray:
        return least_singular_values(system, (engine.state_of(row)[0] for row in rows), joints)

    some = np.unique(np.linspace(0, len(path.times) - 1, _INSTANTS).astype(int))
    regular = regularity(path.rows[some]).max()
    part = np.linspace(0.0, 1.0, _BETWEEN)
    for k in suspects.tolist():
        between = path.rows[k] + part[:, None] * (path.rows[k + 1] - path.rows[k])
        least = regularity(between)
        if least.min() < _NEAR * regular:
            return k, float(between[least.argmin(), 0])
    return None


def cause(system: System, path: CoupledTrajectory) -> str:
    """Advice for a run with an energy jump at a singular position; empty otherwise."""
    found = jump(system, path, _PART_OF_A_DRIFT * path.energy.drift)
    if found is None:
        return ""
    return (
        f"and jumps at t = {found[1]:.6g} s, where the loops pass a singular position: check that the motion follows "
        "the right branch; a smaller solve.tolerance does not help"
    )


def departure(system: System, path: CoupledTrajectory, integrator: str) -> tuple[int, str] | None:
    """Last stored instant on the run's branch, and a message, if it left its branch; None otherwise."""
    left = jump(system, path)
    if left is None:
        return None
    k, when = left
    cure = "start beyond it on the intended branch" if integrator == "radau" else _CURE
    return k, (
        f"the energy balance jumps at t = {when:.6g} s, where the loops pass a singular position: the run would "
        f"continue on a wrong branch. A smaller solve.tolerance does not help; {cure}"
    )
