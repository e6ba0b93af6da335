"""The largest stable step of each integrator, from what a whole period of its steps does to a disturbance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.methods import METHODS
from kaneflex.integrate.outcome import Outcome
from kaneflex.integrate.run import cycle_map
from kaneflex.multibody.model import Model
from kaneflex.stability.floquet import Multipliers

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
