"""Hermite interpolation between known instants of a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Pieces:
    """Indices k of the knots before some instants, their share of the interval, and its length."""

    k: np.ndarray
    share: np.ndarray
    length: np.ndarray

    @classmethod
    def of(cls, knots: np.ndarray, last: np.ndarray, times: np.ndarray) -> Pieces:
        """Pieces for instants; ``last``: last knot at or before each."""
        k = np.minimum(last, len(knots) - 2)
        length = knots[k + 1] - knots[k]
        share = np.divide(times - knots[k], length, out=np.ones(len(times)), where=length > 0.0)
        return cls(k, share[:, None], length[:, None])

    def line(self, values: np.ndarray) -> np.ndarray:
        before, after = values[self.k], values[self.k + 1]
        return before + self.share * (after - before)

    def cubic(self, values: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Hermite cubic of one series."""
        s, h = self.share[:, 0], self.length[:, 0]
        first = (1.0 + 2.0 * s) * values[self.k] + s * h * slopes[self.k]
        last = (3.0 - 2.0 * s) * values[self.k + 1] + (s - 1.0) * h * slopes[self.k + 1]
        return (1.0 - s) ** 2 * first + s**2 * last

    def quintic(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Hermite quintic through q and its two rates, with its slope."""
        s, h, k = self.share, self.length, self.k
        # Horner's scheme in s for the error of the first knot's Taylor polynomial at the second knot
        c_1, c_2 = h * v[k], 0.5 * h**2 * a[k]
        off = q[k + 1] - q[k] - c_1 - c_2
        off_rate, off_accel = h * v[k + 1] - c_1 - 2.0 * c_2, h**2 * a[k + 1] - 2.0 * c_2
        c_3 = 10.0 * off - 4.0 * off_rate + 0.5 * off_accel
        c_4 = -15.0 * off + 7.0 * off_rate - off_accel
        c_5 = 6.0 * off - 3.0 * off_rate + 0.5 * off_accel
        place = q[k] + s * (c_1 + s * (c_2 + s * (c_3 + s * (c_4 + s * c_5))))
        slope = c_1 + s * (2.0 * c_2 + s * (3.0 * c_3 + s * (4.0 * c_4 + s * 5.0 * c_5)))
        return place, np.divide(slope, h, out=v[k + 1].copy(), where=h > 0.0)
