"""Evaluation of all sensors of a run in one compiled pass, from the polynomials of
:mod:`kaneflex.response.polynomials`.

Tracing takes as long as some runs: it pays off for many motions with the same equations, such as the points of a sweep
over speeds. It traces the readers of :mod:`kaneflex.response.sensors`, so that no formula exists twice.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numba import njit

from kaneflex.integrate import conventions
from kaneflex.integrate.conventions import FASTMATH
from kaneflex.mechanism.body_frame import Rates
from kaneflex.response.motion import Motion
from kaneflex.response.polynomials import Readings, sensor_readings
from kaneflex.response.sensors import Series, measure, reads
from kaneflex.scene.sensors import Sensor
from kaneflex.support.fingerprint import made_of
from kaneflex.support.inner import PART

_BLOCK = 32
"""Instants that are read at once, side by side."""


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
        given = np.zeros((own.given + 1, -(-steps // _BLOCK) * _BLOCK))
        moving = np.vstack([motion.rigid.values.T, *(each.T for each in moved)])
        given[: len(moving), :steps] = moving
        for place, body in self.angles.items():
            given[place, :steps] = motion.turned(body)
        given[:, steps:] = given[:, steps - 1 : steps]
        given[-1] = 1.0
        found = np.empty((len(own.sensors), given.shape[1]))
        entries = int((own.stages[:, 1] * (own.stages[:, 2] + 1)).max())
        work = np.empty((own.count, _BLOCK)), np.empty((entries + 1, _BLOCK))
        _read(given, own.stages, own.ends, own.pairs, own.constants, *work, found)
        return found[:, :steps]


@njit(error_model="numpy", fastmath=FASTMATH, _nrt=False, **PART)
def _solve(rows, n, entries, numbers, place):
    """Least-squares solution x of A x = b, stored in `numbers` from ``place`` on, by Householder reflections (Golub
    and Van Loan 2013, 5.3).

    ``entries``: A, row by row, then b, and a row of work; all are overwritten.
    """
    along = entries[rows * (n + 1)]
    for k in range(n):
        own, begin = entries[k * n + k], numbers[place + k]  # of the solution until it is known: the diagonal of R
        for t in range(_BLOCK):
            along[t] = 0.0
        for i in range(k, rows):
            for t in range(_BLOCK):
                along[t] += entries[i * n + k, t] * entries[i * n + k, t]
        for t in range(_BLOCK):
            begin[t] = -np.copysign(np.sqrt(along[t]), own[t])
            own[t] -= begin[t]
        for j in range(k + 1, n + 1):
            column, apart = (j, n) if j < n else (rows * n, 1)
            for t in range(_BLOCK):
                along[t] = 0.0
            for i in range(k, rows):
                for t in range(_BLOCK):
                    along[t] += entries[column + i * apart, t] * entries[i * n + k, t]
            for t in range(_BLOCK):
                along[t] /= begin[t] * own[t]
            for i in range(k, rows):
                for t in range(_BLOCK):
                    entries[column + i * apart, t] += along[t] * entries[i * n + k, t]
    for back in range(n):
        k = n - 1 - back
        found, known = numbers[place + k], entries[rows * n + k]
        for j in range(k + 1, n):
            for t in range(_BLOCK):
                known[t] -= entries[k * n + j, t] * numbers[place + j, t]
        for t in range(_BLOCK):
            found[t] = known[t] / found[t]


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True, _nrt=False)
@made_of(conventions.__file__)
def _read(given, stages, ends, pairs, constants, numbers, entries, found):
    """Evaluate the sensors (n_sensors, n_times) from given numbers and a one, (n_given + 1, n_times).

    ``n_times``: a multiple of _BLOCK; ``stages``, ``ends``, ``pairs``, ``constants``: see `Readings`; ``numbers``,
    ``entries``: work for one block of instants, (count, _BLOCK) and (most sums of a system + 1, _BLOCK).
    """
    width = given.shape[0]
    for begin in range(0, given.shape[1], _BLOCK):
        for k in range(width):
            for t in range(_BLOCK):
                numbers[k, t] = given[k, begin + t]
        place, row, term = width, 0, 0
        for stage in range(stages.shape[0]):
            own, rows, n = stages[stage, 0], stages[stage, 1], stages[stage, 2]
            for k in range(own + rows * (n + 1)):
                total = numbers[place + k] if k < own else entries[k - own]
                for t in range(_BLOCK):
                    total[t] = 0.0
                for each in range(term, ends[row]):
                    one, other = numbers[pairs[each, 0]], numbers[pairs[each, 1]]
                    for t in range(_BLOCK):
                        total[t] += constants[each] * one[t] * other[t]
                term = ends[row]
                row += 1
                if k >= own and n == 0:
                    for t in range(_BLOCK):
                        found[k - own, begin + t] = total[t]
            place += own
            if n > 0:
                _solve(rows, n, entries, numbers, place)
                place += n
