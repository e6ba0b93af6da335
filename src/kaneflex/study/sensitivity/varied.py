"""A model and its neighbours along one parameter: what it is made of, with slopes.

A slope here is the logarithmic derivative p dx/dp, in the unit of x, at a fixed share of the cycle or of the run. The
constants of a model are sums of products of the scene's numbers, so that central differences of fourth order,
(x(-2) - 8 x(-1) + 8 x(1) - x(2)) / 12, leave rounding only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from types import ModuleType

import numpy as np

from kaneflex.fem.links import mesh
from kaneflex.mechanism.affine import Affine, Monomial
from kaneflex.multibody.binding import Progress, find_tangent_module
from kaneflex.multibody.model import Model
from kaneflex.solve.loading import neighbour
from kaneflex.study.sensitivity.parameters import Parameter
from kaneflex.support.errors import SceneError

STEP = 2e-4
"""Relative step from neighbour to neighbour: what is left out is of its fourth power."""
SHARES = (-2, -1, 1, 2)
_WEIGHTS = np.array([1.0, -8.0, 8.0, -1.0]) / 12.0


def slope_of(values: list[np.ndarray], step: float = STEP) -> np.ndarray:
    """p dx/dp from the values at 1 + share * step times the parameter, for the shares of SHARES."""
    return sum(weight / step * value for weight, value in zip(_WEIGHTS, values, strict=True))


@dataclass(frozen=True, eq=False)
class Varied:
    """A model with neighbours whose parameter is 1 + share * step times as large, for the shares of SHARES.

    ``tangents`` is the module of the motion's slopes, which a coupled model does without.
    """

    model: Model
    parameter: Parameter
    neighbours: tuple[Model, ...]
    tangents: ModuleType | None
    step: float = STEP

    def slope(self, of: Callable[[Model], float | np.ndarray]) -> np.ndarray:
        """p dx/dp of what a function gives of a model."""
        return slope_of([of(model) for model in self.neighbours], self.step)

    @cached_property
    def stretch(self) -> float:
        """p dT/dp / T of the cycle or the run: how its instants move with the parameter."""
        return float(self.slope(lambda model: model.step)) / self.model.step

    @cached_property
    def parameters(self) -> np.ndarray:
        """Slopes of the kernels' argument p."""
        return self.slope(lambda model: model.motion.parameters)

    @cached_property
    def constants(self) -> dict[str, Affine]:
        """Slopes of the constant matrices in M, C, K and F."""
        found = {}
        for key, kept in self.model.kept.items():
            found[key] = Affine.zero(*kept.shape)
            for weight, model in zip(_WEIGHTS, self.neighbours, strict=True):
                found[key] += float(weight / self.step) * model.kept[key]
        return found

    @cached_property
    def monomials(self) -> tuple[Monomial, ...]:
        """The products of motion scalars that the equations or their slopes are made of."""
        monomials = {*self.model.monomials, *(m for slope in self.constants.values() for m in slope.terms)}
        return self.model.motion.ordered(monomials)

    def scalars(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The motion's scalars at instants [s] of the model's own run, and their slopes: (n_times, n_scalars) each."""
        motion = self.model.motion
        slopes = np.zeros((len(times), len(motion.column)))
        self.tangents.tabulate_slopes(times, self.stretch * times, motion.parameters, self.parameters, slopes)
        return motion.table(times), slopes


def vary(
    model: Model, parameter: Parameter, frozen: bool, progress: Progress = lambda stage: None, step: float = STEP
) -> Varied:
    """The neighbours of a model along a parameter.

    Parameters
    ----------
    frozen : bool
        Whether they keep its modal bases.
    step : float
        Relative step from one to the next.

    Raises
    ------
    SceneError
        If a small change of the parameter changes which equations there are, or what can be assembled.
    """
    # the module is that of the scene as it is written, also of what the options leave out
    written = parameter.scaled(model.scene, 1.0)
    tangents = find_tangent_module(written, progress)[0] if model.coupled is None else None
    neighbours = []
    for share in SHARES:
        scene = parameter.scaled(model.scene, 1.0 + share * step)
        if scene.structure_hash() != written.structure_hash():
            raise SceneError(
                parameter.name, parameter.value, "a small change of it makes other equations",
                "Move it off the value at which the equations change",
            )  # fmt: skip
        if any(len(mesh(scene, name, _elements(model, name))) != len(link.nodes) for name, link in model.links.items()):
            raise SceneError(
                parameter.name, parameter.value, "a small change of it makes another mesh",
                "Move it off the value at which the numbers of elements change",
            )  # fmt: skip
        neighbours.append(neighbour(model, scene, frozen, tangents))
    return Varied(model, parameter, tuple(neighbours), tangents, step)


def _elements(model: Model, link: str) -> int:
    return model.options.elements or model.scene.bodies[link].beam.elements
