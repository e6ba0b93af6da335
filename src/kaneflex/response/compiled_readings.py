"""Evaluation of all sensors of a run in one compiled pass, from the polynomials of
:mod:`kaneflex.response.polynomials`.

Tracing takes as long as some runs: it pays off for many motions with the same equations, such as the points of a sweep
over speeds. It traces the readers of :mod:`kaneflex.response.sensors`, so that no formula exists twice.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from kaneflex.integrate.conventions import BLOCK
from kaneflex.mechanism.body_frame import Rates
from kaneflex.response.motion import Motion
from kaneflex.response.polynomials import Readings, sensor_readings
from kaneflex.response.sensors import Series, measure, reads
from kaneflex.scene.sensors import Sensor
from kaneflex.support.c_library import FAST, addresses_of, by_address


@dataclass(frozen=True, eq=False)
class CompiledReadings:
    """Sensors of motions of models with the same equations.

    Attributes
    ----------
    sensors : mapping of str to Sensor
        Sensors of the scene.
    readings : Readings
        All traced readings, including rigid values and angles of bodies.
    angles : mapping of int to str
        Index of a given angle -> its body.
    labels : mapping of str to (str, str)
        Series, including those that are not traced -> unit and meaning.
    unread : frozenset of str
        Sensors that are not traced and need the usual reader.
    """

    sensors: Mapping[str, Sensor]
    readings: Readings
    angles: Mapping[int, str]
    labels: Mapping[str, tuple[str, str]]
    unread: frozenset[str]

    @classmethod
    def of(cls, motion: Motion) -> CompiledReadings:
        """Traced readings of the model of a planar motion."""
        model = motion.model
        found = sensor_readings(model, tuple(model.scene.bodies), rigid=True)
        used = {*found.pairs.ravel().tolist()}
        angles = dict(enumerate(found.turned, found.given - len(found.turned)))
        angles = {place: body for place, body in angles.items() if place in used}
        labels = {each.name: (each.unit, each.meaning) for each in reads(motion)}
        return cls(model.scene.sensors, found, angles, labels, frozenset(model.scene.sensors) - {*found.sensors})

    def measure(self, motion: Motion, moved: Rates) -> dict[str, Series] | None:
        """Same as :func:`kaneflex.response.sensors.measure`, but None if a value is not finite.

        ``moved``: integrated coordinates and rates, each (n_times, n).
        """
        found = self._values(motion, moved)
        if not np.isfinite(found).all():
            return None
        values = dict(zip(self.readings.sensors, found, strict=True))
        if self.unread:
            values |= {name: each.values for name, each in measure(motion, self.unread).items()}
            if not all(np.isfinite(values[name]).all() for name in self.unread):
                return None
        return {name: Series(values[name], *label) for name, label in self.labels.items()}

    def _values(self, motion: Motion, moved: Rates) -> np.ndarray:
        """Series (n_sensors, n_times)."""
        own, steps = self.readings, len(motion.times)
        given = np.zeros((own.given + 1, -(-steps // BLOCK) * BLOCK))
        moving = np.vstack([motion.rigid.values.T, *(each.T for each in moved)])
        given[: len(moving), :steps] = moving
        for place, body in self.angles.items():
            given[place, :steps] = motion.turned(body)
        given[:, steps:] = given[:, steps - 1 : steps]
        given[-1] = 1.0
        found = np.empty((len(own.sensors), given.shape[1]))
        entries = int((own.stages[:, 1] * (own.stages[:, 2] + 1)).max())
        work = np.empty((own.count, BLOCK)), np.empty((entries + 1, BLOCK))
        plan = np.array([len(given), given.shape[1], len(own.stages), *own.stages.ravel()], np.int64)
        _loop()(*map(by_address, (plan, own.ends, np.ascontiguousarray(own.pairs), given, own.constants, *work, found)))
        return found[:, :steps]


@cache
def _loop() -> Callable[..., None]:
    """Compiled loop of `kaneflex.response.reading_loop`."""
    (address,) = addresses_of("response.reading_loop", ["read"], ["integrate.conventions"], FAST)
    return ctypes.CFUNCTYPE(None, *(ctypes.c_void_p,) * 8)(address)
