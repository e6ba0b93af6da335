"""Elastic coordinates z of the mechanism, and the map q = L z of every part.

Displacements of joints are global coordinates shared by the connected bodies; rotations are released at a revolute
joint and shared at a weld; rigid bodies carried by elastic links have a slide, a rotation, or a displacement and a
rotation. All other coordinates belong to one link, in its axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from kaneflex.fem.interface_coordinates import Interfaces
from kaneflex.fem.links import Part
from kaneflex.mechanism.affine import Affine, Matrix, from_entries
from kaneflex.mechanism.rigid_bodies import Carried
from kaneflex.scene import Scene

WHOLE, SHIFT, TURN = (Affine.constant(np.eye(3)[rows]) for rows in ([0, 1, 2], [0, 1], [2]))
"""Matrices that take all, the displacement, or the rotation from global displacements and a rotation."""


@dataclass(frozen=True)
class Frame:
    """Names of the coordinates z, and maps of links and carried bodies.

    Attributes
    ----------
    coordinates : tuple of str
    maps : mapping of str to Affine
        Link -> L, local coordinates q = L(t) z.
    bodies : mapping of str to Affine
        Carried rigid body -> global displacement of its start and its turn, (3, n).
    """

    coordinates: tuple[str, ...]
    maps: Mapping[str, Affine]
    bodies: Mapping[str, Affine] = field(default_factory=dict)

    def link_point(self, link: str, part: Part, node: int) -> Affine:
        """Global displacement and rotation of a link's node, (3, n)."""
        u, v, theta = part.place[node]
        rows = Affine.constant(_selector(3, [0, 1, 2], [u, v, theta], part.size)) @ self.maps[link]
        return (SHIFT.T @ to_link_axes(link).T @ SHIFT + TURN.T @ TURN) @ rows


def to_link_axes(body: str) -> Affine:
    """T of paper (66) for one point: global components -> components in the body's axes."""
    return Affine.term((f"{body}.c",), np.eye(2)) + Affine.term((f"{body}.s",), [[0.0, 1.0], [-1.0, 0.0]])


def from_start(body: str, at: tuple[float, float]) -> Affine:
    """Global displacement of a rigid body's point, d + theta S R r, and its turn from those of its start, (3, 3)."""
    if at == (0.0, 0.0):
        return WHOLE
    return WHOLE + SHIFT.T @ to_link_axes(body).T @ Affine.constant([[-at[1]], [at[0]]]) @ TURN


def guide_direction(scene: Scene, joint_name: str) -> Affine:
    """Global components (2 x 1) of a guide's direction, which turns with the body that carries the guide."""
    joint = scene.joints[joint_name]
    t = np.array(joint.direction)[:, None]
    carrier = joint.addresses[0].body
    return Affine.constant(t) if carrier == "ground" else to_link_axes(carrier).T @ Affine.constant(t)


class _Columns:
    """Coordinates in the order of their first use."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._at: dict[object, list[int]] = {}

    def __call__(self, key: object, *labels: str) -> list[int]:
        if key not in self._at:
            self._at[key] = list(range(len(self.names), len(self.names) + len(labels)))
            self.names.extend(labels)
        return self._at[key]


def build_frame(
    scene: Scene, links: Mapping[str, Part], carried: Mapping[str, Carried], interfaces: Interfaces
) -> Frame:
    """Name the coordinates z and build L of every link, link after link along each chain."""
    columns = _Columns()
    own = {name: _name_coordinates(part, carried, interfaces, columns) for name, part in links.items()}
    for name in carried:
        _body_columns(name, carried, columns)
    size = len(columns.names)
    bodies: dict[str, Affine] = {}
    for name in carried:
        bodies[name] = _body_motion(scene, name, carried[name], bodies, columns, size)
    maps = {}
    for name, part in links.items():
        total = Affine.constant(_selector(part.size, *(zip(*own[name], strict=True) if own[name] else ((), ())), size))
        for node, (u, v, theta) in part.place.items():
            key = (name, node)
            if key in interfaces.displaced:
                displacement = _node_displacement(key, scene, interfaces, bodies, columns, size)
                total += _lift(part.size, [u, v]) @ to_link_axes(name) @ displacement
            body = interfaces.turned_body.get(interfaces.turned.get(key))
            if body is not None and theta is not None:
                total += _lift(part.size, [theta]) @ TURN @ bodies[body]
        maps[name] = total
    return Frame(tuple(columns.names), maps, bodies)


def _name_coordinates(part: Part, carried, interfaces: Interfaces, columns: _Columns) -> list[tuple[int, int]]:
    """Pairs (local row, coordinate) of a link's own coordinates and shared rotations; also names the others."""
    pairs = []
    # All nodes of an axially rigid link share a row: it is that of the node at a joint, which comes last.
    nodes = sorted(part.place, key=lambda node: (part.name, node) in interfaces.displaced)
    node_of_row = {row: (node, k) for node in nodes for k, row in enumerate(part.place[node])}
    for row, label in enumerate(part.coordinates):
        node, k = node_of_row.get(row, (None, None))
        key = (part.name, node)
        if node is None or key not in interfaces.displaced:
            pairs.append((row, columns((part.name, row), label)[0]))
        elif k == 2:
            group = interfaces.turned[key]
            if group in interfaces.turned_body:
                _body_columns(interfaces.turned_body[group], carried, columns)
            elif group not in interfaces.clamped:
                pairs.append((row, columns(("turn", group), label)[0]))
        else:
            group = interfaces.displaced[key]
            if group in interfaces.carrier:
                _body_columns(interfaces.carrier[group].body, carried, columns)
            elif group not in interfaces.fixed:
                columns(("shift", group), f"{interfaces.joint[group]}.x", f"{interfaces.joint[group]}.y")
    return pairs


_LABELS = {"guided": ("slide",), "hinged": ("turn",), "welded": (), "free": ("x", "y", "turn")}


def _body_columns(name: str, carried: Mapping[str, Carried], columns: _Columns) -> list[int]:
    return columns(("body", name), *(f"{name}.{label}" for label in _LABELS[carried[name].kind]))


def _body_motion(scene: Scene, name: str, how: Carried, bodies, columns: _Columns, size: int) -> Affine:
    """Global displacement of a carried body's start and its turn, (3, n)."""
    at = columns(("body", name))
    if how.kind == "guided":
        return SHIFT.T @ guide_direction(scene, how.joint) @ Affine.constant(_selector(1, [0], at, size))
    if how.kind == "free":
        return Affine.constant(_selector(3, [0, 1, 2], at, size))
    held = Affine.zero(3, size)
    if how.base.body in bodies:
        held = from_start(how.base.body, scene.point(how.base)) @ bodies[how.base.body]
    # The held point moves with the holder; the start follows at -theta S R r.
    turn = Affine.constant(_selector(1, [0], at, size)) if how.kind == "hinged" else TURN @ held
    return from_start(name, (-how.at[0], -how.at[1])) @ (SHIFT.T @ SHIFT @ held + TURN.T @ turn)


def _node_displacement(key, scene: Scene, interfaces: Interfaces, bodies, columns: _Columns, size: int) -> Affine:
    """Global displacement of an interface node, (2, n)."""
    group = interfaces.displaced[key]
    if group in interfaces.carrier:
        address = interfaces.carrier[group]
        return SHIFT @ from_start(address.body, scene.point(address)) @ bodies[address.body]
    if group in interfaces.fixed:
        return Affine.zero(2, size)
    return Affine.constant(_selector(2, [0, 1], columns(("shift", group)), size))


def _selector(rows: int, at, columns, size: int) -> Matrix:
    return from_entries((rows, size), list(at), list(columns), np.ones(len(at)))


def _lift(rows: int, at: list[int]) -> Affine:
    """Matrix that puts len(at) components into rows ``at`` of a longer vector."""
    return Affine.constant(_selector(rows, at, range(len(at)), len(at)))
