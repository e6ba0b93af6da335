"""Degrees of freedom of a scene: the rigid mechanism by Gruebler's formula and by rank, and elastic coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaneflex.mechanism.joints import Constraints, normalised
from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.scene import Scene
from kaneflex.support.errors import SceneError, counted

if TYPE_CHECKING:
    from kaneflex.mechanism.closure import Courses
    from kaneflex.mechanism.position_analysis import Placement

_HELD = 1e-7
"""Smallest singular value of independent rows at the given position, as a share of the largest."""


class Freedom(NamedTuple):
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
            return f"{counted(-self.left, 'redundant constraint')}: leave a drive or a joint out"
        return "forces drive the free joints" if self.free or self.floating else "the drives determine the motion"


def count_freedom(mechanism: NumericMechanism) -> Freedom:
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
    jacobian = normalised(Constraints(mechanism, {}).jacobian(poses), mechanism.size)
    ranks = np.linalg.matrix_rank(jacobian, tol=_HELD * np.linalg.norm(jacobian, 2, axis=(1, 2)))
    return 3 * len(bodies) - int(ranks.max())


_IN_WORDS = {
    "force_x": "across x", "force_y": "across y", "moment": "in rotation", "normal": "across its guide",
    "drive": "by its drive",
}  # fmt: skip


def in_words(mechanism: NumericMechanism, spare: Sequence[str], loose: Sequence[str]) -> tuple[str, str]:
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


def check_held_twice(mechanism: NumericMechanism, placement: Placement, spare: Sequence[str]) -> None:
    """Raise SceneError unless redundant joints leave the mechanism as many degrees of freedom as it has drives.

    Raises
    ------
    SceneError
        With the rows ``spare``, if the joints lock the mechanism at its start.
    """
    free = mobility_by_rank(mechanism, {name: pose[:, None] for name, pose in placement.poses.items()})
    if free < len(mechanism.drives):
        reason, cure = in_words(mechanism, spare, ())
        raise SceneError("joints", None, f"{reason}; at the start they permit no motion", cure)


def elastic_coordinates(scene: Scene) -> tuple[str, ...]:
    """Names of the coordinates of the elastic stage, before any reduction to modes.

    Raises
    ------
    SceneError
        If the elastic stage can't be set up for the scene.
    """
    from kaneflex.fem.coordinate_map import Sites, find_interfaces
    from kaneflex.fem.links import Link, build_link
    from kaneflex.mechanism.floating_frames import shapes_given
    from kaneflex.mechanism.numbers import mesh
    from kaneflex.mechanism.rigid_bodies import check_elastic
    from kaneflex.scene.options import resolve_options

    options, mechanism = resolve_options(scene), mechanism_of(scene)
    if options.dynamics == "rigid":
        return ()
    check_elastic(scene)
    given = shapes_given(mechanism.deforming) if options.dynamics == "coupled" else ()
    beams = {name: body.beam for name, body in mechanism.deforming.items() if body.elastic}
    # with only nodes and coordinates, since matrices need the derived element
    links = {name: build_link(mechanism, Link, name, mesh(mechanism, name, options.elements or beam.elements), {}, (),
                              axially_rigid=beam.axially_rigid) for name, beam in beams.items()}  # fmt: skip
    interfaces = find_interfaces(mechanism, links, options.weld_pins, options.free_drives)
    sites = Sites(mechanism, links, {name: link.part for name, link in links.items()}, interfaces)
    return (*sites.names, *given)
