"""What estimates of errors have in common: a run with the instants that are compared, and stages of richer models."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.multibody.model import Model
from kaneflex.response.motion import Motion
from kaneflex.response.sensors import measure
from kaneflex.scene import Scene
from kaneflex.scene.bodies import Body
from kaneflex.solve.simulation import storing
from kaneflex.solve.solution import Solution

Stage = tuple[str, Mapping[str, np.ndarray]]
"""What a richer model adds, and the sensors' values by it at the instants that are read."""
Progress = Callable[[float], None]
READ = 256
"""Instants at about which sensors are compared."""


class Unknown(Exception):
    """What a richer model adds is not found; its argument says why."""


@dataclass(frozen=True, eq=False)
class Read:
    """A run, and the stored instants at which its sensors are compared: about READ, equally far apart.

    run: all of it, where instants or a part of it were asked for; stored: the numbers of these instants
    periodic: whether richer models are to repeat themselves after it
    steps: of the run from one of them to the next
    """

    run: Solution
    stored: np.ndarray
    periodic: bool
    steps: int

    @classmethod
    def of(cls, solution: Solution, periodic: bool) -> Read:
        run = solution
        while run.whole is not None:
            run = run.whole
        reached = int(np.searchsorted(run.times, solution.times[-1], side="right"))
        count = len(run.times) - 1 if periodic else reached
        every = max(1, count // READ)
        return cls(run, np.arange(0, count, every), periodic, every * storing(run.model))

    @property
    def model(self) -> Model:
        return self.run.model

    @property
    def times(self) -> np.ndarray:
        return self.run.times[self.stored]

    @cached_property
    def motion(self) -> Motion:
        """The run at these instants."""
        return self.run.motion.taken(self.stored)

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The sensors of the run."""
        return values_of(self.motion)


def values_of(motion: Motion) -> dict[str, np.ndarray]:
    """The sensors' values, (n_times,) each."""
    return {name: series.values for name, series in measure(motion).items()}


def with_half_elements(scene: Scene) -> Scene:
    """The scene with elements half as long."""
    return scene.seen(bodies={name: _halved(body) if body.elastic else body for name, body in scene.bodies.items()})


def _halved(body: Body) -> Body:
    assert body.beam is not None
    return body.model_copy(update={"beam": body.beam.model_copy(update={"elements": 2 * body.beam.elements})})
