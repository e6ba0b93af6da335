"""What sensors read as polynomials of the motion's scalars and the elastic coordinates, for who has no Python.

The readers of a motion only add and multiply what they are given, unless they turn to angles or solve equations. So
they are given, in place of numbers at instants, one instant of unknowns, and hand back what they do with them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np

from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.response.sensors import sensor_values

Product = tuple[int, ...]
"""Sorted numbers of unknowns, repeated for powers."""


@dataclass(frozen=True, eq=False)
class Polynomial:
    """Sum of constant x product of unknowns."""

    terms: Mapping[Product, float]

    def __add__(self, other: Polynomial | float) -> Polynomial:
        terms = dict(self.terms)
        for product, constant in _terms(other).items():
            terms[product] = terms.get(product, 0.0) + constant
        return Polynomial(terms)

    def __mul__(self, other: Polynomial | float) -> Polynomial:
        terms: dict[Product, float] = {}
        for one, a in self.terms.items():
            for another, b in _terms(other).items():
                product = tuple(sorted(one + another))
                terms[product] = terms.get(product, 0.0) + a * b
        return Polynomial({product: constant for product, constant in terms.items() if constant})

    def __neg__(self) -> Polynomial:
        return self * -1.0

    def __sub__(self, other: Polynomial | float) -> Polynomial:
        return self + other * -1.0

    def __rsub__(self, other: float) -> Polynomial:
        return -self + other

    def __truediv__(self, other: float) -> Polynomial:
        if not isinstance(other, Real):
            raise TypeError("not a polynomial: a quotient")
        return Polynomial({product: constant / float(other) for product, constant in self.terms.items()})

    def __pow__(self, power: int) -> Polynomial:
        found = self
        for _ in range(int(power) - 1):
            found = found * self
        return found

    def __bool__(self) -> bool:
        return bool(self.terms)

    __radd__ = __add__
    __rmul__ = __mul__


def _terms(value: Polynomial | float) -> Mapping[Product, float]:
    if isinstance(value, Polynomial):
        return value.terms
    if not isinstance(value, Real):
        raise TypeError(f"neither number nor polynomial: {value!r}")
    return {(): float(value)} if value else {}


polynomials = np.frompyfunc(lambda value: Polynomial(_terms(value)), 1, 1)
"""Of an array of polynomials and numbers."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What sensors read, of scalars of the motion, z, z' and z'', each in their order, and unknowns x after them.

    Attributes
    ----------
    sensors : mapping of str to Polynomial
    systems : sequence of (ndarray of Polynomial (n_rows, n), ndarray of Polynomial (n_rows,))
        A and b of A x = b for the unknowns x, those of each system after those of the ones before, on which A and b
        may depend, too. With more rows than unknowns x makes the sum of squares of A x - b least.
    """

    sensors: Mapping[str, Polynomial]
    systems: Sequence[tuple[np.ndarray, np.ndarray]]


def sensor_readings(model: Model) -> Readings:
    """What each sensor reads, of those that are polynomials of the motion or of joint forces.

    Angles aren't, and springs between points.
    """
    count = len(model.motion.column) + 3 * model.reduced.size
    unknowns = np.array([Polynomial({(k,): 1.0}) for k in range(count)], dtype=object)[:, None]
    scalars, moved = unknowns[: len(model.motion.column)], np.split(unknowns[len(model.motion.column) :], 3)
    if model.modal_basis is not None:
        moved = [model.modal_basis @ part for part in moved]
    systems: list[tuple[np.ndarray, np.ndarray]] = []

    def solver(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        first = count + sum(known.shape[1] for known, _ in systems)
        systems.append((polynomials(matrix[0]), polynomials(right[0])))
        return np.array([[Polynomial({(first + k,): 1.0}) for k in range(matrix.shape[2])]], dtype=object)

    rigid = RigidMotion(model.motion, np.zeros(1), scalars.T)
    motion, found = ElasticMotion(model, rigid, tuple(moved), solver=solver), {}
    for name, sensor in model.scene.sensors.items():
        try:
            value = sensor_values(motion, sensor)[0]
            found[name] = Polynomial(_terms(value))
        except (TypeError, AttributeError):  # an angle, an absolute value
            continue
    return Readings(found, systems)
