"""Springs and dampers on bodies that deform, linear about the rigid motion."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from kaneflex.fem.assembly import Placed, empty_part
from kaneflex.fem.coordinate_map import Frame, to_link_axes
from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.affine import Affine
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address


def place_springs(scene: Scene, links: Mapping[str, Link], parts: Mapping[str, Part], frame: Frame) -> list[Placed]:
    """Springs whose ends can move by the deformation."""
    found = (place_spring(scene, links, parts, frame, name) for name in scene.springs)
    return [(part, L) for part, L in found if L.terms]


def place_spring(
    scene: Scene, links: Mapping[str, Link], parts: Mapping[str, Part], frame: Frame, name: str
) -> Placed:
    """A spring as a part whose coordinates are how far its ends part: along and across it, or by an angle.

    With e along the spring from its first point to its second and n across, the force on the second changes by
    -(k e e^T + T/L n n^T) d - c e (e^T d)': its direction turns, which the rate of e in L accounts for. A spring
    without free length and damper pulls with k d, whatever the direction.
    """
    spring = scene.springs[name]
    torsional = spring.torsional_at is not None
    addresses = scene.joints[spring.torsional_at].addresses if torsional else spring.between
    rows = [2] if torsional else [0, 1]
    pick = Affine.constant(np.eye(3)[rows])
    apart = Affine.zero(len(rows), len(frame.coordinates))
    for address, sign in zip(addresses, (-1.0, 1.0), strict=True):
        moved = _motion(scene, links, parts, frame, address)
        if moved is not None:
            apart += sign * (pick @ moved)
    k, c = spring.stiffness, spring.damping
    matrices = dict(empty_part(name, len(rows)).matrices)
    if torsional:
        matrices |= {"K_s": Affine.constant([[k]]), "C_s": Affine.constant([[c]])}
        matrices["F"] = Affine.term((f"{name}.torque",), [[-1.0]])
    elif not (spring.length or c):
        matrices["K_s"] = Affine.constant(k * np.eye(2))
        matrices["F"] = Affine.term((f"{name}.force_x",), [[1.0], [0.0]])
        matrices["F"] += Affine.term((f"{name}.force_y",), [[0.0], [1.0]])
    else:
        apart = to_link_axes(name) @ apart
        along, across = np.diag([1.0, 0.0]), np.diag([0.0, 1.0])
        matrices |= {"K_s": Affine.constant(k * along), "C_s": Affine.constant(c * along)}
        matrices["K_g"] = Affine.term((f"{name}.pull",), across)
        matrices["F"] = Affine.term((f"{name}.tension",), [[-1.0], [0.0]])
    coordinates = tuple(f"{name}.{kind}" for kind in (("turn",) if torsional else ("along", "across")))
    return Part(name, coordinates, matrices, {}), apart


def _motion(scene: Scene, links, parts, frame: Frame, address: Address) -> Affine | None:
    """Global displacement and turn of a point, (3, n); None where the deformation doesn't move it."""
    at = scene.point(address)
    if address.body in links:
        return frame.link_point(address.body, parts[address.body], links[address.body].node_at(at[0]))
    return frame.body_point(address.body, at) if address.body in frame.bodies else None
