"""Start of free joints next to joints with clearance, from the mechanism without clearance."""

from __future__ import annotations

import math

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.scene import Scene
from kaneflex.scene.drives import Drive
from kaneflex.scene.parts import Joint
from kaneflex.support.errors import SceneError

_TINY = 1e-30
"""Imaginary time step [s], without rounding."""
_STEP = 1e-4
"""Step of the fourth-order difference for the initial speed of a law or a table, as a share of the horizon."""
_FORWARD = (-25 / 12, 4.0, -3.0, 4 / 3, -0.25)
"""Weights of this difference (Fornberg 1988, Math. Comput. 51, 699, table 3)."""


def tight_start(scene: Scene) -> Scene:
    """Scene with pins and blocks in the middle of their clearance, at the speeds of the mechanism without clearance.

    It gives the start of free joints and of free bodies with clearances for which the scene gives neither position
    nor speed. If the others and the drives do not determine them, they start at zero.
    """
    given = {"angle", "position", "initial_speed"}
    open_ = [name for name in scene.free_joints if not given & scene.drives[name].model_fields_set]
    sides = {side.body for loose in scene.loose.values() for side in loose.sides}
    floating = {name: free for name, body in scene.bodies.items()
                if name in sides and (free := body.free) is not None and not free.model_fields_set}  # fmt: skip
    if scene.is_spatial or not scene.loose or not (open_ or floating):
        return scene
    import numpy as np

    from kaneflex.mechanism.joints import course
    from kaneflex.mechanism.position_analysis import drive_rates, place

    joints = dict(scene.joints)
    for name, loose in scene.loose.items():
        if loose.direction is None:
            joints[name] = Joint(revolute=loose.sides)
        else:
            joints[name] = Joint(prismatic=loose.sides, direction=loose.direction)
    drives = {name: drive for name, drive in scene.drives.items() if name not in open_}
    contacts = {name: contact for name, contact in scene.contacts.items() if contact.joint not in scene.loose}
    held = {name: scene.bodies[name].model_copy(update={"free": None}) for name in floating}
    tight = scene.seen(bodies=scene.bodies | held, joints=joints, drives=drives, contacts=contacts)
    mechanism = mechanism_of(tight)
    try:
        placement = place(mechanism)
    except SceneError:
        return scene
    rates = dict.fromkeys(scene.bodies, np.zeros(3))
    for drive, velocities in drive_rates(mechanism, placement).items():
        speed = _speed(drives[drive], scene.horizon)
        rates = {name: rate + speed * velocities[name] for name, rate in rates.items()}
    # a complex step gives the rate of a joint's coordinate exactly
    moving = {name: (pose + 1j * _TINY * rates[name])[:, None] for name, pose in placement.poses.items()}
    started = dict(scene.drives)
    for name in open_:
        joint = mechanism.joints[name]
        (value,) = course(joint, moving).tolist()
        start = value.real if joint.slides else math.remainder(value.real, math.tau)
        update = {joint.start_name: start, "initial_speed": value.imag / _TINY}
        started[name] = scene.drives[name].model_copy(update=update)
    for name, free in floating.items():
        (x, y, angle), (v_x, v_y, speed) = placement.poses[name].tolist(), rates[name].tolist()
        update = {"at": (x, y), "angle": angle, "velocity": (v_x, v_y), "angular_speed": speed}
        held[name] = held[name].model_copy(update={"free": free.model_copy(update=update)})
    return scene.seen(drives=started, bodies=scene.bodies | held)


def _speed(drive: Drive, horizon: float) -> float:
    """Initial speed of a drive [rad/s or m/s]."""
    if drive.free:
        return float(drive.initial_speed)
    if drive.speed is not None:
        return float(drive.speed) if drive.spin_up is None else 0.0
    step = _STEP * horizon
    return sum(weight * float(drive.coordinate(k * step)) for k, weight in enumerate(_FORWARD)) / step


def as_it_starts(scene: Scene) -> Scene:
    """Scene with branches instead of ``near``, and with :func:`tight_start`."""
    scene = tight_start(scene)
    if not any(joint.near for joint in scene.joints.values()):
        return scene
    from kaneflex.mechanism.position_analysis import with_branches

    return with_branches(scene)
