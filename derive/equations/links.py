"""The motion's scalars of one elastic link, in the link's own axes."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sm

from kaneflex.derive.elements.parameters import LINK_SCALARS
from kaneflex.derive.equations.rigid import Rates, Solved, multiplier
from kaneflex.derive.ir.program import Scalar, Steps
from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.planar import BodyPoint, Vector


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
        "P_0": -_axial_forces(mechanism, name, solved).get("start", sm.S.Zero),
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
    axial, found = _axial_forces(mechanism, name, solved), []
    for point in sorted(axial.keys() - {"start", "end"}):
        value = steps.assign(f"{name}_link_jump_{point}", -axial[point])
        found.append(Scalar(f"{name}.link.jump_{point}", "N", f"growth of the axial force at {point}", value))
    return found


def _axial_forces(mechanism: Mechanism, name: str, solved: Solved) -> dict[str, sm.Expr]:
    """Point of a link -> axial part of the forces of joints, loads, springs and lumped masses there."""
    rates, pose, forces = solved.rates, solved.rates.poses[name], list[tuple[BodyPoint, sm.Expr, Vector]]()
    for joint in mechanism.joints.values():
        force = _joint_force(joint, rates, solved.reactions)
        forces += [(side, sign, force) for side, sign in zip(joint.sides, (-1, 1), strict=True)]
    for load_name, load in mechanism.loads.items():
        if load.point is not None:
            direction = load.direction if load.axes == "global" else pose.turn(load.direction)
            forces.append((load.point, solved.loads[load_name], direction))
    pulls = {scalar.name: scalar.value for scalar in solved.springs}
    for spring in mechanism.springs.values():
        for end, sign in zip(spring.ends, (-1, 1), strict=False):  # a torsional spring has no ends
            forces.append((end, sign, tuple(pulls[f"{spring.name}.force_{axis}"] for axis in "xy")))
    for mass in mechanism.masses.values():
        if mass.point.body == name:
            forces.append((mass.point, -mass.mass, rates.specific_force(name, mass.point, mechanism.gravity)))
    sums: dict[str, Vector] = {}
    for point, factor, force in forces:
        if point.body == name:
            x, y = sums.get(point.name, (sm.S.Zero, sm.S.Zero))
            sums[point.name] = x + factor * force[0], y + factor * force[1]
    return {point: pose.c * x + pose.s * y for point, (x, y) in sums.items()}


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
