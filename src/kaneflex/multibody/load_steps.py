"""A deformation in balance, found in load steps where Newton's method does not reach it at once."""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

LOAD_STEPS = 256
"""Share of the load, its inverse, below which a load step is not worth trying."""

FARTHEST = 0.1
"""Step of Newton's method, as a share of the mechanism's size, that is as likely to lead to a balance far away: the
load then grows in smaller steps."""

_S = TypeVar("_S")


def in_load_steps(state: _S, off: np.ndarray, corrected: Callable[[_S, np.ndarray], _S | None]) -> _S | None:
    """A state whose residual (n,) is zero, from one where it is ``off``; None where no load step leads there.

    ``corrected``: a state and a residual -> the state near by that has it, or None. The whole load is tried first, then
    halves of it as often as needed: a residual that shrinks to zero is a load that grows from none (Riks 1979).
    """
    done, share = 0.0, 1.0
    while done < 1.0:
        found = corrected(state, (1.0 - done - share) * off)
        if found is None:
            share *= 0.5
            if share * LOAD_STEPS < 1.0:
                return None
        else:
            state, done = found, done + share
            share = min(2.0 * share, 1.0 - done)
    return state
