"""Tabulated drives and loads, with the signatures of a generated module's kernels.

The times are numbers of rows, 0, 1, 2 and so on.
"""

from __future__ import annotations

import numpy as np
from numba import njit


def parameters(courses: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Parameters p of the kernels: numbers of columns, then row after row.

    ``courses`` (n, 3 drives): coordinate, speed and acceleration of every drive; ``sizes`` (n, loads).
    """
    return np.concatenate([[courses.shape[1], sizes.shape[1]], np.hstack([courses, sizes]).ravel()]).astype(float)


@njit(cache=True, error_model="numpy")
def courses(t, p, out, k):
    """Coordinate, speed and acceleration of every drive, three numbers each."""
    first = 2 + int(t) * int(p[0] + p[1])
    for j in range(int(p[0])):
        out[k + j] = p[first + j]


@njit(cache=True, error_model="numpy")
def magnitudes(t, x, i, p, out, k):
    """Size of every load."""
    first = 2 + int(t) * int(p[0] + p[1]) + int(p[0])
    for j in range(int(p[1])):
        out[k + j] = p[first + j]
