"""Springs and dampers on bodies that deform, linear about the rigid motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kaneflex.fem.assembly import Placed, Sites, sparse_part
from kaneflex.fem.coordinate_map import SHIFT, TURN, to_link_axes
from kaneflex.fem.links import Part
from kaneflex.mechanism.affine import Affine


def place_springs(sites: Sites) -> Iterator[Placed]:
    """Springs as parts, see :func:`spring_part` and :func:`torsion_part`, with the sites of their ends."""
    scene = sites.motions.scene
    for name, spring in scene.springs.items():
        if spring.torsional_at is not None:
            part = torsion_part(name, spring.stiffness, spring.damping)
            yield sites.between(part, scene.joints[spring.torsional_at].addresses, TURN)
            continue
        directed, rows = bool(spring.length or spring.damping), Affine.constant(np.eye(3)[:, 1:]) @ SHIFT
        if directed:
            rows += Affine.constant(np.eye(3, 2) * [1.0, 0.0]) @ to_link_axes(name) @ SHIFT
        yield sites.between(spring_part(name, spring.stiffness, spring.damping, directed, "xy"), spring.between, rows)


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
