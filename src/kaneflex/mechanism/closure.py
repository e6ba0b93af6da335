"""Whether loops close, and what to say of one that doesn't."""

from __future__ import annotations

import numpy as np

from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.support.errors import SceneError

_OPEN = 1e-9
"""Share of the mechanism's size by which a loop may be open."""
SWEEP = 720
"""Samples of a cycle at which the linkage must close before anything is computed."""
_LOCKED, _NEAR, _TOUCHED = 1e-3, 1e-2, 1e-7
"""Margins of a loop, squares of the sine of its transmission angle: below which one that can't go on is said to lock,
below which its least value is looked for, and below which it has reached its limit."""
_SINGULAR = 1e-14
"""The same below which it is rounding, a hundred times that of a square of a length."""


def check_closure(mechanism: Mechanism, motion: RigidKinematics, horizon: float) -> None:
    """Sweep the drives' range up to ``horizon`` [s]: every loop must close with a margin.

    The error names loop, place and value.
    """
    check_loops(mechanism, motion.at(np.linspace(0.0, horizon, SWEEP + 1)))


def check_loops(mechanism: Mechanism, rigid: RigidMotion) -> None:
    """Every loop must close at all instants of a rigid motion; what Newton's method leaves open must be rounding."""
    for name in (name for name in rigid.motion.column if name.endswith(".gap")):
        size = max(abs(rigid[f"{body}.{axis}"]).max() for body in mechanism.bodies for axis in "xy")
        worst = int(np.argmax(np.nan_to_num(rigid[name], nan=np.inf)))
        if not rigid[name][worst] <= _OPEN * size:
            raise SceneError(
                f"joints.{name.removesuffix('.gap')}", None,
                f"the loop that it closes is left open by {rigid[name][worst]:.2g} m at "
                f"{stand(mechanism, rigid, worst)}, about to lock",
                "Change the lengths, or limit the drive's range",
            )  # fmt: skip
    for name in _margins(rigid):
        closes = rigid[name] > 0.0
        if (rigid[name] > _SINGULAR).all():
            continue
        joint = mechanism.joints[name.removesuffix(".closure")]
        if closes.all():
            at = stand(mechanism, rigid, int(np.argmin(rigid[name])))
            raise SceneError(
                f"joints.{joint.name}", joint.written_branch,
                f"a singular position: at {at} {' and '.join(joint.bodies)} lie on one line, joint forces have no "
                "finite value and two branches meet",
                f"Change the lengths, or {_elsewhere(mechanism)}",
            )  # fmt: skip
        raise SceneError(
            f"joints.{joint.name}", joint.written_branch,
            f"the loop can't close: at {stand(mechanism, rigid, int(np.argmin(closes)))} {apart(joint)}",
            f"Change the lengths, or {_elsewhere(mechanism)}",
        )  # fmt: skip


def check_start(mechanism: Mechanism, rigid: RigidMotion, acceleration: np.ndarray, inertia: np.ndarray) -> None:
    """The first instant of forward dynamics: loops close, and every free joint has mass to move and finite forces.

    ``rigid`` is the motion there, ``acceleration`` (n,) and ``inertia`` (n, n) those of the free joints' equations.
    """
    check_loops(mechanism, rigid)
    if np.isfinite(acceleration).all():
        return
    free = rigid.motion.module.FREE
    if np.isfinite(inertia).all():
        still = np.flatnonzero(np.diag(inertia) == 0.0)
        joint = free[still[0] if len(still) else int(np.argmax(abs(np.linalg.svd(inertia)[2][-1])))]
        raise SceneError(
            f"drives.{joint}", "free", f"nothing that it moves has mass or inertia, at {stand(mechanism, rigid)}",
            "Give the bodies that move with it a mass or an inertia, or prescribe it",
        )  # fmt: skip
    raise SceneError(
        f"drives.{free[0]}", "free", f"the forces are not finite at {stand(mechanism, rigid)}, where it starts",
        "Change loads or start",
    )  # fmt: skip


def check_passage(mechanism: Mechanism, motion: RigidKinematics, times: np.ndarray) -> None:
    """A linkage that free joints have brought to its limit stays there, or comes back on the branch that it left.

    ``times`` [s] are those that the motion was integrated at; between them every loop's least margin is looked for.
    """
    rigid = motion.at(times)
    for name in _margins(rigid):
        margin, first = rigid[name], None
        lowest = np.r_[True, margin[1:] <= margin[:-1]] & np.r_[margin[:-1] <= margin[1:], True] & (margin < _NEAR)
        for k in np.flatnonzero(lowest):
            fine = motion.at(np.linspace(times[max(k - 1, 0)], times[min(k + 1, len(times) - 1)], 1001))
            if not fine[name].min() > _TOUCHED:
                first = fine, int(np.argmin(fine[name]))
                break
        if first is not None:
            raise swung(mechanism, name.removesuffix(".closure"), *first)


def swung(mechanism: Mechanism, joint: str, rigid: RigidMotion, index: int = 0) -> SceneError:
    """What to say of a linkage that swings into the limit of the loop that a joint closes."""
    return SceneError(
        f"joints.{joint}", None,
        f"the linkage swings into its limit: at t = {rigid.times[index]:.6g} s, {stand(mechanism, rigid, index)}, it "
        f"locks, as beyond that {apart(mechanism.joints[joint])}",
        "Shorten the duration, change lengths, loads or start, or take preset coupled, which goes on",
    )  # fmt: skip


def locking(rigid: RigidMotion) -> str | None:
    """The joint that closes the loop about to lock at a motion's only instant, if there is one."""
    margins = {name: float(rigid[name][0]) for name in _margins(rigid)}
    name = min(margins, key=lambda name: margins[name] if margins[name] > 0.0 else 0.0, default=None)
    return None if name is None or margins[name] > _LOCKED else name.removesuffix(".closure")


def apart(joint: Joint) -> str:
    """What a loop's closing joint can't hold together."""
    first, second = joint.bodies
    if joint.slides:
        return f"{second} does not reach its guide on {first}"
    return f"{first} and {second} do not meet"


def _margins(rigid: RigidMotion) -> list[str]:
    return [name for name in rigid.motion.column if name.endswith(".closure")]


def stand(mechanism: Mechanism, rigid: RigidMotion, index: int = 0) -> str:
    """Where the drives, the first three of many, stand at an instant, like "main = 90 deg"."""
    first = list(mechanism.drives)[:3]
    return ", ".join(f"{name} = {mechanism.joints[name].written(rigid[f'{name}.angle'][index])}" for name in first)


def _elsewhere(mechanism: Mechanism) -> str:
    free = [name for name, drive in mechanism.drives.items() if drive.free]
    return f"let {', '.join(free)} start elsewhere" if free else "limit the drive's range"
