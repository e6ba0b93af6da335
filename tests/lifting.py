"""A planar scene in space, turned by any rotation, as the text of a scene: the same mechanism, seen otherwise."""

import numpy as np

from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import GROUND
from kaneflex.mechanism.position_analysis import place, with_branches
from kaneflex.multibody.model.topology import spanning_tree
from kaneflex.scene import scene_of
from kaneflex.scene.poses import about

TURN = about(np.array([2.0, -1.0, 2.0]) / 3.0, 1.1)
VECTORS = ("displacement", "velocity", "acceleration", "position", "joint_force")
"""Kinds of sensors with components."""


def lifted(scene, turn=TURN, zero_at_start=False):
    """Description of the scene with axes, gravity, loads and fixed points turned by ``turn``.

    Links get sections that also bend across the plane and twist. Sensors are those in body axes and of the coordinates
    of driven joints; :func:`global_components` adds those in global axes. ``zero_at_start``: all coordinates of joints
    are zero there, for scenes whose drives have no start of their own.
    """
    scene = with_branches(scene)
    poses = place(mechanism_of(scene)).poses
    angles = {name: pose[2] for name, pose in poses.items()}
    first = _turned(scene, turn, angles)
    if zero_at_start:
        return first
    return _turned(scene, turn, _at_zero(scene, scene_of(first | {"sensors": {}, "solve": {"duration": 1.0}}), angles))


def _at_zero(scene, deep, angles):
    """Angle of each body where the coordinates of driven joints are zero.

    Such a coordinate is the angle between the x axes of the two bodies, so these are parallel there. Other joints start
    as the scene places them.
    """
    mechanism, found = mechanism_of(deep), {GROUND: 0.0}
    for outer, name, side in spanning_tree(mechanism, rubs=False):
        if name is None:
            found[outer] = angles[outer]
            continue
        inner = mechanism.joints[name].sides[1 - side].body
        driven = name in scene.drives and scene.joints[name].kind == "revolute"
        found[outer] = found[inner]
        if not driven and outer in scene.bodies:  # a lumped mass stands as its body
            found[outer] += angles[outer] - angles.get(inner, 0.0)
    return found


def _turned(scene, turn, angles):
    """Description of the scene in space, its bodies at these angles in their plane."""
    raw = scene.raw

    def vector(v):
        return [*map(float, v), 0.0]

    def turned(v):
        return [float(x) for x in turn @ vector(v)]

    bodies = {}
    for name, body in scene.bodies.items():
        axes = turn @ about(np.array([0.0, 0.0, 1.0]), angles[name])
        entry = {
            "points": {p: vector(at) for p, at in body.points.items()},
            "rotation": {"x": axes[:, 0].tolist(), "y": axes[:, 1].tolist()},
        }  # fmt: skip
        if body.elastic:
            entry["beam"] = _beam(body.beam)
            if not body.beam.has_area:
                entry["mass"] = body.mass
        else:
            about_y = body.inertia if body.free is not None else 0.0  # else joints carry it
            entry |= {"centre": vector(body.centre), "inertia": [body.inertia, about_y, body.inertia]}
            if body.mass:
                entry["mass"] = body.mass
        if body.free is not None:
            speed = [float(x) for x in body.free.angular_speed * turn[:, 2]]
            entry["free"] = {"at": turned(body.free.at), "velocity": turned(body.free.velocity),
                             "angular_velocity": speed}  # fmt: skip
        elif body.pose is not None:
            entry["free"] = {"at": turned(body.pose.at)}
        bodies[name] = entry | ({} if body.length is None else {"length": body.length})
    joints = {}
    for name, joint in scene.joints.items():
        entry = {joint.kind: [str(side) for side in joint.addresses]}
        ground = joint.addresses[0].body == "ground"
        if joint.kind == "revolute":
            entry["axis"] = (turn[:, 2] if ground else np.array([0.0, 0.0, 1.0])).tolist()
        if joint.kind == "prismatic":
            entry["direction"] = turned(joint.direction) if ground else vector(joint.direction)
        if joint.rotation == "shared":
            entry["rotation"] = joint.rotation
        given = raw["joints"].get(name, {})
        entry |= {key: given[key] for key in ("clearance", "friction") if key in given}
        joints[name] = entry
    for name, loose in scene.loose.items():  # balls in place of pins
        joints[name] = {"spherical": [str(side) for side in loose.sides], "clearance": raw["joints"][name]["clearance"]}
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
    contacts = raw.get("contacts", {}).items()
    if contacts:
        found["contacts"] = {name: _contact(scene, name, entry, turned, vector) for name, entry in contacts}
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


def _contact(scene, name, entry, turned, vector):
    """Contact of a point and a plane in place of a line."""
    found, contact = {key: value for key, value in entry.items() if key != "point_on_line"}, scene.contacts[name]
    normal = (turned if contact.sides[0].body == "ground" else vector)(contact.direction)
    return found | {"point_on_plane": entry["point_on_line"], "normal": normal}


def _sensor(sensor, raw, name):
    """The sensor in space, None for one in global axes, whose components turn with the scene."""
    entry = dict(raw["sensors"][name])
    entry.pop("body", None)
    moving = sensor.kind in VECTORS
    of_joint = raw["sensors"][name].get("position") in raw.get("joints", ())
    if moving and sensor.axes == "global" and raw["sensors"][name].get("position") not in raw.get("drives", ()):
        return None
    if sensor.kind in ("shear_force", "bending_moment"):
        entry["component"] = {"shear_force": "y", "bending_moment": "z"}[sensor.kind]
    elif sensor.kind == "strain":
        entry["fibre"] = [sensor.fibre, 0.0]
    elif sensor.component == "angle" and moving and not of_joint:
        entry["component"] = "angle_z"
    return entry


def global_components(scene, found):
    """Sensors of the three components of every planar sensor in global axes, by the name of the planar one."""
    names = {}
    for name, sensor in scene.sensors.items():
        of_joint = scene.raw["sensors"][name].get("position") in scene.joints
        if sensor.kind not in VECTORS or name in found["sensors"] or of_joint:
            continue  # in space joints that no drive moves start at zero
        angular = sensor.component == "angle"
        if angular and sensor.kind == "position":
            continue  # in space a body has no angle
        names[name] = [f"{name}_in_{axis}" for axis in "xyz"]
        for each, axis in zip(names[name], "xyz", strict=True):
            entry = dict(scene.raw["sensors"][name])
            found["sensors"][each] = entry | {"component": f"angle_{axis}" if angular else axis, "axes": "global"}
    return names


def in_plane(values, component, turn):
    """A component of the planar sensor from the three global ones (3, n_times)."""
    return turn[:, {"x": 0, "y": 1, "angle": 2}[component]] @ values
