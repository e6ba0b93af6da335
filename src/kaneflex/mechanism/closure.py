"""Checks that loops close, and their error messages."""

from __future__ import annotations

import numpy as np

from kaneflex.mechanism.parts import Joint, Mechanism
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.support.errors import SceneError

_OPEN = 1e-9
"""Largest gap of a closed loop, as a share of the mechanism's size."""
SWEEP = 720
"""Samples of a cycle at which the linkage must close before anything is computed."""
_LOCKED, _NEAR, _TOUCHED = 1e-3, 1e-2, 1e-7
"""Margins of a loop (squared sine of the transmission angle): below the first a loop that can't continue counts as
locked, below the second its minimum is searched, below the third it has reached its limit."""
_SINGULAR = 1e-14
"""Margin of rounding, a hundred times that of a squared length."""


def check_closure(mechanism: Mechanism, motion: RigidKinematics, horizon: float) -> None:
    """Raise SceneError unless every loop closes with a margin over the drives' range up to ``horizon`` [s].
    """
    check_loops(mechanism, motion.at(np.linspace(0.0, horizon, SWEEP + 1)))


def check_loops(mechanism: Mechanism, rigid: RigidMotion) -> None:
    """Raise SceneError unless every loop closes at all instants of a rigid motion, up to rounding."""
    for name in (name for name in rigid.motion.column if name.endswith(".gap")):
        size = max(abs(rigid[f"{body}.{axis}"]).max() for body in mechanism.bodies for axis in "xy")
        worst = int(np.argmax(np.nan_to_num(rigid[name], nan=np.inf)))
        if not rigid[name][worst] <= _OPEN * size:
            raise SceneError(
                f"joints.{name.removesuffix('.gap')}", None,
                f"the loop cannot close: a gap of {rigid[name][worst]:.2g} m remains at "
                f"{stand(mechanism, rigid, worst)}, near a dead centre",
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
                f"joints.{joint.name}.branch", joint.written_branch,
                f"singular position: at {at} {' and '.join(joint.bodies)} lie on one line, joint forces are "
                "infinite and two branches meet",
                f"Change the lengths, or {_elsewhere(mechanism)}",
            )  # fmt: skip
        raise SceneError(
            f"joints.{joint.name}.branch", joint.written_branch,
            f"the loop cannot close: at {stand(mechanism, rigid, int(np.argmin(closes)))} {apart(joint)}",
            f"Change the lengths, or {_elsewhere(mechanism)}",
        )  # fmt: skip


def check_start(mechanism: Mechanism, rigid: RigidMotion, acceleration: np.ndarray, inertia: np.ndarray) -> None:
    """Check the first instant of forward dynamics: closed loops, inertia at every free joint, and finite forces.

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
            f"drives.{joint}", "free", f"singular mass matrix at {stand(mechanism, rigid)}: the joint moves no inertia",
            "Give the bodies that move with it a mass or an inertia, or prescribe it",
        )  # fmt: skip
    raise SceneError(
        f"drives.{free[0]}", "free", f"the forces are not finite at the start, {stand(mechanism, rigid)}",
        "Change loads or start",
    )  # fmt: skip


def check_passage(mechanism: Mechanism, motion: RigidKinematics, times: np.ndarray) -> None:
    """Raise SceneError if free joints move the linkage into a limit position (dead centre).

    ``times`` [s] are those of the integration; between them every loop's smallest margin is searched.
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
    """Error for a linkage that moves into the limit position of the loop that a joint closes."""
    return SceneError(
        f"joints.{joint}", None,
        f"the linkage reaches a dead centre at t = {rigid.times[index]:.6g} s, {stand(mechanism, rigid, index)}: "
        f"beyond it {apart(mechanism.joints[joint])}",
        "Shorten the duration, change lengths, loads or start, or use preset coupled, which can continue",
    )  # fmt: skip


def changed_speed(entry: str, given: float, found: float) -> SceneError:
    """Error for a given initial speed that the loops change."""
    return SceneError(
        entry, given,
        f"the loops and other speeds make it {found:.9g}: a loop locks this joint, or is in a singular position",
        "Start near this position, or give as many initial speeds as the mechanism has degrees of freedom",
    )  # fmt: skip


def locking(rigid: RigidMotion) -> str | None:
    """Joint that closes the loop near its limit at a motion's only instant, if any."""
    margins = {name: float(rigid[name][0]) for name in _margins(rigid)}
    name = min(margins, key=lambda name: margins[name] if margins[name] > 0.0 else 0.0, default=None)
    return None if name is None or margins[name] > _LOCKED else name.removesuffix(".closure")


def apart(joint: Joint) -> str:
    """Reason why a loop's closing joint can't close it."""
    first, second = joint.bodies
    if joint.slides:
        return f"{second} does not reach its guide on {first}"
    return f"{first} and {second} do not meet"


def _margins(rigid: RigidMotion) -> list[str]:
    return [name for name in rigid.motion.column if name.endswith(".closure")]


def stand(mechanism: Mechanism, rigid: RigidMotion, index: int = 0) -> str:
    """Positions of the first three drives at an instant, like "main = 90 deg"."""
    first = list(mechanism.drives)[:3]
    return ", ".join(f"{name} = {mechanism.joints[name].written(rigid[f'{name}.angle'][index])}" for name in first)


def _elsewhere(mechanism: Mechanism) -> str:
    free = [name for name, drive in mechanism.drives.items() if drive.free]
    return f"let {', '.join(free)} start elsewhere" if free else "limit the drive's range"
