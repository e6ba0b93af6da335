"""The motion's scalars of one elastic link, in the link's own axes."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sm

from kaneflex.derive.equations.rigid import Rates, Solved, multiplier
from kaneflex.derive.ir.program import Scalar, Steps
from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import Vector
from kaneflex.support.contract import LINK_SCALARS


def link_scalars(mechanism: Mechanism, name: str, solved: Solved, steps: Steps) -> tuple[Scalar, ...]:
    """The scalars of M q'' + ... = sum s_k f_k, in the link's own axes.

    P(X) starts at P_0 = -(axial part of all forces that act on the link at its origin); its growth along the
    link follows from a_x - g_x and omega^2 and is in the element's geometric terms.
    """
    pose, value, gravity = solved.rates.poses[name], solved.rates.value[name], mechanism.gravity
    a, b = value["a_x"] - gravity[0], value["a_y"] - gravity[1]
    values = {
        "omega": value["omega"],
        "epsilon": value["epsilon"],
        "a_x": pose.c * a + pose.s * b,
        "a_y": -pose.s * a + pose.c * b,
        "P_0": -_axial_force(mechanism, name, "start", solved),
    }
    return frame_scalars(name, values, steps)


def frame_scalars(name: str, values: Mapping[str, sm.Expr], steps: Steps) -> tuple[Scalar, ...]:
    """LINK_SCALARS of a link, zero where no value is given."""
    return tuple(
        Scalar(f"{name}.link.{key}", unit, meaning, steps.assign(f"{name}_link_{key}", values.get(key, sm.S.Zero)))
        for key, unit, meaning in LINK_SCALARS
    )


def jump_scalars(mechanism: Mechanism, name: str, solved: Solved, steps: Steps) -> list[Scalar]:
    """Jumps of P(X) at points with forces between the link's ends: one scalar a point."""
    found = []
    for point in sorted(forced_points(mechanism, name) - {"start", "end"}):
        force = _axial_force(mechanism, name, point, solved)
        value = steps.assign(f"{name}_link_jump_{point}", -force)
        found.append(Scalar(f"{name}.link.jump_{point}", "N", f"growth of the axial force at {point}", value))
    return found


def forced_points(mechanism: Mechanism, body: str) -> set[str]:
    """Points of a body at which joints, loads, springs or lumped masses act."""
    points = [point for joint in mechanism.joints.values() for point in (joint.first, joint.second)]
    points += [load.point for load in mechanism.loads.values() if load.point is not None]
    points += [mass.point for mass in mechanism.masses.values()]
    points += [end for spring in mechanism.springs.values() for end in spring.ends]
    return {point.name for point in points if point.body == body}


def _axial_force(mechanism: Mechanism, name: str, point: str, solved: Solved) -> sm.Expr:
    """Axial part of the forces of joints, loads, springs and lumped masses on a link at one of its points."""
    rates, loads, reactions = solved.rates, solved.loads, solved.reactions
    pose, force = rates.poses[name], [sm.S.Zero, sm.S.Zero]

    def push(vector: Vector) -> None:
        force[0] += vector[0]
        force[1] += vector[1]

    for joint in mechanism.joints.values():
        for side, sign in zip(joint.sides, (-1, 1), strict=True):
            if (side.body, side.name) == (name, point):
                push(tuple(sign * component for component in _joint_force(joint, rates, reactions)))
    for load_name, load in mechanism.loads.items():
        if load.point is not None and (load.point.body, load.point.name) == (name, point):
            direction = load.direction if load.axes == "global" else pose.turn(load.direction)
            push(tuple(loads[load_name] * component for component in direction))
    forces = {scalar.name: scalar.value for scalar in solved.springs}
    for spring in mechanism.springs.values():
        for end, sign in zip(spring.ends, (-1, 1), strict=False):  # a torsional spring has no ends
            if (end.body, end.name) == (name, point):
                push(tuple(sign * forces[f"{spring.name}.force_{axis}"] for axis in "xy"))
    for mass in mechanism.masses.values():
        if (mass.point.body, mass.point.name) == (name, point):
            specific_force = rates.specific_force(name, mass.point, mechanism.gravity)
            push(tuple(-mass.mass * component for component in specific_force))
    return pose.c * force[0] + pose.s * force[1]


def _joint_force(joint: Joint, rates: Rates, reactions) -> tuple[sm.Expr, sm.Expr]:
    """Global force on the second body of a joint."""

    def reaction(row: str) -> sm.Expr:
        return reactions[multiplier(f"{joint.name}.{row}")]

    if not joint.slides:
        return reaction("force_x"), reaction("force_y")
    t = rates.poses[joint.first.body].turn(joint.direction)
    normal = reaction("normal")
    along = reactions.get(multiplier(f"{joint.name}.drive"), sm.S.Zero)
    return -t[1] * normal + t[0] * along, t[0] * normal + t[1] * along
