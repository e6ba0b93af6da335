"""Whole turns of the bodies of a planar mechanism: with how many they begin, and how many of them sensors leave out."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.mechanism.position_analysis import Placement
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.system import CoupledSystem
from kaneflex.scene import Scene


def unwrapped(scene: Scene, system: CoupledSystem, q: np.ndarray, rigid: RigidMotion) -> np.ndarray:
    """q with whole turns added to the bodies' angles, so that drives, welds and guides have the turn they prescribe.

    Joints that laws know besides begin within half a turn of zero.
    """
    drives = {name: float(rigid[f"{name}.angle"][0]) for name in scene.drives}
    angles = _counted(scene, {name: float(q[k + 2]) for name, k in system.start.items()}, drives)
    q = q.copy()
    for name, k in system.start.items():
        q[k + 2] = angles[name]
    return q


def left_out(scene: Scene, start: Placement) -> dict[str, float]:
    """Body -> whole turns [rad] with which it begins, where sensors begin within half a turn of zero."""
    angles = {name: math.atan2(math.sin(pose[2]), math.cos(pose[2])) for name, pose in start.poses.items()}
    counted = _counted(scene, angles, start.drives)
    return {name: float(whole_turns(counted[name] - angle)) for name, angle in angles.items()}


def _counted(scene: Scene, angles: Mapping[str, float], drives: Mapping[str, float]) -> dict[str, float]:
    """Angles of the bodies [rad] with the turns that the joints prescribe; ``drives`` are the drives' coordinates."""
    counted, angle = {"ground"}, {"ground": 0.0, **angles}
    turns = {name: joint.relative_angle for name, joint in scene.joints.items() if joint.kind != "revolute"}
    turns |= {name: drives[name] for name in scene.drives if scene.joints[name].kind == "revolute"}
    near = {name: 0.0 for name in scene.observed if scene.joints[name].kind == "revolute"}
    near |= {s.torsional_at: s.angle for s in scene.springs.values() if s.torsional_at is not None}
    near |= {name: joint.clearance.middle for name, joint in scene.joints.items() if joint.clearance is not None}
    turns |= {name: angle for name, angle in near.items() if name not in turns}  # what is prescribed comes first
    while len(counted) < len(angle):
        leading = [(name, side) for name in turns for side in (0, 1) if _leads(scene, name, side, counted)]
        if not leading:  # no joint prescribes the turn of what is left against what is counted
            counted.add(next(name for name in angle if name not in counted))
            continue
        name, side = leading[0]
        base, other = (scene.joints[name].addresses[k].body for k in (side, 1 - side))
        wanted = angle[base] + (turns[name] if side == 0 else -turns[name])
        angle[other] += float(whole_turns(wanted - angle[other]))
        counted.add(other)
    return angle


def _leads(scene: Scene, joint: str, side: int, counted: set[str]) -> bool:
    """Whether a joint leads from a body that is counted, on this side of it, to one that is not."""
    base, other = (scene.joints[joint].addresses[k].body for k in (side, 1 - side))
    return base in counted and other not in counted
