"""Outcome of a run, and its results."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np

Floquet = np.ndarray | Callable[[], np.ndarray] | None


class Outcome(Enum):
    """Outcome of a run; the value is the text for the user."""

    COMPLETED = "completed"
    UNSTABLE = "unstable: the motion grows without bound"
    SINGULAR = "singular step: a pivot of its equations vanishes"
    NO_PERIODIC_STATE = "no periodic state: a Floquet multiplier equals one"
    CASCADE = "cascade: contacts close and open without end at one instant"
    PARADOX = "paradox: no combination of sticking and sliding satisfies the friction laws"


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Motion at the stored steps, in the units of the system.

    times: shape (n_out,), in s
    z, v, a: shape (n_out, n), displacements, velocities, accelerations; they satisfy the equation
    outcome, message: outcome; the message adds time and reason
    floquet: the multipliers, or a function that computes them on demand
    ns_per_step: wall time of a step in the compiled loop, without compiling and without the table, in ns
    solver: method used and the reason, as text; empty without a choice

    A run that stopped early holds the steps before; without a periodic state it is empty.
    """

    times: np.ndarray
    z: np.ndarray
    v: np.ndarray
    a: np.ndarray
    outcome: Outcome
    message: str
    floquet: Floquet
    ns_per_step: float
    solver: str = ""

    def at(self, times: np.ndarray) -> Trajectory:
        """Motion at other instants: the quintic through the stored z, z', z''."""
        from scipy.interpolate import BPoly

        knots = np.stack([self.z, self.v, self.a], axis=1)
        if not knots.size:
            empty = np.zeros((len(times), 0))
            return replace(self, times=times, z=empty, v=empty, a=empty)
        curve = BPoly.from_derivatives(self.times, knots)
        z, v, a = curve(times), curve.derivative(1)(times), curve.derivative(2)(times)
        return replace(self, times=times, z=z, v=v, a=a)

    @cached_property
    def multipliers(self) -> np.ndarray | None:
        """Complex, shape (2 n,), Floquet multipliers of the *discrete* equations by decreasing modulus.

        None if not computed.
        """
        return self.floquet() if callable(self.floquet) else self.floquet


def leading(multipliers: np.ndarray, n: int) -> np.ndarray:
    """Multipliers of largest modulus (2 n of them), largest first."""
    return multipliers[np.argsort(-np.abs(multipliers), kind="stable")][: 2 * n].astype(complex)
