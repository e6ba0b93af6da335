"""A deformation in balance, found in load steps where Newton's method does not reach it at once."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

_LOAD_STEPS = 256
"""Share of the load, its inverse, below which a load step is not worth trying."""

FARTHEST = 0.1
"""Step of Newton's method, as a share of the mechanism's size, that is as likely to lead to a balance far away: the
load then grows in smaller steps."""
UNBALANCED = "no deformation is found that balances what acts at the start, not even in load steps"

_S = TypeVar("_S")


def in_load_steps(state: _S, off: np.ndarray, corrected: Callable[[_S, np.ndarray], _S | None]) -> _S | None:
    """A state in balance, from one that is in balance where ``off`` (n,) of its load is missing; None if none is found.

    ``corrected``: a state and what is missing -> the balanced state near by, or None. The whole load is tried first,
    then halves of it as often as needed.
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
