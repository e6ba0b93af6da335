"""Preset coupled in space: deforming bodies and their rigid reference."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from types import ModuleType

import numpy as np

from kaneflex.fem.links import link_of_scene
from kaneflex.multibody.model.held_shapes import held_shapes
from kaneflex.multibody.model.independent_speeds import choose
from kaneflex.multibody.model.shape_bases import alike, spanned, spatial_shapes
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.spatial_system import SpatialSystem, build_spatial_system
from kaneflex.multibody.model.state import State
from kaneflex.multibody.model.tree_layout import Deformable, Flexible, Place
from kaneflex.multibody.time.spatial_curves import Curve, Followed, Standing
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule
from kaneflex.scene import Scene
from kaneflex.scene.options import Options


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

    def states(self, system: SpatialSystem, times: np.ndarray) -> list[State]:
        """States at ``times`` [s] with zero shapes at rest: by the drives if these prescribe them, else by the motion.
        """
        if not self.module.FREE:
            return list(map(Followed(system, start_of(system)), times.tolist()))
        return [self._at_rest(system, self.curve(t)) for t in times.tolist()]

    def _at_rest(self, system: SpatialSystem, found: State) -> State:
        """State with zero shapes at rest."""
        q, u = found.q.copy(), found.u.copy()
        coordinates, speeds = system.engine.modal
        q[coordinates] = u[speeds] = 0.0
        return system.project(found.t, q, u, choose(system, q, prefer=True))


def build_coupled_system(
    scene: Scene, module: ModuleType, options: Options, like: SpatialSystem | None = None, frozen: bool = False
) -> SpatialSystem:
    """A scene in space whose bodies deform.

    ``like``: system of a scene that differs in numbers only, and whose links' shapes have the same signs and scales;
    ``frozen`` keeps the space spanned by them.
    """

    def shapes(name: str, held: Place | None, freed: str) -> Deformable:
        body, before = scene.bodies[name], None if like is None else like.layout.shapes[name]
        if body.modal is not None:
            return held_shapes(body.modal, held, freed)
        assert body.beam is not None
        link = link_of_scene(scene, name, options.elements or body.beam.elements)
        if not isinstance(before, Shapes):
            return spatial_shapes(scene, link, int(options.modes), held, freed)
        hung = None if held is None else held[0]
        kept = frozen and spanned(scene, before, link, hung)
        return alike(kept or spatial_shapes(scene, link, int(options.modes), held, freed), before)

    flexible: Flexible = {name: partial(shapes, name) for name, body in scene.bodies.items() if body.deforms}
    return build_spatial_system(scene, module, flexible, coupled=True)


def before_run(module: SpatialModule, first: State) -> CoupledKinematics:
    """Motion of a coupled system, at ``first`` at the start, as far as it is known before a run."""
    system = module.system
    alone = build_spatial_system(system.scene, system.module, coupled=True)
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

    def __init__(self, coupled: SpatialKinematics, system: SpatialSystem, start: State) -> None:
        self.coupled, self.system, self.start = coupled, system, replace(start, t=coupled.begin)
        of, self.turned = coupled.module.system, coupled.curve.turned
        coordinates, speeds = of.engine.modal
        self.q = np.setdiff1d(np.arange(len(of.engine.layout.positions)), coordinates)
        self.u = np.setdiff1d(np.arange(of.engine.size), speeds)

    def rows(self, times: np.ndarray) -> np.ndarray:
        found = self.coupled.module.system.engine.instants(self.coupled.curve.rows(times))
        given = np.ascontiguousarray(np.hstack([found.q[:, self.q], found.u[:, self.u]]))
        out, done = np.full((len(times), len(self.system.work.kept)), np.nan), 0
        while done < len(times):
            try:
                self.system.near(self.start.choice, times[done:], given[done:], out[done:])
                done = len(times)
            except ArithmeticError as reason:
                done += int(np.searchsorted(times[done:], reason.args[1]))
                out[done] = np.nan
                done += 1
        return out
