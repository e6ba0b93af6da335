"""From parts in their own axes to the equations of the mechanism.

With q = L(t) z of each part,

    M_z = sum L^T M L
    C_z = sum L^T C L + 2 L^T M L'
    K_z = sum L^T K L + L^T C L' + L^T M L''
    F_z = sum L^T F

where L turns with the bodies. The paper drops L' and L''; kept, they cancel the spin and Coriolis terms of
whatever inertia is isotropic, as they must.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from kaneflex.affine import Affine, Monomial
from kaneflex.frame import Frame, to_link_axes
from kaneflex.links import MATRIX_OF_GROUP, Link, Part
from kaneflex.scene import Scene


@dataclass(frozen=True)
class Equations:
    """M z'' + (C_s + C_d) z' + (K_s + K_d + K_c + K_g) z = F in the mechanism's coordinates, affine in the motion.

    K_c = L^T C_s L' is the share of the material damping that turns with the links: it comes and goes with C_s.
    """

    coordinates: tuple[str, ...]
    M: Affine
    C_s: Affine
    C_d: Affine
    K_s: Affine
    K_d: Affine
    K_c: Affine
    K_g: Affine
    F: Affine

    @property
    def size(self) -> int:
        return len(self.coordinates)

    def matrices(self) -> dict[str, Affine]:
        return {name: getattr(self, name) for name in ("M", "C_s", "C_d", "K_s", "K_d", "K_c", "K_g", "F")}

    def in_basis(self, basis: np.ndarray, coordinates: tuple[str, ...]) -> Equations:
        """The same equations projected on z = B a with a constant basis."""
        projected = {
            name: affine.projected(basis) if name == "F" else affine.congruent(basis)
            for name, affine in self.matrices().items()
        }
        return Equations(coordinates, **projected)


def guided_part(scene: Scene, name: str) -> Part:
    """A rigid body on a guide, as a point mass in global axes; only its slide is a coordinate of the mechanism.

    Its own inertia force -m (a - g) at the mass centre and the loads on it are its F.
    """
    body = scene.bodies[name]
    x, y = body.centre
    mass = np.eye(2) * body.mass
    load = Affine.constant(body.mass * np.array(scene.gravity)[:, None])
    load += Affine.term((f"{name}.a_x",), [[-body.mass], [0.0]])
    load += Affine.term((f"{name}.a_y",), [[0.0], [-body.mass]])
    if x or y:
        # a of the centre = a of the start + epsilon S R c - omega^2 R c
        arm = to_link_axes(name).T @ Affine.constant(body.mass * np.array([[x], [y]]))
        turned = to_link_axes(name).T @ Affine.constant(body.mass * np.array([[-y], [x]]))
        load += turned @ Affine.term((f"{name}.epsilon",), [[-1.0]])
        load += arm @ Affine.term((f"{name}.omega", f"{name}.omega"), [[1.0]])
    matrices = {key: Affine.zero(2, 1 if key == "F" else 2) for key in set(MATRIX_OF_GROUP.values())}
    matrices |= {"M": Affine.constant(mass), "F": load}
    return Part(name, (f"{name}.x", f"{name}.y"), matrices, {})


def with_loads(scene: Scene, part: Part, link: Link | None) -> Part:
    """Add the scene's point loads on this body to its F, in its own axes."""
    total = part.matrices["F"]
    for name, load in scene.loads.items():
        if load.force_on.body != part.name:
            continue
        direction = Affine.term((name,), np.array(load.direction)[:, None])
        if link is not None:
            node = link.node_at(scene.point(load.force_on)[0])
            rows = part.place[node][:2]
            local = to_link_axes(part.name) @ direction if load.axes == "global" else direction
        else:
            rows = (0, 1)
            local = direction if load.axes == "global" else to_link_axes(part.name).T @ direction
        spread = np.zeros((part.size, 2))
        spread[rows, (0, 1)] = 1.0
        total = total + Affine.constant(spread) @ local
    return replace(part, matrices={**part.matrices, "F": total})


def assemble(parts: Mapping[str, Part], frame: Frame, convective: bool = True) -> Equations:
    """Sum the parts; ``convective=False`` drops L' and L'', as the paper does."""
    size = len(frame.coordinates)
    total = {name: Affine.zero(size, size) for name in ("M", "C_s", "C_d", "K_s", "K_d", "K_c", "K_g")}
    total["F"] = Affine.zero(size, 1)
    for name, part in parts.items():
        L, A = frame.maps[name], part.matrices
        L_T = L.T
        for key in ("M", "C_s", "C_d", "K_s", "K_d", "K_g"):
            total[key] += L_T @ A[key] @ L
        total["F"] += L_T @ A["F"]
        if convective:
            rate = L.rate()
            total["C_d"] += 2.0 * (L_T @ A["M"] @ rate)
            total["K_d"] += L_T @ A["C_d"] @ rate + L_T @ A["M"] @ rate.rate()
            total["K_c"] += L_T @ A["C_s"] @ rate
    return Equations(frame.coordinates, **total)


def spin_or_euler(monomial: Monomial) -> str:
    """Which complete group a term of K_d belongs to: "euler" if proportional to epsilon, else "spin"."""
    return "euler" if any(name.endswith(".epsilon") for name in monomial) else "spin"
