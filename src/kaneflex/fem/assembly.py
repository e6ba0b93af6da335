"""Assembly of parts in their own axes into the equations of the mechanism.

With q = L(t) z for each part,

    M_z = sum L^T M L
    C_z = sum L^T C L + 2 L^T M L'
    K_z = sum L^T K L + L^T C L' + L^T M L''
    F_z = sum L^T F

where L rotates with the bodies. The paper drops L' and L''; here they cancel the spin and Coriolis terms of isotropic
inertia, as they must. A quasi-static deformation is at rest in the axes of the bodies, whatever the coordinates z: then
K_z = sum L^T K L.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from kaneflex.fem.coordinate_map import Frame, to_link_axes
from kaneflex.fem.element_terms import MATRIX_OF_GROUP
from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.affine import Affine, Monomial
from kaneflex.mechanism.rigid_bodies import Carried
from kaneflex.scene import Scene
from kaneflex.scene.parts import Load

Placed = tuple[Part, Affine]
"""Part with its map L."""


@dataclass(frozen=True)
class ElasticEquations:
    """Equations M z'' + (C_s + C_d) z' + (K_s + K_d + K_c + K_g) z = F of the mechanism, affine in the motion.

    K_c = L^T C_s L' is the share of the material damping that rotates with the links; it vanishes without C_s.
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

    def fixed(self, constants: Mapping[str, float]) -> ElasticEquations:
        """Equations with the scalars that a structure fixes replaced by their values; terms that vanish are omitted."""
        return replace(self, **{name: affine.fixed(constants) for name, affine in self.matrices().items()})

    def in_basis(self, basis: np.ndarray, coordinates: tuple[str, ...]) -> ElasticEquations:
        """Equations projected on z = B a with a constant basis."""
        projected = {
            name: affine.projected(basis) if name == "F" else affine.congruent(basis)
            for name, affine in self.matrices().items()
        }
        return ElasticEquations(coordinates, **projected)


def inertia_part(name: str, body: str, mass: float, inertia: float, at: tuple[float, float], gravity) -> Part:
    """Rigid mass at a point of a body; coordinates are its global displacement x, y and rotation.

    M = diag(m, m, J) is constant; F = (-m (a - g), -J epsilon) with a = a_O + epsilon S R r - omega^2 R r. Damping acts
    on its velocity in the body's axes, d' - omega S d.
    """
    load = Affine.constant([[mass * gravity[0]], [mass * gravity[1]], [0.0]])
    load += Affine.term((f"{body}.a_x",), [[-mass], [0.0], [0.0]]) + Affine.term(
        (f"{body}.a_y",), [[0.0], [-mass], [0.0]]
    )
    x, y = at
    if x or y:
        spin, turn = (f"{body}.omega", f"{body}.omega"), (f"{body}.epsilon",)
        global_axes = to_link_axes(body).T
        toward = global_axes @ Affine.constant([[mass * x], [mass * y]])
        across = global_axes @ Affine.constant([[-mass * y], [mass * x]])
        arms = toward @ Affine.term(spin, [[1.0]]) + across @ Affine.term(turn, [[-1.0]])
        load += Affine.constant(np.eye(3)[:, :2]) @ arms
    if inertia:
        load += Affine.term((f"{body}.epsilon",), [[0.0], [0.0], [-inertia]])
    part = sparse_part(name, 3, M=Affine.constant(np.diag([mass, mass, inertia])), F=load)
    return replace(part, turns=body)


def load_on_link(scene: Scene, part: Part, link: Link) -> Part:
    """Add the scene's point loads on a link to its F, in link axes; in space one scalar of each node and axis."""
    if link.dofs == 6:
        return with_pushes(part, {f"push_{node}_{axis}": part.place[node][k]
                                  for node in pushed_nodes(scene, link) for k, axis in enumerate("xyz")})  # fmt: skip
    total = part.matrices["F"]
    for name, load in scene.forces.items():
        if load.force_on.body == part.name:
            direction = Affine.term((name,), np.array(load.direction)[:, None])
            local = to_link_axes(part.name) @ direction if load.axes == "global" else direction
            spread = np.zeros((part.size, 2))
            spread[part.place[link.node_at(scene.point(load.force_on)[0])][:2], (0, 1)] = 1.0
            total = total + Affine.constant(spread) @ local
    return replace(part, matrices={**part.matrices, "F": total})


def pushed_nodes(scene: Scene, link: Link) -> list[int]:
    """Nodes of a link on which loads act."""
    on = [load.force_on for load in scene.forces.values()]
    nodes = {link.node_at(scene.point(at)[0]) for at in on if at is not None and at.body == link.name}
    return sorted(node for node in nodes if node is not None)


def with_pushes(part: Part, rows: Mapping[str, int]) -> Part:
    """Part with forces and torques ``PART.link.NAME`` on its rows in F."""
    total = part.matrices["F"]
    for name, row in rows.items():
        total = total + Affine.term((f"{part.name}.link.{name}",), np.eye(part.size, 1, -row))
    return replace(part, matrices={**part.matrices, "F": total})


def place_rigid(scene: Scene, carried: Mapping[str, Carried], frame: Frame) -> list[Placed]:
    """Add the carried rigid bodies and the loads on them."""
    placed = []
    for name in carried:
        body = scene.bodies[name]
        if body.mass:
            part = inertia_part(name, name, body.mass, body.inertia, body.centre, scene.gravity)
            placed.append((part, frame.body_point(name, body.centre)))
        placed.append((_turning_part(scene, name, carried[name]), frame.bodies[name]))
    for body in carried:
        for name, load, address, share in scene.pushes(body):
            pushed = share * _along(name, load, body)
            part = sparse_part(name, 3, F=Affine.constant(np.eye(3)[:, :2]) @ pushed)
            placed.append((part, frame.body_point(body, scene.point(address))))
    return placed


def _along(name: str, load: Load, body: str) -> Affine:
    """Global vector of a load (2 x 1)."""
    direction = Affine.term((name,), np.array(load.direction)[:, None])
    return direction if load.axes == "global" else to_link_axes(body).T @ direction


def place_torques(scene: Scene, links: Mapping[str, Link], parts: Mapping[str, Part], frame: Frame) -> list[Placed]:
    """Add torques at joints, which act on the rotation of the second side relative to the first."""
    placed = []
    for name, load in scene.torques.items():
        relative = Affine.zero(1, len(frame.coordinates))
        for address, sign in zip(scene.joints[load.torque_at].addresses, (-1.0, 1.0), strict=True):
            if address.body in links:
                node = links[address.body].node_at(scene.point(address)[0])
                motion = frame.link_point(address.body, parts[address.body], node)
            elif address.body in frame.bodies:
                motion = frame.bodies[address.body]
            else:
                continue
            relative += sign * (Affine.constant([[0.0, 0.0, 1.0]]) @ motion)
        placed.append((sparse_part(name, 1, F=Affine.term((name,), [[1.0]])), relative))
    return placed


def place_masses(scene: Scene, links: Mapping[str, Link], parts: Mapping[str, Part], frame: Frame) -> list[Placed]:
    """Add lumped masses on links and on carried rigid bodies, each once and in global axes."""
    placed = []
    for name, mass in scene.masses.items():
        at = scene.point(mass.at)
        if mass.at.body in links:
            motion = frame.link_point(mass.at.body, parts[mass.at.body], links[mass.at.body].node_at(at[0]))
        elif mass.at.body in frame.bodies:
            motion = frame.body_point(mass.at.body, at)
        else:
            continue
        placed.append((inertia_part(name, mass.at.body, mass.mass, mass.inertia, at, scene.gravity), motion))
    return placed


def sparse_part(name: str, size: int, **own: Affine) -> Part:
    """Part with its own matrices, the others zero."""
    matrices = {key: Affine.zero(size, 1 if key == "F" else size) for key in set(MATRIX_OF_GROUP.values())}
    return Part(name, tuple(f"{name}.{k}" for k in range(size)), matrices | own, {})


def _turning_part(scene: Scene, name: str, how: Carried) -> Part:
    """Geometric stiffness K_g of a rotating carried body: forces keep their direction while their arms rotate.

    A force F at the arm a = R (r - r_0) from the body's centre of rotation does second-order work
    -1/2 theta^2 a . F, so that K_theta_theta = sum a . F over inertia, weight, loads and joints.
    """
    if how.kind not in ("free", "hinged"):
        return sparse_part(f"{name}.arms", 3)
    total = Affine.zero(1, 1)
    body = scene.bodies[name]
    for force, at in _forces_on(scene, name):
        arm = np.array([[at[0] - how.at[0], at[1] - how.at[1]]])
        if arm.any():
            total += Affine.constant(arm) @ to_link_axes(name) @ force
    inertia = inertia_part(name, name, body.mass, 0.0, body.centre, scene.gravity).matrices["F"]
    arm = np.array([[body.centre[0] - how.at[0], body.centre[1] - how.at[1]]])
    total += Affine.constant(arm) @ to_link_axes(name) @ Affine.constant(np.eye(3)[:2]) @ inertia
    corner = Affine.constant([[0.0], [0.0], [1.0]])
    return sparse_part(f"{name}.arms", 3, K_g=corner @ total @ corner.T)


def _forces_on(scene: Scene, body: str) -> Iterable[tuple[Affine, tuple[float, float]]]:
    """Global force (2 x 1) and its point, of every load, spring and joint on a rigid body."""
    for name, load, address, share in scene.pushes(body):
        yield share * _along(name, load, body), scene.point(address)
    pairs = {name: joint.addresses for name, joint in scene.joints.items() if joint.kind != "prismatic"}
    pairs |= {name: spring.between for name, spring in scene.springs.items() if spring.ends}
    for name, addresses in pairs.items():
        for address, sign in zip(addresses, (-1.0, 1.0), strict=True):
            if address.body == body:
                force = Affine.term((f"{name}.force_x",), [[sign], [0.0]])
                yield force + Affine.term((f"{name}.force_y",), [[0.0], [sign]]), scene.point(address)


def assemble(
    placed: Iterable[Placed], coordinates: tuple[str, ...], convective: bool = True, at_rest: bool = False
) -> ElasticEquations:
    """Sum the parts; ``convective=False`` drops L' and L'', as the paper does.

    ``at_rest``: of a deformation at rest in the axes of the bodies.
    """
    size = len(coordinates)
    total = {name: Affine.zero(size, size) for name in ("M", "C_s", "C_d", "K_s", "K_d", "K_c", "K_g")}
    total["F"] = Affine.zero(size, 1)
    for matrices, L, body in _by_motion(placed):
        L_T = L.T
        pushes = {key: L_T @ matrices[key] for key in ("M", "C_s", "C_d", "K_s", "K_d", "K_g", "F")}
        total["F"] += pushes.pop("F")
        for key, push in pushes.items():
            total[key] += push @ L
        if at_rest:
            if body is not None:
                total["K_d"] += pushes["M"] @ _of_turning(f"{body}.epsilon", f"{body}.omega") @ L
        elif convective:
            rate = L.rate
            total["C_d"] += 2.0 * (pushes["M"] @ rate)
            total["K_d"] += pushes["C_d"] @ rate + pushes["M"] @ rate.rate
            total["K_c"] += pushes["C_s"] @ (rate if body is None else rate + -1.0 * (_of_turning(f"{body}.omega") @ L))
    return ElasticEquations(coordinates, **total)


def _of_turning(about: str, spin: str = "") -> Affine:
    """Before a global displacement x, y and rotation: the velocity omega S d of one that turns with a body, from the
    name of its omega, or its acceleration (epsilon S - omega^2) d, from those of epsilon and omega."""
    across = Affine.term((about,), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return across + Affine.term((spin, spin), np.diag([-1.0, -1.0, 0.0])) if spin else across


def _by_motion(placed: Iterable[Placed]) -> Iterable[tuple[Mapping[str, Affine], Affine, str | None]]:
    """Sum of the matrices of parts with the same L, which turn with the same body."""
    found: dict[tuple[int, str | None], tuple[Mapping[str, Affine], Affine, str | None]] = {}
    for part, L in placed:
        before = found.get((id(L), part.turns), (None,))[0]
        whole = {key: before[key] + own for key, own in part.matrices.items()} if before else part.matrices
        found[id(L), part.turns] = whole, L, part.turns
    return found.values()


def spin_or_euler(monomial: Monomial) -> str:
    """Name of the complete group that a term of K_d belongs to: "euler" if proportional to epsilon, else "spin"."""
    return "euler" if any(name.rpartition(".")[2].startswith("epsilon") for name in monomial) else "spin"
