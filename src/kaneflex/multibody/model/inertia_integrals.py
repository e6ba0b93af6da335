"""Integrals over a body for the coupled kernels: its moments, and its shapes at points."""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce

import numpy as np

from kaneflex.fem.links import Link, spread_sums
from kaneflex.fem.modes import damping_ratios, rayleigh_coefficients
from kaneflex.mechanism.affine import Matrix
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.scene import Scene
from kaneflex.scene.modal_data import ARRAYS, POINT_ARRAYS, ModalData, symmetrised


def body_data(scene: Scene, name: str, links: Mapping[str, Link], shapes: Mapping[str, Shapes]) -> ModalData | None:
    """Arrays of an elastic body, from finite elements or from its file; None for a rigid one."""
    return link_data(scene, links[name], shapes[name]) if name in links else scene.bodies[name].modal


def body_moments(scene: Scene, name: str, data: ModalData | None) -> dict[str, np.ndarray]:
    """Inertia moments ARRAYS of a body with its lumped masses.

    A rigid body has mass [kg], first [kg m] and second moments [kg m^2] and inertia only; it may have mass off the
    axis: mass_Y, mass_X_Y, mass_Y_Y.
    """
    body = scene.bodies[name]
    lumped = [mass for mass in scene.masses.values() if mass.at.body == name]
    if data is not None:
        found = {key: data.arrays[key] for key in ARRAYS}
        slices = [(mass.mass, mass.inertia, data.at_point(mass.at.point)) for mass in lumped]
    else:
        found = dict.fromkeys(_RIGID, np.zeros(()))
        slices = [(mass.mass, mass.inertia, scene.point(mass.at)) for mass in lumped]
        slices = [(body.mass, body.inertia, body.centre), *slices]
        slices = [(mass, inertia, dict(zip("XY", at, strict=True))) for mass, inertia, at in slices]
    for key in found:
        of, *factors = key.split("_")
        for mass, inertia, at in slices:
            amount = {"mass": mass, "inertia": inertia}.get(of)
            if amount is not None:
                found[key] = found[key] + reduce(np.multiply.outer, [at[factor] for factor in factors], amount)
    return found


_RIGID = ("mass", "mass_X", "mass_Y", "mass_X_X", "mass_X_Y", "mass_Y_Y", "inertia")


def link_data(scene: Scene, link: Link, shapes: Shapes) -> ModalData:
    """Modal data of a link's finite elements without lumped masses, with the points on its axis."""
    points = {name: x for name, (x, y) in scene.bodies[link.name].points_all.items() if y == 0.0}
    H, axial = shapes.shortening(link), shapes.axial.shape[1]
    rows, shortening = zip(*(shapes.at(link, x, H) for x in points.values()), strict=True)
    found = np.array(rows)
    arrays = _link_moments(scene, link, shapes) | {
        "X": np.array(list(points.values())), "s": found[:, 0, :axial], "w": found[:, 1, axial:],
        "psi": found[:, 2, axial:], "H": np.array(shortening),
    }  # fmt: skip
    both = ARRAYS | POINT_ARRAYS
    symmetric = {name: symmetrised(np.asarray(arrays[name], dtype=float), axes) for name, (axes, *_) in both.items()}
    return ModalData(link.length, tuple(points), symmetric)


def _link_moments(scene: Scene, link: Link, shapes: Shapes) -> dict[str, np.ndarray]:
    """Inertia moments ARRAYS of finite elements, from their matrices with rigid displacements and shapes.

    The integral of H_jk = int_0^X w_j' w_k' over the mass is, by exchange of integrals, the geometric stiffness of the
    tension that the mass beyond X (or its first moment) would cause.
    """
    matrices, nodes = link.part.matrices, link.nodes
    size = 3 * len(nodes)
    M, K = (matrices[name].value({}) for name in ("M", "K_s"))
    square = (f"{link.name}.omega",) * 2
    translation = -matrices["K_d"].terms[square]
    rotary = M - translation
    gyroscopic = matrices["C_d"].terms[square[:1]] / 2
    P_0, a_x, spin = (
        matrices["K_g"].terms[monomial]
        for monomial in ((f"{link.name}.link.P_0",), (f"{link.name}.link.a_x",), square)
    )
    total = scene.bodies[link.name].profile.inertia(link.length)
    along, across, forward, turn = np.zeros((4, size))
    along[0::3], across[1::3], forward[0::3], turn[1::3], turn[2::3] = 1.0, 1.0, nodes, nodes, 1.0
    s, w, modal, start = shapes.axial, shapes.transverse, shapes.all, shapes.shortening(link)[0]
    return {
        "mass": total.mass, "mass_X": total.first, "mass_X_X": total.second, "inertia": total.rotary,
        "mass_s": along @ translation @ s, "mass_w": across @ translation @ w,
        "mass_X_s": forward @ translation @ s, "mass_X_w": turn @ translation @ w,
        "mass_s_s": s.T @ translation @ s, "mass_w_w": w.T @ translation @ w, "mass_s_w": -(s.T @ gyroscopic @ w),
        "mass_H": w.T @ (total.mass * P_0 - a_x) @ w + total.mass * start,
        "mass_X_H": w.T @ (total.first * P_0 + spin) @ w + total.first * start,
        "inertia_psi": turn @ rotary @ w, "inertia_psi_psi": w.T @ rotary @ w,
        "stiffness": np.diag(modal.T @ K @ modal), "damping": modal_damping(scene, link, modal, M),
    }  # fmt: skip


def spread_shapes(scene: Scene, name: str, link: Link | None, shapes: Shapes | None) -> dict[str, np.ndarray]:
    """Integrals of a distributed load over its body: share [m], X [m^2], s, w [m] and H [1].

    int p H dX is, by exchange of integrals, the geometric stiffness of a tension int_X^l p.
    """
    load = scene.spreads[name]
    length, (first, last) = scene.bodies[load.spread_on].length, load.profile
    share = length * (first + last) / 2
    found = {"share": np.array(share), "X": np.array(length**2 * (first + 2 * last) / 6)}
    if link is None:
        return found
    along, across, tension = spread_sums(scene, name, link.nodes, link.parameters)
    push, lift = np.zeros(3 * len(link.nodes)), np.zeros(3 * len(link.nodes))
    total = {key: blocks for key, m, blocks in link.element_terms if m == (f"{link.name}.link.P_0",)}["K_g"]
    H = share * shapes.shortening(link)[0]
    for e in range(len(along)):
        rows = slice(3 * e, 3 * e + 6)
        push[rows] += along[e, :, 0]
        lift[rows] += across[e, :, 0]
        w = shapes.transverse[rows]
        H += w.T @ (share * total[e] + tension[e]) @ w
    return found | {"s": push @ shapes.axial, "w": lift @ shapes.transverse, "H": (H + H.T) / 2}


def modal_damping(scene: Scene, link: Link, modal: np.ndarray, M: Matrix) -> np.ndarray:
    """Damping matrix of the modal coordinates [N s/m]; a modal ratio applies to the link's own modes."""
    damping = scene.damping
    if damping is None:
        return np.zeros((modal.shape[1],) * 2)
    K, mass = modal.T @ link.part.matrices["K_s"].value({}) @ modal, modal.T @ M @ modal
    if damping.kind == "rayleigh":
        alpha, beta = rayleigh_coefficients(damping.rayleigh.ratio, *damping.rayleigh.at)
        return alpha * mass + beta * K
    if damping.kind == "modal":
        omega = np.sqrt(np.diag(K) / np.diag(mass))
        return np.diag(2 * damping_ratios(damping.modal.ratio, omega) * omega * np.diag(mass))
    return modal.T @ link.part.matrices["C_s"].value({}) @ modal
