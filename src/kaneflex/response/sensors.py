"""Evaluation of a scene's sensors on a motion."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from kaneflex.response.motion import Motion
from kaneflex.response.readings import Reader
from kaneflex.scene.sensors import DRIVE_KINDS, RIGID_COMPANIONS, Sensor


@dataclass(frozen=True, eq=False)
class Series:
    """Values (n_times,) of a sensor in ``unit`` (SI), and their meaning."""

    values: np.ndarray
    unit: str
    meaning: str


@dataclass(frozen=True, eq=False)
class Read:
    """Name, unit (SI), meaning and function for the values (n_times,) of a series."""

    name: str
    unit: str
    meaning: str
    values: Callable[[], np.ndarray]


OF_RIGID = ", of the rigid mechanism"
"""Ending of the meaning of values that ignore the deformation."""


def reads(motion: Motion, only: Container[str] | None = None) -> Iterator[Read]:
    """Every sensor of the scene, and the rigid value ``NAME_rigid`` of every force.

    ``only``: names of sensors to include.
    """
    reader = Reader(motion)
    for name, sensor in motion.model.scene.sensors.items():
        if only is not None and name not in only:
            continue
        meaning = reader.scene.meaning_of(sensor)
        reaction, frozen = sensor.kind in ("joint_force", *DRIVE_KINDS), motion.model.options.dynamics == "frozen"
        yield Read(name, sensor.unit, meaning + OF_RIGID * (reaction and frozen), partial(reader.read, sensor))
        if sensor.kind in RIGID_COMPANIONS and motion.has_rigid_forces and reader.is_rigid_known(sensor):
            yield Read(f"{name}_rigid", sensor.unit, meaning + OF_RIGID, partial(reader.read_rigid, sensor))


def measure(motion: Motion, only: Container[str] | None = None) -> dict[str, Series]:
    """Values of :func:`reads`."""
    return {each.name: Series(each.values(), each.unit, each.meaning) for each in reads(motion, only)}


def sensor_values(motion: Motion, sensor: Sensor) -> np.ndarray:
    """Values of one sensor (n_times,) in its SI unit."""
    return Reader(motion).read(sensor)
