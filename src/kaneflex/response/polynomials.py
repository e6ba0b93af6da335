"""What sensors read as sums of products of the motion's scalars and the elastic coordinates, at one instant.

For who has no Python, and for who reads many motions (:mod:`kaneflex.response.compiled_readings`). The readers of a
motion add and multiply what they are given, solve equations, and take lengths and angles. So they are given, in place
of numbers at instants, one instant of unknowns, and hand back what they do with them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Real

import numpy as np

from kaneflex.mechanism.body_frame import Rates
from kaneflex.mechanism.rigid_motion import RigidMotion
from kaneflex.multibody.model import Model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.response.sensors import reads

Terms = Mapping[tuple[int, int], float]
"""A sum: places of two numbers -> what is before their product."""
_SWING = 6.0
"""Range of an angle [rad] below which a body is one that swings."""
_SHORT = 2
"""Terms of a sum that are not worth a number of their own."""


@dataclass(frozen=True, eq=False)
class Readings:
    """What sensors read of the numbers of an instant, each a sum of constant x number x number before it.

    The numbers stand in this order: scalars of the motion, z, z' and z'', angles of the `turned`; one; then those of
    each stage: its sums, and the unknowns x of its system A x = b, of which A and b are sums, too. With more rows than
    unknowns x makes the sum of squares of A x - b least. Two unknowns without rows are length and angle of a plane's
    vector, whose components are sums.

    Attributes
    ----------
    sensors : tuple of str
        In the order of the last sums.
    turned : tuple of str
        Bodies whose angles in the rigid motion are given, continuous over turns.
    given, count : int
        Numbers before the one, and in all.
    stages : ndarray (n_systems + 1, 3)
        Of each its sums that are numbers, then the rows and the unknowns of its system, whose sums follow: A, row by
        row, and b; or a vector's x and y. The sensors are the rows of the last one, which has no unknowns.
    ends : ndarray
        Where the terms of each sum end.
    pairs, constants : ndarray
        Places of the two numbers of each term, (n_terms, 2), and what is before them.
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
    """Numbers in the order in which they follow from each other: ``sums`` has those after the one.

    None stands there for an unknown; systems are (place of the first unknown, rows, unknowns, sums). ``polar``: whether
    there may be lengths and angles.
    """

    def __init__(self, given: int, polar: bool) -> None:
        self.one, self._polar = given, polar
        self.sums: list[Terms | None] = []
        self.systems: list[tuple[int, int, int, list[Terms]]] = []
        self._places: dict[frozenset[tuple[tuple[int, int], float]], int] = {}

    def given(self) -> np.ndarray:
        """The numbers before the one."""
        return np.array([Polynomial(self, {(place, self.one): 1.0}) for place in range(self.one)], dtype=object)

    def place(self, terms: Terms) -> int:
        """Of the number that is a sum."""
        key = frozenset(terms.items())
        if key not in self._places:
            self.sums.append(terms)
            self._places[key] = self.one + len(self.sums)
        return self._places[key]

    def solve(self, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """A :data:`kaneflex.response.least_squares.Solver`."""
        (rows, n), entries = matrix.shape[1:], (*matrix.ravel(), *right.ravel())
        return np.array([self._unknowns(rows, n, entries)], dtype=object)

    def polar(self, x: Polynomial | float, y: Polynomial | float) -> list[Polynomial]:
        """Length of a vector in a plane, and its angle from -pi to pi."""
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
        """The sum that a number is, if it is one."""
        sums = self.sums[place - self.one - 1 : place - self.one] if place > self.one else []
        return [terms for terms in sums if terms is not None]

    def reached(self, sums: Iterable[Terms]) -> set[int]:
        """Places of all numbers that sums are made of."""
        left, found = list(sums), set[int]()
        while left:
            for place in {place for pair in left.pop() for place in pair} - found:
                found.add(place)
                left += self._own(place)
        return found

    def readings(self, sensors: Mapping[str, Terms], turned: tuple[str, ...]) -> Readings:
        """All that sensors are made of, and nothing else."""
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
        pairs = np.array([(now[a], now[b]) for terms in ordered for a, b in terms], dtype=np.uint64).reshape(-1, 2)
        return Readings(
            (*sensors,), turned, self.one, len(places), np.array(stages),
            np.cumsum([len(terms) for terms in ordered], dtype=np.uint64), pairs,
            np.array([constant for terms in ordered for constant in terms.values()], dtype=float),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Polynomial:
    """Sum of constant x product of two numbers of a tape; it becomes a number of it where it is a factor."""

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
        """A number's place, and what it is to be multiplied by."""
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
        """What NumPy's function of that name calls."""
        return self.tape.polar(self, other)[0]

    def arctan2(self, other: Polynomial | float) -> Polynomial:
        """What NumPy's function of that name calls."""
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
    """One instant of unknowns, among them angles of bodies where these are given.

    Others are those of bodies that swing, about the middle of where they go: how often one has turned all round, an
    instant doesn't say.
    """

    turns: Mapping[str, np.ndarray] = field(kw_only=True)

    def turned(self, body: str) -> np.ndarray:
        if self.turns:
            return self.turns[body]
        middle, frame = self._middle(body), self.rigid.frame(body)
        c, s = math.cos(middle), math.sin(middle)
        return middle + np.arctan2(c * frame.s - s * frame.c, c * frame.c + s * frame.s)

    def _middle(self, body: str) -> float:
        """Of the angles of a body [rad]; raises TypeError where it turns all round."""
        options, period = self.model.options, self.model.scene.period
        times = np.linspace(0.0, max(options.duration, period or 0.0), options.steps + 1)
        frame = self.model.motion.at(times).frame(body)
        angle = np.unwrap(np.arctan2(frame.s, frame.c))
        least, most = float(angle.min()), float(angle.max())
        if not most - least < _SWING:
            raise TypeError(f"{body} turns all round")
        return 0.5 * (least + most)


def _traced(
    model: Model, scalars: np.ndarray, coordinates: Rates, tape: _Tape, turns: Mapping[str, np.ndarray]
) -> ElasticMotion:
    """A motion of one instant of unknowns, in the plane or in space."""
    if not model.scene.is_spatial:
        instant = RigidMotion(model.motion, np.zeros(1), scalars.T)
        return _Traced(model, instant, coordinates, solver=tape.solve, turns=turns)
    from kaneflex.multibody.spatial_motion import SpatialMotion
    from kaneflex.response.spatial_elastic_motion import SpatialElasticMotion

    here = SpatialMotion(model.motion, np.zeros(1), scalars.T)
    return SpatialElasticMotion(model, here, coordinates, solver=tape.solve)


def sensor_readings(model: Model, turned: Sequence[str] = (), rigid: bool = False) -> Readings:
    """What each sensor reads, but for angles of bodies that turn all round.

    Where angles of bodies are given, ``turned``, all are counted from these; no lengths are taken then, so that springs
    between points without direction are left out.

    rigid: whether their rigid values ``NAME_rigid`` stand beside them
    """
    sizes = (len(model.motion.column), *[model.reduced.size] * 3, len(turned))
    tape = _Tape(sum(sizes), polar=not turned)
    scalars, *moved, turns = np.split(tape.given()[:, None], np.cumsum(sizes)[:-1])
    if model.modal_basis is not None:
        moved = [model.modal_basis @ part for part in moved]
    angles, found = dict(zip(turned, turns, strict=True)), {}
    motion = _traced(model, scalars, (moved[0], moved[1], moved[2]), tape, angles)
    for each in reads(motion):
        if not (rigid or each.name in model.scene.sensors):
            continue
        try:
            found[each.name] = tape.terms_of(each.values()[0])
        except (TypeError, AttributeError):  # an angle that is counted, an absolute value
            continue
    return tape.readings(found, tuple(turned))
