"""Degrees of freedom of a scene: the rigid mechanism by Gruebler's formula, and elastic coordinates."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from random import Random
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.mechanism.joints import Constraints
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.parts import Mechanism
from kaneflex.mechanism.planar import GROUND
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError

if TYPE_CHECKING:
    from kaneflex.fem.links import Link
    from kaneflex.mechanism.closure import Courses
    from kaneflex.mechanism.position_analysis import Placement


@dataclass(frozen=True)
class Freedom:
    """Mobility 3 bodies - constraints - drives of a planar mechanism (Gruebler; e.g. Norton, Design of Machinery).

    Attributes
    ----------
    bodies : int
    constraints : mapping of str to int
        Constraints of each joint.
    prescribed, free : tuple of str
        Joints whose motion a drive prescribes, and those that follow the forces.
    floating : tuple of str
        Free bodies, each with three degrees of freedom.
    still : bool
        True for a fixed structure, whose bodies have given poses.
    """

    bodies: int
    constraints: Mapping[str, int]
    prescribed: tuple[str, ...]
    free: tuple[str, ...]
    floating: tuple[str, ...]
    still: bool

    @property
    def mobility(self) -> int:
        """Degrees of freedom of the rigid mechanism, not counting drives."""
        return 3 * self.bodies - sum(self.constraints.values())

    @property
    def left(self) -> int:
        """Degrees of freedom without drives, free joints or free bodies; negative for redundant constraints."""
        return self.mobility - len(self.prescribed) - len(self.free) - 3 * len(self.floating)

    @property
    def verdict(self) -> str:
        """Meaning of ``left`` as text."""
        if self.still:
            return "a fixed structure: its bodies have given poses, and only deform"
        if self.left > 0:
            return f"{self.left} too many: add a drive or a joint, or make a joint free"
        if self.left < 0:
            return f"{-self.left} redundant constraints: leave a drive or a joint out"
        return "forces drive the free joints" if self.free or self.floating else "the drives determine the motion"


def count_freedom(mechanism: Mechanism) -> Freedom:
    """Count the degrees of freedom of a rigid mechanism."""
    return Freedom(
        len(mechanism.bodies),
        {name: len(joint.rows) for name, joint in mechanism.joints.items()},
        tuple(name for name, drive in mechanism.drives.items() if not drive.free),
        mechanism.free_joints,
        mechanism.floating,
        mechanism.frame,
    )


def mobility_by_rank(mechanism: NumericMechanism, courses: Courses) -> int:
    """Degrees of freedom by rank, not counting drives: 3 bodies minus the largest rank of the constraints' Jacobian at
    some instants of a motion."""
    bodies = [*mechanism.bodies]
    if not mechanism.joints:
        return 3 * len(bodies)
    count = courses[bodies[0]].shape[1]
    instants = sorted({round(share * (count - 1)) for share in (0.0, 0.13, 0.29, 0.41, 0.58, 0.77)})
    poses = {name: course[:, instants] for name, course in courses.items()}
    jacobian = _scaled(Constraints(mechanism, {}).jacobian(poses), mechanism.size)
    ranks = np.linalg.matrix_rank(jacobian, tol=_HELD * np.linalg.norm(jacobian, 2, axis=(1, 2)))
    return 3 * len(bodies) - int(ranks.max())


_HELD = 1e-7
"""Smallest singular value of independent rows at the given position, as a share of the largest."""
_IN_WORDS = {
    "force_x": "across x", "force_y": "across y", "moment": "in rotation", "normal": "across its guide",
    "drive": "by its drive",
}  # fmt: skip

def _in_words(mechanism: Mechanism, spare: Sequence[str], loose: Sequence[str]) -> tuple[str, str]:
    """Reason and advice from redundant rows "<joint>.<row>" and bodies with undetermined motion."""
    reasons, cures = [], []
    if spare:
        rows: dict[str, list[str]] = {}
        for name in spare:
            joint, _, row = name.rpartition(".")
            rows.setdefault(joint, []).append(_IN_WORDS.get(row, row))
        held = ", ".join(f"{joint} {' and '.join(words)}" for joint, words in rows.items())
        many = "a constraint" if len(spare) == 1 else f"{len(spare)} constraints"
        reasons.append(f"{many} too many (redundant with other joints and drives): {held}")
        cures.append("leave a joint or a drive out, or give every body a pose for a fixed structure")
    if loose:
        reasons.append(f"nothing determines the motion of {', '.join(loose)}")
        cures.append("join or drive them; a drive may be free, and under preset coupled also a body")
    count = count_freedom(mechanism)
    taken = ", ".join(f"{name} {number}" for name, number in count.constraints.items())
    driven = f", drives {len(mechanism.drives)}" if mechanism.drives else ""
    cure = "; ".join(cures)
    reasons.append(f"bodies have {3 * count.bodies} degrees of freedom, constraints are {taken}{driven}")
    return "; ".join(reasons), cure[:1].upper() + cure[1:]


def check_determined(mechanism: NumericMechanism, twice: bool = False) -> tuple[str, ...]:
    """Check the mechanism's topology for redundant constraints and undetermined motions, before anything is derived.

    ``twice``: redundant constraints are permitted. Returns the redundant rows "<joint>.<row>".

    The constraints' Jacobian at random positions, with only guides and welds keeping their angles, has at least the
    rank of closed positions: rows dependent here are dependent everywhere.

    Raises
    ------
    SceneError
        With the redundant joints or drives, and the undetermined bodies.
    """
    if mechanism.frame:
        return ()
    bodies = [*mechanism.bodies]
    constraints = Constraints(mechanism, dict.fromkeys(mechanism.drives, 0.0))
    names = [f"{name}.{row}" for name, joint in mechanism.joints.items() for row in joint.rows]
    held = len(names)
    names += [f"{drive}.drive" for drive in constraints.driven]
    jacobian = constraints.jacobian(_by_chance(mechanism))
    for body in mechanism.floating:
        own = 3 * bodies.index(body)
        names += [f"{body}.free"] * 3
        jacobian = np.vstack([jacobian.reshape(-1, 3 * len(bodies)), np.eye(3 * len(bodies))[own : own + 3]])
    if not names:
        return ()
    jacobian = _scaled(jacobian, mechanism.size)
    _, sizes, shapes = np.linalg.svd(jacobian)
    if len(names) == len(shapes) and sizes[-1] > _REGULAR * sizes[0]:
        return ()
    order = list(range(len(names)))
    if held < len(names) and len(_independent(jacobian[:held])) == jacobian.shape[1]:
        # The joints alone permit no motion: the last joints are redundant, not the drives.
        closing = {f"{name}.{row}" for name in mechanism.loop_joints for row in mechanism.joints[name].rows}
        order.sort(key=lambda k: names[k] in closing)
    kept = {order[k] for k in _independent(jacobian[order])}
    spare = [name for k, name in enumerate(names) if k not in kept]
    if held_free := [name for name in spare if name.endswith(".free")]:
        raise SceneError(
            f"bodies.{held_free[0]}", None, "joints and drives determine the body's motion, at least in part",
            "Leave free out; give coordinates and speeds of free joints at their drives",
        )  # fmt: skip
    # Motions in the null space are undetermined.
    free = shapes[int((sizes > _DEPENDENT * sizes[0]).sum()) :]
    loose = [body for k, body in enumerate(bodies) if abs(free[:, 3 * k : 3 * k + 3]).max(initial=0.0) > 1e-6]
    drives = [name.removesuffix(".drive") for name in spare if name.endswith(".drive")]
    if loose or (spare and not (twice and not drives)):
        reason, cure = _in_words(mechanism, spare, loose)
        if spare and not loose and not drives:
            cure += "; preset coupled accepts redundant constraints that are consistent"
        key = f"drives.{drives[-1]}" if drives and len(drives) == len(spare) else "joints"
        raise SceneError(key, None, reason, cure)
    return tuple(spare)


def check_free(mechanism: NumericMechanism) -> None:
    """Raise SceneError for a loop closed by Newton's method if its drive is free and there are other drives, before
    anything is derived. Preset coupled has no such loops."""
    free = mechanism.free_joints
    if not free or len(mechanism.drives) == 1 or mechanism.frame:
        return
    from kaneflex.mechanism.position_analysis import closing_groups

    group = next((group.bodies for group in closing_groups(mechanism) if group.is_larger), ())
    if group:
        raise SceneError(
            f"drives.{free[0]}", "free",
            f"a free drive must be the only drive, as {', '.join(group)} close a loop of more than two bodies",
            "Use preset coupled, prescribe all drives, or leave the others out",
        )  # fmt: skip


def check_held_twice(mechanism: NumericMechanism, placement: Placement, spare: Sequence[str]) -> None:
    """Raise SceneError unless redundant joints leave the mechanism as many degrees of freedom as it has drives.

    Raises
    ------
    SceneError
        With the rows ``spare``, if the joints lock the mechanism at its start.
    """
    free = mobility_by_rank(mechanism, {name: pose[:, None] for name, pose in placement.poses.items()})
    if free < len(mechanism.drives):
        reason, cure = _in_words(mechanism, spare, ())
        raise SceneError("joints", None, f"{reason}; at the start they permit no motion", cure)


_REGULAR = 1e-6
"""Smallest singular value of certainly independent rows, as a share of the largest."""
_DEPENDENT = 1e-9
"""Share of a row, or of the largest singular value, that counts as rounding."""


def _by_chance(mechanism: NumericMechanism) -> dict[str, np.ndarray]:
    """Reproducible random poses, with the angles that guides and welds prescribe between two bodies."""
    random = Random(0)  # numpy's takes longer to import than all of this
    spread = (mechanism.size, mechanism.size, math.pi)
    poses = {name: np.array([random.uniform(-w, w) for w in spread]) for name in mechanism.bodies}
    poses[GROUND] = np.zeros(3)
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
    """Normalised rows, with angles scaled by the mechanism's size: ranks do not depend on the unit of length."""
    jacobian[..., 2::3] /= size
    lengths = np.linalg.norm(jacobian, axis=-1, keepdims=True)
    return jacobian / np.where(lengths > 0.0, lengths, 1.0)


def _independent(rows: np.ndarray) -> list[int]:
    """Rows that are independent of earlier ones (Gram and Schmidt, twice for rounding)."""
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
        If the elastic stage can't be set up for the scene.
    """
    from kaneflex.fem.coordinate_map import Sites, find_interfaces
    from kaneflex.mechanism.floating_frames import shapes_given
    from kaneflex.mechanism.rigid_bodies import check_elastic
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
    interfaces = find_interfaces(scene, links, options.weld_pins, options.free_drives)
    sites = Sites(scene, links, {name: link.part for name, link in links.items()}, interfaces)
    return (*sites.names, *given)


def _mesh_of(scene: Scene, name: str, elements: int) -> Link:
    """Link with only nodes and coordinates, since matrices need the derived element."""
    from kaneflex.fem.links import Link, Part, node_coordinates
    from kaneflex.mechanism.floating_frames import mesh

    nodes = mesh(scene, name, elements)
    coordinates, place = node_coordinates(name, len(nodes), scene.bodies[name].beam.axially_rigid)
    return Link(name, nodes, {}, (), Part(name, coordinates, {}, place))
