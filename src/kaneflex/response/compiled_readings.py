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

from kaneflex.integrate import conventions, lanes
from kaneflex.integrate.conventions import FASTMATH, LANES, aligned
from kaneflex.integrate.lanes import ONE, ZERO, compiled, less, load, root, store
from kaneflex.mechanism.body_frame import Rates
from kaneflex.response.motion import Motion
from kaneflex.response.polynomials import Readings, sensor_readings
from kaneflex.response.sensors import Series, measure, reads
from kaneflex.scene.sensors import Sensor
from kaneflex.support.fingerprint import made_of


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
        rows, column = np.zeros((-(-steps // LANES) * LANES, own.given + 1)), 0
        for part in (motion.rigid.values, *moved):
            rows[:steps, column : column + part.shape[1]] = part
            column += part.shape[1]
        for place, body in self.angles.items():
            rows[:steps, place] = motion.turned(body)
        rows[:, -1] = 1.0
        rows[steps:] = rows[steps - 1]
        found = np.empty((len(own.sensors), len(rows) // LANES, LANES))
        entries = int((own.stages[:, 1] * (own.stages[:, 2] + 1)).max())
        work = aligned(own.count, LANES), aligned(max(entries, 1), LANES)
        _read(rows, own.stages, own.ends, own.pairs, own.constants, *work, found)
        return found.reshape(len(found), -1)[:, :steps]


@compiled
def _solve(rows, n, entries, numbers, place):
    """Least-squares solution x of A x = b, stored in `numbers` from ``place`` on, by Householder reflections (Golub
    and Van Loan 2013, 5.3).

    ``entries``: A, row by row, then b; both are overwritten.
    """
    for k in range(n):
        pivot = load(entries, k * n + k)
        square = pivot * pivot
        for i in range(k + 1, rows):
            square += load(entries, i * n + k) * load(entries, i * n + k)
        length = root(square) * (2.0 * less(pivot, 0.0 * pivot) - 1.0)  # opposite sign of the pivot
        store(entries, k * n + k, pivot - length)
        scale = 1.0 / (square - pivot * length)
        for j in range(k + 1, n + 1):
            column, apart = (j, n) if j < n else (rows * n, 1)
            along = 0.0 * pivot
            for i in range(k, rows):
                along += load(entries, i * n + k) * load(entries, column + i * apart)
            along = along * scale
            for i in range(k, rows):
                changed = load(entries, column + i * apart) - along * load(entries, i * n + k)
                store(entries, column + i * apart, changed)
        store(entries, k * n + k, length)
    for back in range(n):
        k = n - 1 - back
        known = load(entries, rows * n + k)
        for j in range(k + 1, n):
            known -= load(entries, k * n + j) * load(numbers, place + j)
        store(numbers, place + k, known / load(entries, k * n + k))


@njit(cache=True, error_model="numpy", fastmath=FASTMATH, no_cfunc_wrapper=True, _nrt=False)
@made_of(conventions.__file__, lanes.__file__)
def _read(given, stages, ends, pairs, constants, numbers, entries, found):
    """Evaluate the sensors (n_sensors, n_times / LANES, LANES) from given numbers and a one, (n_times, n_given + 1).

    ``n_times``: a multiple of LANES; ``stages``, ``ends``, ``pairs``, ``constants``: see `Readings`; ``numbers``,
    ``entries``: work, (count, LANES) and (most sums of a system, LANES).
    """
    width = given.shape[1]
    for begin in range(0, given.shape[0], LANES):
        for k in range(width):
            for lane in range(LANES):
                numbers[k, lane] = given[begin + lane, k]
        place, row, term = width, ZERO, ZERO
        for stage in range(stages.shape[0]):
            own, rows, n = stages[stage, 0], stages[stage, 1], stages[stage, 2]
            for k in range(own + rows * (n + 1)):
                total = 0.0 * load(numbers, width - 1)
                while term < ends[row]:
                    total += constants[term] * load(numbers, pairs[term, 0]) * load(numbers, pairs[term, 1])
                    term += ONE
                row += ONE
                if k < own:
                    store(numbers, place + k, total)
                elif n > 0:
                    store(entries, k - own, total)
                else:
                    store(found, (k - own, begin // LANES), total)
            place += own
            if n > 0:
                _solve(rows, n, entries, numbers, place)
                place += n
