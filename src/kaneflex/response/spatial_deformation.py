"""Deformed links in space, and section forces of elastic and rigid links."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, cast

import numpy as np

from kaneflex.mechanism.affine import Affine
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.mechanism.spatial_wrenches import wrenches_on
from kaneflex.multibody.model.spatial_elastic import pushed_nodes, spread_on, with_loads
from kaneflex.response.deformation import Deformation
from kaneflex.response.section_forces import spread_loads
from kaneflex.scene import Scene

SECTION = ("N", "V_y", "V_z", "T", "M_y", "M_z")
"""Axial force (tension positive), shear forces [N], torsional and bending moments [N m] in link axes, exerted by the
part beyond a section on the part before it."""


@dataclass(frozen=True, eq=False)
class SpatialDeformation(Deformation):
    """Deformation of one link in space: u, v, w, theta_x, theta_y, theta_z of every node; section forces as in
    SECTION."""

    BENT: ClassVar[Mapping[int, tuple[int, float]]] = {1: (5, 1.0), 2: (4, -1.0)}  # M_z'' = p_y, M_y'' = -p_z

    def pushes(self) -> np.ndarray:
        link = self.link
        nodes = pushed_nodes(spatial_mechanism_of(self.model.scene), link)
        unloaded = replace(link.part, matrices={"F": Affine.zero(link.part.size, 1)})
        return self.rigid.column_of(with_loads(unloaded, nodes).matrices["F"])

    def _rigid_load(self, e: int) -> tuple[np.ndarray, ...]:
        """Inertia load of the rigid link on an element along x, y, z [N/m]: coefficients of 1, x, x^2 each."""
        name, x_0 = self.link.name, self.link.nodes[e]
        specific_force, *turning = ([self.rigid[f"{name}.link.{kind}_{axis}"] for axis in "xyz"]
                                    for kind in ("a", "omega", "epsilon"))  # fmt: skip
        return tuple(
            self._inertia_load(e, at + growing * x_0, growing)
            for at, growing in zip(specific_force, _growing(*turning), strict=True)
        )


def _growing(omega: Sequence[np.ndarray] | np.ndarray, epsilon: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Gradient (epsilon~ + omega~ omega~) e_x of the acceleration along a link, in its axes."""
    return np.array([
        -(omega[1] ** 2 + omega[2] ** 2), epsilon[2] + omega[0] * omega[1], omega[0] * omega[2] - epsilon[1]
    ])  # fmt: skip


def rigid_section(scene: Scene, rigid: RigidMotion, name: str, x: float, after: bool = False) -> np.ndarray:
    """Section forces SECTION of the rigid link at distance x [m] from its start, (6, n_times).

    From the equilibrium of the part before x under inertia, weight and loads; ``after``: include those at x.
    """
    mechanism, frame = spatial_mechanism_of(scene), rigid.frame(name)
    body, before = scene.bodies[name], scene.bodies[name].profile.inertia(x)
    assert body.beam is not None and body.length is not None  # only beams have sections
    omega, epsilon = frame.to_body(frame.omega), frame.to_body(frame.epsilon)
    specific_force = frame.to_body(frame.acceleration(np.zeros(3)) - mechanism.gravity[:, None])
    grows = _growing(omega, epsilon)
    e_x = np.array([1.0, 0.0, 0.0])[:, None]
    force = before.mass * specific_force + before.first * grows
    first, second = before.first - x * before.mass, before.second - x * before.first  # about x
    moment = np.cross(e_x, first * specific_force + second * grows, axis=0)
    about_y, about_z = before.about_y, before.about_z
    own = np.array([[about_y + about_z], [about_y * body.beam.rotary], [about_z * body.beam.rotary]])
    moment += own * epsilon + np.cross(omega, own * omega, axis=0)
    for start, rise in spread_loads(scene, rigid, name):
        force = force - (start * x + rise * x**2 / 2)
        moment = moment + np.cross(e_x, start * x**2 / 2 + rise * x**3 / 6, axis=0)
    spread = spread_on(mechanism, name)
    for each in wrenches_on(mechanism, rigid, name):
        at = each.on[0]
        if each.by not in spread and (at < x or at == 0.0 or (after and at == x < body.length)):
            force = force - each.force
            moment = moment - each.moment - np.cross(each.at - x * e_x, each.force, axis=0)
    return cast(np.ndarray, np.vstack([force, moment]))
