"""Checks of laws over a run: finite values, poles, jumps and kinks; imported by scenes with laws."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from kaneflex.scene.drives import Drive
from kaneflex.scene.law_parser import parse_law
from kaneflex.scene.laws import Law, sample_times
from kaneflex.scene.parts import Load
from kaneflex.scene.scene import Scene
from kaneflex.support.errors import Fault

_FINE = 20_000
"""Intervals of a run searched for jumps of atan2 and ends of asin, as many as laws are sampled at."""
_HALVINGS = 60
"""Bisections of an interval, more than double precision has binary digits."""
_ROUNDING = 1e-12
"""Distance below 1 at which the argument of asin counts as 1: the slope is then above 7e5."""
_POLE_PARTS, _POLE_LEVELS = 64, 4
"""Parts into which intervals around a possible pole are divided, and how often: by 1e7 in all."""
_ROUNDED = 1e-9
"""Share of a law's largest value that counts as rounding."""
FINITE = "Give a law that is finite over the run, or another duration"


def check_drive_law(drive: Drive, horizon: float | None) -> None:
    """Raise Fault unless a drive's law is valid, without kinks, and finite over the run."""
    law = parse_law(drive.law, ("t",))
    kink = law.kinks(smooth=("atan2",))
    if kink is not None:
        reason = f"{kink} has kinks, at which the speed would jump"
        raise Fault(reason, "Write a law whose speed is continuous, like sqrt(x**2 + small**2) for abs(x)")
    if horizon is not None:
        law.check_values({"t": sample_times(horizon)})
        times = np.linspace(0.0, horizon, _FINE + 1)
        _check_inverse_functions(law, times)
        if (t := pole(lambda at: law.on_arrays({"t": at}), times)) is not None:
            raise Fault(f"it grows without bound at t = {t:.6g} s", FINITE)


def _check_inverse_functions(law: Law, times: np.ndarray) -> None:
    """Raise Fault for a law in t whose atan2 jumps, or whose asin or acos has an infinite slope, at some time."""
    for _, call, _ in law.calls("atan2"):
        t = _first_jump(call, times)
        if t is not None:
            reason = f"{call.text} jumps where its point (x, y) crosses the negative x axis, "
            cure = "Write a law whose point does not cross the negative x axis"
            raise Fault(f"{reason}at t = {t:.6g} s", cure)
    for _, call, (argument,) in law.calls("asin", "acos"):
        t = _first_end(argument, times)
        if t is not None:
            reason = f"{call.text} has an infinite slope at t = {t:.6g} s, where its argument is 1 or -1"
            raise Fault(reason, "Write a law whose argument stays between -1 and 1, both excluded")


def load_jump(law: Law, names: Sequence[str], horizon: float | None) -> str | None:
    """Text of the first part of a load's law that jumps; atan2 of the time alone counts only if it jumps in the run."""
    found = law.jumps(smooth=("atan2",))
    moving = [name for name in names if name != "t"]
    for _, call, _ in law.calls("atan2") if found is None else ():
        known = horizon is not None and not call.uses_any(moving)
        if not known or _first_jump(call, np.linspace(0.0, horizon or 0.0, _FINE + 1)) is not None:
            return call.text
    return found


def _first_jump(angle: Law, times: np.ndarray) -> float | None:
    """First time between `times` at which an angle [rad] in t jumps; None without a jump.

    Between neighbours that differ by more than 1 rad, the half with the larger difference is bisected down to
    rounding: over a jump, of pi or more, the values remain different.
    """

    def values(at: np.ndarray) -> np.ndarray:
        return angle.on_arrays({"t": at})

    found = values(times)
    k = np.flatnonzero(abs(np.diff(found)) > 1.0)
    low, high = times[k], times[k + 1]
    for _ in range(_HALVINGS if len(k) else 0):
        middle = (low + high) / 2
        first = abs(values(middle) - values(low)) >= abs(values(high) - values(middle))
        low, high = np.where(first, low, middle), np.where(first, middle, high)
    jumps = abs(values(high) - values(low)) > 1.0
    return float(high[jumps][0]) if jumps.any() else None


def _first_end(argument: Law, times: np.ndarray) -> float | None:
    """First time at which the magnitude of an argument in t reaches 1, also between `times`; None if never."""

    def sizes(at: np.ndarray) -> np.ndarray:
        return abs(argument.on_arrays({"t": at}))

    found = sizes(times)
    k = np.arange(len(times))
    largest = (found >= np.roll(found, 1)) | (k == 0)
    largest &= (found >= np.roll(found, -1)) | (k == k[-1])
    k = np.flatnonzero(largest)
    low, high = times[np.maximum(k - 1, 0)], times[np.minimum(k + 1, len(times) - 1)]
    for _ in range(2 * _HALVINGS):  # each iteration keeps two thirds
        left, right = (2 * low + high) / 3, (low + 2 * high) / 3
        rises = sizes(left) < sizes(right)
        low, high = np.where(rises, left, low), np.where(rises, high, right)
    at = np.where(sizes(times[k]) >= sizes(low), times[k], low)
    ends = sizes(at) >= 1.0 - _ROUNDING
    return float(at[ends][0]) if ends.any() else None


def check_load_law(scene: Scene, load: Load) -> None:
    """Raise Fault unless a load's law is valid, and finite wherever its joints' motion is known before the run.

    A law of a free joint's motion is evaluated at the joint's start; laws in the speed of a spin-up, a law or a table
    are sampled with the derived motion (`kaneflex.solve.run_checks.check_laws`).
    """
    law = parse_law(load.law, scene.law_names())
    for name in scene.joints:
        if f"{name}_speed" in scene.joints and law.uses(f"{name}_speed"):
            reason = f"{name}_speed is both a joint and the speed of joint {name}"
            raise Fault(reason, "Give the joint another name")
    free = law.uses_any(scene.free_joints)
    if scene.horizon is None and not free:
        return
    times = np.zeros(1) if free else sample_times(scene.horizon)
    known = start_motion(scene, times)
    if all(name in known for name in scene.law_names() if law.uses(name)):
        law.check_values(known)


def start_motion(scene: Scene, times: np.ndarray) -> dict[str, np.ndarray | float]:
    """Names of laws at ``times`` (n,) [s]: coordinates [rad or m] and speeds of drives as far as known before the run,
    of free joints those at the start."""
    known: dict[str, np.ndarray | float] = {"t": times}
    for name, drive in scene.drives.items():
        speed = drive.initial_speed if drive.free else drive.speed if drive.spin_up is None else None
        try:
            known |= {name: drive.coordinate(times)} | ({} if speed is None else {f"{name}_speed": speed})
        except Fault:
            continue  # reported by the drive's own check
    return known


def pole(values_at: Callable[[np.ndarray], np.ndarray], times: np.ndarray) -> float | None:
    """Time of a pole of finite values [s], searched where those at neighbouring times differ most; None if there is
    none.

    At a pole the difference grows with each refinement; at a jump it stays the same, elsewhere it decreases. A pole at
    an instant itself exceeds both neighbours at every refinement.
    """
    values = values_at(times)
    parted = abs(np.diff(values))
    before = first = max(float(parted.max(initial=0.0)), _ROUNDED * float(abs(values).max()))
    for _ in range(_POLE_LEVELS if first else 0):
        k, before = int(parted.argmax()), max(first, float(parted.max()))
        low, high = max(k - 1, 0), min(k + 2, len(parted))  # an even pole lies next to the largest difference
        times = np.linspace(times[low], times[high], _POLE_PARTS * (high - low) + 1)
        values = values_at(times)
        parted = abs(np.diff(values))
        if not np.isfinite(values).all():
            return float(times[np.isfinite(values).argmin()])
        if parted.max() < 2.0 / _POLE_PARTS * first:
            return None
    if not first:
        return None
    rise, fall = np.diff(values)[:-1], -np.diff(values)[1:]
    alone = np.minimum(abs(rise), abs(fall)) * (rise * fall > 0.0)
    if parted.max() > 2.0 * before:
        return float(times[parted.argmax()])
    return float(times[1 + alone.argmax()]) if alone.max() > 0.5 * parted.max() else None
