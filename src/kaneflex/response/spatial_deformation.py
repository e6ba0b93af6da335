"""Deformed links in space, the section forces in them, and those of rigid ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from kaneflex.mechanism.affine import Affine
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import spatial_mechanism_of
from kaneflex.mechanism.spatial_wrenches import wrenches_on
from kaneflex.multibody.spatial_elastic import pushed_nodes, spread_on, with_loads
from kaneflex.response.deformation import Deformation, sag
from kaneflex.response.section_forces import spread_loads
from kaneflex.scene import Scene

SECTION = ("N", "V_y", "V_z", "T", "M_y", "M_z")
"""Axial force (tension positive), shear forces [N], torsional and bending moments [N m], link axes: what the part
beyond a section exerts on the part before it."""


@dataclass(frozen=True, eq=False)
class SpatialDeformation(Deformation):
    """One link's deformation in space: u, v, w, theta_x, theta_y, theta_z of every node."""

    def pushes(self) -> np.ndarray:
        link = self.link
        nodes = pushed_nodes(spatial_mechanism_of(self.model.scene), link)
        unloaded = replace(link.part, matrices={"F": Affine.zero(link.part.size, 1)})
        return self.rigid.column_of(with_loads(unloaded, nodes).matrices["F"])

    def section(self, x: float, after: bool = False) -> np.ndarray:  # type: ignore[override]
        """SECTION at distance x [m] from the start, (6, n_times), as in the plane."""
        e, local = self.link.locate(x)
        left, right = self._ends(e)
        if self.link.node_at(x) is not None and e > 0 and local < 0.5 * self.link.length_of(e):
            return np.array(self._at_node(x, after, tuple(self._ends(e - 1)[1]), tuple(left)))
        length = self.link.length_of(e)
        found = left + (right - left) * (local / length)
        if self.model.balances:
            for k, load in enumerate(self._rigid_load(e)):
                found[k] -= sag(load, local, length, 1)
                if k:  # M_z'' = p_y, M_y'' = -p_z
                    found[5 if k == 1 else 4] += (1.0 if k == 1 else -1.0) * sag(load, local, length, 2)
        return found

    def _ends(self, e: int) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[override]
        f = self.end_forces(e)
        return -f[:6], f[6:]

    def _rigid_load(self, e: int) -> tuple[np.ndarray, ...]:  # type: ignore[override]
        """Inertia load of the rigid link and what is spread on it, on an element [N/m] along x, y, z: coefficients of
        1, x, x^2 each."""
        name, x_0 = self.link.name, self.link.nodes[e]
        specific_force, *turning = ([self.rigid[f"{name}.link.{kind}_{axis}"] for axis in "xyz"]
                                    for kind in ("a", "omega", "epsilon"))  # fmt: skip
        spread = self._spread(e)
        return tuple(
            self._inertia_load(e, at + growing * x_0, growing) + spread[k]
            for k, (at, growing) in enumerate(zip(specific_force, _growing(*turning), strict=True))
        )


def _growing(omega: Sequence[np.ndarray] | np.ndarray, epsilon: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """(epsilon~ + omega~ omega~) e_x, by which the acceleration grows along a link; components in its axes."""
    return np.array([
        -(omega[1] ** 2 + omega[2] ** 2), epsilon[2] + omega[0] * omega[1], omega[0] * omega[2] - epsilon[1]
    ])  # fmt: skip


def rigid_section(scene: Scene, rigid: RigidMotion, name: str, x: float, after: bool = False) -> np.ndarray:
    """SECTION of the rigid link at distance x [m] from its start, (6, n_times).

    The part before x is in balance under its inertia, its weight and all that acts on it: ``after`` says whether what
    acts at x between the ends does, too.
    """
    mechanism, frame = spatial_mechanism_of(scene), rigid.frame(name)
    body, before = scene.bodies[name], scene.bodies[name].profile.inertia(x)
    assert body.beam is not None and body.length is not None  # only such have sections
    omega, epsilon = frame.to_body(frame.omega), frame.to_body(frame.epsilon)
    specific_force = frame.to_body(frame.acceleration(np.zeros(3)) - mechanism.gravity[:, None])
    grows = _growing(omega, epsilon)
    e_x = np.array([1.0, 0.0, 0.0])[:, None]
    force = before.mass * specific_force + before.first * grows
    first, second = before.first - x * before.mass, before.second - x * before.first  # about the place itself
    moment = np.cross(e_x, first * specific_force + second * grows, axis=0)
    own = np.array(body.spatial_profile.rotary_inertias(x))[:, None] * [[1.0], [body.beam.rotary], [body.beam.rotary]]
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
