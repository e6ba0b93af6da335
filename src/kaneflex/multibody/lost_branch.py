"""Runs that leave their branch at a singular position: only the energy balance tells, which jumps there.

Branches of a loop's motion cross where its bars lie on one line. Both close the loops, so that no residual knows which
one a step has taken; but closing the loops on the other branch changes speeds, and with them the energy.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.mechanism.energy import LARGEST_JUMP
from kaneflex.multibody import tables as at
from kaneflex.multibody.system import CoupledSystem
from kaneflex.multibody.trajectory import CoupledTrajectory

if TYPE_CHECKING:
    from kaneflex.multibody.run import Run

_PART_OF_A_DRIFT = 0.02
"""Share of the missing energy that, lost between two instants at a singular position, makes that its cause."""
_NEAR = 0.25
"""Share of a run's most regular loops, by the least singular value of their derivatives, below which one is singular
nearby. It falls in proportion to the distance from there."""
_CURE = "take solve.integrator = radau, which passes such positions"
_INSTANTS, _BETWEEN = 20, 9
"""Of a run, to see how regular its loops are; between two stored instants, to see whether they are singular."""


def jump(system: CoupledSystem, path: CoupledTrajectory, share: float = LARGEST_JUMP) -> tuple[int, float] | None:
    """The last stored instant before a jump at a singular position, and when [s] that was passed; None without one.

    ``share``: of the energy turned over, by which the balance has to jump.
    """
    suspects = path.energy.jumps(share)
    loops = min(system.engine.count(at.JOINT_ROWS), system.engine.count(at.KEPT))  # resting contacts are kept rows, too
    if not len(suspects) or not len(_free(system)) or not loops:
        return None
    some = np.unique(np.linspace(0, len(path.times) - 1, _INSTANTS).astype(int))
    rows = _loops(system, path.times[some], path.q[some])
    scale = np.maximum(abs(rows).max(axis=(0, 2), keepdims=True), 1e-300)
    regular = _least(system, rows / scale).max()
    part = np.linspace(0.0, 1.0, _BETWEEN)
    for k in suspects.tolist():
        times = path.times[k] + part * (path.times[k + 1] - path.times[k])
        least = _least(system, _loops(system, times, path.q[k] + part[:, None] * (path.q[k + 1] - path.q[k])) / scale)
        if least.min() < _NEAR * regular:
            return k, float(times[least.argmin()])
    return None


def _free(system: CoupledSystem) -> list[int]:
    """Coordinates of joints that no drive prescribes."""
    engine = system.engine
    return [k for k in (*engine.independent.tolist(), *engine.dependent.tolist()) if not engine.shapes[k]]


def _loops(system: CoupledSystem, times: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Derivatives of the cuts' rows by the joints' free coordinates at some states, (n_times, rows, coordinates)."""
    engine, found = system.engine, []
    n, rows = engine.size, engine.count(at.JOINT_ROWS)
    free = _free(system)
    for t, here in zip(times, q, strict=True):
        system.fold(here, np.zeros_like(here))
        engine.openings(float(t))
        gradient = engine.numbers(at.GRADIENT, rows * n).reshape(rows, n) * engine.numbers(at.MEASURE, n)
        found.append(gradient[:, free])
    return np.array(found)


def _least(system: CoupledSystem, loops: np.ndarray) -> np.ndarray:
    """Least singular value of as many rows as follow from no others, (n_times,)."""
    values = np.linalg.svd(loops, compute_uv=False)
    return values[:, min(system.engine.count(at.KEPT), values.shape[1]) - 1]


def cause(system: CoupledSystem, path: CoupledTrajectory) -> str:
    """Advice for a run whose energy gets lost at a singular position; nothing for one that loses it elsewhere."""
    found = jump(system, path, _PART_OF_A_DRIFT * path.energy.drift)
    if found is None:
        return ""
    return (
        f"and jumps at t = {found[1]:.6g} s, where the loops pass a singular position: look whether the motion goes on "
        "along the right branch; a smaller solve.tolerance is no cure"
    )


def cut(run: Run, found: CoupledTrajectory) -> CoupledTrajectory:
    """A run as it was found, up to where it left its branch, with an outcome that says so."""
    left = jump(run.system, found)
    if left is None:
        return found
    k, when = left
    run.filled, run.here = k, run.rows[k].copy()
    run.impacts = tuple(impact for impact in run.impacts if impact.begin <= run.times[k])
    cure = "start beyond it on the branch that is meant" if run.method.integrator == "radau" else _CURE
    message = (
        f"the energy balance jumps at t = {when:.6g} s, where the loops pass a singular position: the run would go on "
        f"along a wrong branch. A smaller solve.tolerance does not help; {cure}"
    )
    ends = found.ends[found.ends <= run.times[k]]
    return run.trajectory(run.rows[: k + 1], Outcome.SINGULAR, message, found.ns_per_step, ends)
