"""Preset coupled in space: deforming bodies and their rigid reference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from kaneflex.multibody.model.assembly import rigid_system
from kaneflex.multibody.model.independent_speeds import choose
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.curves import Beside, Curve, Followed, Standing
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule


@dataclass(frozen=True, eq=False)
class CoupledKinematics(SpatialKinematics):
    """Motion of deforming bodies: their axes and shapes; ``rigid``: motion of the rigid mechanism with the same
    positions of free joints. Before a run bodies are undeformed, and follow the drives or, with free joints, are at
    their start."""

    rigid: SpatialKinematics

    def along(self, curve: Curve) -> CoupledKinematics:
        """This mechanism with another motion."""
        engine, rigid = self.module.system.engine, self.rigid
        counts = len(engine.layout.positions), engine.size
        q, u = (np.setdiff1d(np.arange(count), modal) for count, modal in zip(counts, engine.modal, strict=True))

        def near(times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            found = engine.instants(curve.rows(times))
            return found.q[:, q], found.u[:, u], found.du[:, u]

        beside = Beside(rigid.module.system, replace(rigid.curve.start, t=curve.start.t), near)
        beside.turned = curve.turned
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
    alone = rigid_system(system.mechanism, system.module, system.parameters, coupled=True)
    start = start_of(alone)
    rigid = SpatialKinematics(SpatialModule(alone), alone.parameters, Followed(alone, start))
    if not module.FREE:
        return CoupledKinematics(module, system.parameters, Followed(system, start_of(system)), rigid)
    found = CoupledKinematics(module, system.parameters, Standing(system, first), rigid)
    return found.along(found.curve)
