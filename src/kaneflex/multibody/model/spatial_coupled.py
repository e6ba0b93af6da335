"""Preset coupled in space: deforming bodies and their rigid reference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.independent_speeds import choose
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.curves import Curve, Followed, Standing
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule


@dataclass(frozen=True, eq=False)
class CoupledKinematics(SpatialKinematics):
    """Motion of deforming bodies: their axes and shapes; ``rigid``: motion of the rigid mechanism with the same
    positions of free joints. Before a run bodies are undeformed, and follow the drives or, with free joints, are at
    their start."""

    rigid: SpatialKinematics

    def along(self, curve: Curve) -> CoupledKinematics:
        """This mechanism with another motion."""
        moved, rigid = SpatialKinematics(self.module, self.parameters, curve), self.rigid
        beside = _Beside(moved, rigid.module.system, rigid.curve.start)
        return replace(self, curve=curve, rigid=replace(rigid, curve=beside))

    def states(self, system: System, times: np.ndarray) -> list[State]:
        """States at ``times`` [s] with zero shapes at rest: by the drives if these prescribe them, else by the motion.
        """
        if not self.module.FREE:
            return list(map(Followed(system, start_of(system)), times.tolist()))
        return [self._at_rest(system, self.curve(t)) for t in times.tolist()]

    def _at_rest(self, system: System, found: State) -> State:
        """State with zero shapes at rest."""
        q, u = found.q.copy(), found.u.copy()
        coordinates, speeds = system.engine.modal
        q[coordinates] = u[speeds] = 0.0
        return system.project(found.t, q, u, choose(system, q, prefer=True))


def before_run(module: SpatialModule, first: State) -> CoupledKinematics:
    """Motion of a coupled system, at ``first`` at the start, as far as it is known before a run."""
    system = module.system
    alone = rigid_system(system.scene, system.module, coupled=True)
    start = start_of(alone)
    rigid = SpatialKinematics(SpatialModule(alone), alone.parameters, Followed(alone, start))
    if not module.FREE:
        return CoupledKinematics(module, system.parameters, Followed(system, start_of(system)), rigid)
    found = CoupledKinematics(module, system.parameters, Standing(system, first), rigid)
    return found.along(found.curve)


class _Beside(Curve):
    """Curve of the rigid mechanism with the drives and free joints of a coupled one.

    NaN if its loops don't close.
    """

    def __init__(self, coupled: SpatialKinematics, system: System, start: State) -> None:
        self.coupled, self.system, self.start = coupled, system, replace(start, t=coupled.begin)
        of, self.turned = coupled.module.system, coupled.curve.turned
        coordinates, speeds = of.engine.modal
        self.q = np.setdiff1d(np.arange(len(of.engine.layout.positions)), coordinates)
        self.u = np.setdiff1d(np.arange(of.engine.size), speeds)

    def rows(self, times: np.ndarray) -> np.ndarray:
        found = self.coupled.module.system.engine.instants(self.coupled.curve.rows(times))
        engine = self.system.engine
        engine.choose_speeds(self.start.choice)
        rows = engine.rows_of(times, found.q[:, self.q], found.u[:, self.u])
        out, done = np.full((len(times), len(engine.work.kept)), np.nan), 0
        while done < len(times):
            closed = engine.unfold(rows[done:], nearby=True)
            out[done : done + len(closed)] = closed
            done += len(closed) + 1
        return out
