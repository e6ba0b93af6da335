"""Constants and arguments that compiled loops share with the Python that calls them; numba is not imported here."""

from typing import Any, NamedTuple

# No "nnan", "ninf": the test for a runaway motion relies on comparisons with NaN being false.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}
COMPLETED, SINGULAR, UNBOUNDED = 0, 1, 2
"""Outcomes of a loop over steps."""
OUTCOMES = 3
"""Number of outcomes."""
BLOCK = 32
"""Instants that sensors are read at together, side by side."""


class Plan(NamedTuple):
    """Whole numbers of a call of a loop over steps.

    n, columns: rows and columns of a state
    n_slots: of a matrix
    stages: 0 for methods without stages
    n_scalars: numbers in a row of the table
    period, position: steps in the table, and those already taken in it
    n_steps: to take
    done, every: steps taken before this call; each `every`-th step is stored
    """

    n: int
    columns: int
    n_slots: int
    stages: int
    n_scalars: int
    period: int
    position: int
    n_steps: int
    done: int
    every: int


class Terms(NamedTuple):
    """Terms of the matrices and forces: ends of those of each number, their scalars, and their constants."""

    ends: Any
    what: Any
    values: Any


class Layout(NamedTuple):
    """Layout of a banded matrix: entry (i, j) at ``base[i] + j`` for ``first[i] <= j < last[i]``."""

    n: int
    n_slots: int
    base: Any
    first: Any
    last: Any
