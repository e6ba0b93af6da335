"""Floquet multipliers of the elastic equations over a period (Nayfeh and Mook 1979, section 5.2), and stable steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.by_steps import cycle_map
from kaneflex.integrate.methods import METHODS
from kaneflex.integrate.periodic import leading
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model.bound_model import Model
from kaneflex.solve.one_way_run import not_repeated
from kaneflex.support.errors import SceneError

FIRST_STEPS, MOST_STEPS = 256, 16384
"""Steps per period of the first attempt and of the last one."""
CONVERGED = 1e-7
"""Change of the spectral radius between two attempts, relative to the larger of it and one, that ends refinement."""
MARGIN = 1e-5
"""Excess of the spectral radius over one that counts as unstable: rounding splits a double multiplier 1."""


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Floquet multipliers of one period.

    Attributes
    ----------
    values : ndarray (2 n,)
        Complex, largest modulus first.
    period : float
        Period [s].
    steps : int
        Steps of the two-stage Gauss-Legendre method over the period.
    change : float
        Change of the spectral radius from half the steps, relative to the larger of it and one.
    """

    values: np.ndarray
    period: float
    steps: int
    change: float

    @property
    def radius(self) -> float:
        """Largest modulus: a disturbance grows by this factor per period."""
        return float(abs(self.values[0]))

    @property
    def converged(self) -> bool:
        return self.change <= CONVERGED

    @property
    def unstable(self) -> bool:
        return self.radius > 1.0 + max(MARGIN, self.change)

    @property
    def growth_rate(self) -> float:
        """Growth rate [1/s] of the fastest disturbance: log(radius) / period."""
        return float(np.log(self.radius) / self.period)


def floquet_multipliers(model: Model) -> Multipliers:
    """Floquet multipliers of M z'' + C z' + K z = 0 over a period, with as many steps as needed.

    The method has order four and no numerical damping. The number of steps is doubled until the spectral radius changes
    by at most CONVERGED.

    Raises
    ------
    SceneError
        If the model has no elastic equations with time-varying coefficients, no cycle, or is not periodic.
    """
    check_periodic(model)
    period, steps, before = model.scene.period, FIRST_STEPS, math.inf
    while True:
        values = _multipliers(model, period, steps)
        radius = float(abs(values[0]))
        change = abs(radius - before) / max(radius, 1.0)
        if change <= CONVERGED or 2 * steps > MOST_STEPS:
            return Multipliers(values, period, steps, change)
        before, steps = radius, 2 * steps


def check_periodic(model: Model) -> None:
    """Raise SceneError unless the model has periodic equations with elastic coordinates."""
    options = model.options
    if options.dynamics != "dynamic" or not model.reduced.size:
        reason = "it has no elastic equations whose coefficients vary with the motion"
        raise SceneError("solve.preset", options.preset, reason, "Choose preset linear or stiffened, with a beam")
    if not options.cycles:
        raise SceneError(
            "solve.duration", model.scene.solve.duration, "stability needs a cycle, and the scene has none",
            "Give a drive a speed and a cycle, or a law and a period, and leave out solve.duration",
        )  # fmt: skip
    reason = not_repeated(model)
    if reason is not None:
        raise SceneError("stability", None, reason, "Make every drive, law and table periodic with the cycle")


def _multipliers(model: Model, period: float, steps: int) -> np.ndarray:
    cycle = cycle_map(model.system, model.scalars, 0.0, period, steps, "gauss")
    if cycle.outcome is not Outcome.COMPLETED:
        raise SceneError("stability", None, cycle.message, "Change the model: this motion has no Floquet multipliers")
    return leading(np.linalg.eigvals(cycle.monodromy), model.reduced.size)


FINEST, COARSEST = 2048, 8
"""Largest and smallest number of steps per period of the search."""
_RATIO = 2**0.5
"""Ratio of successive numbers of steps."""
_SPURIOUS, _SHARE = 1e-4, 0.05
"""Growth per period, beyond that of the equations, at which an integrator counts as unstable: its logarithm,
and the share of the equations' own growth added to it."""
PER_PERIOD, PER_CYCLE = 10, 72
"""Recommended steps at least: per period of the lowest mode, and per cycle of the motion."""


@dataclass(frozen=True)
class StepLimit:
    """Largest stable step of an integrator.

    Attributes
    ----------
    integrator : str
        Name in ``kaneflex.integrate.methods.METHODS``.
    steps : int or None
        Fewest steps per period from which on, up to ``FINEST``, every tried number is stable; None if ``FINEST`` is
        unstable.
    step : float or None
        Period / steps [s].
    limited : bool
        Whether coarser steps are unstable; else all down to ``COARSEST`` are stable.
    """

    integrator: str
    steps: int | None
    step: float | None
    limited: bool


def step_limits(model: Model, multipliers: Multipliers) -> tuple[StepLimit, ...]:
    """Stability limits of the integrators of presets linear and stiffened, by bisection from fine to coarse steps.

    A step is stable if no disturbance grows faster per period than by the equations themselves.
    """
    own = np.log(max(1.0, multipliers.radius))
    allowed = float(np.exp((1.0 + _SHARE) * own + _SPURIOUS))
    names = [name for name, method in METHODS.items() if method.varying]
    return tuple(_limit(model, name, multipliers.period, allowed) for name in names)


def recommended(limits: tuple[StepLimit, ...], lowest: float) -> StepLimit | None:
    """The stable integrator of highest order with enough steps to resolve the lowest mode and the motion.

    If none is stable at these steps, the one with the largest stable step. ``lowest``: highest value over the cycle of
    the lowest nonzero frequency [Hz]. None if no integrator is stable.
    """
    stable = [limit for limit in limits if limit.steps is not None]
    if not stable:
        return None
    period = stable[0].step * stable[0].steps
    wanted = max(PER_CYCLE, int(np.ceil(PER_PERIOD * lowest * period)))
    best = min(stable, key=lambda limit: (max(limit.steps, wanted), -METHODS[limit.integrator].order))
    steps = max(best.steps, wanted)
    return StepLimit(best.integrator, steps, period / steps, best.limited)


def _limit(model: Model, name: str, period: float, allowed: float) -> StepLimit:
    def stable(steps: int) -> bool:
        cycle = cycle_map(model.system, model.scalars, 0.0, period, steps, name, model.options.rho_infinity)
        return cycle.outcome is Outcome.COMPLETED and abs(np.linalg.eigvals(cycle.monodromy)).max() <= allowed

    # from fine to coarse, not by bisection alone: some coarse steps may be stable by chance
    fewest, tried = None, FINEST
    while tried >= COARSEST and stable(tried):
        fewest, tried = tried, min(tried - 1, round(tried / _RATIO))
    if fewest is None:
        return StepLimit(name, None, None, True)
    limited = tried >= COARSEST
    while limited and fewest - tried > 1:
        middle = (fewest + tried) // 2
        fewest, tried = (middle, tried) if stable(middle) else (fewest, middle)
    return StepLimit(name, fewest, period / fewest, limited)
