"""Forces of springs and dampers in the rigid motion."""

from __future__ import annotations

from collections.abc import Mapping

import sympy as sm

from kaneflex.derive.ir.program import Scalar, Steps
from kaneflex.mechanism import springs
from kaneflex.mechanism.parts import Mechanism
from kaneflex.mechanism.planar import GROUND, BodyPoint, Pose, Vector, carried_velocity, minus
from kaneflex.mechanism.springs import Spring

Values = Mapping[str, Mapping[str, sm.Expr]]
"""Body -> its rates v_x, v_y, omega."""


def spring_scalars(
    mechanism: Mechanism, drive_angle: Mapping[str, sm.Expr], poses: Mapping[str, Pose], values: Values, steps: Steps
) -> list[Scalar]:
    """Stretch and force of every spring, from the poses and velocities of the bodies.

    Where a body is elastic also the spring's direction, its turning, and tension by length: the elastic stage needs
    them.
    """
    found = []
    elastic = any(body.elastic for body in mechanism.bodies.values())
    for spring in mechanism.springs.values():
        if spring.joint is None:
            found += _between_points(spring, poses, values, elastic, steps)
        else:
            found += _at_joint(spring, drive_angle, poses, values, steps)
    return found


def _between_points(spring: Spring, poses, values: Values, elastic: bool, steps: Steps) -> list[Scalar]:
    """T = k (L - L0) + c L' along d, from the first point to the second: L = |d|, L' = d . d' / L.

    With L0 = 0 and c = 0 the force is k d, which needs no direction and is regular also where the points meet.
    """
    name = spring.name
    starts, rates_of = zip(*(_point(point, poses, values) for point in (spring.first, spring.second)), strict=True)
    d = [steps.assign(f"{name}_d_{axis}", b - a) for axis, a, b in zip("xy", *starts, strict=True)]
    length = steps.assign(f"{name}_now", sm.sqrt(d[0] ** 2 + d[1] ** 2))
    more = []
    tension = springs.tension(spring, length)
    if spring.is_directed:
        d_rate = minus(*rates_of[::-1])
        rate = springs.rate_of_length(d, d_rate, length)
        tension = steps.assign(f"{name}_pull", springs.tension(spring, length, rate))
        if elastic:
            more = _direction(name, d, d_rate, length, tension, steps)
    force = springs.force(spring, d, tension, length)
    force = [steps.assign(f"{name}_push_{axis}", f) for axis, f in zip("xy", force, strict=True)]
    on = f"force on {spring.second.body} by {spring.first.body}"
    return [
        Scalar(f"{name}.length", "m", "length of the spring", length),
        Scalar(f"{name}.tension", "N", "tension of spring and damper", tension),
        Scalar(f"{name}.force_x", "N", f"{on}, global x", force[0]),
        Scalar(f"{name}.force_y", "N", f"{on}, global y", force[1]),
        *more,
    ]


def _direction(name: str, d, d_rate, length: sm.Expr, tension: sm.Expr, steps: Steps) -> list[Scalar]:
    """Direction cosines, their turning omega = (d x d') / L^2, and T / L, by the names that a body's axes have."""
    c, s = (steps.assign(f"{name}_{key}", part / length) for key, part in zip("cs", d, strict=True))
    omega = steps.assign(f"{name}_omega", (c * d_rate[1] - s * d_rate[0]) / length)
    pull = steps.assign(f"{name}_per_length", tension / length)
    return [
        Scalar(f"{name}.c", "1", "direction of the spring, cosine", c),
        Scalar(f"{name}.s", "1", "direction of the spring, sine", s),
        Scalar(f"{name}.omega", "rad/s", "angular velocity of the spring", omega),
        Scalar(f"{name}.pull", "N/m", "tension by length", pull),
    ]


def _point(point: BodyPoint, poses: Mapping[str, Pose], values: Values) -> tuple[Vector, Vector]:
    """Global position and velocity of a body-fixed point: r_O + R r, v_O + omega S R r."""
    pose = poses[point.body]
    if point.body == GROUND:
        return pose.place(point.at), (sm.S.Zero, sm.S.Zero)
    value = values[point.body]
    x, y = carried_velocity(pose.turn(point.at), value["omega"])
    return pose.place(point.at), (value["v_x"] + x, value["v_y"] + y)


def _at_joint(spring: Spring, drive_angle, poses, values: Values, steps: Steps) -> list[Scalar]:
    """k (phi - phi_0) + c phi', phi the angle of the second body against the first.

    At a driven joint phi counts whole turns; elsewhere the poses give it, within half a turn of the free angle.
    """
    name, first, second = spring.name, spring.first.body, spring.second.body
    if spring.joint in drive_angle:
        angle = drive_angle[spring.joint]
    else:
        a, b = poses[first], poses[second]
        c, s = a.c * b.c + a.s * b.s, a.c * b.s - a.s * b.c
        c_0, s_0 = sm.cos(spring.free), sm.sin(spring.free)
        angle = steps.assign(f"{name}_now", spring.free + sm.atan2(s * c_0 - c * s_0, c * c_0 + s * s_0))
    omega = {body: sm.S.Zero if body == GROUND else values[body]["omega"] for body in (first, second)}
    torque = springs.tension(spring, angle, omega[second] - omega[first])
    torque = steps.assign(f"{name}_torque_now", torque)
    return [
        Scalar(f"{name}.angle", "rad", f"angle of {second} against {first} at the spring", angle),
        Scalar(f"{name}.torque", "N m", f"torque on {first} by the spring, its opposite on {second}", torque),
    ]
