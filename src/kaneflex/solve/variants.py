"""Variants of one scene: settings over it, loaded with reuse of the previous model, and solved.

Studies use them: a sweep for its points, stability for speeds; runs whose time is measured are loaded separately, see
:mod:`kaneflex.study.runs`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene import Scene, with_settings
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.solve.solution import Solution

Settings = Sequence[str]
"""Settings path=value over a scene."""


@dataclass(frozen=True)
class Variant:
    """A model of a scene: its name, and its settings over the scene."""

    name: str
    settings: tuple[str, ...]

    def of(self, scene: Scene) -> Scene:
        """The scene with these settings."""
        return with_settings(scene, self.settings)


class Variants:
    """Models of one scene, each loaded with the common parts of the previous one."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._last: Model | None = None

    def load(self, settings: Settings) -> Model:
        """Model of the scene with these settings; raises as ``load`` and ``with_settings``."""
        model, last = load(with_settings(self.scene, settings), like=self._last), self._last
        self._last = model if last is None else model.sharing(last)
        return self._last

    def solve(self, settings: Settings) -> Solution:
        """Solution with these settings."""
        return solve(self.load(settings))
