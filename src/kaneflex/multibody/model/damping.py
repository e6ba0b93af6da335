"""Floating axes of links, and the damping of shapes.

Axes follow from the joints, in each plane of bending: the tangent if only one joint holds the link's rotation relative
to prescribed motions, else the chord of its first and last joints, else its mean rotation about its only joint. In
space, shapes may follow a tangent only at the joint of the tree, as a rotation of the axes that bending undoes would
have hardly any inertia. The motion damped by Rayleigh's mass term, a modal ratio or viscous damping does not depend on
the tree.
"""

from __future__ import annotations

import numpy as np

from kaneflex.fem.links import Link
from kaneflex.fem.modes import damping_ratios, rayleigh_coefficients, symmetric_modes
from kaneflex.mechanism.affine import Matrix
from kaneflex.mechanism.floating_frames import stations
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.spatial import SpatialJoint, SpatialMechanism

_FREE = 0.5 + 1e-9
"""Squared share of an axis in the free rotations of a joint, above which the body turns freely about it."""
_PLANES = ((1, 5, "z", 1.0), (2, 4, "y", -1.0))
"""Places of displacement and rotation among a node's motions in either plane of bending, the rotation's axis, and its
sign where the link turns about it."""


def shape_damping(link: Link, basis: np.ndarray) -> np.ndarray:
    """Damping of modal coordinates [N s/m], (count, count), of shapes ``basis``, (dofs n_nodes, count)."""
    K, M = (link.part.matrices[name].value({}) for name in ("K_s", "M"))
    if link.mechanism.damping is None or link.dofs == 3:  # planar shapes are modes in these axes already
        return modal_damping(link, basis, M)
    apart = against_axes(link, basis, M)
    mass = apart.T @ M @ apart
    modes = symmetric_modes(apart.T @ K @ apart, mass, len(mass))[1]
    of_modes = modal_damping(link, apart @ modes, M)
    back = modes.T @ mass
    return back.T @ of_modes @ back


def modal_damping(link: Link, modal: np.ndarray, M: Matrix) -> np.ndarray:
    """Damping matrix of the modal coordinates [N s/m]; a modal ratio applies to the link's own modes."""
    damping = link.mechanism.damping
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


def against_axes(link: Link, basis: np.ndarray, M: Matrix, hung: float | None = None) -> np.ndarray:
    """Shapes relative to a link's axes by its joints, without rigid motions, (dofs n_nodes, count).

    ``hung``: place of the joint of the tree, where alone the axes may then follow the section.
    """
    joined, alone = _joined(link, hung)
    left, d, places = basis.copy(), link.dofs, link.motions

    def rigid_motion(*moved: tuple[int, float | np.ndarray]) -> np.ndarray:
        """Values of all coordinates from those of some motions of the nodes."""
        found = np.zeros(len(left))
        for motion, values in moved:
            found[places.index(motion) :: d] = values
        return found

    def row(x: float, motion: int) -> np.ndarray:
        found = np.zeros(len(left))
        found[d * node_of(link, x) + places.index(motion)] = 1.0
        return found

    def take(rigid: np.ndarray, measured: list[np.ndarray]) -> None:
        """Remove from the shapes the rigid motions for which ``measured`` vanishes."""
        rows = np.array(measured)
        left[:] -= rigid @ np.linalg.solve(rows @ rigid, rows @ left)

    for v, theta, axis, sign in _PLANES[: d // 3]:
        at = alone.get(axis, joined[0] if joined else 0.0)
        rigid = np.column_stack([rigid_motion((v, 1.0)), rigid_motion((v, sign * (link.nodes - at)), (theta, 1.0))])
        if axis in alone:
            take(rigid, [row(at, v), row(at, theta)])
        elif len(joined) > 1:
            take(rigid, [row(joined[0], v), row(joined[-1], v)])
        else:
            take(rigid, [row(at, v) if joined else M @ rigid[:, 0], M @ rigid[:, 1]])
    for k, at_joint in ((0, axial_place(link, hung)), (3, alone.get("x")))[: d // 3]:
        rigid = rigid_motion((k, 1.0))[:, None]
        take(rigid, [M @ rigid[:, 0] if at_joint is None else row(at_joint, k)])
    return left


def axial_place(link: Link, hung: float | None = None) -> float | None:
    """Distance from a link's start [m] of its section without axial displacement in its axes: at its only joint, or at
    the one that holds its bending; None: it has none in the mean over its mass."""
    joined, alone = _joined(link, hung)
    return joined[0] if len(joined) == 1 else alone["z"] if {*"zy"[: link.dofs // 3]} <= {*alone} else None


def _joined(link: Link, hung: float | None) -> tuple[list[float], dict[str, float]]:
    """Distances from a link's start [m] of its joints, and of the section that the axes follow about each axis that a
    single joint holds."""
    if link.dofs == 3:
        clamped = {each.x: "z" * each.clamped for each in stations(link.mechanism, link.name) if each.joined}
    else:
        clamped = clamps(link.mechanism, link.name)
    places = {axis: [x for x, held in clamped.items() if axis in held] for axis in "xyz"}
    alone = {axis: of[0] for axis, of in places.items() if len(of) == 1 and hung in (None, of[0])}
    return sorted(clamped), alone


def node_of(link: Link, x: float) -> int:
    """Node of a link at a joint or load, x [m] from its start."""
    found = link.node_at(x)
    assert found is not None
    return int(found)


def clamps(mechanism: SpatialMechanism, body: str) -> dict[float, str]:
    """Distance from a body's start [m] of each point held by joints -> axes x, y, z of the body about which the joint
    holds its rotation relative to prescribed motions."""
    driven, placed, found = mechanism.prescribed, _placed(mechanism), dict[float, str]()
    for name, joint in mechanism.joints.items():
        for own, other in (joint.sides, joint.sides[::-1]):
            if own.body == body and other.body not in mechanism.lumped:
                x = float(own.at[0])
                held = _held(mechanism, joint, body, name in driven) if other.body in placed else ""
                found[x] = "".join(sorted({*found.get(x, ""), *held}))
    return found


def _held(mechanism: SpatialMechanism, joint: SpatialJoint, body: str, driven: bool) -> str:
    """Axes of one of its bodies about which a joint holds it."""
    turns = [axis for name, axis in joint.moves if name.startswith("angle") and not driven]
    if joint.kind == "spherical":
        return ""
    if not turns:
        return "xyz"
    own = mechanism.rest_axes(body).T @ mechanism.rest_axes(joint.sides[0].body)
    free = np.linalg.qr(own @ np.array(turns).T)[0]
    return "".join(name for name, share in zip("xyz", (free**2).sum(axis=1), strict=True) if not share > _FREE)


def _placed(mechanism: SpatialMechanism) -> set[str]:
    """The ground, rigid free bodies, and bodies connected to these by drives and welds alone."""
    placed, count = {GROUND, *mechanism.floating} - mechanism.deforming.keys(), 0
    while count < len(placed):
        count = len(placed)
        for name, joint in mechanism.joints.items():
            bodies = {side.body for side in joint.sides}
            if bodies & placed and (joint.freedoms == 0 or (joint.freedoms == 1 and name in mechanism.prescribed)):
                placed |= bodies - mechanism.deforming.keys()
    return placed
