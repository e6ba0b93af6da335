"""Degrees of freedom, counted from a scene alone: the rigid mechanism by Gruebler's formula, and what is elastic."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.joints import Constraints
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import Mechanism
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.reach import Courses
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
    floating : tuple of str
        Bodies that move freely in the plane, each with three degrees of freedom.
    still : bool
        Whether this is a structure whose bodies stand in given poses.
    """

    bodies: int
    constraints: Mapping[str, int]
    prescribed: tuple[str, ...]
    free: tuple[str, ...]
    floating: tuple[str, ...]
    still: bool

    @property
    def mobility(self) -> int:
        """Degrees of freedom of the rigid mechanism, drives left out."""
        return 3 * self.bodies - sum(self.constraints.values())

    @property
    def left(self) -> int:
        """What neither drives, free joints nor free bodies account for; below zero where constraints are redundant."""
        return self.mobility - len(self.prescribed) - len(self.free) - 3 * len(self.floating)

    @property
    def verdict(self) -> str:
        """What ``left`` means, in words."""
        if self.still:
            return "a structure: its bodies stand in the given poses, and only deform"
        if self.left > 0:
            return f"{self.left} too many: drive or join something more, or leave a joint free"
        if self.left < 0:
            return f"{-self.left} constraints too many: leave a drive or a joint out"
        return "the forces drive what is free" if self.free or self.floating else "the drives determine the motion"


def count_freedom(mechanism: Mechanism) -> Freedom:
    """Count the degrees of freedom of a rigid mechanism."""
    return Freedom(
        len(mechanism.bodies),
        {name: len(joint.rows) for name, joint in mechanism.joints.items()},
        tuple(name for name, drive in mechanism.drives.items() if not drive.free),
        tuple(name for name, drive in mechanism.drives.items() if drive.free),
        mechanism.floating,
        mechanism.frame,
    )


def mobility_by_rank(mechanism: NumericMechanism, courses: Courses) -> int:
    """Freedoms that the joints leave the bodies where they stand, drives left out: 3 bodies less the largest rank of
    the constraints' Jacobian at some instants of a motion."""
    bodies, joints = [*mechanism.bodies], [*mechanism.joints]
    if not joints:
        return 3 * len(bodies)
    count = courses[bodies[0]].shape[1]
    instants = sorted({round(share * (count - 1)) for share in (0.0, 0.13, 0.29, 0.41, 0.58, 0.77)})
    poses = {GROUND: np.zeros(3)} | {name: course[:, instants] for name, course in courses.items()}
    jacobian = Constraints(mechanism, {}).jacobian(poses, bodies, joints)
    jacobian = _scaled(jacobian, mechanism.size)
    ranks = np.linalg.matrix_rank(jacobian, tol=_HELD * np.linalg.norm(jacobian, 2, axis=(1, 2)))
    return 3 * len(bodies) - int(ranks.max())


_HELD = 1e-7
"""Share of the largest singular value below which rows of joints say the same where the bodies were placed."""
_IN_WORDS = {
    "force_x": "across x", "force_y": "across y", "moment": "in rotation", "normal": "across its guide",
    "drive": "by its drive",
}  # fmt: skip
_RATES = ("v_x", "v_y", "omega", "a_x", "a_y", "epsilon")


def in_joints(mechanism: Mechanism, spare: Sequence[str], open_unknowns: Sequence[str]) -> tuple[str, str]:
    """What is redundant and what is open in a mechanism's equations, and the cure, in words of joints and bodies.

    Parameters
    ----------
    spare : sequence of str
        Rows that are too many, "<joint>.<row>".
    open_unknowns : sequence of str
        Symbols that no equation determines, "<quantity>_<body>" or "<joint>_<row>".
    """
    loose = [body for body in mechanism.bodies if any(f"{rate}_{body}" in open_unknowns for rate in _RATES)]
    loaded = [joint for joint in mechanism.joints if any(f"{joint}_{row}" in open_unknowns for row in _IN_WORDS)]
    return _in_words(mechanism, spare, loose, loaded)


def _in_words(
    mechanism: Mechanism, spare: Sequence[str], loose: Sequence[str], loaded: Sequence[str]
) -> tuple[str, str]:
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
        cures.append("join or drive what is open; a drive may be free, and under preset coupled a body, too")
    if loaded:
        reasons.append(f"nothing determines the force in {', '.join(loaded)}")
    count = count_freedom(mechanism)
    taken = ", ".join(f"{name} {number}" for name, number in count.constraints.items())
    driven = f", drives {len(mechanism.drives)}" if mechanism.drives else ""
    cure = "; ".join(cures) or "compare with what `kaneflex show` counts"
    reasons.append(f"of {3 * count.bodies} degrees of freedom the joints take {taken}{driven}")
    return "; ".join(reasons), cure[:1].upper() + cure[1:]


def check_determined(mechanism: NumericMechanism, twice: bool = False) -> tuple[str, ...]:
    """What is redundant or open in a mechanism, whatever its lengths are, named before anything is derived.

    ``twice``: whether joints may hold what others hold already. Returns the rows "<joint>.<row>" of those that do.

    The constraints' Jacobian at places drawn by chance, where only guides and welds hold their angles, has at least the
    rank that it has where the mechanism closes: what is dependent here is so everywhere.

    Raises
    ------
    SceneError
        Naming the redundant joints or drives, and the bodies that nothing determines.
    """
    if mechanism.frame:
        return ()
    joints, bodies = [*mechanism.joints], [*mechanism.bodies]
    constraints = Constraints(mechanism, dict.fromkeys(mechanism.drives, 0.0))
    names = [f"{name}.{row}" for name, joint in mechanism.joints.items() for row in joint.rows]
    held = len(names)
    names += [f"{drive}.drive" for drive in constraints.driven(joints)]
    jacobian = constraints.jacobian(_by_chance(mechanism), bodies, joints)
    for body in mechanism.floating:
        own = 3 * bodies.index(body)
        names += [f"{body}.free"] * 3
        jacobian = np.vstack([jacobian.reshape(-1, 3 * len(bodies)), np.eye(3 * len(bodies))[own : own + 3]])
    if not names:
        return ()
    jacobian = _scaled(jacobian, mechanism.size)
    if _is_regular(jacobian):
        return ()
    order = list(range(len(names)))
    if held < len(names) and len(_independent(jacobian[:held])) == jacobian.shape[1]:
        # The joints alone let nothing move: of them the last ones are redundant, not the drives.
        closing = {f"{name}.{row}" for name in mechanism.loop_joints for row in mechanism.joints[name].rows}
        order.sort(key=lambda k: names[k] in closing)
    kept = {order[k] for k in _independent(jacobian[order])}
    spare = [name for k, name in enumerate(names) if k not in kept]
    if held_free := [name for name in spare if name.endswith(".free")]:
        raise SceneError(
            f"bodies.{held_free[0]}", None, "joints and drives say already how the body moves, in part at least",
            "Leave free out: joints that are free give coordinates and speeds at their drives",
        )  # fmt: skip
    # What moves in the null space is open.
    _, sizes, shapes = np.linalg.svd(jacobian)
    free = shapes[int((sizes > _DEPENDENT * sizes[0]).sum()) :]
    loose = [body for k, body in enumerate(bodies) if abs(free[:, 3 * k : 3 * k + 3]).max(initial=0.0) > 1e-6]
    drives = [name.removesuffix(".drive") for name in spare if name.endswith(".drive")]
    if loose or (spare and not (twice and not drives)):
        reason, cure = _in_words(mechanism, spare, loose, ())
        if spare and not loose and not drives:
            cure += "; preset coupled moves bodies that are held twice where their joints agree"
        key = f"drives.{drives[-1]}" if drives and len(drives) == len(spare) else "joints"
        raise SceneError(key, None, reason, cure)
    return tuple(spare)


def check_held_twice(mechanism: NumericMechanism, placement: Placement, spare: Sequence[str]) -> None:
    """Joints that hold something twice must leave the mechanism as many degrees of freedom as it has drives.

    Raises
    ------
    SceneError
        Naming the rows ``spare`` where the joints lock the mechanism at its first place.
    """
    free = mobility_by_rank(mechanism, {name: pose[:, None] for name, pose in placement.poses.items()})
    if free < len(mechanism.drives):
        reason, cure = _in_words(mechanism, spare, (), ())
        raise SceneError("joints", None, f"{reason}; where it starts they let nothing move", cure)


_REGULAR = 1e-6
"""Share of the largest singular value that the least one has where none of the rows is taken for dependent."""
_DEPENDENT = 1e-9
"""Share of a row, or of the largest singular value, below which rounding is what is left."""


def _by_chance(mechanism: NumericMechanism) -> dict[str, np.ndarray]:
    """Poses drawn by chance, the same each time, with the angles that guides and welds give two bodies."""
    random = np.random.default_rng(0)
    spread = [mechanism.size, mechanism.size, math.pi]
    poses = {GROUND: np.zeros(3)} | {name: random.uniform(-1.0, 1.0, 3) * spread for name in mechanism.bodies}
    held, turning = {GROUND}, [joint for joint in mechanism.joints.values() if joint.kind != "revolute"]
    while len(held) < len(poses):
        for joint in [joint for _ in turning for joint in turning]:
            first, second = joint.bodies
            if first in held and second not in held:
                poses[second][2] = poses[first][2] + joint.angle
                held.add(second)
            elif second in held and first not in held:
                poses[first][2] = poses[second][2] - joint.angle
                held.add(first)
        held.add(next((name for name in poses if name not in held), GROUND))
    return poses


def _scaled(jacobian: np.ndarray, size: float) -> np.ndarray:
    """Rows of one length, with angles in sizes of the mechanism: ranks then do not depend on the unit of length."""
    jacobian[..., 2::3] /= size
    lengths = np.linalg.norm(jacobian, axis=-1, keepdims=True)
    return jacobian / np.where(lengths > 0.0, lengths, 1.0)


def _is_regular(rows: np.ndarray) -> bool:
    """Whether there are as many rows as columns, and by far no row is a combination of others."""
    lengths = np.linalg.norm(rows, axis=1, keepdims=True)
    if rows.shape[0] != rows.shape[1] or not lengths.all():
        return False
    sizes = np.linalg.svd(np.stack([rows, rows / lengths]), compute_uv=False)
    return bool((sizes[:, -1] > _REGULAR * sizes[:, 0]).all())


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
    from kaneflex.fem.links import Link, Part, node_coordinates
    from kaneflex.mechanism.floating_frames import mesh

    nodes = mesh(scene, name, elements)
    coordinates, place = node_coordinates(name, len(nodes), scene.bodies[name].beam.axially_rigid)
    return Link(name, nodes, {}, (), Part(name, coordinates, {}, place))
