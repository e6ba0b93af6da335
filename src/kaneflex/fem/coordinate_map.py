"""Elastic coordinates z of a planar mechanism by its joints, and the map q = L z of every part.

Displacements of joints are global coordinates shared by the connected bodies; rotations are released at a revolute
joint and shared at a weld; rigid bodies carried by elastic links have a slide, a rotation, or a displacement and a
rotation. All other coordinates belong to one link, in its axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaneflex.fem.links import Link, Part
from kaneflex.mechanism.affine import Affine, from_entries
from kaneflex.mechanism.planar import GROUND, BodyPoint, Vector
from kaneflex.mechanism.rigid_bodies import FIXED, Site, Tie, carried_bodies, prescribed_bodies, spanning_tree

if TYPE_CHECKING:
    from kaneflex.mechanism.mechanism import NumericMechanism
    from kaneflex.mechanism.parts import Joint, Mechanism

WHOLE, SHIFT, TURN = (Affine.constant(np.eye(3)[rows]) for rows in ([0, 1, 2], [0, 1], [2]))
"""Matrices that take all, the displacement, or the rotation from global displacements and a rotation."""


@dataclass(frozen=True)
class Interfaces:
    """Sites that joints tie together; in space nodes of links at joints or springs, which share all coordinates.

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

    def held_rows(self, part: Part) -> set[int]:
        """Local rows that a reduction must keep: displacements at joints, and shared or clamped rotations."""
        sharing = {site for tie in self.ties if tie.joint in self.shared for site in (tie.site, tie.parent)}
        return {row for site in self.displaced if site[0] == part.name
                for row in part.place[site[1]][: None if site in sharing else 2]}  # fmt: skip


def find_interfaces(
    mechanism: NumericMechanism, links: Mapping[str, Link], weld_pins: bool, free_drives: bool
) -> Interfaces:
    """Tie the nodes of the elastic links and the rigid bodies together.

    ``weld_pins`` shares the rotation of elastic links at every revolute joint, and ``free_drives`` lets the elastic
    rotation at a drive go free: two choices of the paper, (56), (86) and (108).

    Raises
    ------
    SceneError
        If a joint lies off the nodes of a link, or for rigid bodies as :func:`carried_bodies`.
    """
    carried_bodies(mechanism)
    prescribed = prescribed_bodies(mechanism)

    def site_of(side: BodyPoint) -> Site:
        if side.body in links:
            return side.body, links[side.body].node_of_joint(side.at, f"{side.body}.{side.name}")
        return FIXED if side.body in prescribed else (side.body, None)

    sides: dict[str, tuple[Site, Site]] = {}
    shared: set[str] = set()
    for name, joint in mechanism.joints.items():
        first, second = map(site_of, joint.sides)
        sides[name] = first, second
        elastic, drive = (first[1] is not None) + (second[1] is not None), mechanism.drives.get(name)
        keeps = drive is not None and (not elastic or (drive.rotation == "held" and not free_drives))
        if keeps or joint.kind != "revolute" or name in mechanism.shared or (weld_pins and elastic == 2):
            shared.add(name)
    nodes: dict[Site, str] = {}
    for name, ends in sides.items():
        nodes |= {site: name for site in ends if site[1] is not None and site not in nodes}
    rigid = [(name, None) for name, body in mechanism.bodies.items() if not body.elastic and name not in prescribed]
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


def to_link_axes(body: str) -> Affine:
    """T of paper (66) for one point: global components -> components in the body's axes."""
    return Affine.term((f"{body}.c",), np.eye(2)) + Affine.term((f"{body}.s",), [[0.0, 1.0], [-1.0, 0.0]])


def from_start(body: str, at: Sequence[float]) -> Affine:
    """Global displacement of a rigid body's point, d + theta S R r, and its turn from those of its start, (3, 3)."""
    if not any(at):
        return WHOLE
    return WHOLE + SHIFT.T @ to_link_axes(body).T @ Affine.constant([[-at[1]], [at[0]]]) @ TURN


def guide_direction(joint: Joint) -> Affine:
    """Global components (2 x 1) of a guide's direction, which turns with the body that carries the guide."""
    t, carrier = np.array(joint.direction, float)[:, None], joint.first.body
    return Affine.constant(t) if carrier == GROUND else to_link_axes(carrier).T @ Affine.constant(t)


class Placed(NamedTuple):
    """Part with its map L from the mechanism's coordinates.

    ``at``: sites on which the part acts, with the matrices (size, dofs) from the displacement and rotation there to the
    part's coordinates; these are global in the plane, those of a rigid body are of its start; a link has none.
    """

    part: Part
    L: Affine
    at: tuple[tuple[Site, Affine], ...] = ()


class Sites:
    """Sites of a planar mechanism, and their global displacement and rotation from the coordinates, (3, n).

    Attributes
    ----------
    parts : mapping of str to Part
        Links as assembled.
    names : list of str
        The coordinates, in the order of their first use by the links.
    found : mapping of Site to Affine
        Motions of the sites that joints tie together.
    """

    def __init__(
        self, mechanism: Mechanism, links: Mapping[str, Link], parts: Mapping[str, Part], interfaces: Interfaces
    ) -> None:
        self.mechanism, self.links, self.parts, self.interfaces = mechanism, links, parts, interfaces
        self.names: list[str] = []
        self._columns: dict[object, list[int]] = {}
        self._ties = {tie.site: tie for tie in interfaces.ties}
        self.alone = {name: self._name(part) for name, part in parts.items()}
        for site in self._ties:
            if site[1] is None:
                self._name_body(site)
        self.found: dict[Site, Affine] = {}
        for tie in interfaces.ties:
            self.found[tie.site] = self._motion(tie)

    def _add(self, key: object, *labels: str) -> list[int]:
        """Columns of a site's coordinates, which are added at their first use."""
        if key not in self._columns:
            self._columns[key] = list(range(len(self.names), len(self.names) + len(labels)))
            self.names.extend(labels)
        return self._columns[key]

    def _name(self, part: Part) -> list[tuple[int, int]]:
        """Name the coordinates that a link needs; pairs (local row, coordinate) of those that are its own alone."""
        displaced, turned, pairs = self.interfaces.displaced, self.interfaces.turned, []
        # All nodes of an axially rigid link share a row: it is that of the node at a joint, which comes last.
        nodes = sorted(part.place, key=lambda node: (part.name, node) in displaced)
        node_of_row = {row: (node, k) for node in nodes for k, row in enumerate(part.place[node])}
        for row, label in enumerate(part.coordinates):
            node, k = node_of_row.get(row, (None, None))
            site = part.name, node
            if node is None or site not in displaced:
                pairs.append((row, self._add((part.name, row), label)[0]))
            elif (owner := turned[site] if k == 2 else displaced[site])[1] is None:
                self._name_body(owner)
            else:
                joint = self.interfaces.joint[displaced[site]]
                self._add((owner, k == 2), *((label,) if k == 2 else (f"{joint}.x", f"{joint}.y")))
        return pairs

    def _name_body(self, site: Site) -> None:
        """Name what a carried rigid body has of its own: a slide, its turn, or its displacement and its turn."""
        if site != FIXED:
            body, joint = site[0], self._ties[site].joint
            own = ("x", "y") if not joint else ("slide",) if self._is_guide(joint) else ()
            self._add((site, False), *(f"{body}.{label}" for label in own))
            self._add((site, True), *([] if joint in self.interfaces.shared else [f"{body}.turn"]))

    def _is_guide(self, joint: str) -> bool:
        return bool(joint) and self.mechanism.joints[joint].slides

    def _motion(self, tie: Tie) -> Affine:
        """Motion of a site by its own coordinates, and by those of its parent."""
        size, (shifts, turns) = len(self.names), (self._columns.get((tie.site, turn), []) for turn in (False, True))
        own = [0, 1][: len(shifts)] + [2][: len(turns)]
        if self._is_guide(tie.joint):
            return SHIFT.T @ guide_direction(self.mechanism.joints[tie.joint]) @ selector(1, [0], shifts, size)
        found = selector(3, own, shifts + turns, size) if own else Affine.zero(3, size)
        if not tie.joint:
            return found
        if tie.parent != FIXED:
            kept = WHOLE if tie.joint in self.interfaces.shared else SHIFT.T @ SHIFT
            found += kept @ from_start(tie.parent[0], self.arm(tie, tie.parent)) @ self.found[tie.parent]
        x, y = self.arm(tie, tie.site)  # the joint's point moves with the parent, the start follows at -theta S R r
        return from_start(tie.site[0], (-x, -y)) @ found

    def arm(self, tie: Tie, site: Site) -> Sequence[float]:
        """Joint's point of one of its sites, from a rigid body's start; nodes are there."""
        sides = self.mechanism.joints[tie.joint].sides
        return (0.0, 0.0) if site[1] is not None else next(side.at for side in sides if side.body == site[0])

    @cached_property
    def frame(self) -> Frame:
        """Names of the coordinates, and L of every link from the motions of its nodes at joints."""
        size, maps = len(self.names), {}
        for name, part in self.parts.items():
            rows, columns = zip(*self.alone[name], strict=True) if self.alone[name] else ((), ())
            total = selector(part.size, rows, columns, size)
            for node, (u, v, theta) in part.place.items():
                moved = self.found.get((name, node))
                if moved is not None:
                    total += selector(part.size, [u, v], [0, 1], 2) @ to_link_axes(name) @ SHIFT @ moved
                    if theta is not None:
                        total += selector(part.size, [theta], [0], 1) @ TURN @ moved
            maps[name] = total
        bodies = {name: moved for (name, node), moved in self.found.items() if node is None}
        return Frame(tuple(self.names), maps, bodies)

    def place(self, part: Part, *points: tuple[str, Vector, Affine]) -> Placed:
        """Part with coordinates that are sums of matrices times the global displacement and rotation of points, given
        by body and place in its axes."""
        at: list[tuple[Site, Affine]] = []
        L = Affine.zero(part.size, len(self.names))
        for body, where, rows in points:
            if body != GROUND:
                node = self.links[body].node_at(where[0]) if body in self.links else None
                at.append(((body, node), rows if body in self.links else rows @ from_start(body, where)))
                L += at[-1][1] @ self.motion((body, node))
        return Placed(part, L, tuple(at))

    def motion(self, site: Site) -> Affine:
        """Global displacement and rotation of a node or of a rigid body's start, (3, n)."""
        (name, node), known = site, self.found
        if site in known or node is None:
            return known.get(site, Affine.zero(3, len(self.names)))
        part = self.parts[name]
        rows = selector(3, [0, 1, 2], part.place[node], part.size) @ self.frame.maps[name]
        return (SHIFT.T @ to_link_axes(name).T @ SHIFT + TURN.T @ TURN) @ rows

    def between(self, part: Part, sides: Iterable[BodyPoint], rows: Affine) -> Placed:
        """Part with coordinates that are a matrix times the displacement and rotation of a second point less those of
        a first."""
        signs = zip(sides, (-1.0, 1.0), strict=True)
        return self.place(part, *((side.body, side.at, sign * rows) for side, sign in signs))


def selector(rows: int, at: Sequence[int], columns: Sequence[int], size: int) -> Affine:
    """Matrix (rows, size) that takes some columns to rows ``at``."""
    return Affine.constant(from_entries((rows, size), list(at), list(columns), np.ones(len(at))))

