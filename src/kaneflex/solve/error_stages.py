"""Common parts of error estimates: the compared instants of a run, and stages of richer models."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.numbers import mesh
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.response.motion import Motion
from kaneflex.response.sensors import Reader
from kaneflex.scene import Scene
from kaneflex.solve.one_way_run import storing
from kaneflex.solve.run_result import RunResult

Stage = tuple[str, Mapping[str, np.ndarray]]
"""Kind of enrichment, and the sensors' values with it at the compared instants."""
TOGETHER = "together"
"""Kind of a stage with finer time steps, more modes and shorter elements at once."""
Progress = Callable[[float], None]
READ = 256
"""Approximate number of compared instants."""
REQUEST = 'request it by solve.errors = "total"'
"""End of a reason for no estimate that a user can overrule."""


class Unknown(Exception):
    """Effect of a richer model that cannot be computed; the argument is the reason."""


@dataclass(frozen=True, eq=False)
class Read:
    """A run, and the evenly spaced stored instants, about READ, at which its sensors are compared.

    ``run``: the complete run, even if a part of it is asked about; ``stored``: indices of the instants, with contacts
    all; ``periodic``: whether richer models are periodic, too; ``steps``: of the run between two of the instants.
    """

    run: RunResult
    stored: np.ndarray
    periodic: bool
    steps: int

    @classmethod
    def of(cls, solution: RunResult, periodic: bool, apart: int = 1) -> Read:
        """Instants of a run, or of its part, at multiples of ``apart`` stored ones."""
        run = solution
        while run.whole is not None:
            run = run.whole
        reached = int(np.searchsorted(run.times, solution.times[-1], side="right"))
        count = len(run.times) - 1 if periodic else reached
        every = apart * (1 if run.model.scene.contacts else max(1, count // (apart * READ)))
        return cls(run, np.arange(0, count, every), periodic, every * storing(run.model))

    @property
    def model(self) -> Model:
        return self.run.model

    @property
    def times(self) -> np.ndarray:
        return self.run.times[self.stored]

    @cached_property
    def motion(self) -> Motion:
        """Motion of the run at these instants."""
        return self.run.motion.taken(self.stored)

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """Sensors of the run at these instants."""
        return {name: self.run.series[name].values[self.stored] for name in self.model.scene.sensors}


def values_of(motion: Motion, only: Container[str] | None = None) -> dict[str, np.ndarray]:
    """Values of the scene's sensors, (n_times,) each, without ``NAME_rigid``; ``only``: names of those to read."""
    reader, sensors = Reader(motion), motion.model.scene.sensors
    return {name: reader.read(sensor) for name, sensor in sensors.items() if only is None or name in only}


def motion_of(read: Read, richer: Model, coordinates: Rates) -> ElasticMotion:
    """Motion of a model with these coordinates at the compared instants."""
    rigid = read.motion.rigid if richer.motion is read.model.motion else richer.motion.at(read.times)
    return ElasticMotion(richer, rigid, coordinates)


def embedded(richer: Model, motion: ElasticMotion, rate: int = 0) -> np.ndarray:
    """Motion in the coordinates of a richer model, (n, n_times), by the elements' shape functions at its nodes;
    ``rate`` 1: velocities."""
    known = dict(zip(motion.model.coordinates, motion.coordinates[rate], strict=True))
    z = np.zeros((len(richer.coordinates), len(motion.times)))
    nodes = {}
    for name, link in motion.model.links.items():
        q = motion.nodes(name, rate)
        places = (link.locate(x) for x in richer.links[name].nodes)
        n = link.dofs
        moved = (link.shape(e, local)[:n] @ q[n * e : n * (e + 2)] for e, local in places)
        nodes[name] = [dict(zip(link.names, each, strict=True)) for each in moved]
    for row, name in enumerate(richer.coordinates):
        owner, _, place = name.partition(".")
        node, _, component = place.partition(".")
        if owner in nodes and component:
            z[row] = nodes[owner][int(node)][component]
        elif name in known:
            z[row] = known[name]
    return z


def max_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference over instants at which both have a value."""
    found = np.abs(one - other)
    return float(found.max(initial=0.0, where=np.isfinite(found)))


def with_half_elements(scene: Scene) -> Scene:
    """The scene with twice the number of elements, or more where forces divide a link into more than its number."""
    mechanism = mechanism_of(scene)
    finer = {}
    for name, body in scene.bodies.items():
        if body.elastic and body.beam is not None and body.length is not None:
            longest = np.diff(mesh(mechanism, name, body.beam.elements)).max()
            elements = max(2 * body.beam.elements, ceil(2.0 * body.length / longest * (1.0 - 1e-9)))  # but for rounding
            finer[name] = body.model_copy(update={"beam": body.beam.model_copy(update={"elements": elements})})
    return scene.seen(bodies={**scene.bodies, **finer})
