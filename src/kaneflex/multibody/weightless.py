"""Bodies that nothing gives an inertia, against which a recursion over the tree can't solve for their motion."""

from __future__ import annotations

import numpy as np

from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.multibody import tables as at
from kaneflex.multibody.system import CoupledSystem
from kaneflex.support.errors import SceneError

_NOTHING = 1e-14
"""Share of what all bodies' masses resist, below which nothing resists."""


def check_weighty(system: CoupledSystem, placement: Placement) -> None:
    """What the joint that a body of the tree hangs on lets it do must be resisted by masses, its cuts left out.

    Bodies count as rigid here: articulated inertias (Featherstone 1983), of twists as the ground's origin sees them.

    Raises
    ------
    SceneError
        Naming the body whose mass or moment of inertia is missing.
    """
    tables, layout = system.engine.tables, system.engine.layout
    owners = tables.sections[:, at.OWNER]
    inertias = [_inertia(tables.w[k : k + 4], placement.poses[body])
                for k, body in zip(tables.bodies[:, at.BLOCK], layout.bodies, strict=True)]  # fmt: skip
    least = _NOTHING * sum(each[0, 0] for each in inertias) * max(1.0, system.mechanism.size) ** 2
    for b in range(len(inertias) - 1, -1, -1):
        (hung, child), row, own = layout.inboard[b], tables.bodies[b], inertias[b]
        if hung is None:
            if np.linalg.eigvalsh(own)[0] <= least:
                raise _missing(system, layout.bodies[b], own, None)
            continue
        joint = system.mechanism.joints[hung]
        if joint.kind != "weld" and row[at.COURSE_OF] < 0:
            axis = _axis(joint, child, placement)
            resists = own @ axis
            if axis @ resists <= least:
                raise _missing(system, layout.bodies[b], own, joint)
            own = own - np.outer(resists, resists) / (axis @ resists)
        if owners[row[at.PARENT]] >= 0:
            inertias[owners[row[at.PARENT]]] = inertias[owners[row[at.PARENT]]] + own


def _inertia(moments: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Of a twist v_x, v_y of the origin and omega, by mass, its first moments and its second about the body's start."""
    mass, first, (x, y, phi) = moments[0], moments[1:3], pose
    turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
    first = turn @ first
    second = moments[3] + 2.0 * (x * first[0] + y * first[1]) + mass * (x * x + y * y)
    first = first + mass * np.array([x, y])
    return np.array([[mass, 0.0, -first[1]], [0.0, mass, first[0]], [-first[1], first[0], second]])


def _axis(joint: Joint, child: int, placement: Placement) -> np.ndarray:
    """Twist that a pin or a guide leaves to a body."""
    if joint.kind == "revolute":
        side = joint.sides[child]
        x, y = placement.pose(side.body).place(side.at)
        return np.array([y, -x, 1.0])
    return np.array([*placement.pose(joint.first.body).turn(joint.direction), 0.0])


def _missing(system: CoupledSystem, body: str, inertia: np.ndarray, joint: Joint | None) -> SceneError:
    massless = inertia[0, 0] <= 0.0 or (joint is not None and joint.kind == "prismatic")
    what = "mass" if massless else "inertia"
    does = "moves" if massless else "turns"
    where = f"at {joint.name}" if joint is not None else "freely"
    return SceneError(
        f"bodies.{body}.{what}", 0,
        f"{body} {does} {where}, and neither it nor what hangs on it has a"
        f"{' mass' if massless else ' moment of inertia'} that resists that, as preset coupled needs it",
        "Give it one, however small, or a length and a mass" if not massless else "Give it one, however small",
    )  # fmt: skip
