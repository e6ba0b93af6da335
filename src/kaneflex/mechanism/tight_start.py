"""Start of free joints next to joints with clearance, from the mechanism without clearance."""

from __future__ import annotations

import math

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.scene import Scene
from kaneflex.scene.drives import Drive
from kaneflex.scene.parts import Joint
from kaneflex.support.errors import SceneError

_STEP = 1e-4
"""Step of the fourth-order difference for the initial speed of a law or a table, as a share of the horizon."""
_FORWARD = (-25 / 12, 4.0, -3.0, 4 / 3, -0.25)
"""Weights of this difference (Fornberg 1988, Math. Comput. 51, 699, table 3)."""


def tight_start(scene: Scene) -> Scene:
    """Scene with pins and blocks in the middle of their clearance, at the speeds of the mechanism without clearance.

    It gives the start of free joints for which the scene gives neither position nor speed. If the others and the
    drives do not determine them, they start at zero.
    """
    free = [name for name, drive in scene.drives.items() if drive.free]
    told = {"angle", "position", "initial_speed"}
    open_ = [name for name in free if not told & scene.drives[name].model_fields_set]
    if not scene.loose or not open_:
        return scene
    from kaneflex.mechanism.position_analysis import drive_rates, place

    joints = dict(scene.joints)
    for name, loose in scene.loose.items():
        if loose.direction is None:
            joints[name] = Joint(revolute=loose.sides)
        else:
            joints[name] = Joint(prismatic=loose.sides, direction=loose.direction)
    drives = {name: drive for name, drive in scene.drives.items() if name not in open_}
    contacts = {name: contact for name, contact in scene.contacts.items() if contact.joint not in scene.loose}
    tight = scene.seen(joints=joints, drives=drives, contacts=contacts)
    mechanism = mechanism_of(tight)
    try:
        placement = place(tight)
    except SceneError:
        return scene
    poses = {name: placement.pose(name) for name in ("ground", *scene.bodies)}
    rates = {name: [0.0, 0.0, 0.0] for name in poses}
    for drive, each in drive_rates(mechanism, placement).items():
        speed = _speed(drives[drive], scene.horizon)
        for name, velocity in each.items():
            rates[name] = [own + speed * float(part) for own, part in zip(rates[name], velocity, strict=True)]
    started = dict(scene.drives)
    for name in open_:
        joint = scene.joints[name]
        (one, at_one), (two, at_two) = ((side.body, scene.point(side)) for side in joint.addresses)
        if joint.kind == "revolute":
            turn, speed = poses[two].phi - poses[one].phi, rates[two][2] - rates[one][2]
            update = {"angle": math.remainder(turn, math.tau), "initial_speed": speed}
        else:
            assert joint.direction is not None
            along = poses[one].turn(joint.direction)
            (x_1, y_1), (x_2, y_2) = poses[one].place(at_one), poses[two].place(at_two)
            v_1, v_2 = (_velocity(rates[body], poses[body].turn(at)) for body, at in ((one, at_one), (two, at_two)))
            gap, omega = (x_2 - x_1, y_2 - y_1), rates[one][2]
            faster = v_2[0] - v_1[0] + omega * gap[1], v_2[1] - v_1[1] - omega * gap[0]
            place_, speed = (along[0] * part[0] + along[1] * part[1] for part in (gap, faster))
            update = {"position": place_, "initial_speed": speed}
        started[name] = scene.drives[name].model_copy(update=update)
    return scene.seen(drives=started)


def _velocity(rates: list[float], arm: tuple[float, float]) -> tuple[float, float]:
    """Velocity of a point of a body at this global distance from its start [m/s]."""
    return rates[0] - rates[2] * arm[1], rates[1] + rates[2] * arm[0]


def _speed(drive: Drive, horizon: float) -> float:
    """Initial speed of a drive [rad/s or m/s]."""
    if drive.free:
        return float(drive.initial_speed)
    if drive.speed is not None:
        return float(drive.speed) if drive.spin_up is None else 0.0
    from kaneflex.mechanism.position_analysis import coordinate_at

    step = _STEP * horizon
    return sum(weight * coordinate_at(drive, k * step) for k, weight in enumerate(_FORWARD)) / step


def as_it_starts(scene: Scene) -> Scene:
    """Scene with branches instead of ``near``, and with :func:`tight_start`."""
    scene = tight_start(scene)
    if not any(joint.near for joint in scene.joints.values()):
        return scene
    from kaneflex.mechanism.position_analysis import with_branches

    return with_branches(scene)
