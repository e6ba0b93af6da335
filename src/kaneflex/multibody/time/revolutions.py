"""Full turns: those with which planar bodies start, and of angles along a run in space."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.model.system import System
from kaneflex.scene.laws import Law
from kaneflex.support.errors import SceneError

_FAR = 1.0
"""Largest change of an angle in a step [rad], by the rate at either end, for a reliable count of turns."""


def unwrapped(
    system: System, q: np.ndarray, drives: Mapping[str, float], given: Collection[str] = ()
) -> np.ndarray:
    """State q with full turns added to the bodies' angles, consistent with ``drives`` [rad or m], welds and guides.

    Joints with springs, laws or free drives start within half a turn of their rest or start; between bodies with
    ``given`` angles they keep their turns.
    """
    before = {name: float(q[k + 2]) for name, k in system.start.items()}
    angles = _counted(system, before, drives, _between(system, before, given))
    q = q.copy()
    for name, k in system.start.items():
        q[k + 2] = angles[name]
    return q


def check_turns_kept(system: System, laws: Collection[Law], before: np.ndarray, q: np.ndarray) -> None:
    """Raise SceneError if springs and laws of loads have other turns in q than in the given state ``before``."""
    was, now = ({name: float(part[k + 2]) for name, k in system.start.items()} for part in (before, q))
    now = _between(system, now, system.start)
    sprung = {spring.joint for spring in system.mechanism.springs.values()}
    for name, turned in _between(system, was, system.start).items():
        knows = "a torsional spring" if name in sprung else "a law" if any(law.uses_any([name]) for law in laws) else ""
        if knows and round((turned - now[name]) / math.tau):
            raise SceneError(
                "solve.start", "a table of a state",
                f"the state has {name} at {math.degrees(turned):.6g} deg, but by drives, welds and guides it starts at "
                f"{math.degrees(now[name]):.6g} deg, and {knows} depends on these whole turns",
                "Continue with --after, or simulate(model, after=...), which also continues drives, or add turns to "
                "the drives' angles",
            )  # fmt: skip


def _between(system: System, angles: Mapping[str, float], given: Collection[str]) -> dict[str, float]:
    """Coordinates [rad] of pins between ``given`` bodies whose turns a spring, a law or a free drive counts."""
    mechanism = system.mechanism
    sprung = [spring.joint for spring in mechanism.springs.values() if spring.joint is not None]
    known, found = {"ground": 0.0, **{name: angles[name] for name in given}}, {}
    for name in dict.fromkeys([*sprung, *mechanism.observed, *mechanism.free_joints]):
        first, second = mechanism.joints[name].bodies
        if mechanism.joints[name].kind == "revolute" and first in known and second in known:
            found[name] = known[second] - known[first]
    return found


def _counted(
    system: System, angles: Mapping[str, float], drives: Mapping[str, float], kept: Mapping[str, float]
) -> dict[str, float]:
    """Angles of the bodies [rad] with the turns prescribed by joints, or ``kept`` between them.

    ``drives``: coordinates of the drives.
    """
    mechanism = system.mechanism
    counted, angle = {"ground"}, {"ground": 0.0, **angles}
    pins = {name for name, joint in mechanism.joints.items() if joint.kind == "revolute"}
    turns = {name: joint.angle for name, joint in mechanism.joints.items() if name not in pins}
    turning = {name: drive.kind for name, drive in mechanism.drives.items() if name in pins}
    turns |= {name: drives[name] for name, kind in turning.items() if kind != "free"}
    near = {name: 0.0 for name in mechanism.observed if name in pins}
    near |= {spring.joint: spring.free for spring in mechanism.springs.values() if spring.joint is not None}
    near |= mechanism.backlash
    near = {name: drives[name] for name in turning} | {name: at for name, at in near.items() if name not in turning}
    near |= kept
    turns |= {name: angle for name, angle in near.items() if name not in turns}  # prescribed ones take precedence
    ends = [(*mechanism.joints[name].bodies, turn) for name, turn in turns.items()]
    ways = [way for first, second, turn in ends for way in ((first, second, turn), (second, first, -turn))]
    while len(counted) < len(angle):
        leading = [way for way in ways if way[0] in counted and way[1] not in counted]
        if not leading:  # no joint determines the remaining turns
            counted.add(next(name for name in angle if name not in counted))
            continue
        base, other, turn = leading[0]
        angle[other] += float(whole_turns(angle[base] + turn - angle[other]))
        counted.add(other)
    return angle


class Counts:
    """Counts of the turns of several angles from the start of a run, in steps too short for a whole turn.

    Parameters
    ----------
    at : callable
        Angles (n_times, n) at ascending times [s], from -pi to pi, and their rates [rad, rad/s].
    longest : float
        Longest step [s].
    begin : float
        Start [s].
    known : ndarray (n,)
        Angles with whole turns there; NaN: none.
    """

    def __init__(
        self, at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], longest: float, begin: float = 0.0,
        known: np.ndarray | float = math.nan,
    ) -> None:  # fmt: skip
        self.at, self.longest = at, longest
        start = np.array([begin])
        self.times, self.angles, self.rates = start, *at(start)
        self.first = np.nan_to_num(np.round((known - self.angles) / math.tau))

    def over(self, times: np.ndarray, angles: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """Angles (n_times, n) [rad] at times [s] with whole turns; ``angles``: without these.

        Each turn is counted from the change of an angle that the rates at both ends of a step predict.
        """
        self._add(times, angles, rates)
        while len(between := self._between()):
            self._add(between, *self.at(between))
        near = 0.5 * np.diff(self.times)[:, None] * (self.rates[1:] + self.rates[:-1])
        turns = np.round((near - np.diff(self.angles, axis=0)) / math.tau)
        counted = self.angles + math.tau * np.cumsum(np.vstack([self.first, turns]), axis=0)
        return np.asarray(counted[np.searchsorted(self.times, times)])

    def _add(self, times: np.ndarray, angles: np.ndarray, rates: np.ndarray) -> None:
        """Add instants to the known ones, in their order."""
        self.times, first = np.unique(np.concatenate([self.times, times]), return_index=True)
        self.angles, self.rates = (
            np.concatenate(parts)[first] for parts in ((self.angles, angles), (self.rates, rates))
        )  # fmt: skip

    def _between(self) -> np.ndarray:
        """Instants within steps that are too long by the rates at their ends, ascending."""
        steps, fast = np.diff(self.times), abs(np.nan_to_num(self.rates)).max(axis=1, initial=0.0)
        parts = steps * np.maximum(1.0 / self.longest, np.maximum(fast[1:], fast[:-1]) / _FAR)
        long = np.flatnonzero(parts > 1.0001)
        return np.concatenate([np.zeros(0), *(
            self.times[k] + steps[k] * np.arange(1, count) / count
            for k, count in zip(long, np.ceil(parts[long]), strict=True)
        )])  # fmt: skip
