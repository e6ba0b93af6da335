"""The two tasks of the kernels: all matrices of a beam element, and a slider-crank's motion and inverse dynamics.

Both are in the symbols of :mod:`kaneflex.derive`, written out, and in numbers: 16 samples, which differ in the length
and the angular velocity of the element and in the time of the motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import sympy as sm

from kaneflex.derive.elements.plane import element_kernel
from kaneflex.derive.generate import Equations, derive_equations
from kaneflex.generated import slider_crank_150
from kaneflex.multibody.model.module_loading import bind_parameters
from kaneflex.scene import read_scene
from kaneflex.scene.structure import structure_of
from kaneflex.support.contract import ELEMENT_KERNELS

SAMPLES = 16


@dataclass(frozen=True)
class Task:
    """Groups of input symbols, the matrices to evaluate, and numbers for the inputs.

    varied : indices (group, place) of the inputs that take the sample's value of ``values``, shape (SAMPLES,).
    """

    name: str
    groups: tuple[tuple[sm.Symbol, ...], ...]
    matrices: dict[str, sm.Matrix]
    numbers: tuple[np.ndarray, ...]
    varied: tuple[tuple[int, int], ...]
    values: np.ndarray

    def sample(self, k: int) -> tuple[np.ndarray, ...]:
        """The inputs of the k-th sample, a group each."""
        found = tuple(group.copy() for group in self.numbers)
        for group, place in self.varied:
            found[group][place] = self.values[k]
        return found

    def arguments(self, k: int) -> tuple[float, ...]:
        """The same as scalars."""
        return tuple(float(number) for group in self.sample(k) for number in group)

    def entries(self) -> int:
        """How many numbers are not zero by structure."""
        return sum(entry != 0 for matrix in self.matrices.values() for entry in matrix)


@cache
def equations() -> Equations:
    return derive_equations(structure_of(read_scene("slider-crank-150")))


def element_task() -> Task:
    """M, K_s, K_d, K_g, C and F of an element in a link that moves as it likes."""
    element = equations().element(equations().theory)
    matrices = {}
    for name in ELEMENT_KERNELS:
        _, raw = element_kernel(name, element)
        outputs = {slot[4:-1]: expression for slot, expression in raw.outputs}
        shape = (6, 1) if name == "F" else (6, 6)
        at = (lambda i, j: f"{i}") if name == "F" else (lambda i, j: f"{i}, {j}")
        matrices[name] = sm.Matrix(*shape, lambda i, j, at=at, found=outputs: found.get(at(i, j), 0))
    generator = np.random.default_rng(42)
    return Task(
        "beam element",
        (tuple(symbol for _, symbol, *_ in element.parameters), tuple(symbol for _, symbol, *_ in element.scalars)),
        matrices,
        (generator.uniform(0.5, 2.0, len(element.parameters)), generator.uniform(0.5, 2.0, len(element.scalars))),
        ((0, [name for name, *_ in element.parameters].index("length")), (1, 0)), np.linspace(0.5, 2.0, SAMPLES),
    )


def motion_task() -> Task:
    """The scalars of the scene slider-crank-150, each written out in time and parameters."""
    parameters = tuple(symbol for symbol, _ in equations().mechanism.parameters.values())
    program = equations().motion.program(parameters)
    known: dict[sm.Symbol, sm.Expr] = {}
    for symbol, expression in program.assignments:
        known[symbol] = expression.xreplace(known)
    numbers = bind_parameters(read_scene("slider-crank-150"), slider_crank_150)[: len(parameters)]
    return Task(
        "slider-crank", ((program.inputs[0],), parameters),
        {"s": sm.Matrix([sm.sympify(expression).xreplace(known) for _, expression in program.outputs])},
        (np.zeros(1), numbers.copy()), ((0, 0),), np.linspace(0.0, 0.04, SAMPLES),
    )
