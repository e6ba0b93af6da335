"""Extremes of the numerics alone: a million cycles of an oscillator, and kernels in single precision."""

from __future__ import annotations

import importlib
import math

import numpy as np
from integrate_cases import constant

from kaneflex.integrate.run import Run, integrate

ANGLE_OF_A_STEP = {
    "gauss": lambda x: 2 * math.atan2(x / 2, 1 - x * x / 12),
    "newmark": lambda x: 2 * math.atan2(x / 2, 1),
    "generalised-alpha": lambda x: 2 * math.atan2(x / 2, 1),  # rho_infinity = 1: that of average acceleration
    "exact-modal": lambda x: x,
}
"""Angle [rad] by which a step of omega h = x turns a free vibration: of the methods' own rational functions."""


def drift(method: str, cycles: int, steps: int) -> tuple[float, float, float]:
    """Amplitude gained, phase lost a cycle [rad], and phase unexplained after all cycles [rad], of z'' + z = 0."""
    system, table = constant(np.eye(1), np.zeros((1, 1)), np.eye(1))
    step, count = 2 * np.pi / steps, cycles * steps
    start = (np.ones(1), np.zeros(1))
    run = integrate(Run(
        system, table, 0.0, step, count, method, start=start, period_steps=steps, every=count, rho_infinity=1.0)
    )
    state = run.z[-1, 0] - 1j * run.v[-1, 0]
    turned = ANGLE_OF_A_STEP[method](step)
    unexplained = np.angle(state * np.exp(-1j * math.fmod(turned * count, 2 * np.pi)))
    return float(abs(state) - 1), steps * abs(turned - step), float(abs(unexplained))


def single_precision(scene: str) -> dict[str, float]:
    """Kernel of a shipped scene's elements -> largest difference of float32 from float64, over the largest entry."""
    module = importlib.import_module(f"kaneflex.generated.{scene.replace('-', '_')}")
    random = np.random.default_rng(5)
    typical = {"rho_A": 1.117, "E_A": 2.99e7, "E_I": 1472.0, "length": 0.137}
    p = np.array([typical.get(name, 0.0) for name, *_ in module.ELEMENT_PARAMETERS])
    s = random.normal(size=len(module.LINK_SCALARS)) * 1e3
    found = {}
    for name in ("M", "K_s", "K_d", "K_g", "C", "F"):
        arguments = (p,) if name in ("M", "K_s") else (p, s)
        values = []
        for kind in (np.float64, np.float32):
            out = np.zeros(6 if name == "F" else (6, 6), dtype=kind)
            getattr(module, name)(*(argument.astype(kind) for argument in arguments), out)
            values.append(out.astype(np.float64))
        found[name] = float(abs(values[1] - values[0]).max() / max(abs(values[0]).max(), 1e-300))
    return found
