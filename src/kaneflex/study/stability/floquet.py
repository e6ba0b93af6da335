"""Floquet multipliers of the elastic equations over a period (Nayfeh and Mook 1979, section 5.2), and stable steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.methods import METHODS
from kaneflex.integrate.outcome import Outcome
from kaneflex.integrate.periodic import leading
from kaneflex.integrate.run import cycle_map
from kaneflex.multibody.model import Model
from kaneflex.solve.simulation import not_repeated
from kaneflex.support.errors import SceneError

FIRST_STEPS, MOST_STEPS = 256, 16384
"""Steps of the first attempt over a period, and those at which refining ends."""
CONVERGED = 1e-7
"""Change of the spectral radius by twice the steps, as a share of it or of one, at which refining ends."""
MARGIN = 1e-5
"""How far above one the spectral radius must be to be called unstable: a double multiplier 1 splits by rounding."""


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Floquet multipliers of one period.

    Attributes
    ----------
    values : ndarray (2 n,)
        Complex, largest modulus first.
    period : float
        What they belong to [s].
    steps : int
        Steps of the two-stage Gauss-Legendre method over the period.
    change : float
        Of the spectral radius against half the steps, as a share of it, or of one where it is smaller.
    """

    values: np.ndarray
    period: float
    steps: int
    change: float

    @property
    def radius(self) -> float:
        """Largest modulus: above one, a disturbance grows by it in every period."""
        return float(abs(self.values[0]))

    @property
    def converged(self) -> bool:
        return self.change <= CONVERGED

    @property
    def unstable(self) -> bool:
        return self.radius > 1.0 + max(MARGIN, self.change)

    @property
    def growth_rate(self) -> float:
        """Rate [1/s] at which the fastest disturbance grows: log(radius) / period."""
        return float(np.log(self.radius) / self.period)


def floquet_multipliers(model: Model) -> Multipliers:
    """Multipliers of M z'' + C z' + K z = 0 over a period, with as many steps as they need.

    The method is of order four and neither damps nor excites: from one attempt to the next its steps are halved, until
    the spectral radius changes by no more than CONVERGED.

    Raises
    ------
    SceneError
        If the model has no elastic equations with time-varying coefficients, no cycle, or does not repeat itself.
    """
    check_periodic(model)
    period, before = model.scene.period, None
    steps = FIRST_STEPS
    while True:
        values = _multipliers(model, period, steps)
        radius = float(abs(values[0]))
        if before is not None:
            change = abs(radius - before) / max(radius, 1.0)
            if change <= CONVERGED or 2 * steps > MOST_STEPS:
                return Multipliers(values, period, steps, change)
        before, steps = radius, 2 * steps


def check_periodic(model: Model) -> None:
    """Raise SceneError unless the equations are periodic ones with elastic coordinates."""
    options = model.options
    if options.dynamics != "dynamic" or not model.reduced.size:
        reason = "has no elastic equations whose coefficients change with the motion"
        raise SceneError("solve.preset", options.preset, reason, "Choose preset linear or stiffened, with a beam")
    if not options.cycles:
        raise SceneError(
            "solve.duration", model.scene.solve.duration, "there is no cycle whose end could be held against its start",
            "Give a drive a speed and a cycle, or a law and a period, and no duration",
        )  # fmt: skip
    reason = not_repeated(model)
    if reason is not None:
        raise SceneError("stability", None, reason, "Let every drive, law and table repeat within the cycle")


def _multipliers(model: Model, period: float, steps: int) -> np.ndarray:
    cycle = cycle_map(model.system, model.scalars, 0.0, period, steps, "gauss")
    if cycle.outcome is not Outcome.COMPLETED:
        raise SceneError("stability", None, cycle.message, "Change the model: such a motion has no multipliers")
    return leading(np.linalg.eigvals(cycle.monodromy), model.reduced.size)


FINEST, COARSEST = 2048, 8
"""Steps of a period between which the search runs."""
_RATIO = 2**0.5
"""From one number of steps to the next one that is tried."""
_SPURIOUS, _SHARE = 1e-4, 0.05
"""Logarithm of the growth in a period, beyond that of the equations themselves, at which an integrator is called
unstable, and the share of the equations' own growth that is added to it."""
PER_PERIOD, PER_CYCLE = 10, 72
"""Steps in a period of the lowest mode, and of the motion, that are recommended at least."""


@dataclass(frozen=True)
class StepLimit:
    """What an integrator needs.

    Attributes
    ----------
    integrator : str
        Name in ``kaneflex.integrate.methods.METHODS``.
    steps : int or None
        Fewest steps of a period from which on, up to ``FINEST``, every number that was tried is stable; None if even
        ``FINEST`` are not.
    step : float or None
        Period / steps [s].
    limited : bool
        Whether coarser steps were found unstable; else none down to ``COARSEST`` were.
    """

    integrator: str
    steps: int | None
    step: float | None
    limited: bool


def step_limits(model: Model, multipliers: Multipliers) -> tuple[StepLimit, ...]:
    """Limits of the integrators that preset linear and stiffened can have, by bisection from fine to coarse steps.

    Stable is a step by which no disturbance grows in a period by more than the equations themselves let it grow.
    """
    own = np.log(max(1.0, multipliers.radius))
    allowed = float(np.exp((1.0 + _SHARE) * own + _SPURIOUS))
    names = [name for name, method in METHODS.items() if method.lanes]
    return tuple(_limit(model, name, multipliers.period, allowed) for name in names)


def recommended(limits: tuple[StepLimit, ...], lowest: float) -> StepLimit | None:
    """The integrator of highest order that is stable with the steps that resolve a mode and the motion.

    Where none is, the one of the largest stable step, with that. lowest: highest value over the cycle of the lowest
    frequency that is not zero [Hz]. None where no integrator is stable.
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

    # from fine to coarse, and not by bisection alone: coarse steps may be stable again by chance
    fewest, tried = None, FINEST
    while tried >= COARSEST:
        if not stable(tried):
            break
        fewest, tried = tried, min(tried - 1, round(tried / _RATIO))
    else:
        return StepLimit(name, fewest, period / fewest, False)
    if fewest is None:
        return StepLimit(name, None, None, True)
    unstable = tried
    while fewest - unstable > 1:
        middle = (fewest + unstable) // 2
        fewest, unstable = (middle, unstable) if stable(middle) else (fewest, middle)
    return StepLimit(name, fewest, period / fewest, True)
