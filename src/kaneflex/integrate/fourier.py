"""Fourier transforms of eight rows at once: radix four, in Stockham's order, a row in each lane (Van Loan 1992, 1.7).

Signals of N instants, a power of two from eight on, are arrays (LANES, N) in memory (N, LANES): number 8 t + r is row r
at instant t. So `load(x, t)` reads an instant of all rows, and `transpose` fills them from arrays of lanes.
"""

from functools import lru_cache

import numpy as np

from kaneflex.integrate.lanes import LANES, load, stay_apart, store
from kaneflex.integrate.matrices import compiled


@lru_cache(maxsize=16)
def circle(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of 2 pi k / count, each of shape (count,)."""
    angle = 2.0 * np.pi / count * np.arange(count)
    return np.cos(angle), np.sin(angle)


@compiled
def transform(re, im, spare_re, spare_im, cosine, sine):
    """Sum over t of (re + i im) exp(-2 pi i k t / N), in the order of k; the two arrays in which it lies.

    The inverse is N times that of (im, re). An even number of transforms ends in (re, im).
    """
    stay_apart()
    count = re.size // LANES
    left, stride = count, 1
    while left > 2:
        quarter = left // 4
        for p in range(quarter):
            once, twice, thrice = p * stride, 2 * p * stride, 3 * p * stride
            cos_1, sin_1 = load(cosine, once), load(sine, once)
            cos_2, sin_2 = load(cosine, twice), load(sine, twice)
            cos_3, sin_3 = load(cosine, thrice), load(sine, thrice)
            for q in range(stride):
                place, apart = q + stride * p, stride * quarter
                a_re, a_im = load(re, place), load(im, place)
                b_re, b_im = load(re, place + apart), load(im, place + apart)
                c_re, c_im = load(re, place + 2 * apart), load(im, place + 2 * apart)
                d_re, d_im = load(re, place + 3 * apart), load(im, place + 3 * apart)
                even_re, even_im, odd_re, odd_im = a_re + c_re, a_im + c_im, b_re + d_re, b_im + d_im
                half_re, half_im, turn_re, turn_im = a_re - c_re, a_im - c_im, b_im - d_im, d_re - b_re
                to = q + stride * 4 * p
                store(spare_re, to, even_re + odd_re)
                store(spare_im, to, even_im + odd_im)
                x, y = half_re + turn_re, half_im + turn_im
                store(spare_re, to + stride, cos_1 * x + sin_1 * y)
                store(spare_im, to + stride, cos_1 * y - sin_1 * x)
                x, y = even_re - odd_re, even_im - odd_im
                store(spare_re, to + 2 * stride, cos_2 * x + sin_2 * y)
                store(spare_im, to + 2 * stride, cos_2 * y - sin_2 * x)
                x, y = half_re - turn_re, half_im - turn_im
                store(spare_re, to + 3 * stride, cos_3 * x + sin_3 * y)
                store(spare_im, to + 3 * stride, cos_3 * y - sin_3 * x)
        left, stride = quarter, 4 * stride
        re, spare_re = spare_re, re
        im, spare_im = spare_im, im
    if left == 2:
        for q in range(stride):
            a_re, a_im, b_re, b_im = load(re, q), load(im, q), load(re, q + stride), load(im, q + stride)
            store(spare_re, q, a_re + b_re)
            store(spare_im, q, a_im + b_im)
            store(spare_re, q + stride, a_re - b_re)
            store(spare_im, q + stride, a_im - b_im)
        re, spare_re = spare_re, re
        im, spare_im = spare_im, im
    return re, im, spare_re, spare_im


@compiled
def filtered(re, im, spare_re, spare_im, cosine, sine, gains):
    """Every harmonic of a real signal, in re, times its gain, in place.

    gains: real and imaginary part, shape (2, N, LANES)
    """
    for k in range(re.size // LANES):
        store(im, k, 0.0)
    for inverse in range(2):  # one place where transforms are called is compiled once
        re, im, spare_re, spare_im = transform(re, im, spare_re, spare_im, cosine, sine)
        if inverse == 0:
            for k in range(re.size // LANES):
                x, y, c, s = load(re, k), load(im, k), load(gains, (0, k)), load(gains, (1, k))
                store(re, k, c * x - s * y)
                store(im, k, c * y + s * x)
        re, im, spare_re, spare_im = im, re, spare_im, spare_re


@compiled
def fill_rates(omega, gains):
    """Gains by which z becomes z' omega N / 8, and z'' stands in the imaginary part: one inverse finds both.

    The highest harmonic has no first derivative at the instants.
    """
    count = gains.shape[1]
    alike = omega * count / 8.0  # rates of about one size: what rounds the one would else spoil the other
    for k in range(count):
        rate = omega * (k if 2 * k <= count else k - count)
        store(gains, (0, k), 0.0)
        store(gains, (1, k), ((alike if 2 * k != count else 0.0) - rate) * rate / count)
