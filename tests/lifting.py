"""A planar scene in space, turned by any rotation, as the text of a scene: the same mechanism, seen otherwise."""

import numpy as np

from kaneflex.mechanism.position_analysis import place, with_branches
from kaneflex.scene.rotation import about

TURN = about(np.array([2.0, -1.0, 2.0]) / 3.0, 1.1)


def lifted(scene):
    """Axes, gravity, loads and fixed points turned by TURN; bodies as they stand at first, links with sections that
    bend across the plane and twist, too; sensors in body axes and of coordinates, nothing else."""
    scene = with_branches(scene)
    poses = place(scene).poses
    raw = scene.raw

    def vector(v):
        return [*map(float, v), 0.0]

    def turned(v):
        return [float(x) for x in TURN @ vector(v)]

    bodies = {}
    for name, body in scene.bodies.items():
        axes = TURN @ about(np.array([0.0, 0.0, 1.0]), poses[name][2])
        entry = {
            "points": {p: vector(at) for p, at in body.points.items()},
            "rotation": {"x": axes[:, 0].tolist(), "y": axes[:, 1].tolist()},
        }  # fmt: skip
        if body.elastic:
            entry["beam"] = _beam(body.beam)
            if not body.beam.has_area:
                entry["mass"] = body.mass
        else:
            entry |= {"centre": vector(body.centre), "inertia": [body.inertia, 0.0, body.inertia]}
            if body.mass:
                entry["mass"] = body.mass
        bodies[name] = entry | ({} if body.length is None else {"length": body.length})
    joints = {}
    for name, joint in scene.joints.items():
        entry = {joint.kind: [str(side) for side in joint.addresses]}
        ground = joint.addresses[0].body == "ground"
        if joint.kind == "revolute":
            entry["axis"] = (TURN[:, 2] if ground else np.array([0.0, 0.0, 1.0])).tolist()
        if joint.kind == "prismatic":
            entry["direction"] = turned(joint.direction) if ground else vector(joint.direction)
        joints[name] = entry
    loads = {}
    for name, load in scene.loads.items():
        loads[name] = dict(raw["loads"][name])
        if load.direction is not None:
            loads[name]["direction"] = turned(load.direction) if load.axes == "global" else vector(load.direction)
    found = {
        "schema": 1, "gravity": turned(scene.gravity), "ground": {p: turned(at) for p, at in scene.ground.items()},
        "bodies": bodies, "joints": joints, "loads": loads, "drives": dict(raw.get("drives", {})),
        "sensors": {name: entry for name, sensor in scene.sensors.items() if (entry := _sensor(sensor, raw, name))},
    }  # fmt: skip
    if scene.springs:
        found["springs"] = raw["springs"]
    if scene.masses:
        found["masses"] = {name: {"at": str(mass.at), "mass": mass.mass, "inertia": [mass.inertia, 0.0, mass.inertia]}
                           for name, mass in scene.masses.items()}  # fmt: skip
    if scene.damping is not None:
        found["damping"] = raw["damping"]
    return found


def _beam(beam):
    given = beam.model_dump(exclude_unset=True, exclude_none=True)
    given = {key: value for key, value in given.items() if key not in ("axially_rigid", "shapes", "I")}
    if beam.section is None:
        given |= {"I_z": beam.I, "I_y": 2.3 * beam.I, "J": 1.7 * beam.I}
    if not {"G", "nu", "material"} & set(given):
        given["nu"] = 0.3
    return given


def _sensor(sensor, raw, name):
    """The sensor in space, None for one in global axes, whose components turn with the scene."""
    entry = dict(raw["sensors"][name])
    entry.pop("body", None)
    moving = sensor.kind in ("displacement", "velocity", "acceleration", "position", "joint_force")
    of_joint = sensor.kind == "position" and "." not in str(sensor.target)
    if (moving and sensor.axes == "global") or of_joint:
        return None
    if sensor.kind in ("shear_force", "bending_moment"):
        entry["component"] = {"shear_force": "y", "bending_moment": "z"}[sensor.kind]
    elif sensor.kind == "strain":
        entry["fibre"] = [sensor.fibre, 0.0]
    elif sensor.component == "angle" and moving:
        entry["component"] = "angle_z"
    return entry
