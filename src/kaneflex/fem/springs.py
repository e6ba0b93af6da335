"""Springs and dampers on bodies that deform, linear about the rigid motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kaneflex.fem.assembly import Placed, sparse_part
from kaneflex.fem.coordinate_map import Frame, to_link_axes
from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.affine import Affine
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address


def place_springs(scene: Scene, links: Mapping[str, Link], parts: Mapping[str, Part], frame: Frame) -> list[Placed]:
    """Springs with an end that the deformation can move."""
    found = (place_spring(scene, links, parts, frame, name) for name in scene.springs)
    return [(part, L) for part, L in found if L.terms]


def place_spring(
    scene: Scene, links: Mapping[str, Link], parts: Mapping[str, Part], frame: Frame, name: str
) -> Placed:
    """A spring as a part, see :func:`spring_part` and :func:`torsion_part`, and its map L."""
    spring = scene.springs[name]
    torsional = spring.torsional_at is not None
    addresses = scene.joints[spring.torsional_at].addresses if torsional else spring.between
    pick = Affine.constant(np.eye(3)[[2] if torsional else [0, 1]])
    apart = Affine.zero(1 if torsional else 2, len(frame.coordinates))
    for address, sign in zip(addresses, (-1.0, 1.0), strict=True):
        moved = _motion(scene, links, parts, frame, address)
        if moved is not None:
            apart += sign * (pick @ moved)
    if torsional:
        return torsion_part(name, spring.stiffness, spring.damping), apart
    directed, L = bool(spring.length or spring.damping), Affine.constant(np.eye(3)[:, 1:]) @ apart
    if directed:
        L += Affine.constant(np.eye(3, 2) * [1.0, 0.0]) @ to_link_axes(name) @ apart
    return spring_part(name, spring.stiffness, spring.damping, directed, "xy"), L


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


def _motion(scene: Scene, links, parts, frame: Frame, address: Address) -> Affine | None:
    """Global displacement and turn of a point, (3, n); None where the deformation doesn't move it."""
    at = scene.point(address)
    if address.body in links:
        return frame.link_point(address.body, parts[address.body], links[address.body].node_at(at[0]))
    return frame.body_point(address.body, at) if address.body in frame.bodies else None
