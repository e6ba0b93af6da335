"""Constants and arrays that compiled loops share with the Python that calls them; numba is not imported here."""

import math
from functools import lru_cache

import numpy as np

LANES = 8  # of 64 bits: a register of AVX-512, two of AVX
# No "nnan", "ninf": the test for a runaway motion relies on comparisons with NaN being false.
FASTMATH = {"nsz", "arcp", "contract", "afn", "reassoc"}


def aligned(*shape: int) -> np.ndarray:
    """An array, not filled, from where a line of the cache begins: lanes across two lines take half as long again."""
    size = math.prod(shape)
    numbers = np.empty(size + LANES)
    first = -numbers.__array_interface__["data"][0] // numbers.itemsize % LANES
    return numbers[first : first + size].reshape(shape)


COMPLETED, SINGULAR, UNBOUNDED = 0, 1, 2
"""Outcomes of a loop over steps."""
FOUND, NO_MOTION, TOO_SLOW = 0, 1, 2
"""Outcomes of corrections."""
VECTORS, SIGNALS = 5, 3
"""Motions, and pairs of signals, that a correction works with."""
PATIENCE = 8
"""Corrections over which their contraction counts."""
COS, SIN, ALONG_COS, ALONG_SIN, ORDER, ODD, ONCE, HIGH = range(8)
"""Rows of `turns`."""
_REVERSED = np.array([0, 4, 2, 6, 1, 5, 3, 7])
"""Harmonic of each lane."""


@lru_cache(maxsize=16)
def turns(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Factors of the transforms of so many instants: shapes (8, N / LANES, LANES) and (4, LANES).

    The rows: cosine and sine of 2 pi b r / N; of 2 pi b LANES / N; of each harmonic its order, from -N / 2 on; the same
    with none of the highest, which has no derivative at the instants; and one for those that are not the conjugates of
    others, and one for those of them in the highest quarter. Then cosine and sine of what each lane is turned by after
    the first halving, and after the second.
    """
    blocks, lanes = count // LANES, np.arange(LANES)
    along = np.arange(blocks)[:, None]
    angle, angle_along = 2.0 * np.pi / count * along * _REVERSED, 2.0 * np.pi / blocks * along + 0.0 * lanes
    k = LANES * along + _REVERSED
    order = np.where(2 * k <= count, k, k - count)
    once = 2 * k <= count
    rows = (np.cos(angle), np.sin(angle), np.cos(angle_along), np.sin(angle_along),
            order, np.where(2 * k == count, 0, order), once, once & (8 * k >= 3 * count))  # fmt: skip
    found, across = aligned(len(rows), blocks, LANES), aligned(4, LANES)
    found[...] = rows
    eighths, quarters = np.where(lanes & 4, lanes & 3, 0), np.where(lanes & 2, lanes & 1, 0)
    turned = np.exp(2j * np.pi * np.array([eighths / 8.0, quarters / 4.0])).round(16)
    across[...] = turned[0].real, turned[0].imag, turned[1].real, turned[1].imag
    return found, across
