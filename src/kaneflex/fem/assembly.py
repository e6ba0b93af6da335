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

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from kaneflex.fem.coordinate_map import SHIFT, TURN, WHOLE, Interfaces, Placed, Sites, to_link_axes
from kaneflex.fem.element_terms import MATRIX_OF_GROUP
from kaneflex.fem.links import Link, Part, craig_bampton
from kaneflex.mechanism.affine import Affine, Monomial
from kaneflex.mechanism.parts import Mechanism
from kaneflex.mechanism.planar import Vector
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError

_MATRICES = ("M", "C_s", "C_d", "K_s", "K_d", "K_c", "K_g", "F")


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

    @classmethod
    def zero(cls, coordinates: tuple[str, ...]) -> ElasticEquations:
        """Equations without terms."""
        n = len(coordinates)
        return cls(coordinates, **{name: Affine.zero(n, 1 if name == "F" else n) for name in _MATRICES})

    @property
    def size(self) -> int:
        return len(self.coordinates)

    def matrices(self) -> dict[str, Affine]:
        return {name: getattr(self, name) for name in _MATRICES}

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
    acceleration = Affine.constant(-np.reshape(gravity, (2, 1)))
    acceleration += Affine.term((f"{body}.a_x",), [[1.0], [0.0]]) + Affine.term((f"{body}.a_y",), [[0.0], [1.0]])
    if any(at):
        acceleration += (to_link_axes(body).T @ Affine.constant(np.reshape(at, (2, 1)))).rate.rate
    load = SHIFT.T @ (-mass * acceleration)
    if inertia:
        load += TURN.T @ Affine.term((f"{body}.epsilon",), [[-inertia]])
    part = sparse_part(name, 3, M=Affine.constant(np.diag([mass, mass, inertia])), F=load)
    return replace(part, turns=body)


def parts_of_links(
    options: Options, links: Mapping[str, Link], interfaces: Interfaces, frozen: Mapping[str, np.ndarray]
) -> tuple[dict[str, Part], dict[str, np.ndarray]]:
    """Loaded links as parts, and the bases of reduced ones; ``frozen``: bases to reduce to."""
    parts: dict[str, Part] = {}
    bases: dict[str, np.ndarray] = {}
    for name, link in links.items():
        parts[name] = load_on_link(link.part, link)
        if options.reduction == "craig-bampton":
            held = interfaces.held_rows(parts[name]) | (_loaded_rows(link) if link.dofs == 3 else set())
            held = held or {*parts[name].place[0]}  # of a link that nothing holds: its start has the rigid motion
            count = _count_of_modes(options, name, parts[name].size - len(held))
            parts[name], bases[name] = craig_bampton(parts[name], held, count, frozen.get(name))
    return parts, bases


def _count_of_modes(options: Options, link: str, limit: int) -> int:
    """Number of fixed-interface modes to keep of a link with ``limit`` ones; SceneError if more are requested."""
    count = limit if options.modes == "all" else int(options.modes)
    if count > limit:
        raise SceneError(
            "solve.modes", options.modes, f"{link} has {limit} fixed-interface modes",
            "Use fewer modes, or more elements",
        )  # fmt: skip
    return count


def _loaded_rows(link: Link) -> set[int]:
    """Rows of nodes with lumped masses, springs or torques, which a reduction keeps."""
    mechanism = link.mechanism
    sides = [mass.point for mass in mechanism.masses.values()]
    sides += [end for spring in mechanism.springs.values() for end in spring.ends]
    sides += [side for contact in mechanism.contacts.values() for side in contact.sides]
    turned = {each.joint for of in (mechanism.loads, mechanism.springs) for each in of.values()} - {None}
    sides += [side for joint in sorted(turned) for side in mechanism.joints[joint].sides]
    nodes = [cast(int, link.node_at(side.at[0])) for side in sides if side.body == link.name]
    return {row for node in nodes for row in link.part.place[node]}


def load_on_link(part: Part, link: Link) -> Part:
    """Add the point loads on a link to its F, in link axes; in space one scalar of each node and axis."""
    if link.dofs == 6:
        return with_pushes(part, {f"push_{node}_{axis}": part.place[node][k]
                                  for node in pushed_nodes(link) for k, axis in enumerate("xyz")})  # fmt: skip
    total = part.matrices["F"]
    for name, load in link.mechanism.loads.items():
        if load.point is not None and load.point.body == part.name:
            direction = Affine.term((name,), np.array(load.direction)[:, None])
            local = direction if load.in_body else to_link_axes(part.name) @ direction
            spread = np.zeros((part.size, 2))
            spread[part.place[link.node_at(load.point.at[0])][:2], (0, 1)] = 1.0
            total = total + Affine.constant(spread) @ local
    return replace(part, matrices={**part.matrices, "F": total})


def pushed_nodes(link: Link) -> list[int]:
    """Nodes of a link on which loads act."""
    on = [load.point for load in link.mechanism.loads.values()]
    nodes = {link.node_at(side.at[0]) for side in on if side is not None and side.body == link.name}
    return sorted(node for node in nodes if node is not None)


def with_pushes(part: Part, rows: Mapping[str, int]) -> Part:
    """Part with forces and torques ``PART.link.NAME`` on its rows in F."""
    total = part.matrices["F"]
    for name, row in rows.items():
        total = total + Affine.term((f"{part.name}.link.{name}",), np.eye(part.size, 1, -row))
    return replace(part, matrices={**part.matrices, "F": total})


def place_rigid(sites: Sites) -> Iterator[Placed]:
    """Add rigid bodies, lumped masses, and the loads on rigid bodies."""
    mechanism, shared = sites.mechanism, sites.interfaces.shared
    for tie in sites.interfaces.ties:
        if tie.site[1] is None:
            centre = sites.arm(tie, tie.site) if tie.joint else (0.0, 0.0)
            turning = _turning_part(mechanism, tie.site[0], centre if tie.joint not in shared else None)
            yield sites.place(turning, (tie.site[0], (0.0, 0.0), WHOLE))
    for name, *inertia in _inertias(mechanism):
        body, _, _, at = inertia
        yield sites.place(inertia_part(name, *inertia, mechanism.gravity), (body, at, WHOLE))
    for body in mechanism.bodies:
        for name, force, point in _pushes(mechanism, body) if body not in sites.links else ():
            yield sites.place(sparse_part(name, 2, F=force), (body, point, SHIFT))


def _inertias(mechanism: Mechanism) -> Iterator[tuple[str, str, float, float, Vector]]:
    """Rigid bodies and lumped masses: name, body, mass [kg], moment of inertia [kg m^2] and centre."""
    for name, body in mechanism.bodies.items():
        if not body.elastic and body.mass:
            yield name, name, body.mass, body.inertia, body.centre
    for name, mass in mechanism.masses.items():
        yield name, mass.point.body, mass.mass, mass.inertia, mass.point.at


def _pushes(mechanism: Mechanism, body: str) -> Iterator[tuple[str, Affine, Vector]]:
    """Loads on a rigid body as point forces: name, global force (2 x 1), and its point."""
    for name, load in mechanism.loads.items():
        for point, share in load.pushes:
            if point.body == body:
                force = Affine.term((name,), share * np.array(load.direction)[:, None])
                yield name, to_link_axes(body).T @ force if load.in_body else force, point.at


def place_torques(sites: Sites) -> Iterator[Placed]:
    """Add torques at joints, which act on the rotation of the second side relative to the first."""
    joints = sites.mechanism.joints
    for name, load in sites.mechanism.loads.items():
        if load.joint is not None:
            torque = sparse_part(name, 1, F=Affine.term((name,), [[1.0]]))
            yield sites.between(torque, joints[load.joint].sides, TURN)


def sparse_part(name: str, size: int, **own: Affine) -> Part:
    """Part with its own matrices, the others zero."""
    matrices = {key: Affine.zero(size, 1 if key == "F" else size) for key in set(MATRIX_OF_GROUP.values())}
    return Part(name, tuple(f"{name}.{k}" for k in range(size)), matrices | own, {})


def _turning_part(mechanism: Mechanism, name: str, centre: Vector | None) -> Part:
    """Geometric stiffness K_g of a carried body that rotates about its ``centre``: forces keep their direction while
    their arms rotate.

    A force F at the arm a = R (r - r_0) from the body's centre of rotation does second-order work
    -1/2 theta^2 a . F, so that K_theta_theta = sum a . F over inertia, weight, loads and joints; 0 in a fixed
    structure, whose joint forces are not known beforehand.
    """
    total = Affine.zero(1, 1)
    for force, at in () if centre is None or mechanism.frame else _forces_on(mechanism, name):
        arm = np.array([[at[0] - centre[0], at[1] - centre[1]]])
        if arm.any():
            total += Affine.constant(arm) @ to_link_axes(name) @ force
    return sparse_part(f"{name}.arms", 3, K_g=TURN.T @ total @ TURN)


def _forces_on(mechanism: Mechanism, body: str) -> Iterable[tuple[Affine, tuple[float, float]]]:
    """Global force (2 x 1) and its point, of inertia, weight, and every load, spring and joint on a rigid body."""
    for name, on, mass, _, at in _inertias(mechanism):
        if on == body:
            yield SHIFT @ inertia_part(name, body, mass, 0.0, at, mechanism.gravity).matrices["F"], at
    for _, force, point in _pushes(mechanism, body):
        yield force, point
    pairs = {name: joint.sides for name, joint in mechanism.joints.items() if not joint.slides}
    pairs |= {name: spring.sides for name, spring in mechanism.springs.items() if spring.ends}
    for name, sides in pairs.items():
        for side, sign in zip(sides, (-1.0, 1.0), strict=True):
            if side.body == body:
                force = Affine.term((f"{name}.force_x",), [[sign], [0.0]])
                yield force + Affine.term((f"{name}.force_y",), [[0.0], [sign]]), side.at


def place_springs(sites: Sites) -> Iterator[Placed]:
    """Springs as parts, see :func:`spring_part` and :func:`torsion_part`, with the sites of their ends."""
    for name, spring in sites.mechanism.springs.items():
        if spring.joint is not None:
            yield sites.between(torsion_part(name, spring.stiffness, spring.damping), spring.sides, TURN)
            continue
        rows = Affine.constant(np.eye(3)[:, 1:]) @ SHIFT
        if spring.is_directed:
            rows += Affine.constant(np.eye(3, 2) * [1.0, 0.0]) @ to_link_axes(name) @ SHIFT
        part = spring_part(name, spring.stiffness, spring.damping, spring.is_directed, "xy")
        yield sites.between(part, spring.sides, rows)


def spring_part(name: str, stiffness: float, damping: float, directed: bool, axes: str) -> Part:
    """Spring between two points as a part whose coordinates are how far its ends part, along it and along global axes.

    With e along the spring from its first point to its second, the force on the second changes by
    -(k e e^T + T/L (1 - e e^T)) d - c e (e^T d)': its direction turns, which the rate of e in L accounts for. A spring
    without free length and damper, which is not ``directed``, pulls with k d, whatever the direction.
    """
    n = len(axes)
    if not directed:
        rows = zip(axes, np.eye(n + 1)[1:], strict=True)
        pulls = (Affine.term((f"{name}.force_{axis}",), row[:, None]) for axis, row in rows)
        pull = sum(pulls, Affine.zero(n + 1, 1))
        return sparse_part(name, n + 1, K_s=Affine.constant(stiffness * np.diag([0.0, *[1.0] * n])), F=pull)
    along, across = np.diag([1.0, *[0.0] * n]), np.diag([-1.0, *[1.0] * n])
    return sparse_part(
        name, n + 1, K_s=Affine.constant(stiffness * along), C_s=Affine.constant(damping * along),
        K_g=Affine.term((f"{name}.pull",), across), F=Affine.term((f"{name}.tension",), -along[:, :1]),
    )  # fmt: skip


def torsion_part(name: str, stiffness: float, damping: float) -> Part:
    """Torsional spring as a part whose coordinate is the relative rotation of a joint's second body."""
    push = Affine.term((f"{name}.torque",), [[-1.0]])
    return sparse_part(name, 1, K_s=Affine.constant([[stiffness]]), C_s=Affine.constant([[damping]]), F=push)


def assemble(
    placed: Iterable[Placed], coordinates: tuple[str, ...], convective: bool = True, at_rest: bool = False
) -> ElasticEquations:
    """Sum the parts; ``convective=False`` drops L' and L'', as the paper does.

    ``at_rest``: of a deformation at rest in the axes of the bodies.
    """
    total = ElasticEquations.zero(coordinates).matrices()
    for part, L, *_ in placed:
        own = in_own_axes(part, convective, at_rest).matrices()
        L_T = L.T
        pushes = {key: L_T @ matrix for key, matrix in own.items()}
        total["F"] += pushes.pop("F")
        for key, push in pushes.items():
            total[key] += push @ L
        if convective and not at_rest:
            rate = L.rate
            total["C_d"] += 2.0 * (pushes["M"] @ rate)
            total["K_d"] += pushes["C_d"] @ rate + pushes["M"] @ rate.rate
            total["K_c"] += pushes["C_s"] @ rate
    return ElasticEquations(coordinates, **total)


def in_own_axes(part: Part, convective: bool, at_rest: bool) -> ElasticEquations:
    """Equations of a part in its own coordinates; damping and rest of one in global axes are in those of its body."""
    K_c, matrices = Affine.zero(part.size, part.size), dict(part.matrices)
    if part.turns is not None and at_rest:
        turned = _of_turning(f"{part.turns}.epsilon", f"{part.turns}.omega")
        matrices["K_d"] = matrices["K_d"] + matrices["M"] @ turned
    elif part.turns is not None and convective:
        K_c = -1.0 * (matrices["C_s"] @ _of_turning(f"{part.turns}.omega"))
    return ElasticEquations(part.coordinates, K_c=K_c, **matrices)


def _of_turning(about: str, spin: str = "") -> Affine:
    """Before a global displacement x, y and rotation: the velocity omega S d of one that turns with a body, from the
    name of its omega, or its acceleration (epsilon S - omega^2) d, from those of epsilon and omega."""
    across = Affine.term((about,), [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    return across + Affine.term((spin, spin), np.diag([-1.0, -1.0, 0.0])) if spin else across


def spin_or_euler(monomial: Monomial) -> str:
    """Name of the complete group that a term of K_d belongs to: "euler" if proportional to epsilon, else "spin"."""
    return "euler" if any(name.rpartition(".")[2].startswith("epsilon") for name in monomial) else "spin"
