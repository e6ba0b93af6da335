"""Where the bodies of a scene stand, by numbers alone: what can be known of a mechanism before anything is derived.

Every joint and drive gives residuals in the bodies' global coordinates x, y, phi. Groups of bodies that the ground and
the bodies placed before determine (a driven body, a dyad, ...) are solved one after the other by Newton's method; of a
dyad's two solutions the branch of the joint that closes its loop chooses, as the generated equations do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from kaneflex.mechanism.joints import Poses, Rows, constraint_count, place_of, turned
from kaneflex.scene import Scene
from kaneflex.scene.laws import parse_law
from kaneflex.scene.parts import Joint
from kaneflex.support.errors import SceneError

_STARTS = 400
"""Places from which a group of bodies is closed before it counts as one that can't close."""
_IN_VAIN = 60
"""Places in a row that lead to no new assembly before all of them count as found."""
_ALIKE = 0.02
"""Angles [rad] that two assemblies must differ by for one of them to be the nearer one."""
_CLOSED = 1e-9
"""Largest gap of a closed joint, in sizes of the mechanism; angles in rad."""
_GROUND = np.zeros(3)


@dataclass(frozen=True, eq=False)
class Placement:
    """The rigid mechanism at one configuration; ``placement["rod.c"]`` reads as in a RigidMotion at one time.

    Attributes
    ----------
    poses : mapping of str to ndarray (3,)
        Each body's x, y of its start [m] and angle [rad].
    drives : mapping of str to float
        Coordinate of each drive [rad or m].
    """

    poses: Poses
    drives: Mapping[str, float]

    @property
    def times(self) -> np.ndarray:
        return np.zeros(1)

    def __getitem__(self, name: str) -> np.ndarray:
        body, _, kind = name.rpartition(".")
        x, y, phi = self.poses[body]
        return np.array([{"x": x, "y": y, "c": math.cos(phi), "s": math.sin(phi)}[kind]])


def place(scene: Scene, at: Mapping[str, float] | None = None) -> Placement:
    """Place the bodies with the drives as the run starts, or at the coordinates [rad or m] that ``at`` gives some.

    Raises
    ------
    SceneError
        If the linkage can't close there, or if the drives leave a body's place open.
    """
    if scene.is_frame:
        poses = {name: np.array([*body.pose.at, body.pose.angle]) for name, body in scene.bodies.items()}
        return Placement(poses, {})
    drives = {name: start_coordinate(scene, name) for name in scene.drives} | dict(at or {})
    rows = Rows(scene, drives)
    poses: dict[str, np.ndarray] = {"ground": _GROUND}
    while len(poses) <= len(scene.bodies):
        group = _next_group(scene, poses)
        poses |= _closed(rows, poses, group)
    del poses["ground"]
    return Placement(poses, drives)


def with_branches(scene: Scene) -> Scene:
    """The scene with the branch of every dyad whose closing joint says by `near` which of its two places is meant.

    Raises
    ------
    SceneError
        If the linkage can't close at the start, or both places are as near.
    """
    if scene.is_frame or not any(joint.near for joint in scene.joints.values()):
        return scene
    poses, placed, joints = None, {"ground": _GROUND}, dict(scene.joints)
    while len(placed) <= len(scene.bodies):
        group = _next_group(scene, placed)
        around = _joints_of(scene, placed, group)
        closing = next((name for name in around if name in scene.loop_joints()), None)
        if closing and scene.joints[closing].near and not _is_larger(scene, group, around):
            poses = poses or {"ground": _GROUND, **place(scene).poses}
            plus = scene.joints | {closing: scene.joints[closing].model_copy(update={"branch": "+"})}
            ahead = _on_branch(scene.model_copy(update={"joints": plus}), placed, poses, group, around)
            joints[closing] = scene.joints[closing].model_copy(update={"branch": "+" if ahead else "-"})
        placed |= dict.fromkeys(group, _GROUND) if poses is None else {name: poses[name] for name in group}
    return scene.model_copy(update={"joints": joints})


def larger_group(scene: Scene) -> tuple[str, ...]:
    """The first bodies that are neither driven or welded nor a dyad, whose loop has no closed form; or none."""
    placed = {"ground": _GROUND}
    while len(placed) <= len(scene.bodies):
        group = _next_group(scene, placed)
        if _is_larger(scene, group, _joints_of(scene, placed, group)):
            return group
        placed |= dict.fromkeys(group, _GROUND)
    return ()


def start_coordinate(scene: Scene, name: str) -> float:
    """Coordinate of a drive at t = 0 [rad or m]."""
    return coordinate_at(scene, name, 0.0)


def coordinate_at(scene: Scene, name: str, t: float) -> float:
    """Coordinate of a drive at the time t [rad or m]; a free joint's where it starts."""
    drive = scene.drives[name]
    if drive.kind == "law":
        return float(parse_law(drive.law, ("t",)).on_arrays({"t": t}))
    if drive.kind == "table":
        from kaneflex.scene.tables import evaluate_block

        return float(evaluate_block(drive.read_table().coefficients(drive.period), t))
    if drive.kind == "spin up":  # speed (t / T - sin(2 pi t / T) / 2 pi) until T, integrated
        T = drive.spin_up
        inside = min(t, T)
        course = inside**2 / (2 * T) + T / (2 * math.pi) ** 2 * (math.cos(2 * math.pi * inside / T) - 1.0)
        return drive.start + drive.speed * (course + max(t - T, 0.0))
    return drive.start + (0.0 if drive.free else drive.speed * t)


def drive_rates(scene: Scene, placement: Placement) -> dict[str, dict[str, np.ndarray]]:
    """Velocity (x, y of its start; angle) of every body for unit speed of each drive: drive -> body -> ndarray (3,).

    The same factors take the drives' accelerations to those of the bodies, beside what depends on the speeds.
    """
    rows, names = Rows(scene, placement.drives), list(scene.bodies)
    joints = [*scene.joints]
    jacobian = rows.jacobian({"ground": _GROUND, **placement.poses}, names, joints)
    rates = {}
    for drive, row in zip(rows.driven(joints), range(len(jacobian) - len(scene.drives), len(jacobian)), strict=True):
        unit = np.zeros(len(jacobian))
        unit[row] = 1.0
        velocity = np.linalg.lstsq(jacobian, unit, rcond=None)[0]
        rates[drive] = {name: velocity[3 * k : 3 * k + 3] for k, name in enumerate(names)}
    return rates


def _next_group(scene: Scene, poses: Poses) -> tuple[str, ...]:
    """The fewest bodies that their joints and drives determine, given the bodies that are placed."""
    waiting = [name for name in scene.bodies if name not in poses]
    for size in range(1, len(waiting) + 1):
        for group in combinations(waiting, size):
            joints = _joints_of(scene, poses, group)
            equations = sum(constraint_count(scene.joints[name]) + (name in scene.drives) for name in joints)
            if equations >= 3 * size:
                return group
    raise SceneError(
        "drives", ", ".join(scene.drives) or None, f"they leave the place of {', '.join(waiting)} open",
        "Drive or join these bodies: each needs three constraints, drives counted",
    )  # fmt: skip


def _joints_of(scene: Scene, poses: Poses, group: Sequence[str]) -> list[str]:
    """Joints between bodies of a group, or between the group and placed bodies."""
    known = {*poses, *group}
    return [
        name
        for name, joint in scene.joints.items()
        if {side.body for side in joint.addresses} <= known and {side.body for side in joint.addresses} & set(group)
    ]


def _closed(rows: Rows, poses: Poses, group: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Poses of a group: Newton's method from many starts, until one ends on the branch that the scene names."""
    from scipy.optimize import least_squares

    scene, joints = rows.scene, _joints_of(rows.scene, poses, group)
    closing = ([name for name in joints if name in scene.loop_joints()] or joints)[-1]
    many = _is_larger(scene, group, joints) or bool(scene.joints[closing].near)
    assemblies: list[dict[str, np.ndarray]] = []
    in_vain = 0

    def with_group(unknowns: np.ndarray) -> dict[str, np.ndarray]:
        return {**poses, **{name: unknowns[3 * k : 3 * k + 3] for k, name in enumerate(group)}}

    random = np.random.default_rng(0)
    size = rows.size
    for _ in range(_STARTS):
        start = random.uniform([-size, -size, -math.pi], [size, size, math.pi], (len(group), 3)).ravel()
        found = least_squares(
            lambda unknowns: rows.residuals(with_group(unknowns), joints), start, xtol=1e-15, ftol=1e-15, gtol=1e-15,
            jac=lambda unknowns: rows.jacobian(with_group(unknowns), group, joints), method="lm",
            x_scale=np.tile([size, size, 1.0], len(group)), max_nfev=60,
        )  # fmt: skip
        if np.abs(found.fun).max() > _CLOSED * max(size, 1.0):
            continue
        closed = with_group(found.x)
        if not many and _on_branch(scene, poses, closed, group, joints):
            return {name: closed[name] for name in group}
        if many and not any(_same(closed, other, group, size) for other in assemblies):
            assemblies.append(closed)
            in_vain = 0
        in_vain += 1
        if in_vain > _IN_VAIN:
            break
    if assemblies:
        chosen = _nearest(scene, closing, assemblies, group)
        return {name: chosen[name] for name in group}
    at = ", ".join(f"{name} = {scene.written_coordinate(name, value)}" for name, value in rows.drives.items())
    raise SceneError(
        f"joints.{closing}", scene.joints[closing].branch, f"the linkage can't close at {at}: {', '.join(group)}",
        "Change the lengths, or show another configuration",
    )  # fmt: skip


def _is_larger(scene: Scene, group: tuple[str, ...], joints: Sequence[str]) -> bool:
    """Whether a group is neither a driven or welded body nor a dyad, and may close in more than two ways."""
    return len(group) > 2 or (len(group) == 2 and len(joints) != 3)


def _same(one: Poses, other: Poses, group: tuple[str, ...], size: float) -> bool:
    """Whether two assemblies are one, whole turns left out."""
    change = np.array([one[name] - other[name] for name in group])
    change[:, 2] = np.remainder(change[:, 2] + math.pi, 2 * math.pi) - math.pi
    return bool((abs(change) < 1e-6 * np.array([size, size, 1.0])).all())


def _nearest(scene: Scene, closing: str, assemblies: list[dict[str, np.ndarray]], group: tuple[str, ...]) -> Poses:
    """The assembly whose bodies' angles are nearest to those that the closing joint names.

    Raises SceneError where it names none and there are several.
    """
    near = scene.joints[closing].near

    def off(poses: Poses) -> float:
        turns = np.array([poses[name][2] - angle for name, angle in near.items() if name in group])
        return float((abs(np.remainder(turns + math.pi, 2 * math.pi) - math.pi)).max(initial=0.0))

    strange = [name for name in near if name not in group]
    if strange:
        raise SceneError(
            f"joints.{closing}.near.{strange[0]}", None, f"the loop that {closing} closes moves {', '.join(group)}",
            "Name one of these",
        )  # fmt: skip
    ranked = sorted(assemblies, key=off)
    if len(ranked) > 1 and off(ranked[1]) - off(ranked[0]) < _ALIKE:
        ways = "; ".join(
            ", ".join(f"{name} {math.degrees(math.remainder(poses[name][2], 2 * math.pi)):.1f} deg" for name in group)
            for poses in assemblies
        )
        raise SceneError(
            f"joints.{closing}.near", {name: f"{math.degrees(angle):g} deg" for name, angle in near.items()} or None,
            f"the loop closes in {len(ranked)} ways at the start: {ways}",
            f"Say which, like near = {{{group[0]} = "
            f"'{math.degrees(math.remainder(assemblies[0][group[0]][2], 2 * math.pi)):.0f} deg'}}",
        )  # fmt: skip
    return ranked[0]


def _on_branch(scene: Scene, placed: Poses, poses: Poses, group: tuple[str, ...], joints: Sequence[str]) -> bool:
    """Whether a dyad stands on the branch of the joint that closes its loop; true of all that is no dyad."""
    closing = next((name for name in joints if name in scene.loop_joints()), None)
    middle = [scene.joints[name] for name in joints if {a.body for a in scene.joints[name].addresses} == set(group)]
    outer = [joint for name in joints if (joint := scene.joints[name]) not in middle]
    if len(group) != 2 or len(middle) != 1 or len(outer) != 2 or closing is None:
        return True
    side = _side_of_dyad(scene, placed, poses, middle[0], outer)
    return side is None or side * (1.0 if scene.joints[closing].branch == "+" else -1.0) >= 0.0


def _side_of_dyad(scene: Scene, placed: Poses, poses: Poses, middle: Joint, outer: list[Joint]) -> float | None:
    """A number whose sign is the branch of a dyad (see the functions of kaneflex.derive.closure); None for others.

    Slider: the rod's span along the guide. Three revolutes: the middle joint to the left of the line between the
    pivots. Lever: the slider ahead of the lever's pivot.
    """
    outer = sorted(outer, key=lambda joint: middle.addresses[0].body not in {side.body for side in joint.addresses})
    kinds = (outer[0].kind, middle.kind, outer[1].kind)
    pivots = [next(side for side in joint.addresses if side.body in placed) for joint in outer]
    start, end = (place_of(scene, poses, pivot) for pivot in pivots)
    head = place_of(scene, poses, middle.addresses[0])
    if kinds == ("revolute", "revolute", "revolute"):
        d, v = end - start, head - start
        return float(d[0] * v[1] - d[1] * v[0])
    if kinds == ("revolute", "prismatic", "revolute"):
        return float(turned(middle.direction, poses[middle.addresses[0].body][2]) @ (end - start))
    if sorted(kinds[::2]) == ["prismatic", "revolute"] and middle.kind == "revolute":
        guide = next(joint for joint in outer if joint.kind == "prismatic")
        foot = start if outer[0].kind == "revolute" else end
        t = turned(guide.direction, poses[guide.addresses[0].body][2])
        return float(t @ (head - foot))
    return None
