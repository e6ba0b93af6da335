"""Many models of one scene: each is the scene with settings over it, loaded like the one before, and solved.

Every study is a question put to these: a sweep reads its points of them, sensitivities the neighbours of a run, the
stability over speeds its models; runs whose time counts go one by one, see :mod:`kaneflex.study.runs`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from kaneflex.multibody.model import Model
from kaneflex.scene import Scene, with_settings
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution, read_together

Settings = Sequence[str]
"""Of the form path=value, laid over a scene."""
Solver = Callable[[Model], Solution]
Name = TypeVar("Name", bound=Hashable)
Found = TypeVar("Found")
_TOGETHER, _SOON = 8, 0.1
"""Solutions at most whose sensors are read in one pass, and seconds of solving them: an interrupt loses what waits."""
_LARGE = 4_000_000
"""Numbers in an array by whose end glibc learns to keep the memory of smaller ones for the next, see mallopt(3)."""


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
    wrong with them. Where some have the same equations and are solved at once, their sensors are read in one pass.
    """
    waiting: list[tuple[Name, Solution | Exception]] = []
    begun = 0.0
    np.empty(_LARGE)  # which is not touched; else each pass would ask the system for its pages anew
    for name, model in models.items():
        started = time.perf_counter()
        found: Solution | Exception
        try:
            found = (solver or solve)(model())
        except Exception as error:  # whatever one model breaks, the others are to be computed
            found = error
        if waiting and not _alike(waiting[0][1], found):
            yield from _read(waiting, reader)
            waiting = []
        begun = begun if waiting else started
        waiting.append((name, found))
        if len(waiting) == _TOGETHER or time.perf_counter() - begun > _SOON:
            yield from _read(waiting, reader)
            waiting = []
    yield from _read(waiting, reader)


def _alike(first: Solution | Exception, other: Solution | Exception) -> bool:
    """Whether two solutions are read alike: sensors and equations are the same."""
    if not isinstance(first, Solution) or not isinstance(other, Solution):
        return False
    one, two = first.model, other.model
    return one.reduced is two.reduced and one.scene.sensors == two.scene.sensors


def _read(
    solved: Sequence[tuple[Name, Solution | Exception]], reader: Callable[[Name, Solution], Found]
) -> Iterator[tuple[Name, Found | Exception]]:
    read_together([found for _, found in solved if isinstance(found, Solution)])
    for name, solution in solved:
        found: Found | Exception
        try:
            found = solution if isinstance(solution, Exception) else reader(name, solution)
        except Exception as error:
            found = error
        yield name, found
