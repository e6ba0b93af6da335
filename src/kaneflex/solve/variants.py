"""Many models of one scene: each is the scene with settings over it, loaded like the one before, and solved.

Every study is a question put to these: a sweep reads its points of them, sensitivities the neighbours of a run, the
stability over speeds its models; runs whose time counts go one by one, see :mod:`kaneflex.study.runs`.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from kaneflex.multibody.model import Model
from kaneflex.scene import Scene, with_settings
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution

Settings = Sequence[str]
"""Of the form path=value, laid over a scene."""
Solver = Callable[[Model], Solution]
Name = TypeVar("Name", bound=Hashable)
Found = TypeVar("Found")


@dataclass(frozen=True)
class Variant:
    """A model of a scene: its name, and its settings over the scene."""

    name: str
    settings: tuple[str, ...]

    def of(self, scene: Scene) -> Scene:
        """The scene by this model."""
        return with_settings(scene, self.settings)


class Variants:
    """Models of one scene. What one has in common with the one loaded before is taken from that."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._last: Model | None = None

    def load(self, settings: Settings) -> Model:
        """The model of the scene with these settings; raises what ``load`` and ``with_settings`` raise."""
        model, last = load(with_settings(self.scene, settings), like=self._last), self._last
        self._last = model if last is None else model.sharing(last)
        return self._last


def read(
    models: Mapping[Name, Callable[[], Model]],
    reader: Callable[[Name, Solution], Found],
    solver: Solver | None = None,
) -> Iterator[tuple[Name, Found | Exception]]:
    """What is read of each model's solution, in their order, or the exception that came instead.

    They are solved by ``solver``, by default `solve`. What is found of one does not depend on the others, whatever goes
    wrong with them.
    """
    for name, model in models.items():
        found: Found | Exception
        try:
            found = reader(name, (solver or solve)(model()))
        except Exception as error:  # whatever one model breaks, the others are to be computed
            found = error
        yield name, found
