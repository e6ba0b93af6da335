"""M y'' + C y' + K y = B u: linear equations of small motions about one, in the plane and in space.

What they are the derivatives of is smooth, and known to rounding: central differences of fourth order leave 1e-11 of
the largest entry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

OFFSETS, WEIGHTS = np.array([2.0, 1.0, -1.0, -2.0]), np.array([-1.0, 8.0, -8.0, 1.0]) / 12.0
"""Of central differences of fourth order."""
STEP = 1e-4
"""Their step in places, in sizes of the mechanism and rad; nothing has less than that to do with accelerations and
forces, in which the equations are affine."""


At = TypeVar("At")
"""An instant of a planar motion, or of one in space."""


@dataclass(frozen=True, eq=False)
class Linear(Generic[At]):
    """M y'' + C y' + K y = B u about an instant of a motion.

    Attributes
    ----------
    instant : At
    names : tuple of str
        Of y: JOINT.angle, JOINT.position, BODY.axial_K or BODY.transverse_K; of a body on no joint BODY.x, y, phi. In
        space see :func:`kaneflex.multibody.spatial_linear.names_of`.
    M, C, K : ndarray (n, n)
    B : ndarray (n, inputs)
        By the sizes of the loads, then by the accelerations that drives prescribe.
    """

    instant: At
    names: tuple[str, ...]
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    B: np.ndarray


def state_matrix(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """A of x' = A x, x = (y, y'), (2 n, 2 n)."""
    n = len(M)
    return np.vstack([np.eye(n, 2 * n, n), -np.linalg.solve(M, np.hstack([K, C]))])
