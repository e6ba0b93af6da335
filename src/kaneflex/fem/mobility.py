"""Degrees of freedom, counted from a scene alone: the rigid mechanism by Gruebler's formula, and what is elastic."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.joints import Rows, constraint_count
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.fem.links import Link


@dataclass(frozen=True)
class Freedom:
    """The count 3 bodies - constraints - drives of a planar mechanism (Gruebler; e.g. Norton, Design of Machinery).

    Attributes
    ----------
    bodies : int
    constraints : mapping of str to int
        What each joint takes away.
    prescribed, free : tuple of str
        Joints whose motion a drive prescribes, and those that follow the forces.
    still : bool
        Whether this is a structure whose bodies stand in given poses.
    """

    bodies: int
    constraints: Mapping[str, int]
    prescribed: tuple[str, ...]
    free: tuple[str, ...]
    still: bool

    @property
    def mobility(self) -> int:
        """Degrees of freedom of the rigid mechanism, drives left out."""
        return 3 * self.bodies - sum(self.constraints.values())

    @property
    def left(self) -> int:
        """What neither a prescribed nor a free joint accounts for; below zero where constraints are redundant."""
        return self.mobility - len(self.prescribed) - len(self.free)

    @property
    def verdict(self) -> str:
        """What ``left`` means, in words."""
        if self.still:
            return "a structure: its bodies stand in the given poses, and only deform"
        if self.left > 0:
            return f"{self.left} too many: drive or join something more, or leave a joint free"
        if self.left < 0:
            return f"{-self.left} constraints too many: leave a drive or a joint out"
        return "the forces drive what is free" if self.free else "the drives determine the motion"


def count_freedom(scene: Scene) -> Freedom:
    """Count the degrees of freedom of a scene's rigid mechanism."""
    return Freedom(
        len(scene.bodies),
        {name: constraint_count(joint) for name, joint in scene.joints.items()},
        tuple(name for name, drive in scene.drives.items() if drive.kind != "free"),
        tuple(name for name, drive in scene.drives.items() if drive.kind == "free"),
        scene.is_frame,
    )


_IN_WORDS = {
    "force_x": "across x", "force_y": "across y", "moment": "in rotation", "normal": "across its guide",
    "drive": "by its drive",
}  # fmt: skip
_RATES = ("v_x", "v_y", "omega", "a_x", "a_y", "epsilon")


def in_joints(scene: Scene, spare: Sequence[str], open_unknowns: Sequence[str]) -> tuple[str, str]:
    """What is redundant and what is open in a mechanism's equations, and the cure, in words of joints and bodies.

    Parameters
    ----------
    spare : sequence of str
        Rows that are too many, "<joint>.<row>".
    open_unknowns : sequence of str
        Symbols that no equation determines, "<quantity>_<body>" or "<joint>_<row>".
    """
    loose = [body for body in scene.bodies if any(f"{rate}_{body}" in open_unknowns for rate in _RATES)]
    loaded = [joint for joint in scene.joints if any(f"{joint}_{row}" in open_unknowns for row in _IN_WORDS)]
    return _in_words(scene, spare, loose, loaded)


def _in_words(scene: Scene, spare: Sequence[str], loose: Sequence[str], loaded: Sequence[str]) -> tuple[str, str]:
    """Reason and cure: rows too many, bodies whose motion is open, joints whose force is."""
    reasons, cures = [], []
    if spare:
        rows: dict[str, list[str]] = {}
        for name in spare:
            joint, _, row = name.rpartition(".")
            rows.setdefault(joint, []).append(_IN_WORDS.get(row, row))
        held = ", ".join(f"{joint} {' and '.join(words)}" for joint, words in rows.items())
        many = "a constraint" if len(spare) == 1 else f"{len(spare)} constraints"
        reasons.append(f"{many} too many, redundant as other joints and drives hold that already: {held}")
        cures.append("leave a joint or a drive out, or give every body a pose where nothing is to move")
    if loose:
        reasons.append(f"nothing determines the motion of {', '.join(loose)}")
        cures.append("join or drive what is open")
    if loaded:
        reasons.append(f"nothing determines the force in {', '.join(loaded)}")
    count = count_freedom(scene)
    taken = ", ".join(f"{name} {number}" for name, number in count.constraints.items())
    driven = f", drives {len(scene.drives)}" if scene.drives else ""
    cure = "; ".join(cures) or "compare with what `kaneflex show` counts"
    reasons.append(f"of {3 * count.bodies} degrees of freedom the joints take {taken}{driven}")
    return "; ".join(reasons), cure[:1].upper() + cure[1:]


def check_determined(scene: Scene) -> None:
    """What is redundant or open in a mechanism, whatever its lengths are, named before anything is derived.

    The constraints' Jacobian at places drawn by chance, where only guides and welds hold their angles, has at least the
    rank that it has where the mechanism closes: what is dependent here is so everywhere.

    Raises
    ------
    SceneError
        Naming the redundant joints or drives, and the bodies that nothing determines.
    """
    if scene.is_frame:
        return
    joints = list(scene.joints)
    rows = Rows(scene, dict.fromkeys(scene.drives, 0.0))
    names = [f"{joint}.{row}" for joint in joints for row in _ROWS[scene.joints[joint].kind]]
    constraints = len(names)
    names += [f"{drive}.drive" for drive in rows.driven(joints)]
    if not names:
        return
    jacobian = rows.jacobian(_by_chance(scene, rows.size), list(scene.bodies), joints)
    jacobian[:, 2::3] /= rows.size
    order = list(range(len(names)))
    if constraints < len(names) and len(_independent(jacobian[:constraints])) == jacobian.shape[1]:
        # The joints alone let nothing move: of them the last ones are redundant, not the drives.
        closing = {f"{joint}.{row}" for joint in scene.loop_joints() for row in _ROWS[scene.joints[joint].kind]}
        order.sort(key=lambda k: names[k] in closing)
    kept = {order[k] for k in _independent(jacobian[order])}
    spare = [name for k, name in enumerate(names) if k not in kept]
    # What moves in the null space is open.
    _, sizes, shapes = np.linalg.svd(jacobian)
    free = shapes[int((sizes > _DEPENDENT * sizes[0]).sum()) :]
    loose = [body for k, body in enumerate(scene.bodies) if abs(free[:, 3 * k : 3 * k + 3]).max(initial=0.0) > 1e-6]
    if spare or loose:
        reason, cure = _in_words(scene, spare, loose, ())
        drives = [name.removesuffix(".drive") for name in spare if name.endswith(".drive")]
        key = f"drives.{drives[-1]}" if drives and len(drives) == len(spare) else "joints"
        raise SceneError(key, None, reason, cure)


_ROWS = {
    "revolute": ("force_x", "force_y"), "weld": ("force_x", "force_y", "moment"), "prismatic": ("normal", "moment"),
}  # fmt: skip
"""Kind of a joint -> its constraints, in the order of `joint_rows.Rows`."""
_DEPENDENT = 1e-9
"""Share of a row, or of the largest singular value, below which rounding is what is left."""


def _by_chance(scene: Scene, size: float) -> dict[str, np.ndarray]:
    """Poses drawn by chance, the same each time, with the angles that guides and welds give two bodies."""
    random = np.random.default_rng(0)
    poses = {name: random.uniform(-1.0, 1.0, 3) * [size, size, math.pi] for name in scene.bodies}
    poses = {"ground": np.zeros(3)} | poses
    held, turning = {"ground"}, [joint for joint in scene.joints.values() if joint.kind != "revolute"]
    while len(held) < len(poses):
        for joint in [joint for _ in turning for joint in turning]:
            first, second = (address.body for address in joint.addresses)
            if first in held and second not in held:
                poses[second][2] = poses[first][2] + joint.relative_angle
                held.add(second)
            elif second in held and first not in held:
                poses[first][2] = poses[second][2] - joint.relative_angle
                held.add(first)
        held.add(next((name for name in poses if name not in held), "ground"))
    return poses


def _independent(rows: np.ndarray) -> list[int]:
    """Rows that those before them don't already span (Gram and Schmidt, twice for rounding)."""
    basis, kept = np.zeros((0, rows.shape[1])), []
    for k, row in enumerate(rows):
        rest = row - basis.T @ (basis @ row)
        rest = rest - basis.T @ (basis @ rest)
        if np.linalg.norm(rest) > _DEPENDENT * np.linalg.norm(row):
            basis = np.vstack([basis, rest / np.linalg.norm(rest)])
            kept.append(k)
    return kept


def elastic_coordinates(scene: Scene) -> tuple[str, ...]:
    """Names of the coordinates of the elastic stage, before any reduction to modes.

    Raises
    ------
    SceneError
        If the elastic stage can't be set up as the scene asks.
    """
    from kaneflex.fem.coordinate_map import build_frame
    from kaneflex.fem.interface_coordinates import find_interfaces
    from kaneflex.mechanism.floating_frames import shapes_given
    from kaneflex.mechanism.rigid_bodies import carried_bodies, check_elastic
    from kaneflex.scene.options import resolve_options

    options = resolve_options(scene)
    if options.dynamics == "rigid":
        return ()
    check_elastic(scene)
    given = shapes_given(scene) if options.dynamics == "coupled" else ()
    links = {
        name: _mesh_of(scene, name, options.elements or body.beam.elements)
        for name, body in scene.bodies.items()
        if body.elastic
    }
    carried = carried_bodies(scene)
    interfaces = find_interfaces(scene, links, carried, options.weld_pins, options.free_drives)
    frame = build_frame(scene, {name: link.part for name, link in links.items()}, carried, interfaces)
    return (*frame.coordinates, *given)


def _mesh_of(scene: Scene, name: str, elements: int) -> Link:
    """A link with its nodes and coordinates alone: the matrices would need the derived element."""
    from kaneflex.fem.links import Link, Part, mesh, node_coordinates

    nodes = mesh(scene, name, elements)
    coordinates, place = node_coordinates(name, len(nodes), scene.bodies[name].beam.axially_rigid)
    return Link(name, nodes, {}, (), Part(name, coordinates, {}, place))
