"""Slopes of the coupled equations: how their residuals change along one direction of the parameters and of the time.

Forward mode on the Programs of

    R = (M a - f - G^T lambda, G a + gamma),    g,    g_t + G v

with q, v, a and lambda held. How R follows those, the kernel ``tangent`` of the scene's own coupled module says.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import sympy as sm

from kaneflex.derive import emit
from kaneflex.derive.coupled import CoupledEquations, Shapes, residual
from kaneflex.derive.coupled_module import equations_of, state_reads
from kaneflex.derive.lookups import T
from kaneflex.derive.program import Program, share
from kaneflex.derive.tangent import is_fixed, slope, slopes, slopes_text

Progress = Callable[[str], None]

_DOCS = {
    "residual_slope": "Slope R (n + m,) of (M a - f - G^T lambda, G a + gamma) at given q, v, a and multipliers.",
    "closing_slope": "Slopes of the constraints' residuals g (m,) and of their rates g_t + G v (m,) at given q, v.",
}
_ARGUMENTS = {
    "residual_slope": ("t", "t_slope", "q", "v", "a", "multipliers", "p", "p_slope", "R"),
    "closing_slope": ("t", "t_slope", "q", "v", "p", "p_slope", "g", "rate"),
}


def generate_coupled_tangent(
    scene: Any, shapes: Shapes, structure: str, progress: Progress = lambda stage: None
) -> str:
    """Text of the module of the coupled equations' slopes, under the structure hash of that module."""
    progress("slopes of the coupled equations")
    equations = equations_of(scene.structure(), shapes)
    kernels = [_kernel(equations, raw, more) for raw, more in _programs(equations)]
    progress("module text")
    return slopes_text(equations.mechanism.names, structure, kernels, (), "--coupled --slopes")


def _programs(equations: CoupledEquations) -> list[tuple[Program, list[tuple[sm.Symbol, str]]]]:
    """What is differentiated, and where it finds what it reads beside the state."""
    found, v, rows = residual(equations), equations.v, equations.rows
    closing = [(f"g[{i}]", row.residual) for i, row in enumerate(rows)]
    for i, row in enumerate(rows):
        entries = (found.jacobian[i, j] * v[j] for j in range(len(v)) if found.jacobian[i, j] != 0)
        closing.append((f"rate[{i}]", sum(entries, row.rate)))
    balance = [(f"R[{k}]", entry) for k, entry in enumerate(found.entries)]
    more = [(symbol, f"a[{k}]") for k, symbol in enumerate(found.a)]
    more += [(symbol, f"multipliers[{k}]") for k, symbol in enumerate(found.multipliers)]
    inputs = (*equations.inputs, *(symbol for symbol, _ in more))
    return [
        (Program("residual", inputs, equations.steps, tuple(balance)), more),
        (Program("closing", equations.inputs, equations.steps, tuple(closing)), []),
    ]


def _kernel(
    equations: CoupledEquations, program: Program, more: list[tuple[sm.Symbol, str]]
) -> tuple[emit.Kernel, Program]:
    held = [*equations.q, *equations.v, *(symbol for symbol, _ in more)]
    held += [symbol for path, (symbol, _) in equations.parameters.items() if is_fixed(path)]
    raw = slopes(program, f"{program.name}_slope", held)
    reads = [*state_reads(equations), *more, (slope(T), "t_slope")]
    reads += [
        (slope(symbol), f"p_slope[{k}]")
        for k, (symbol, _) in enumerate(equations.parameters.values())
        if symbol not in held
    ]
    about = "along p_slope, where the time moves by t_slope.\n\np: PARAMETERS of the coupled module, then its tables'"
    doc = f"{_DOCS[raw.name]}\n\nTaken {about} blocks. Outputs: zeros."
    return emit.Kernel(share(raw), _ARGUMENTS[raw.name], tuple(reads), doc), raw
