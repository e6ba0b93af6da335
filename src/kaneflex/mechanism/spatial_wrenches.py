"""What joints, drives, loads and springs exert on a body in space, in its own axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import Side, SpatialMechanism


class Wrench(NamedTuple):
    """Place of a force in the body's axes [m], the force [N] and the moment about that place [N m], (3, n_times) each.

    ``by``: the joint, load or spring that exerts it; ``on``: the point of the body that the scene names for it, [m].
    """

    by: str
    on: tuple[float, ...]
    at: np.ndarray
    force: np.ndarray
    moment: np.ndarray


def wrenches_on(mechanism: SpatialMechanism, motion: RigidMotion, body: str) -> Iterator[Wrench]:
    """Everything but inertia and weight that acts on a body."""
    frame, none = motion.frame(body), np.zeros((3, len(motion.times)))

    def local(vector: np.ndarray) -> np.ndarray:
        return frame.to_body(vector)

    def point(side: Side) -> np.ndarray:
        return motion.frame(side.body).place(side.at)

    for name, joint in mechanism.joints.items():
        for side, sign in zip(joint.sides, (-1.0, 1.0), strict=True):
            if side.body == body:
                exerted = np.array([motion[f"{name}.{part}_{axis}"] for part in ("force", "moment") for axis in "xyz"])
                # what a joint exerts acts at its second point: that of the first may slide along it
                at = local(point(joint.sides[1]) - frame.origin)
                yield Wrench(name, side.at, at, sign * local(exerted[:3]), sign * local(exerted[3:]))
    for name, load in mechanism.loads.items():
        for pushed, share in load.pushes:
            if pushed.body == body:
                direction = np.broadcast_to(share * load.direction[:, None], none.shape)
                force = motion[name] * (direction if load.in_body else local(direction))
                yield Wrench(name, pushed.at, none + np.reshape(pushed.at, (3, 1)), force, none)
        if load.joint is not None:
            yield from _at_joint(mechanism, motion, body, name, load.joint, motion[name])
    for name, spring in mechanism.springs.items():
        if spring.joint is not None:
            yield from _at_joint(mechanism, motion, body, name, spring.joint, -motion[f"{name}.torque"])
            continue
        first, second = spring.sides
        for side, other in ((first, second), (second, first)):
            if side.body == body:
                along = point(other) - point(side)
                pull = spring.numbers[0] * along
                if spring.is_directed:
                    pull = motion[f"{name}.tension"] * along / np.linalg.norm(along, axis=0)
                yield Wrench(name, side.at, none + np.reshape(side.at, (3, 1)), local(pull), none)


def _at_joint(
    mechanism: SpatialMechanism, motion: RigidMotion, body: str, name: str, joint: str, torque: np.ndarray
) -> Iterator[Wrench]:
    """A torque about a joint's axis, on its second body."""
    of = mechanism.joints[joint]
    axis = motion.frame(of.sides[0].body).to_global(of.axes[0])
    for side, sign in zip(of.sides, (-1.0, 1.0), strict=True):
        if side.body == body:
            none = np.zeros((3, len(motion.times)))
            yield Wrench(name, side.at, none + np.reshape(side.at, (3, 1)), none,
                         sign * torque * motion.frame(body).to_body(axis))  # fmt: skip
