"""The sums over a body's slices that the coupled kernels take as parameters, by their names in PARAMETERS."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

import numpy as np

from kaneflex.fem.links import Link, spread_sums
from kaneflex.fem.modes import damping_ratios, rayleigh_coefficients
from kaneflex.mechanism.affine import as_array
from kaneflex.multibody.shapes import Shapes
from kaneflex.scene import Scene


def body_numbers(
    scene: Scene, module: ModuleType, links: Mapping[str, Link], shapes: Mapping[str, Shapes]
) -> dict[str, float]:
    """Path -> value (SI) of every moment, stiffness, damping and shape that belongs to a body."""
    numbers: dict[str, float] = {}
    for name in module.BODIES:
        if name in links:
            own = _with_lumped(scene, name, link_numbers(scene, links[name], shapes[name]))
        elif scene.bodies[name].modal is not None:
            own = _with_lumped(scene, name, scene.bodies[name].modal.numbers())
        else:
            own = _rigid_numbers(scene, name)
        for load in (load for load, entry in scene.spreads.items() if entry.spread_on == name):
            spread = _spread_numbers(scene, load, links.get(name), shapes.get(name))
            numbers |= {f"loads.{load}.{key}": float(value) for key, value in spread.items()}
        numbers |= {
            f"bodies.{name}.{'points.' if '.' in key else ''}{key}": float(value) for key, value in own.items()
        }
    return numbers


def _rigid_numbers(scene: Scene, name: str) -> dict[str, float]:
    """Mass [kg], its first [kg m] and second moments [kg m^2], and inertia about the start, lumped masses included."""
    body = scene.bodies[name]
    entries = [(body.mass, body.inertia, body.centre)]
    entries += [
        (mass.mass, mass.inertia, scene.point(mass.at)) for mass in scene.masses.values() if mass.at.body == name
    ]
    return {
        "mass": sum(m for m, _, _ in entries),
        "mass_X": sum(m * x for m, _, (x, _) in entries),
        "mass_Y": sum(m * y for m, _, (_, y) in entries),
        "mass_X_X": sum(m * x * x for m, _, (x, _) in entries),
        "mass_X_Y": sum(m * x * y for m, _, (x, y) in entries),
        "mass_Y_Y": sum(m * y * y for m, _, (_, y) in entries),
        "inertia": sum(J for _, J, _ in entries),
    }


def link_numbers(scene: Scene, link: Link, shapes: Shapes) -> dict[str, float]:
    """Moments of the finite elements without lumped masses, and shapes at every named point on a node.

    Rigid displacements and shapes go through the elements' own matrices. H_jk = int_0^X w_j' w_k', beside what the
    frame's point has of it, is under the sum, by exchange of the integrals, a geometric stiffness: that of the
    tension which the mass beyond X (or its first moment) would raise.
    """
    matrices, nodes = link.part.matrices, link.nodes
    size = 3 * len(nodes)
    M = matrices["M"].at({}).toarray()
    omega, square = f"{link.name}.omega", (f"{link.name}.omega",) * 2
    translation = -as_array(matrices["K_d"].terms[square])
    rotary = M - translation
    gyroscopic = as_array(matrices["C_d"].terms[(omega,)]) / 2
    tension = {
        key: as_array(matrices["K_g"].terms[monomial])
        for key, monomial in (
            ("P_0", (f"{link.name}.link.P_0",)),
            ("a_x", (f"{link.name}.link.a_x",)),
            ("spin", square),
        )
    }
    total = scene.bodies[link.name].profile.inertia(link.length)
    along, forward, turn = np.zeros(size), np.zeros(size), np.zeros(size)
    along[0::3], forward[0::3], turn[1::3], turn[2::3] = 1.0, nodes, nodes, 1.0
    across = np.zeros(size)
    across[1::3] = 1.0
    s, w = shapes.axial, shapes.transverse
    shortening = shapes.shortening(link)
    found = {"mass": total.mass, "mass_X": total.first, "mass_X_X": total.second, "inertia": total.rotary}
    found |= _vector("mass_s", along @ translation @ s) | _vector("mass_w", across @ translation @ w)
    found |= _vector("mass_X_s", forward @ translation @ s) | _vector("mass_X_w", turn @ translation @ w)
    found |= _pairs("mass_s", "s", s.T @ translation @ s) | _pairs("mass_w", "w", w.T @ translation @ w)
    found |= {f"mass_s_{j}_w_{k}": value for (j, k), value in np.ndenumerate(-(s.T @ gyroscopic @ w))}
    from_start = w.T @ (total.mass * tension["P_0"] - tension["a_x"]) @ w
    found |= _pairs("mass_H", "", from_start + total.mass * shortening[0])
    from_start = w.T @ (total.first * tension["P_0"] + tension["spin"]) @ w
    found |= _pairs("mass_X_H", "", from_start + total.first * shortening[0])
    found |= _vector("inertia_psi", turn @ rotary @ w) | _pairs("inertia_psi", "psi", w.T @ rotary @ w)
    modal = shapes.all
    stiffness = np.diag(modal.T @ matrices["K_s"].at({}).toarray() @ modal)
    found |= _vector("stiffness", stiffness)
    found |= _pairs("damping", "", _damping(scene, link, modal, M))
    for name, (x, _) in scene.bodies[link.name].points_all.items():
        node = link.node_at(x)
        if node is not None:
            own = _point_numbers(link, shapes, node, shortening[node])
            found |= {f"{name}.{key}": value for key, value in own.items()}
    return found


def _spread_numbers(scene: Scene, name: str, link: Link | None, shapes: Shapes | None) -> dict[str, float]:
    """Sums of a load's profile over its body: share [m], X [m^2], s, w [m] and H [1].

    int p H dX is, by exchange of the integrals, the geometric stiffness of a tension int_X^l p.
    """
    load = scene.spreads[name]
    length, (first, last) = scene.bodies[load.spread_on].length, load.profile
    share = length * (first + last) / 2
    found = {"share": share, "X": length**2 * (first + 2 * last) / 6}
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
    found |= _vector("s", push @ shapes.axial) | _vector("w", lift @ shapes.transverse)
    return found | _pairs("H", "", H)


def _point_numbers(link: Link, shapes: Shapes, node: int, H: np.ndarray) -> dict[str, float]:
    """X [m], the shapes s, w [1] and psi [1/m] and their foreshortening H [1/m] at a node."""
    found = {"X": float(link.nodes[node])}
    found |= _vector("s", shapes.axial[3 * node]) | _vector("w", shapes.transverse[3 * node + 1])
    return found | _vector("psi", shapes.transverse[3 * node + 2]) | _pairs("H", "", H)


def _with_lumped(scene: Scene, name: str, link: dict[str, float]) -> dict[str, float]:
    """A lumped mass is one more slice."""
    found = dict(link)
    for mass in scene.masses.values():
        if mass.at.body != name:
            continue
        own = f"{mass.at.point}."
        at = {key.removeprefix(own): value for key, value in link.items() if key.startswith(own)}
        for key in (key for key in link if "." not in key):
            of, *factors = _factors(key)
            if of == "mass":
                found[key] += mass.mass * np.prod([at[factor] for factor in factors])
            elif of == "inertia":
                found[key] += mass.inertia * np.prod([at[factor] for factor in factors])
    return found


def _factors(name: str) -> list[str]:
    """mass_X_H_0_1 -> mass, X, H_0_1."""
    parts = name.split("_")
    found: list[str] = []
    for part in parts:
        if part.isdigit():
            found[-1] += f"_{part}"
        else:
            found.append(part)
    return found


def _vector(name: str, values: np.ndarray) -> dict[str, float]:
    return {f"{name}_{j}": value for j, value in enumerate(values)}


def _pairs(name: str, second: str, matrix: np.ndarray) -> dict[str, float]:
    """The upper triangle of a symmetric matrix."""
    between = f"_{second}_" if second else "_"
    return {f"{name}_{j}{between}{k}": matrix[j, k] for j in range(len(matrix)) for k in range(j, len(matrix))}


def _damping(scene: Scene, link: Link, modal: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Damping of the modal coordinates [N s/m]; a modal ratio is that of each of the link's own modes."""
    damping = scene.damping
    if damping is None:
        return np.zeros((modal.shape[1],) * 2)
    K, mass = modal.T @ link.part.matrices["K_s"].at({}).toarray() @ modal, modal.T @ M @ modal
    if damping.kind == "rayleigh":
        alpha, beta = rayleigh_coefficients(damping.rayleigh.ratio, *damping.rayleigh.at)
        return alpha * mass + beta * K
    if damping.kind == "modal":
        omega = np.sqrt(np.diag(K) / np.diag(mass))
        return np.diag(2 * damping_ratios(damping.modal.ratio, omega) * omega * np.diag(mass))
    return modal.T @ link.part.matrices["C_s"].at({}).toarray() @ modal
