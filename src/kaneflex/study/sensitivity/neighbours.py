"""Models whose parameter is a little smaller or larger, and the slope through what is found of them.

A slope is the logarithmic derivative p dx/dp, in the unit of x, at a fixed share of the cycle or of the run: the
difference quotient of fourth order, (x(-2h) - 8 x(-h) + 8 x(h) - x(2h)) / 12 h (Fornberg 1988, Math. Comp. 51). What is
equal in all neighbours has a slope of exactly zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kaneflex.fem.links import mesh
from kaneflex.multibody.model import Model
from kaneflex.solve.loading import neighbour
from kaneflex.study.sensitivity.parameters import Parameter
from kaneflex.support.errors import SceneError

SHARES = (-2, -1, 1, 2)
"""Where the neighbours lie, in relative steps of the parameter."""


def neighbours(model: Model, parameter: Parameter, step: float, frozen: bool) -> list[Model]:
    """Models whose parameter is 1 + share * step times as large, for the shares of SHARES.

    Parameters
    ----------
    step : float
        Relative step from one to the next.
    frozen : bool
        Whether they keep the modal bases.

    Raises
    ------
    SceneError
        If a small change of the parameter changes which equations there are, or what can be assembled.
    """
    structure = parameter.scaled(model.scene, 1.0).structure_hash()
    found = []
    for share in SHARES:
        scene = parameter.scaled(model.scene, 1.0 + share * step)
        if scene.structure_hash() != structure:
            raise SceneError(
                parameter.name, parameter.value, "a small change of it makes other equations",
                "Move it off the value at which the equations change",
            )  # fmt: skip
        if any(len(mesh(scene, name, _elements(model, name))) != len(link.nodes) for name, link in model.links.items()):
            raise SceneError(
                parameter.name, parameter.value, "a small change of it makes another mesh",
                "Move it off the value at which the numbers of elements change",
            )  # fmt: skip
        found.append(neighbour(model, scene, frozen))
    return found


def _elements(model: Model, link: str) -> int:
    return model.options.elements or model.scene.bodies[link].beam.elements


def slope(values: Sequence[np.ndarray], step: float) -> np.ndarray:
    """p dx/dp from the values at the neighbours, in the order of SHARES."""
    lowest, low, high, highest = values
    return (8.0 * (high - low) - (highest - lowest)) / (12.0 * step)


def bend(values: Sequence[np.ndarray], step: float) -> np.ndarray:
    """By how much the difference quotients of second order over 2 h and 4 h differ: h^2 / 2 of the third derivative."""
    lowest, low, high, highest = values
    return (highest - lowest) / (4.0 * step) - (high - low) / (2.0 * step)
