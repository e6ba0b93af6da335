"""Check that joints and drives determine the motion of a mechanism, before anything is derived."""

from __future__ import annotations

import math
from random import Random

import numpy as np

from kaneflex.mechanism.joints import Constraints, normalised
from kaneflex.mechanism.mechanism import NumericMechanism
from kaneflex.mechanism.planar import GROUND
from kaneflex.support.errors import SceneError


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
    jacobian = normalised(jacobian, mechanism.size)
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
        from kaneflex.fem.freedom import in_words

        reason, cure = in_words(mechanism, spare, loose)
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
