"""Reject mechanisms whose articulated inertia vanishes along a joint's freedom."""

from __future__ import annotations

import numpy as np

from kaneflex.mechanism.parts import Joint
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.system import CoupledSystem
from kaneflex.support.errors import SceneError

_NOTHING = 1e-14
"""Share of the inertia of all bodies at a distance of the mechanism's size that counts as zero."""


def check_weighty(system: CoupledSystem, placement: Placement) -> None:
    """Check that the articulated inertia along the freedoms of the tree's joints is positive, without cuts.

    Bodies count as rigid here: articulated inertias (Featherstone 1983), each by the twist of its body's start.

    Raises
    ------
    SceneError
        Naming the body whose mass or moment of inertia is missing.
    """
    tables, layout = system.engine.tables, system.engine.layout
    owners = tables.sections[:, at.OWNER]
    inertias = [_inertia(tables.w[k : k + 4], placement.poses[body][2])
                for k, body in zip(tables.bodies[:, at.BLOCK], layout.bodies, strict=True)]  # fmt: skip
    least, size = _NOTHING * sum(each[0, 0] for each in inertias), system.mechanism.size or 1.0
    units = np.array([1.0, 1.0, size])
    for b in range(len(inertias) - 1, -1, -1):
        (hung, child), row, own = layout.inboard[b], tables.bodies[b], inertias[b]
        here, parent = placement.poses[layout.bodies[b]], owners[row[at.PARENT]]
        if hung is None:
            if np.linalg.eigvalsh(own / np.outer(units, units))[0] <= least:
                raise _missing(system, layout.bodies[b], own, None)
            continue
        joint = system.mechanism.joints[hung]
        if joint.kind != "weld" and row[at.COURSE_OF] < 0:
            axis = _axis(joint, child, placement, here)
            resists = own @ axis
            if axis @ resists <= least * (size if joint.kind == "revolute" else 1.0) ** 2:
                raise _missing(system, layout.bodies[b], own, joint)
            own = own - np.outer(resists, resists) / (axis @ resists)
        if parent >= 0:
            inertias[parent] = inertias[parent] + _seen(own, here - placement.poses[layout.bodies[parent]])


def _inertia(moments: np.ndarray, phi: float) -> np.ndarray:
    """Inertia of a twist (v_x, v_y of a body's start, omega) by its mass, first moments and second about its start."""
    turn = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])
    mass, (x, y), second = moments[0], turn @ moments[1:3], moments[3]
    return np.array([[mass, 0.0, -y], [0.0, mass, x], [-y, x, second]])


def _seen(inertia: np.ndarray, away: np.ndarray) -> np.ndarray:
    """Inertia by the twist of another point, from which the first one is ``away``."""
    moved = np.array([[1.0, 0.0, -away[1]], [0.0, 1.0, away[0]], [0.0, 0.0, 1.0]])
    return moved.T @ inertia @ moved


def _axis(joint: Joint, child: int, placement: Placement, here: np.ndarray) -> np.ndarray:
    """Twist of a body's start along the freedom of a pin or a guide."""
    if joint.kind == "revolute":
        side = joint.sides[child]
        x, y = placement.pose(side.body).place(side.at)
        return np.array([y - here[1], here[0] - x, 1.0])
    return np.array([*placement.pose(joint.first.body).turn(joint.direction), 0.0])


def _missing(system: CoupledSystem, body: str, inertia: np.ndarray, joint: Joint | None) -> SceneError:
    massless = inertia[0, 0] <= 0.0 or (joint is not None and joint.kind == "prismatic")
    what = "mass" if massless else "inertia"
    does = "moves" if massless else "turns"
    where = f"at {joint.name}" if joint is not None else "freely"
    return SceneError(
        f"bodies.{body}.{what}", 0,
        f"{body} {does} {where}: the mass matrix of preset coupled is singular, as neither it nor the bodies that it "
        f"carries have a {'mass' if massless else 'moment of inertia'} along that freedom",
        "Give it one, however small, or a length and a mass" if not massless else "Give it one, however small",
    )  # fmt: skip
