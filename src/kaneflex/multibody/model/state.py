"""State of a mechanism by the coordinates of its tree, and the choice of its independent speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Choice:
    """Independent rows of the cuts, and as many dependent speeds, with independent speeds.

    Attributes
    ----------
    rows, dependent, independent : ndarray
        Numbers of the rows and speeds.
    virtual_inertia : ndarray (s,)
        Virtual inertia of speeds that have inertia through the loops only, else 0.
    """

    rows: np.ndarray
    dependent: np.ndarray
    independent: np.ndarray
    virtual_inertia: np.ndarray

    def differs(self, other: Choice) -> bool:
        """True if rows or dependent speeds differ."""
        return self.rows.tolist() != other.rows.tolist() or {*self.dependent.tolist()} != {*other.dependent.tolist()}


_EMPTY = np.zeros(0, np.int64)
NONE = Choice(_EMPTY, _EMPTY, _EMPTY, np.zeros(0))


@dataclass(frozen=True, eq=False)
class State:
    """State of a mechanism at an instant: coordinates, speeds, their rates, sizes of loads, the choice of speeds."""

    t: float
    q: np.ndarray
    u: np.ndarray
    du: np.ndarray
    sizes: np.ndarray
    choice: Choice
