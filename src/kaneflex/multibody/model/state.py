"""State of a mechanism by the coordinates of its tree, and the choice of its independent speeds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.multibody.model import layout as at

_LENT = 1e-12
"""Share of the largest inertia of a speed that counts as none."""


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


def virtual_inertia(M: np.ndarray, measure: np.ndarray, bodies: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Virtual inertia of speeds whose pivot in a recursion over the tree would vanish, (s,).

    The recursion begins with the outermost body, of each with its shapes. M: mass matrix; free: mask of speeds without
    drives.
    """
    inertia = np.zeros(len(measure))
    A = M * np.outer(measure, measure)
    most = A.diagonal().max(initial=0.0)
    for own in bodies[::-1]:
        joint, shapes = (range(own[k], own[k] + own[count]) for k, count in ((at.FIRST, at.DOF), (at.MODAL, at.SHAPES)))
        for s in filter(free.__getitem__, (*shapes, *joint)):
            if A[s, s] <= _LENT * most:
                inertia[s], A[s, s] = most / measure[s] ** 2, A[s, s] + most
            if A[s, s] > 0.0:
                A -= np.outer(A[:, s], A[s]) / A[s, s]
    return inertia
