"""Linear equations M y'' + C y' + K y = B u of small motions about a motion, in the plane and in space.

The residual is smooth and accurate to rounding: central differences of fourth order have an error of 1e-11 of the
largest entry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

OFFSETS, WEIGHTS = np.array([2.0, 1.0, -1.0, -2.0]), np.array([-1.0, 8.0, -8.0, 1.0]) / 12.0
"""Offsets and weights of central differences of fourth order."""
STEP = 1e-4
"""Step in positions, in sizes of the mechanism and rad; steps in accelerations and forces may be larger, since the
equations are affine in them."""


At = TypeVar("At")
"""Instant of a planar motion, or of one in space."""


@dataclass(frozen=True, eq=False)
class Linear(Generic[At]):
    """Linear equations M y'' + C y' + K y = B u about an instant of a motion.

    Attributes
    ----------
    instant : At
    names : tuple of str
        Names of y: JOINT.angle, JOINT.position, BODY.axial_K, BODY.transverse_K; BODY.x, y, phi of a floating body; in
        space see :func:`kaneflex.multibody.time.spatial_linear.names_of`.
    M, C, K : ndarray (n, n)
    B : ndarray (n, inputs)
        Columns for the magnitudes of loads, then for prescribed accelerations.
    """

    instant: At
    names: tuple[str, ...]
    M: np.ndarray
    C: np.ndarray
    K: np.ndarray
    B: np.ndarray


def state_matrix(M: np.ndarray, C: np.ndarray, K: np.ndarray) -> np.ndarray:
    """State matrix A of x' = A x, x = (y, y'), (2 n, 2 n)."""
    n = len(M)
    return np.vstack([np.eye(n, 2 * n, n), -np.linalg.solve(M, np.hstack([K, C]))])
