"""Numbers of a scene by their dotted paths, which name the parameters of generated modules."""

from __future__ import annotations

from kaneflex.scene.bodies import Body
from kaneflex.scene.scene import Scene


def number_at(scene: Scene, path: str) -> float:
    """Number of the scene at a path TABLE.OWNER.NAME, or gravity.AXIS, in SI."""
    table, owner, name = (*path.split(".", 2), "")[:3]
    if table == "gravity":
        return scene.gravity["xy".index(owner)]
    if table == "ground":
        return scene.ground[owner]["xy".index(name)]
    if table == "bodies":
        return _of_body(scene.bodies[owner], name)
    entry = getattr(scene, table)[owner]
    if name.startswith("direction_"):
        return entry.direction["xy".index(name[-1])]
    if table == "contacts":
        return entry.number(name)
    if table == "drives" and name in ("angle", "position"):
        return entry.start
    if table == "joints" and name == "branch":
        return 1.0 if entry.branch == "+" else -1.0
    if table == "loads" and name.startswith("profile_"):
        return entry.profile[name == "profile_end"]
    return getattr(entry, name)


def _of_body(body: Body, name: str) -> float:
    field, _, inner = name.partition(".")
    if field == "points":
        point, _, axis = inner.partition(".")
        return body.points_all[point]["xy".index(axis)]
    if field == "element":
        return body.first_element[inner]
    if field.startswith("pose_"):
        assert body.pose is not None  # each body of a fixed frame has a pose
        return body.pose.angle if field == "pose_angle" else body.pose.at["xy".index(field[-1])]
    if field.startswith("centre_"):
        return body.centre["xy".index(field[-1])]
    return getattr(body, field)
