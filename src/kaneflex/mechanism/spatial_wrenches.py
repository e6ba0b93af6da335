"""Forces and moments of joints, drives, loads and springs on a spatial body, in its own axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, cast

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.mechanism.spatial import Side, SpatialMechanism
from kaneflex.mechanism.spatial_frame import SpatialFrame

Carried = Callable[[Side], tuple[SpatialFrame, Side]]
"""Function from a point of a body to the axes that it rotates with, and its position in them."""


class Wrench(NamedTuple):
    """Point of a force in the body's axes [m], the force [N] and the moment about that point [N m], (3, n_times) each.

    ``by``: the joint, load or spring that exerts it; ``on``: its point of the body in the scene [m].
    """

    by: str
    on: tuple[float, ...]
    at: np.ndarray
    force: np.ndarray
    moment: np.ndarray


def wrenches_on(
    mechanism: SpatialMechanism, motion: RigidMotion, body: str, carried: Carried | None = None
) -> Iterator[Wrench]:
    """Wrenches on a body except inertia and weight; ``carried`` gives points of deformed bodies."""
    frame, none = motion.frame(body), np.zeros((3, len(motion.times)))
    carry: Carried = carried or (lambda side: (cast(SpatialFrame, motion.frame(side.body)), side))

    def local(vector: np.ndarray) -> np.ndarray:
        return frame.to_body(vector)

    def point(side: Side) -> np.ndarray:
        axes, there = carry(side)
        return axes.place(there.at)

    for name, joint in mechanism.joints.items():
        for side, sign in zip(joint.sides, (-1.0, 1.0), strict=True):
            if side.body == body:
                exerted = np.array([motion[f"{name}.{part}_{axis}"] for part in ("force", "moment") for axis in "xyz"])
                # a joint's force acts at its second point, since the first may slide along it
                at = local(point(joint.sides[1]) - frame.origin)
                yield Wrench(name, side.at, at, sign * local(exerted[:3]), sign * local(exerted[3:]))
    for name, load in mechanism.loads.items():
        for pushed, share in load.pushes:
            if pushed.body == body:
                direction = share * load.direction
                force = motion[name] * local(carry(pushed)[0].to_global(direction) if load.in_body else direction)
                yield Wrench(name, pushed.at, local(point(pushed) - frame.origin), force, none)
        if load.joint is not None:
            yield from _at_joint(mechanism, motion, body, name, load.joint, motion[name], carry)
    for name, spring in mechanism.springs.items():
        if spring.joint is not None:
            yield from _at_joint(mechanism, motion, body, name, spring.joint, -motion[f"{name}.torque"], carry)
            continue
        first, second = spring.sides
        if spring.is_bushing:
            axes = carry(first)[0]
            force, moment = (axes.to_global(np.array([motion[f"{name}.{part}_{axis}"] for axis in "xyz"]))
                             for part in ("force", "moment"))  # fmt: skip
            for side, sign in ((first, 1.0), (second, -1.0)):
                if side.body == body:  # at the second point, as for a joint
                    at = local(point(second) - frame.origin)
                    yield Wrench(name, side.at, at, sign * local(force), sign * local(moment))
            continue
        for side, other in ((first, second), (second, first)):
            if side.body == body:
                along = point(other) - point(side)
                pull = spring.numbers[0] * along
                if spring.is_directed:
                    pull = motion[f"{name}.tension"] * along / np.hypot(np.hypot(along[0], along[1]), along[2])
                yield Wrench(name, side.at, local(point(side) - frame.origin), local(pull), none)


def _at_joint(
    mechanism: SpatialMechanism, motion: RigidMotion, body: str, name: str, joint: str, torque: np.ndarray,
    carried: Carried,
) -> Iterator[Wrench]:  # fmt: skip
    """Torque about a joint's axis, on its second body."""
    of = mechanism.joints[joint]
    axis = carried(of.sides[0])[0].to_global(of.axes[0])
    for side, sign in zip(of.sides, (-1.0, 1.0), strict=True):
        if side.body == body:
            none = np.zeros((3, len(motion.times)))
            yield Wrench(name, side.at, none + np.reshape(side.at, (3, 1)), none,
                         sign * torque * motion.frame(body).to_body(axis))  # fmt: skip
