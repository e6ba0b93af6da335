"""Static equilibrium by Newton's method, in load steps if needed."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

_LOAD_STEPS = 256
"""Inverse of the smallest load step."""

FARTHEST = 0.1
"""Largest Newton step, as a share of the mechanism's size: longer ones may lead to a distant equilibrium, so the load
is applied in smaller steps."""
UNBALANCED = "no static equilibrium is found at the start, even in load steps"

_S = TypeVar("_S")


def in_load_steps(state: _S, off: np.ndarray, corrected: Callable[[_S, np.ndarray], _S | None]) -> _S | None:
    """Equilibrium state, from one that is in equilibrium without the load ``off`` (n,); None if not found.

    ``corrected``: function of a state and the missing load that returns the equilibrium nearby, or None. The whole load
    is tried first, then halves as often as needed.
    """
    if not off.any():
        return corrected(state, off)
    done, share = 0.0, 1.0
    while done < 1.0:
        found = corrected(state, (1.0 - done - share) * off)
        if found is None:
            share *= 0.5
            if share * _LOAD_STEPS < 1.0:
                return None
        else:
            state, done = found, done + share
            share = min(2.0 * share, 1.0 - done)
    return state
