"""Nodes of elastic links and rigid bodies that joints tie together, and the coordinates that they share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_bodies import FIXED, Site, Tie, carried_bodies, prescribed_bodies, spanning_tree
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address


@dataclass(frozen=True)
class Interfaces:
    """Sites of a planar mechanism that its joints tie together.

    Attributes
    ----------
    ties : tuple of Tie
        Nodes of elastic links and rigid bodies that the deformation moves, parents first.
    shared : frozenset of str
        Joints whose second body turns with the first.
    displaced, turned : mapping of Site to Site
        Node at a joint -> the one with the same displacement, or rotation, that has it as coordinates; FIXED, or the
        rigid body that the node moves with.
    joint : mapping of Site to str
        The joint that names these displacements.
    """

    ties: tuple[Tie, ...]
    shared: frozenset[str]
    displaced: Mapping[Site, Site]
    turned: Mapping[Site, Site]
    joint: Mapping[Site, str]
    fixed: ClassVar[tuple[Site, ...]] = (FIXED,)
    clamped: ClassVar[tuple[Site, ...]] = (FIXED,)

    def held_rows(self, part: Part) -> set[int]:
        """Local rows that a reduction must keep: displacements at joints, and shared or clamped rotations."""
        sharing = {site for tie in self.ties if tie.joint in self.shared for site in (tie.site, tie.parent)}
        return {row for site in self.displaced if site[0] == part.name
                for row in part.place[site[1]][: 3 if site in sharing else 2]}  # fmt: skip


def find_interfaces(scene: Scene, links: Mapping[str, Link], weld_pins: bool, free_drives: bool) -> Interfaces:
    """Tie the nodes of the elastic links and the rigid bodies together.

    ``weld_pins`` shares the rotation of elastic links at every revolute joint, and ``free_drives`` lets the elastic
    rotation at a drive go free: two choices of the paper, (56), (86) and (108).

    Raises
    ------
    SceneError
        If a joint lies off the nodes of a link, or for rigid bodies as :func:`carried_bodies`.
    """
    carried_bodies(scene)
    prescribed = prescribed_bodies(mechanism_of(scene))

    def site_of(address: Address) -> Site:
        if address.body in links:
            return address.body, links[address.body].node_of_joint(scene.point(address), str(address))
        return FIXED if address.body in prescribed else (address.body, None)

    sides: dict[str, tuple[Site, Site]] = {}
    shared: set[str] = set()
    for name, joint in scene.joints.items():
        first, second = map(site_of, joint.addresses)
        sides[name] = first, second
        elastic, drive = (first[1] is not None) + (second[1] is not None), scene.drives.get(name)
        keeps = drive is not None and (not elastic or (drive.rotation == "held" and not free_drives))
        if keeps or joint.kind != "revolute" or joint.rotation == "shared" or (weld_pins and elastic == 2):
            shared.add(name)
    nodes: dict[Site, str] = {}
    for name, ends in sides.items():
        nodes |= {site: name for site in ends if site[1] is not None and site not in nodes}
    rigid = [(name, None) for name, body in scene.bodies.items() if not body.elastic and name not in prescribed]
    firm = sorted(sides, key=lambda name: name not in shared)
    ties, _ = spanning_tree({name: sides[name] for name in firm}, [*rigid, *nodes])
    displaced, turned = {FIXED: FIXED}, {FIXED: FIXED}
    for site, name, parent in ties:
        own = site[1] is None or not name
        displaced[site] = site if own else displaced[parent]
        turned[site] = turned[parent] if name in shared and not own else site
    names = {displaced[node]: name for node, name in reversed(nodes.items())}
    displaced, turned = ({node: owner[node] for node in nodes} for owner in (displaced, turned))
    return Interfaces(tuple(ties), frozenset(shared), displaced, turned, names)
