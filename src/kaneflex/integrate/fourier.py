"""Fourier transforms of a cycle that lies in lanes: one across the lanes, one along the blocks.

Instant l B + b of N = 8 B is lane l of block b. The sum over the instants is one over l, of eight numbers that lie side
by side, then one over b in all lanes at once (Gentleman and Sande 1966). That over l halves three times and leaves
harmonic 8 q + r in the lane of block q whose number is r with its bits reversed (Van Loan 1992, 1.4); that over b goes
by Stockham's radices three and two (Van Loan 1992, 1.7). B is a power of two, or three times one.

Two real signals are one complex one, x + i y: what is done to both alike needs them no more apart than that. Else
X_k = (Z_k + conj Z_-k) / 2 and i Y_k = (Z_k - conj Z_-k) / 2; the harmonic -k is in block B - 1 - q, of lane 0 in block
B - q, in the lane where `lanes.mirrored` finds it.
"""

import numpy as np

from kaneflex.integrate.conventions import ALONG_COS, ALONG_SIN, COS, SIN
from kaneflex.integrate.lanes import butterfly_1, butterfly_2, butterfly_4, compiled, load, stay_apart, store

_HALF_ROOT = 0.5 * np.sqrt(3.0)


@compiled
def _thirds(re, im, spare_re, spare_im, cosine, sine):
    """The first stage of `_along`, by radix three."""
    third = len(cosine) // 3
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
    while left > 1:
        count, left = count + 1, left // 2
    return count


@compiled
def _along(re, im, spare_re, spare_im, cosine, sine):
    """Sum over b of (re + i im) exp(-2 pi i b q / B), in the order of q, in each lane.

    They end in the spare arrays where `_stages` are odd; all may be longer. The inverse is B times that of (im, re).
    """
    stay_apart()
    left, stride = len(cosine), 1
    if left % 3 == 0:
        _thirds(re, im, spare_re, spare_im, cosine, sine)
        left, stride = left // 3, 3
        re, spare_re = spare_re, re
        im, spare_im = spare_im, im
    while left > 1:
        half = left // 2
        for p in range(half):
            c, s = load(cosine, p * stride), load(sine, p * stride)
            for q in range(stride):
                place, apart, to = q + stride * p, stride * half, q + stride * 2 * p
                a_re, a_im = load(re, place), load(im, place)
                b_re, b_im = load(re, place + apart), load(im, place + apart)
                x, y = a_re - b_re, a_im - b_im
                store(spare_re, to, a_re + b_re)
                store(spare_im, to, a_im + b_im)
                store(spare_re, to + stride, c * x + s * y)
                store(spare_im, to + stride, c * y - s * x)
        left, stride = half, 2 * stride
        re, spare_re = spare_re, re
        im, spare_im = spare_im, im


@compiled
def to_harmonics(x, pair, circle, across, harmonics, spare):
    """Sum over t of x_t exp(-2 pi i k t / N), where two rows of x (blocks, rows, LANES) are the parts of x_t.

    harmonics: for the parts of what is found, (2, blocks, LANES), as `spare`
    """
    stay_apart()
    cosine, sine = circle[COS], circle[SIN]
    c_1, s_1, c_2, s_2 = load(across, 0), load(across, 1), load(across, 2), load(across, 3)
    if _stages(len(x)) % 2:
        harmonics, spare = spare, harmonics
    re, im = harmonics[0], harmonics[1]
    for b in range(len(x)):
        u, v = butterfly_4(load(x, (b, pair[0]))), butterfly_4(load(x, (b, pair[1])))
        u, v = butterfly_2(c_1 * u + s_1 * v), butterfly_2(c_1 * v - s_1 * u)
        u, v = butterfly_1(c_2 * u + s_2 * v), butterfly_1(c_2 * v - s_2 * u)
        c, s = load(cosine, b), load(sine, b)
        store(re, b, c * u + s * v)
        store(im, b, c * v - s * u)
    _along(re, im, spare[0], spare[1], circle[ALONG_COS], circle[ALONG_SIN])


@compiled
def to_instants(harmonics, spare, circle, across, x, pair):
    """N times the inverse of `to_harmonics`, its parts to two rows of x; what it reads is lost."""
    stay_apart()
    cosine, sine = circle[COS], circle[SIN]
    c_1, s_1, c_2, s_2 = load(across, 0), load(across, 1), load(across, 2), load(across, 3)
    _along(harmonics[1], harmonics[0], spare[1], spare[0], circle[ALONG_COS], circle[ALONG_SIN])
    if _stages(len(x)) % 2:
        harmonics = spare
    re, im = harmonics[0], harmonics[1]
    for b in range(len(x)):
        p, q, c, s = load(re, b), load(im, b), load(cosine, b), load(sine, b)
        u, v = butterfly_1(c * p - s * q), butterfly_1(c * q + s * p)
        u, v = butterfly_2(c_2 * u - s_2 * v), butterfly_2(c_2 * v + s_2 * u)
        store(x, (b, pair[0]), butterfly_4(c_1 * u - s_1 * v))
        store(x, (b, pair[1]), butterfly_4(c_1 * v + s_1 * u))
