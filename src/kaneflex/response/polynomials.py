"""Sensors as sums of products of the motion's scalars and the elastic coordinates, at one instant.

Used for exports and for reading many motions (:mod:`kaneflex.response.compiled_readings`). The readers of a motion add
and multiply, solve equations, and take lengths and angles. Here they are called with one instant of symbolic unknowns
instead of numbers, and their operations are recorded.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.response.sensors import reads

Terms = Mapping[tuple[int, int], float]
"""A sum: indices of two numbers -> coefficient of their product."""
_SWING = 6.0
"""Range of an angle [rad] below which a body counts as swinging."""
_SHORT = 2
"""Number of terms up to which a sum is expanded instead of stored as a number."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings of sensors from the numbers of an instant, each a sum of constant x number x number.

    The numbers are, in this order: scalars of the motion, z, z' and z'', angles of the `turned`; one; then for each
    stage its sums, and the unknowns x of its system A x = b, with A and b sums, too. With more rows than unknowns x is
    the least-squares solution. Two unknowns without rows are length and angle of a planar vector, whose components are
    sums.

    Attributes
    ----------
    sensors : tuple of str
        Sensors in the order of the last sums.
    turned : tuple of str
        Bodies whose angles in the rigid motion are given, continuous over turns.
    given, count : int
        Count of numbers before the one, and of all.
    stages : ndarray (n_systems + 1, 3)
        For each stage the number of its sums, then of rows and of unknowns of its system, whose sums follow: A, row by
        row, and b; or a vector's x and y. The sensors are the rows of the last stage, which has no unknowns.
    ends : ndarray
        Ends of the terms of each sum.
    pairs, constants : ndarray
        Indices of the two numbers of each term, (n_terms, 2), and its coefficient.
    """

    sensors: tuple[str, ...]
    turned: tuple[str, ...]
    given: int
    count: int
    stages: np.ndarray
    ends: np.ndarray
    pairs: np.ndarray
    constants: np.ndarray


class _Tape:
    """Recorded numbers in the order of their computation: ``sums`` has those after the one, None for an unknown.

    Systems are (index of the first unknown, rows, unknowns, sums). ``polar``: whether lengths and angles are allowed.
    """

    def __init__(self, given: int, polar: bool) -> None:
        self.one, self._polar = given, polar
        self.sums: list[Terms | None] = []
        self.systems: list[tuple[int, int, int, list[Terms]]] = []
        self._places: dict[frozenset[tuple[tuple[int, int], float]], int] = {}

    def given(self) -> np.ndarray:
        """Numbers before the one."""
        return np.array([Polynomial(self, {(place, self.one): 1.0}) for place in range(self.one)], dtype=object)

    def place(self, terms: Terms) -> int:
        """Index of the number that is this sum."""
        key = frozenset(terms.items())
        if key not in self._places:
            self.sums.append(terms)
            self._places[key] = self.one + len(self.sums)
        return self._places[key]

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """A :data:`kaneflex.response.reactions.Solver`."""
        (rows, n), entries = matrix.shape[1:], (*matrix.ravel(), *right.ravel())
        return np.array([self._unknowns(rows, n, entries)], dtype=object)

    def polar(self, x: Polynomial | float, y: Polynomial | float) -> list[Polynomial]:
        """Length of a planar vector, and its angle from -pi to pi."""
        if not self._polar:
            raise TypeError("neither sum nor product: a length or an angle")
        return self._unknowns(0, 2, (x, y))

    def _unknowns(self, rows: int, n: int, entries: Sequence[Polynomial | float]) -> list[Polynomial]:
        first, sums = self.one + 1 + len(self.sums), [self.terms_of(value) for value in entries]
        self.systems.append((first, rows, n, sums))
        self.sums += [None] * n
        return [Polynomial(self, {(first + k, self.one): 1.0}) for k in range(n)]

    def terms_of(self, value: Polynomial | float) -> Terms:
        if isinstance(value, Polynomial):
            return value.terms
        if not isinstance(value, Real):
            raise TypeError(f"neither number nor polynomial: {value!r}")
        return {(self.one, self.one): float(value)} if value else {}

    def _own(self, place: int) -> list[Terms]:
        """Sum that defines a number, if it is one."""
        sums = self.sums[place - self.one - 1 : place - self.one] if place > self.one else []
        return [terms for terms in sums if terms is not None]

    def reached(self, sums: Iterable[Terms]) -> set[int]:
        """Indices of all numbers on which sums depend."""
        left, found = list(sums), set[int]()
        while left:
            for place in {place for pair in left.pop() for place in pair} - found:
                found.add(place)
                left += self._own(place)
        return found

    def readings(self, sensors: Mapping[str, Terms], turned: tuple[str, ...]) -> Readings:
        """Readings with only the numbers that the sensors need."""
        last = (self.one + 1 + len(self.sums), len(sensors), 0, [*sensors.values()])
        ends = [*self.systems, last]
        needed = self.reached(terms for *_, sums in ends for terms in sums)
        places, begin, stages, ordered = list(range(self.one + 1)), self.one + 1, [], list[Terms]()
        for first, rows, n, sums in ends:
            own = [place for place in range(begin, first) if place in needed]
            places += [*own, *range(first, first + n)]
            begin = first + n
            stages.append((len(own), rows, n))
            ordered += [terms for place in own for terms in self._own(place)] + sums
        now = {place: k for k, place in enumerate(places)}
        pairs = np.array([(now[a], now[b]) for terms in ordered for a, b in terms], dtype=np.int64).reshape(-1, 2)
        return Readings(
            (*sensors,), turned, self.one, len(places), np.array(stages),
            np.cumsum([len(terms) for terms in ordered], dtype=np.int64), pairs,
            np.array([constant for terms in ordered for constant in terms.values()], dtype=float),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Polynomial:
    """Sum of constant x product of two numbers of a tape; as a factor it becomes a number of the tape."""

    tape: _Tape
    terms: Terms

    def __add__(self, other: Polynomial | float) -> Polynomial:
        terms = dict(self.terms)
        for pair, constant in self.tape.terms_of(other).items():
            terms[pair] = terms.get(pair, 0.0) + constant
        return Polynomial(self.tape, {pair: constant for pair, constant in terms.items() if constant})

    def __mul__(self, other: Polynomial | float) -> Polynomial:
        if isinstance(other, Polynomial):
            (a, by), (b, more), one = self._factor(), other._factor(), self.tape.one
            pair = (b, a) if a == one or (b != one and b > a) else (a, b)
            return Polynomial(self.tape, {pair: by * more} if by * more else {})
        if not isinstance(other, Real):
            raise TypeError(f"neither number nor polynomial: {other!r}")
        by, terms = float(other), self.terms
        if len(terms) > _SHORT:
            terms = {(self.tape.place(terms), self.tape.one): 1.0}
        return Polynomial(self.tape, {pair: by * constant for pair, constant in terms.items()} if by else {})

    def _factor(self) -> tuple[int, float]:
        """Index of a number, and its coefficient."""
        if not self.terms:
            return self.tape.one, 0.0
        pair, constant = next(iter(self.terms.items()))
        if len(self.terms) == 1 and pair[1] == self.tape.one:
            return pair[0], constant
        return self.tape.place(self.terms), 1.0

    def __neg__(self) -> Polynomial:
        return self * -1.0

    def __sub__(self, other: Polynomial | float) -> Polynomial:
        return self + other * -1.0

    def __rsub__(self, other: float) -> Polynomial:
        return -self + other

    def __truediv__(self, other: Polynomial | float) -> Polynomial:
        if isinstance(other, Polynomial):
            return self.tape.solve(np.array([[[other]]]), np.array([[self]]))[0, 0]
        return self * (1.0 / float(other))

    def hypot(self, other: Polynomial | float) -> Polynomial:
        """Called by numpy.hypot."""
        return self.tape.polar(self, other)[0]

    def arctan2(self, other: Polynomial | float) -> Polynomial:
        """Called by numpy.arctan2."""
        return self.tape.polar(other, self)[1]

    def __pow__(self, power: int) -> Polynomial:
        found = self
        for _ in range(int(power) - 1):
            found = found * self
        return found

    def __bool__(self) -> bool:
        return bool(self.terms)

    __radd__ = __add__
    __rmul__ = __mul__


@dataclass(frozen=True, eq=False)
class _Traced(ElasticMotion):
    """One instant of unknowns, with angles of bodies if given.

    Other angles are those of swinging bodies, about the middle of their range: full turns are not known from one
    instant.
    """

    turns: Mapping[str, np.ndarray] = field(kw_only=True)

    def turned(self, body: str) -> np.ndarray:
        if self.turns:
            return self.turns[body]
        middle, frame = self._middle(body), self.rigid.frame(body)
        c, s = math.cos(middle), math.sin(middle)
        return middle + np.arctan2(c * frame.s - s * frame.c, c * frame.c + s * frame.s)

    def _middle(self, body: str) -> float:
        """Middle of a body's angle range [rad]; raises TypeError if it makes full turns."""
        options, period = self.model.options, self.model.scene.period
        times = np.linspace(0.0, max(options.duration, period or 0.0), options.steps + 1)
        frame = self.model.motion.at(times).frame(body)
        angle = np.unwrap(np.arctan2(frame.s, frame.c))
        least, most = float(angle.min()), float(angle.max())
        if not most - least < _SWING:
            raise TypeError(f"{body} turns all round")
        return 0.5 * (least + most)


def sensor_readings(model: Model, turned: Sequence[str] = (), rigid: bool = False) -> Readings:
    """Readings of each sensor, except angles of bodies with full turns.

    With given angles ``turned``, all angles count from these, and no lengths are taken, so that springs between points
    without direction are left out. ``rigid``: include the rigid values ``NAME_rigid``.
    """
    sizes = (len(model.motion.column), *[model.reduced.size] * 3, len(turned))
    tape = _Tape(sum(sizes), polar=not turned)
    scalars, *moved, turns = np.split(tape.given()[:, None], np.cumsum(sizes)[:-1])
    if model.modal_basis is not None:
        moved = [model.modal_basis @ part for part in moved]
    angles, found = dict(zip(turned, turns, strict=True)), {}
    instant = replace(model.motion.at(0.0), values=scalars.T)
    motion = _Traced(model, instant, (moved[0], moved[1], moved[2]), solver=tape.solve, turns=angles)
    for each in reads(motion):
        if not (rigid or each.name in model.scene.sensors):
            continue
        try:
            found[each.name] = tape.terms_of(each.values()[0])
        except (TypeError, AttributeError):  # an angle with full turns, an absolute value
            continue
    return tape.readings(found, tuple(turned))
