"""Interfaces of elastic links with other bodies, and coordinates shared through joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_bodies import Carried, prescribed_bodies
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address
from kaneflex.support.errors import SceneError

Node = tuple[str, int]
"""Link and index of the node."""


@dataclass(frozen=True)
class Interfaces:
    """Groups of nodes that share a displacement or a rotation.

    Attributes
    ----------
    displaced, turned : mapping of Node to int
        Every interface node -> its group of equal displacement, and of equal rotation.
    fixed, clamped : frozenset of int
        Groups whose displacement, or rotation, is prescribed.
    carrier : mapping of int to Address
        Group -> point of the carried rigid body that it moves with.
    turned_body : mapping of int to str
        Group -> carried rigid body that it rotates with.
    joint : mapping of int to str
        Group of displacements -> joint that names it.
    """

    displaced: Mapping[Node, int]
    turned: Mapping[Node, int]
    fixed: frozenset[int]
    clamped: frozenset[int]
    carrier: Mapping[int, Address]
    turned_body: Mapping[int, str]
    joint: Mapping[int, str]

    def held_rows(self, part: Part) -> set[int]:
        """Local rows that a reduction must keep: shared or fixed displacements, shared or clamped rotations."""
        rows: set[int] = set()
        turning = list(self.turned.values())
        for (link, node), _ in self.displaced.items():
            if link == part.name:
                u, v, theta = part.place[node]
                rows |= {u, v}
                group = self.turned[link, node]
                if group in self.clamped or group in self.turned_body or turning.count(group) > 1:
                    rows.add(theta)
        return rows


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


def find_interfaces(
    scene: Scene, links: Mapping[str, Link], carried: Mapping[str, Carried], weld_pins: bool, free_drives: bool
) -> Interfaces:
    """Sort the joints of the elastic links into groups of equal displacement and of equal rotation.

    ``weld_pins`` shares the rotation of elastic links at every revolute joint, and ``free_drives`` lets the elastic
    rotation at a drive go free: two choices of the paper, (56), (86) and (108).

    Raises
    ------
    SceneError
        If a joint lies off the nodes of a link, or ties two carried rigid bodies to one node.
    """
    prescribed = prescribed_bodies(mechanism_of(scene))
    shifts, turns = _Groups(), _Groups()
    nodes: dict[Node, str] = {}
    held: list[tuple[str, Node, Address]] = []
    for name, joint in scene.joints.items():
        sides = [_side(scene, links, prescribed, address) for address in joint.addresses]
        elastic = [side for side in sides if isinstance(side, tuple)]
        for side in elastic:
            nodes.setdefault(side, name)
            turns.find(side)
        if not elastic:
            continue
        rigid = [address for address in joint.addresses if address.body in carried]
        if rigid:
            held.append((name, elastic[0], rigid[0]))
        else:
            shifts.join(*sides)
        keeps = name in scene.drives and scene.drives[name].rotation == "held" and not free_drives
        shared = joint.kind == "weld" or joint.rotation == "shared" or (weld_pins and len(elastic) == 2)
        if keeps or shared:
            turns.join(*(("body", side) if side in carried else side for side in sides))
    labels: dict[object, int] = {}
    displaced = {node: labels.setdefault(shifts.find(node), len(labels)) for node in nodes}
    turned = {node: labels.setdefault(("turn", turns.find(node)), len(labels)) for node in nodes}
    bodies = {turns.find(("body", body)): body for body in carried}
    return Interfaces(
        displaced,
        turned,
        frozenset(displaced[node] for node in nodes if shifts.find(node) == shifts.find("prescribed")),
        frozenset(turned[node] for node in nodes if turns.find(node) == turns.find("prescribed")),
        _carriers(scene, displaced, held),
        {turned[node]: bodies[turns.find(node)] for node in nodes if turns.find(node) in bodies},
        {displaced[node]: name for node, name in reversed(nodes.items())},
    )


def _carriers(scene: Scene, displaced: Mapping[Node, int], held: list[tuple[str, Node, Address]]) -> dict[int, Address]:
    carrier: dict[int, Address] = {}
    for joint, node, address in held:
        known = carrier.setdefault(displaced[node], address)
        if known.body != address.body:
            raise SceneError(
                f"joints.{joint}", [str(side) for side in scene.joints[joint].addresses],
                f"the point of {node[0]} carries {known.body} already, and can't carry {address.body}, too",
                f"Join {address.body} to {known} instead, give one of these two a beam, or use preset coupled",
            )  # fmt: skip
    return carrier


def _side(scene: Scene, links: Mapping[str, Link], prescribed: set[str], address: Address) -> Node | str:
    """Node of a link, or name of a rigid body ("prescribed" for all bodies placed by drives)."""
    if address.body in links:
        return address.body, links[address.body].node_of_joint(scene.point(address), str(address))
    return "prescribed" if address.body in prescribed else address.body
