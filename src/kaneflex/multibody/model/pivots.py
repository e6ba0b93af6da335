"""Pivots of a recursion over the tree of a mechanism, and virtual inertia where one of them vanishes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kaneflex.multibody.model import layout as at

_LENT = 1e-12
"""Share of the largest inertia of a speed that counts as none."""


def virtual_inertia(M: np.ndarray, measure: np.ndarray, bodies: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Virtual inertia of speeds whose pivot in a recursion over the tree would vanish, (s,).

    M: mass matrix; free: mask of speeds without drives.
    """
    inertia = np.zeros(len(measure))
    A = M * np.outer(measure, measure)
    most = A.diagonal().max(initial=0.0)
    for _, s in pivots(A, bodies, free):
        if A[s, s] <= _LENT * most:
            inertia[s], A[s, s] = most / measure[s] ** 2, A[s, s] + most
    return inertia


def pivots(A: np.ndarray, bodies: np.ndarray, free: np.ndarray) -> Iterator[tuple[int, int]]:
    """Body and speed of every pivot of a recursion over the tree, which A then has on its diagonal; overwrites A.

    The outermost body comes first, of each its shapes, then its joint.
    """
    for b in range(len(bodies) - 1, -1, -1):
        own = bodies[b]
        joint, shapes = (range(own[k], own[k] + own[count]) for k, count in ((at.FIRST, at.DOF), (at.MODAL, at.SHAPES)))
        for s in filter(free.__getitem__, (*shapes, *joint)):
            yield b, s
            if A[s, s] > 0.0:
                A -= np.outer(A[:, s], A[s]) / A[s, s]
