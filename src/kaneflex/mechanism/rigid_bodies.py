"""Rigid bodies in the elastic stage: those placed by drives, and those that joints tie to elastic links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple

from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.mechanism.planar import GROUND
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

Site = tuple[str, int | None]
"""Elastic link and its node, or rigid body and None."""
FIXED: Site = (GROUND, None)
"""Ground, and all bodies that the deformation does not move."""


class Tie(NamedTuple):
    """Site that moves with its parent, but for the freedoms of their joint; without a joint it moves freely."""

    site: Site
    joint: str = ""
    parent: Site = FIXED


def spanning_tree(joints: Mapping[str, tuple[Site, Site]], roots: Iterable[Site]) -> tuple[list[Tie], list[str]]:
    """Ties of all sites, parents first, and the joints that close loops.

    ``joints``: both sites of each, those first that the tree prefers; ``roots``: where it starts besides FIXED.
    """
    group: dict[Site, Site] = {}

    def group_of(site: Site) -> Site:
        while (above := group.get(site, site)) != site:
            site = above
        return site

    near: dict[Site, list[Tie]] = {}
    closing = []
    for joint, (first, second) in joints.items():
        if group_of(first) == group_of(second):
            closing.append(joint)
            continue
        group[group_of(second)] = group_of(first)
        near.setdefault(first, []).append(Tie(second, joint, first))
        near.setdefault(second, []).append(Tie(first, joint, second))
    found = {FIXED: Tie(FIXED)}
    for root in (FIXED, *roots):
        wave = [found.setdefault(root, Tie(root))]
        for tie in wave:  # it grows
            new = [each for each in near.pop(tie.site, ()) if each.site not in found]
            found |= {each.site: each for each in new}
            wave += new
    return list(found.values())[1:], closing


def prescribed_bodies(mechanism: NumericMechanism) -> set[str]:
    """Rigid bodies with prescribed or free motion, found group by group from joints between rigid bodies."""
    rigid = [name for name, body in mechanism.bodies.items() if not body.elastic]
    placed = {GROUND, *(name for name in mechanism.floating if name in rigid)}
    while group := mechanism.smallest_group(placed, [name for name in rigid if name not in placed]):
        placed |= {*group}
    return placed


def carried_bodies(mechanism: NumericMechanism) -> list[Tie]:
    """Ties of the rigid bodies that move with the deformation by joints between rigid bodies, holders first.

    Raises
    ------
    SceneError
        For a rigid body with redundant constraints by other rigid bodies, or on the guide of a carried body.
    """
    prescribed = prescribed_bodies(mechanism)
    rigid = [name for name, body in mechanism.bodies.items() if not body.elastic]
    sites: dict[str, Site] = {name: FIXED if name in prescribed else (name, None) for name in (GROUND, *rigid)}
    sides = {}
    for name, joint in mechanism.joints.items():
        first, second = map(sites.get, joint.bodies)
        if first is not None and second is not None and first != second:
            sides[name] = first, second
    ties, closing = spanning_tree(sides, map(sites.__getitem__, rigid))
    for tie in ties:
        if tie.joint and mechanism.joints[tie.joint].slides and tie.parent != FIXED:
            raise SceneError(
                f"joints.{tie.joint}", tie.parent[0],
                "the guide is on a body that the deformation of elastic links moves",
                "Use preset coupled or rigid, or put the guide on the ground or on a driven body",
            )  # fmt: skip
        before = {FIXED, *(each.site for each in ties[: ties.index(tie)])}
        held = [name for name in sides if name in (tie.joint, *closing) and tie.site in sides[name]
                and before & {*sides[name]}]  # fmt: skip
        if len(held) > 1:
            raise SceneError(
                f"bodies.{tie.site[0]}", "rigid",
                f"{' and '.join(held)} connect it to rigid bodies that move apart as links deform",
                "Use preset coupled or rigid, give one of these bodies a beam, or leave one of the joints out",
            )  # fmt: skip
    return ties


def check_elastic(scene: Scene) -> None:
    """Raise SceneError unless the elastic stage supports the scene, before anything is derived.

    A guide can hold rigid bodies only. Loads, springs and lumped masses on a link must lie on its axis, where its
    nodes are.
    """
    carried_bodies(mechanism_of(scene))  # raises if they can't follow the links
    check_on_axes(scene)


def check_on_axes(scene: Scene) -> None:
    """Raise SceneError for elastic links on guides, and for points off their axes."""
    for name, spring in scene.springs.items():
        joined = scene.joints[spring.torsional_at].addresses if spring.torsional_at is not None else ()
        if scene.solve.preset == "paper" and any(a.body != "ground" and scene.bodies[a.body].elastic for a in joined):
            raise SceneError(
                f"springs.{name}", spring.torsional_at, "in preset paper elastic bodies rotate freely at a drive",
                "Use another preset, or leave the spring out",
            )  # fmt: skip
    for entry, address in scene.acting:
        body = scene.bodies.get(address.body)
        if body is None or not body.elastic:
            continue
        x, y = scene.point(address)
        if not (y == 0 and 0 <= x <= body.length):
            raise SceneError(
                entry, str(address), f"the point lies off the axis of {address.body}",
                "Move the point onto the axis, between start and end, or join a rigid body there",
            )  # fmt: skip
        if entry.endswith(".prismatic"):
            raise SceneError(
                entry, address.body, "an elastic body on a guide is not supported",
                "Join it to a guided rigid body by a revolute joint or a weld, or use preset rigid",
            )  # fmt: skip
