"""The mechanism's elastic coordinates z, and the map q = L z of every part.

Displacements of joints are global coordinates shared by the bodies that meet there; rotations are released at a
revolute joint and shared at a weld; a guide leaves a rigid body its slide only. All other coordinates are a link's
own, in its own axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array

from kaneflex.affine import Affine
from kaneflex.errors import SceneError
from kaneflex.links import Link, Part
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address

Node = tuple[str, int]
IDENTITY, TURN = csr_array(np.eye(2)), csr_array(np.array([[0.0, 1.0], [-1.0, 0.0]]))


@dataclass(frozen=True)
class Interfaces:
    """Where elastic links meet other bodies.

    Attributes
    ----------
    displaced : mapping of Node to int
        Every interface node -> the group of nodes that share its displacement.
    turned : mapping of Node to int
        The same for rotations; a node that turns freely has a group of its own.
    fixed, clamped : frozenset of int
        Groups whose displacement, or rotation, is prescribed.
    slider : mapping of int to str
        Group -> the guided rigid body that it moves with.
    joint : mapping of int to str
        Group of displacements -> the joint that names it.
    """

    displaced: Mapping[Node, int]
    turned: Mapping[Node, int]
    fixed: frozenset[int]
    clamped: frozenset[int]
    slider: Mapping[int, str]
    joint: Mapping[int, str]

    def held_rows(self, part: Part) -> set[int]:
        """Local rows that a reduction must keep: shared or fixed displacements, shared or clamped rotations."""
        rows: set[int] = set()
        nodes_turning = list(self.turned.values())
        for (link, node), _ in self.displaced.items():
            if link == part.name:
                u, v, theta = part.place[node]
                rows |= {u, v}
                group = self.turned[link, node]
                if group in self.clamped or nodes_turning.count(group) > 1:
                    rows.add(theta)
        return rows


@dataclass(frozen=True)
class Frame:
    """Names of the coordinates z, and L of each part: local coordinates q = L(t) z."""

    coordinates: tuple[str, ...]
    maps: Mapping[str, Affine]


class _Groups:
    """Union-find over nodes and bodies."""

    def __init__(self) -> None:
        self.parent: dict[object, object] = {}

    def find(self, item: object) -> object:
        self.parent.setdefault(item, item)
        while self.parent[item] != item:
            item = self.parent[item]
        return item

    def join(self, a: object, b: object) -> None:
        self.parent[self.find(a)] = self.find(b)


def prescribed_bodies(scene: Scene) -> set[str]:
    """Rigid bodies whose motion the drives fix: reached from the ground by drives and welds alone."""
    fixed = {"ground"}
    grown = True
    while grown:
        grown = False
        for name, joint in scene.joints.items():
            pair = [address.body for address in joint.addresses]
            rigid = all(body == "ground" or not scene.bodies[body].elastic for body in pair)
            if rigid and (name in scene.drives or joint.kind == "weld") and len(set(pair) & fixed) == 1:
                fixed |= set(pair)
                grown = True
    return fixed


def guided_bodies(scene: Scene, prescribed: Iterable[str]) -> dict[str, str]:
    """Rigid bodies on a guide of a prescribed body -> the guide's joint.

    Raises
    ------
    SceneError
        For a rigid body that elastic links carry in any other way.
    """
    guided: dict[str, str] = {}
    for name, joint in scene.joints.items():
        first, second = (address.body for address in joint.addresses)
        for guide, body in ((first, second), (second, first)):
            if joint.kind == "prismatic" and guide in prescribed and body not in prescribed:
                guided[body] = name
    for name, body in scene.bodies.items():
        if not body.elastic and name not in prescribed and name not in guided:
            raise SceneError(
                f"bodies.{name}", "rigid", "elastic links carrying a rigid body that no guide leads are not available yet",
                "Lead it by a prismatic joint on the ground or on a driven body, or give it a beam",
            )  # fmt: skip
        if name in guided and scene.bodies[name].elastic:
            raise SceneError(
                f"joints.{guided[name]}", name, "an elastic body on a guide is not available yet",
                "Join it to a guided rigid body by a revolute joint",
            )  # fmt: skip
    return guided


def find_interfaces(scene: Scene, links: Mapping[str, Link], weld_pins: bool, free_drives: bool) -> Interfaces:
    """Sort the joints of the elastic links into groups of equal displacement and of equal rotation.

    ``weld_pins`` shares the rotation of elastic links at every revolute joint, and ``free_drives`` lets the elastic
    rotation at a drive go free: two choices of the paper, (56), (86) and (108).
    """
    prescribed = prescribed_bodies(scene)
    guided = guided_bodies(scene, prescribed)
    shifts, turns = _Groups(), _Groups()
    nodes: dict[Node, str] = {}
    for name, joint in scene.joints.items():
        sides = [_side(scene, links, prescribed, address) for address in joint.addresses]
        elastic = [side for side in sides if isinstance(side, tuple)]
        for side in elastic:
            nodes.setdefault(side, name)
            turns.find(side)
        if not elastic:
            continue
        shifts.join(*sides)
        held = name in scene.drives and scene.drives[name].rotation == "held" and not free_drives
        shared = joint.kind == "weld" or joint.rotation == "shared" or (weld_pins and len(elastic) == 2)
        if held or shared:
            turns.join(*(side if isinstance(side, tuple) else "clamp" for side in sides))
    labels: dict[object, int] = {}
    displaced = {node: labels.setdefault(shifts.find(node), len(labels)) for node in nodes}
    turned = {node: labels.setdefault(("turn", turns.find(node)), len(labels)) for node in nodes}
    fixed = {displaced[node] for node in nodes if shifts.find(node) == shifts.find("prescribed")}
    clamped = {turned[node] for node in nodes if turns.find(node) == turns.find("clamp")}
    slider = {displaced[node]: body for node in nodes for body in guided if shifts.find(node) == shifts.find(body)}
    joint_of = {displaced[node]: name for node, name in reversed(nodes.items())}
    return Interfaces(displaced, turned, frozenset(fixed), frozenset(clamped), slider, joint_of)


def _side(scene: Scene, links: Mapping[str, Link], prescribed: set[str], address: Address) -> object:
    """A node of a link, or the rigid body (all prescribed ones alike)."""
    if address.body in links:
        x, y = scene.point(address)
        node = links[address.body].node_at(x) if y == 0 else None
        if node is None:
            raise SceneError(
                f"bodies.{address.body}", str(address), "a joint on an elastic body must lie on a node of its axis",
                "Choose a number of elements that puts a node there",
            )  # fmt: skip
        return address.body, node
    return "prescribed" if address.body in prescribed else address.body


def build_frame(scene: Scene, parts: Mapping[str, Part], interfaces: Interfaces) -> Frame:
    """Name the coordinates z and build L of every part, link after link along each chain."""
    names: list[str] = []
    column: dict[object, list[int]] = {}
    own: dict[str, list[tuple[int, int]]] = {part: [] for part in parts}

    def columns_of(key: object, *labels: str) -> list[int]:
        if key not in column:
            column[key] = list(range(len(names), len(names) + len(labels)))
            names.extend(labels)
        return column[key]

    elastic = {name: part for name, part in parts.items() if scene.bodies[name].elastic}
    for name, part in elastic.items():
        node_of_row = {row: (node, k) for node, rows in part.place.items() for k, row in enumerate(rows)}
        for row, label in enumerate(part.coordinates):
            node, k = node_of_row.get(row, (None, None))
            key = (name, node)
            if node is None or key not in interfaces.displaced:
                own[name].append((row, columns_of((name, row), label)[0]))
            elif k == 2:
                group = interfaces.turned[key]
                if group not in interfaces.clamped:
                    own[name].append((row, columns_of(group, label)[0]))
            else:
                group = interfaces.displaced[key]
                if group in interfaces.slider:
                    columns_of(interfaces.slider[group], f"{interfaces.slider[group]}.slide")
                elif group not in interfaces.fixed:
                    columns_of(group, f"{interfaces.joint[group]}.x", f"{interfaces.joint[group]}.y")
    for name in parts:
        if name not in elastic and name not in column:
            raise SceneError(
                f"bodies.{name}",
                "guided",
                "no elastic link moves this body",
                "Join it to one, or drive its guide",
            )
    size = len(names)
    maps = {}
    for name, part in parts.items():
        if not scene.bodies[name].elastic:
            maps[name] = _slide(scene, name, column[name], size)
            continue
        pairs = np.array(own[name], dtype=int).reshape(-1, 2)
        total = Affine.constant(
            csr_array(coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(part.size, size)))
        )
        for node, (u, v, _) in part.place.items():
            group = interfaces.displaced.get((name, node))
            if group is None or (group in interfaces.fixed and group not in interfaces.slider):
                continue
            if group in interfaces.slider:
                displacement = _slide(scene, interfaces.slider[group], column[interfaces.slider[group]], size)
            else:
                displacement = Affine.constant(_selector(2, [0, 1], column[group], size))
            rows = Affine.constant(_selector(part.size, [u, v], [0, 1], 2))
            total += rows @ to_link_axes(name) @ displacement
        maps[name] = total
    return Frame(tuple(names), maps)


def to_link_axes(body: str) -> Affine:
    """T of paper (66) for one point: global components -> components in the body's axes."""
    return Affine.term((f"{body}.c",), IDENTITY) + Affine.term((f"{body}.s",), TURN)


def guide_direction(scene: Scene, joint_name: str) -> Affine:
    """Global components (2 x 1) of a guide's direction, which turns with the body that carries the guide."""
    joint = scene.joints[joint_name]
    t = np.array(joint.direction)[:, None]
    carrier = joint.addresses[0].body
    return Affine.constant(t) if carrier == "ground" else to_link_axes(carrier).T @ Affine.constant(t)


def _slide(scene: Scene, body: str, columns: list[int], size: int) -> Affine:
    guide = guided_bodies(scene, prescribed_bodies(scene))[body]
    return guide_direction(scene, guide) @ Affine.constant(_selector(1, [0], columns, size))


def _selector(rows: int, at: list[int], columns: list[int], size: int) -> csr_array:
    return csr_array(coo_array((np.ones(len(at)), (at, columns)), shape=(rows, size)))
