"""Newton's and Euler's equations of every body of a planar mechanism, from the scalars of its rigid motion."""

import numpy as np

from kaneflex.mechanism.closure_continuation import seed_loops
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.multibody.model.module_loading import bind_parameters, find_module
from kaneflex.scene import Scene
from kaneflex.scene.quantities import Address


def motion_of(scene: Scene) -> RigidMotion:
    """The rigid motion over two turns of the first drive in steps of 2 degrees."""
    module, _ = find_module(scene, lambda stage: None)
    speed = next(iter(scene.drives.values())).speed
    p = seed_loops(mechanism_of(scene), module, bind_parameters(scene, module), 4 * np.pi / abs(speed))
    return RigidKinematics(module, p).at(np.radians(np.arange(0, 720, 2)) / speed)


def turned(rigid: RigidMotion, body: str, vector) -> np.ndarray:
    """Global components of a body-fixed vector, (2, n_times)."""
    one = np.ones(len(rigid.times))
    c, s = (rigid[f"{body}.c"], rigid[f"{body}.s"]) if body != "ground" else (one, 0 * one)
    x, y = vector
    return np.array([c * x - s * y, s * x + c * y])


def place(scene: Scene, rigid: RigidMotion, address: Address) -> np.ndarray:
    """Global position of a point, (2, n_times)."""
    from_start = turned(rigid, address.body, scene.point(address))
    if address.body == "ground":
        return from_start
    return from_start + np.array([rigid[f"{address.body}.x"], rigid[f"{address.body}.y"]])


def joint_forces(scene: Scene, rigid: RigidMotion, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Global force and moment of a joint, its drive included, on the second of its bodies."""
    joint, none = scene.joints[name], np.zeros(len(rigid.times))
    if joint.kind == "prismatic":
        t = turned(rigid, joint.addresses[0].body, joint.direction)
        along = rigid[f"{name}.drive"] if name in scene.drives else none
        force = rigid[f"{name}.normal"] * np.array([-t[1], t[0]]) + along * t
        return force, rigid[f"{name}.moment"]
    moment = rigid[f"{name}.drive"] if name in scene.drives else none
    if joint.kind == "weld":
        moment = moment + rigid[f"{name}.moment"]
    return np.array([rigid[f"{name}.force_x"], rigid[f"{name}.force_y"]]), moment


def imbalance(scene: Scene, rigid: RigidMotion) -> float:
    """Largest residual of Newton's and Euler's equations of any body, relative to the largest force."""
    residual, largest = [], []
    length = max(body.length or 0.0 for body in scene.bodies.values())
    for name, body in scene.bodies.items():
        arm = turned(rigid, name, body.centre)
        w, e = rigid[f"{name}.omega"], rigid[f"{name}.epsilon"]
        start = np.array([rigid[f"{name}.a_x"], rigid[f"{name}.a_y"]])
        centre = start + e * np.array([-arm[1], arm[0]]) - w**2 * arm
        force, moment = -body.mass * (centre - np.array(scene.gravity)[:, None]), -body.inertia * e
        pushes = []
        for joint_name, joint in scene.joints.items():
            for address, sign in zip(joint.addresses, (-1.0, 1.0), strict=True):
                if address.body == name:
                    push, turn = joint_forces(scene, rigid, joint_name)
                    # What slides in a guide is pushed where it touches: at its own point, and so is the guide.
                    touches = joint.addresses[1] if joint.kind == "prismatic" else address
                    pushes.append((touches, sign * push, sign * turn))
        for mass in scene.masses.values():
            if mass.at.body == name:
                x, y = turned(rigid, name, scene.point(mass.at))
                at = start + e * np.array([-y, x]) - w**2 * np.array([x, y])
                pushes.append((mass.at, -mass.mass * (at - np.array(scene.gravity)[:, None]), -mass.inertia * e))
        for load_name, load in scene.loads.items():
            if load.force_on.body == name:
                direction = turned(rigid, "ground" if load.axes == "global" else name, load.direction)
                pushes.append((load.force_on, rigid[load_name] * direction, 0.0))
        for address, push, turn in pushes:
            at = place(scene, rigid, address) - place(scene, rigid, Address(name, "start")) - arm
            force = force + push
            moment = moment + turn + at[0] * push[1] - at[1] * push[0]
            largest.append(np.abs(push).max())
        residual += [np.abs(force).max(), np.abs(moment).max() / length]
    return max(residual) / max(largest)


def widest_gap(scene: Scene, rigid: RigidMotion) -> float:
    """Largest distance of the two points of any joint [m]; of a guide's, the part across it."""
    widest = 0.0
    for joint in scene.joints.values():
        first, second = joint.addresses
        apart = place(scene, rigid, second) - place(scene, rigid, first)
        if joint.kind == "prismatic":
            along = turned(rigid, first.body, joint.direction)
            apart = along[0] * apart[1] - along[1] * apart[0]
        widest = max(widest, float(np.abs(apart).max()))
    return widest
