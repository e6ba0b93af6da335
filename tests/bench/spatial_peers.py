"""The kernels of an element in space in two ways: our own, and hand-written C (`spatial_kernels.c`).

There are 16 samples of all parameters and scalars, which a loop takes in turn.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numba import njit

from bench.compiled import HERE, compile_c, pointer
from kaneflex.generated import spatial_beam_euler_bernoulli as generated
from kaneflex.generated.spatial_beam_euler_bernoulli import K_d, K_g, K_s, M
from kaneflex.support.contract import ELEMENT_KERNELS

SAMPLES = 16
NAME = "beam element in space"
OF_PARAMETERS = "M", "K_s"
"""Kernels that don't depend on the motion."""

Many = Callable[[int], object]
"""So many evaluations in one compiled loop."""


def library(folder: Path, compiler: str) -> ctypes.CDLL:
    return compile_c(HERE / "spatial_kernels.c", folder, compiler)


def samples() -> tuple[np.ndarray, np.ndarray]:
    """Rows of ELEMENT_PARAMETERS and of LINK_SCALARS."""
    generator = np.random.default_rng(42)
    tables = generated.ELEMENT_PARAMETERS, generated.LINK_SCALARS
    parameters, scalars = (generator.uniform(0.5, 2.0, (SAMPLES, len(table))) for table in tables)
    return parameters, scalars


def zeros() -> dict[str, np.ndarray]:
    return {name: np.zeros(12 if name == "F" else (12, 12)) for name in ELEMENT_KERNELS}


@njit
def element_many(n, parameters, scalars, m, k_s, k_d, k_g, c, f):
    for i in range(n):
        p, s = parameters[i & 15], scalars[i & 15]
        M(p, m)
        K_s(p, k_s)
        K_d(p, s, k_d)
        K_g(p, s, k_g)
        generated.C(p, s, c)
        generated.F(p, s, f)


def loop(name: str) -> Callable[..., None]:
    """The loop of spatial_kernels.c around one generated kernel."""
    kernel = getattr(generated, name)

    @njit
    def of_parameters(n, parameters, scalars, out):
        for i in range(n):
            kernel(parameters[i & 15], out)

    @njit
    def of_motion(n, parameters, scalars, out):
        for i in range(n):
            kernel(parameters[i & 15], scalars[i & 15], out)

    return of_parameters if name in OF_PARAMETERS else of_motion


def disagreement(hand: ctypes.CDLL) -> float:
    """Largest difference of both over all samples and kernels, relative to each matrix's largest entry."""
    worst = 0.0
    for p, s in zip(*samples(), strict=True):
        ours, theirs = zeros(), zeros()
        element_many(1, p[None], s[None], *ours.values())
        hand.element_many(ctypes.c_long(1), pointer(p), pointer(s), *map(pointer, theirs.values()))
        for name, matrix in ours.items():
            worst = max(worst, float(abs(matrix - theirs[name]).max() / abs(matrix).max()))
    return worst


def races(hand: ctypes.CDLL) -> Iterator[tuple[str, dict[str, Many]]]:
    """What is timed -> candidates: all kernels one after the other, then each in a loop of its own."""
    inputs, out = samples(), zeros()
    yield NAME, _candidates(hand.element_many, element_many, (*inputs, *out.values()))
    for name in ELEMENT_KERNELS:
        yield f"{name} in space alone", _candidates(getattr(hand, f"{name}_many"), loop(name), (*inputs, out[name]))


def _candidates(in_c: Callable, ours: Callable, arrays: tuple[np.ndarray, ...]) -> dict[str, Many]:
    pointers = [pointer(array) for array in arrays]
    return {"hand-written C": lambda n: in_c(ctypes.c_long(n), *pointers), "kaneflex": lambda n: ours(n, *arrays)}
