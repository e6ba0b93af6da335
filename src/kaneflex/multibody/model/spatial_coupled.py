"""Preset coupled in space: deforming bodies, with the rigid mechanism beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from types import ModuleType

import numpy as np

from kaneflex.fem.spatial_links import link_of_scene
from kaneflex.multibody.model.held_shapes import held_shapes
from kaneflex.multibody.model.independent_speeds import choose
from kaneflex.multibody.model.shape_bases import spatial_shapes
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.spatial_layout import BALL, COORDINATE, COUNT, KIND, SPEED, Deformable, Flexible, Place
from kaneflex.multibody.model.spatial_system import SpatialSystem, State, build_spatial_system
from kaneflex.multibody.time.shooting import Verdict
from kaneflex.multibody.time.spatial_curves import Curve, Followed, Standing
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule
from kaneflex.multibody.time.spatial_sections import sections
from kaneflex.scene import Scene
from kaneflex.scene.options import Options

_BENT = 0.02
"""Largest modal coordinate, as a share of its link's length, without a warning of shapes that resemble a rotation."""


@dataclass(frozen=True, eq=False)
class CoupledKinematics(SpatialKinematics):
    """Motion of deforming bodies: their axes and shapes; ``rigid``: motion of the rigid mechanism with the same
    positions of free joints; ``freedoms``: independent speeds; ``verdict``: outcome of the run. Before it there is
    none: bodies are undeformed, and follow the drives or, with free joints, are at their start."""

    rigid: SpatialKinematics
    freedoms: int
    verdict: Verdict | None = None

    def along(self, curve: Curve) -> CoupledKinematics:
        """The same mechanism in another motion."""
        moved, rigid = SpatialKinematics(self.module, self.parameters, curve), self.rigid
        beside = _Beside(moved, rigid.module.system, rigid.curve.start)
        return replace(self, curve=curve, rigid=replace(rigid, curve=beside))

    def undeformed(self, t: float) -> State:
        """State at t [s] with zero shapes at rest: by the drives if they prescribe it, else from the motion."""
        system = self.module.system
        if not self.module.FREE:
            return Followed(system, start_of(system))(t)
        found = self.curve(t)
        q, u = found.q.copy(), found.u.copy()
        q[system.modal_coordinates] = u[system.modal_speeds] = 0.0
        return system.project(t, q, u, choose(system, q, prefer=True))


def build_coupled_system(scene: Scene, module: ModuleType, options: Options) -> SpatialSystem:
    """A scene in space whose bodies deform."""

    def shapes(name: str, held: Place | None, freed: str) -> Deformable:
        body = scene.bodies[name]
        if body.modal is not None:
            return held_shapes(body.modal, held, freed)
        assert body.beam is not None
        link = link_of_scene(scene, name, options.elements or body.beam.elements)
        return spatial_shapes(scene, link, int(options.modes), held, freed)

    flexible: Flexible = {name: partial(shapes, name) for name, body in scene.bodies.items() if body.deforms}
    return build_spatial_system(scene, module, flexible, coupled=True)


def before_run(module: SpatialModule, first: State) -> CoupledKinematics:
    """Motion of a coupled system, at ``first`` at the start, as far as it is known before a run."""
    system = module.system
    alone = build_spatial_system(system.scene, system.module, coupled=True, balls=system.layout.kept)
    start = start_of(alone)
    rigid = SpatialKinematics(SpatialModule(alone), alone.parameters, Followed(alone, start))
    freedoms = len(first.choice.independent)
    if not module.FREE:
        return CoupledKinematics(module, system.parameters, Followed(system, start_of(system)), rigid, freedoms)
    found = CoupledKinematics(module, system.parameters, Standing(system, first), rigid, freedoms)
    return found.along(found.curve)


class _Beside(Curve):
    """Curve of the rigid mechanism with the drives and free joints of a coupled one.

    NaN if its loops don't close.
    """

    def __init__(self, coupled: SpatialKinematics, system: SpatialSystem, start: State) -> None:
        self.coupled, self.system, self.start = coupled, system, start
        of = coupled.module.system
        self.q = np.setdiff1d(np.arange(of.coordinates), of.modal_coordinates)
        self.u = np.setdiff1d(np.arange(of.speeds), of.modal_speeds)

    def rows(self, times: np.ndarray) -> np.ndarray:
        given, out = self._given(times), np.full((len(times), len(self.system.work.kept)), np.nan)
        done = 0
        while done < len(times):
            try:
                self.system.near(self.start.choice, times[done:], given[done:], out[done:])
                done = len(times)
            except ArithmeticError as reason:
                done += int(np.searchsorted(times[done:], reason.args[1]))
                out[done] = np.nan
                done += 1
        return out

    def _given(self, times: np.ndarray) -> np.ndarray:
        of = self.coupled.module.system
        found = of.instants(self.coupled.curve.rows(times))
        q, u = found.q.copy(), found.u.copy()
        for joint, (body, turn) in of.layout.freed.items():  # a joint stands as its section does, not as the axes
            last, shapes = (of.tables.nodes[node] for node in (of.layout.tree[joint][0][-1], of.layout.node_of[body]))
            theta, rate = (moved[:, shapes[what] : shapes[what] + shapes[COUNT]] @ turn.T
                           for moved, what in ((q, COORDINATE), (u, SPEED)))  # fmt: skip
            if last[KIND] == BALL:
                _turn_on(q[:, last[COORDINATE] :][:, :4], u[:, last[SPEED] :][:, :3], theta, rate)
            else:
                q[:, last[COORDINATE]] += 2.0 * np.arctan(0.5 * theta)
                u[:, last[SPEED]] += rate / (1.0 + 0.25 * theta**2)
        return np.ascontiguousarray(np.hstack([q[:, self.q], u[:, self.u]]))


def _turn_on(q: np.ndarray, u: np.ndarray, theta: np.ndarray, rate: np.ndarray) -> None:
    """Rotate quaternions (n, 4) and angular velocities in their axes (n, 3) on to sections at theta there."""
    from scipy.spatial.transform import Rotation

    R, T, _ = sections(theta, rate)
    turned = Rotation.from_quat(np.roll(q, -1, axis=1)) * Rotation.from_matrix(R)
    q[:] = np.roll(turned.as_quat(), 1, axis=1)
    u[:] = np.einsum("nji,nj->ni", R, u + np.einsum("nij,nj->ni", T, rate))


def taken_turns(motion: SpatialKinematics, times: np.ndarray) -> list[str]:
    """Warnings about bodies with large bending at a joint whose rotation their shapes can represent as well, though a
    law or a spring uses the joint's angle."""
    system, seen, found = motion.module.system, motion.moved(times), list[str]()
    mechanism, layout = system.mechanism, system.layout
    for name, (_, child) in layout.tree.items():
        joint = mechanism.joints[name]
        body = joint.sides[1 if child > 0 else 0].body
        turns = any(move.startswith("angle") for move, _ in joint.moves)
        if body not in layout.shapes or not turns or name in mechanism.prescribed or name in layout.freed:
            continue
        bent = max(abs(seen[f"{body}.shape_{k}"]).max() for k in range(layout.shapes[body].count))
        if bent > _BENT * (system.scene.bodies[body].length or np.inf):
            found.append(
                f"{body} bends by {bent:.2g} m, and its shapes can represent the rotation of {name} as well: "
                "compare with fewer solve.modes, or divide it into several welded bodies"
            )
    return found
