"""Fourier transforms of a cycle that lies in lanes: one across the lanes, one along the blocks.

Instant l B + b of N = 8 B is lane l of block b, harmonic 8 q + r lane r of block q. So the sum over the instants is one
over l, of eight numbers that lie side by side, then one over b in all lanes at once (Gentleman and Sande 1966), in
Stockham's order by radices three, four and two (Van Loan 1992, 1.7). B is a power of two, or three times one.
"""

from functools import lru_cache

import numpy as np

from kaneflex.integrate.lanes import LANES, aligned, lane, load, stay_apart, store
from kaneflex.integrate.matrices import compiled

COS, SIN, ALONG_COS, ALONG_SIN, ORDER, ODD, ONCE, HIGH = range(8)
"""Rows of `turns`."""
_HALF_ROOT = 0.5 * np.sqrt(3.0)


@lru_cache(maxsize=16)
def turns(count: int) -> tuple[np.ndarray, np.ndarray]:
    """What transforms of so many instants read: shapes (8, N / LANES, LANES) and (2, LANES, LANES).

    The rows: cosine and sine of 2 pi b r / N; of 2 pi b LANES / N; of each harmonic its order, from -N / 2 on; the same
    with none of the highest, which has no derivative at the instants; and one for those that are not the conjugates of
    others, and one for those of them in the highest quarter. Then cosine and sine of 2 pi l r / LANES.
    """
    blocks, side = count // LANES, np.arange(LANES)
    along = np.arange(blocks)[:, None]
    angle, angle_along = 2.0 * np.pi / count * along * side, 2.0 * np.pi / blocks * along + 0.0 * side
    k = LANES * along + side
    order = np.where(2 * k <= count, k, k - count)
    once = 2 * k <= count
    rows = (np.cos(angle), np.sin(angle), np.cos(angle_along), np.sin(angle_along),
            order, np.where(2 * k == count, 0, order), once, once & (8 * k >= 3 * count))  # fmt: skip
    found, eighths = aligned(len(rows), blocks, LANES), aligned(2, LANES, LANES)
    found[...] = rows
    across = 2.0 * np.pi / LANES * (np.outer(side, side) % LANES)
    eighths[...] = np.cos(across), np.sin(across)
    return found, eighths


@compiled
def _thirds(re, im, spare_re, spare_im, cosine, sine):
    """The first stage of `_along`, by radix three."""
    third = len(re) // 3
    for p in range(third):
        cos_1, sin_1, cos_2, sin_2 = load(cosine, p), load(sine, p), load(cosine, 2 * p), load(sine, 2 * p)
        a_re, a_im = load(re, p), load(im, p)
        b_re, b_im = load(re, p + third), load(im, p + third)
        c_re, c_im = load(re, p + 2 * third), load(im, p + 2 * third)
        both_re, both_im = b_re + c_re, b_im + c_im
        turn_re, turn_im = _HALF_ROOT * (b_im - c_im), _HALF_ROOT * (c_re - b_re)
        half_re, half_im = a_re - 0.5 * both_re, a_im - 0.5 * both_im
        store(spare_re, 3 * p, a_re + both_re)
        store(spare_im, 3 * p, a_im + both_im)
        x, y = half_re + turn_re, half_im + turn_im
        store(spare_re, 3 * p + 1, cos_1 * x + sin_1 * y)
        store(spare_im, 3 * p + 1, cos_1 * y - sin_1 * x)
        x, y = half_re - turn_re, half_im - turn_im
        store(spare_re, 3 * p + 2, cos_2 * x + sin_2 * y)
        store(spare_im, 3 * p + 2, cos_2 * y - sin_2 * x)


@compiled
def _stages(blocks):
    """Stages of `_along`: after each the numbers lie in the other two arrays."""
    count, left = 0, blocks
    if left % 3 == 0:
        count, left = 1, left // 3
    while left > 2:
        count, left = count + 1, left // 4
    return count + (left == 2)


@compiled
def _along(re, im, spare_re, spare_im, cosine, sine):
    """Sum over b of (re + i im) exp(-2 pi i b q / B), in the order of q, in each lane.

    It ends in the spare arrays where `_stages` are odd. The inverse is B times that of (im, re).
    """
    stay_apart()
    left, stride = len(re), 1
    if left % 3 == 0:
        _thirds(re, im, spare_re, spare_im, cosine, sine)
        left, stride = left // 3, 3
        re, spare_re = spare_re, re
        im, spare_im = spare_im, im
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


@compiled
def to_harmonics(x, row, circle, eighths, signals):
    """Sum over t of row `row` of x (blocks, rows, LANES) at t times exp(-2 pi i k t / N).

    signals: (4, blocks, LANES) or more; the real part comes to the first, the imaginary part to the second
    """
    stay_apart()
    cosine, sine = circle[COS], circle[SIN]
    first = 2 * (_stages(len(x)) % 2)
    re, im = signals[first], signals[first + 1]
    for b in range(len(x)):
        u = v = 0.0 * load(x, (b, row))
        for k in range(LANES):
            number = lane(x, (b, row), k)
            u += number * load(eighths, (0, k))
            v -= number * load(eighths, (1, k))
        c, s = load(cosine, b), load(sine, b)
        store(re, b, c * u + s * v)
        store(im, b, c * v - s * u)
    _along(re, im, signals[2 - first], signals[3 - first], circle[ALONG_COS], circle[ALONG_SIN])


@compiled
def to_instants(signals, circle, eighths, row, x, y):
    """N times the inverse of `to_harmonics`, real part to row `row` of x, imaginary part to that of y if it has any."""
    stay_apart()
    _along(signals[1], signals[0], signals[3], signals[2], circle[ALONG_COS], circle[ALONG_SIN])
    first = 2 * (_stages(len(x)) % 2)
    re, im, cosine, sine = signals[first], signals[first + 1], circle[COS], circle[SIN]
    for b in range(len(x)):
        u, v, c, s = load(re, b), load(im, b), load(cosine, b), load(sine, b)
        store(re, b, c * u - s * v)
        store(im, b, c * v + s * u)
    for b in range(len(x)):
        u = 0.0 * load(re, b)
        for k in range(LANES):
            u += lane(re, b, k) * load(eighths, (0, k)) - lane(im, b, k) * load(eighths, (1, k))
        store(x, (b, row), u)
    for b in range(len(y)):
        v = 0.0 * load(re, b)
        for k in range(LANES):
            v += lane(re, b, k) * load(eighths, (1, k)) + lane(im, b, k) * load(eighths, (0, k))
        store(y, (b, row), v)
