"""Equations of a planar mechanism in independent coordinates of the tree, for linear models and equilibria."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.mechanism.planar import whole_turns
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.time.linearisation import Equations, Linear, pulled
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves

_FOLLOWED = 128
"""Instants of a cycle, at most 3 degrees apart, from which on the loops of one are closed from those of the last."""


@dataclass(frozen=True, eq=False)
class Instant:
    """Independent coordinates with rates and accelerations (n,) at the time t [s]; ``row``: all of the engine's
    nearby, from which loops are closed."""

    t: float
    y: np.ndarray
    v: np.ndarray
    a: np.ndarray
    row: np.ndarray


def prepare(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> PlanarEquations:
    """Equations at a state of the bodies, with the coordinates of free drives independent if possible."""
    system.fold(q, v)
    _choose(system.engine, t)
    return PlanarEquations(system, system.engine.independent)


def _choose(engine: Engine, t: float) -> None:
    drives = engine.tables.acts[engine.count(at.DRIVES) : engine.count(at.LOADS), at.COURSE_AT]
    engine.choose(t, drives[drives >= 0].tolist())


@dataclass(frozen=True, eq=False)
class PlanarEquations(Equations[Instant]):
    """Equations of a system in independent coordinates ``which`` of its engine, whose tables keep the last instant."""

    system: CoupledSystem
    which: np.ndarray

    @property
    def engine(self) -> Engine:
        return self.system.engine

    @cached_property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        return tuple(self.engine.layout.coordinates[k][0] for k in self.which)

    @cached_property
    def shapes(self) -> np.ndarray:  # type: ignore[override]
        return self.engine.shapes[self.which]

    @cached_property
    def measure(self) -> np.ndarray:  # type: ignore[override]
        return self.engine.numbers(at.MEASURE, self.engine.size)[self.which]

    def now(self, t: float) -> Instant:
        """Instant of the tables."""
        y, v, a = (part[self.which].copy() for part in self.engine.motion[:3])
        return Instant(t, y, v, a, self.engine.row(t))

    def choose(self, base: Instant) -> None:
        """Choose dependent coordinates again as at an instant."""
        self.engine.stand(base.row)
        _choose(self.engine, base.t)

    def at(self, t: float, q: np.ndarray, v: np.ndarray) -> Instant:
        """Instant at a state of the bodies."""
        self.system.fold(q, v)
        return self.now(t)

    def bodies(self, state: Instant) -> tuple[np.ndarray, np.ndarray]:
        """q and v (size,) of the bodies at an instant on the constraints."""
        found = self.system.unfold(state.row[None])
        return found.q[0], found.v[0]

    def scales(self, base: Instant) -> tuple[float, float, np.ndarray]:
        self.residuals(base, np.zeros((1, 0)))
        engine, (_, v, a, reactions) = self.engine, self.engine.motion
        measure = engine.numbers(at.MEASURE, engine.size)
        rate, acceleration = (max(1.0, (abs(part) / measure).max(initial=0.0)) for part in (v, a))
        push = np.full(engine.inputs, max(1.0, abs(reactions).max(initial=0.0)))
        push[engine.count(at.SPRINGS) - engine.count(at.LOADS) :] = acceleration
        return rate, acceleration, push

    def residuals(self, base: Instant, x: np.ndarray, times: np.ndarray | None = None) -> np.ndarray:
        rows = np.zeros((len(x), 1 + 3 * len(self.which) + self.engine.inputs))
        rows[:, 1 : 1 + x.shape[1]] = x
        rows[:, 1 : 1 + 3 * len(self.which)] += np.concatenate([base.y, base.v, base.a])
        rows[:, 0] = base.t if times is None else times
        self.engine.stand(base.row)
        return self.engine.demand(rows)

    def rates(self, base: Instant) -> tuple[np.ndarray, np.ndarray]:
        return base.v, base.a

    def moved(self, base: Instant, x: np.ndarray) -> Instant:
        self.residuals(base, x[None])
        y, v, a = np.split(x, 3)
        return Instant(base.t, base.y + y, base.v + v, base.a + a, self.engine.row(base.t))

    def deformed(self, base: Instant, y: np.ndarray, v: np.ndarray, a: np.ndarray) -> Instant:
        return Instant(base.t, y, v, a, base.row)

    def lacking(self, states: Sequence[Instant]) -> np.ndarray:
        # loops are followed from one instant to the next if these are near each other
        count, found = len(states) if len(states) >= _FOLLOWED else 1, list[np.ndarray]()
        for k in range(0, len(states), count):
            self.engine.stand(states[k].row)
            rows = [np.concatenate([[each.t], each.y, each.v, each.a]) for each in states[k : k + count]]
            found.append(self.engine.demand(np.array(rows)))
        return np.concatenate(found)

    def apart(self, start: Instant, *others: Instant) -> np.ndarray:
        turns = self.engine.turns[self.which]
        found = np.array([[each.y - start.y, each.v - start.v] for each in others])
        found[:, 0, turns] -= whole_turns(found[:, 0, turns])
        return found.reshape(len(others), -1)

    def beside(self, start: Instant, x: np.ndarray) -> Instant:
        engine = self.engine
        self.choose(start)
        for part, move in zip(engine.motion, np.split(x, 2), strict=False):
            part[self.which] += move
        if not engine.project(start.t):
            raise ArithmeticError(f"the loops don't close near t = {start.t:.6g} s")
        return self.now(start.t)

    def mass(self, base: Instant) -> np.ndarray:
        n = len(self.which)
        return self.slopes(base, range(2 * n, 3 * n))[1]

    def rests(self, base: Instant) -> tuple[np.ndarray, Iterator[tuple[np.ndarray, np.ndarray]]]:
        engine, n = self.engine, len(self.which)
        sections, rates, units = [], [], np.zeros((n + 1, 3 * n))
        units[1:, n : 2 * n] = np.eye(n)
        for unit in units:
            self.residuals(base, unit[None])
            rates.append(engine.motion[1].copy())
            sections.append(engine.sections.copy())
        N = (np.array(rates[1:]) - rates[0]).T
        K = N.T @ (np.where(engine.shapes, engine.numbers(at.STIFFNESS, engine.size), 0.0)[:, None] * N)
        return K, self._springs(sections[0], np.array(sections[1:]) - sections[0])

    def _springs(self, sections: np.ndarray, moved: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        engine = self.engine
        for fields in engine.tables.acts[engine.count(at.SPRINGS) : engine.count(at.CONTACTS)]:
            ends, numbers = fields[[at.AT, at.ON]], engine.tables.w[fields[at.NUMBERS_AT] :][:3]
            if fields[at.WHAT] == at.TORSIONAL:
                yield np.diff(moved[:, ends, 5]), numbers[:1]
            else:
                yield pulled(sections[:, :2], moved[:, :, 3:5], ends, numbers)


def probes(system: CoupledSystem, found: Linear[Instant]) -> tuple[CoupledTrajectory, np.ndarray, np.ndarray]:
    """States around an instant for central differences by y, y' and p.

    Returns a trajectory with four states for each of these, their distances from the instant, and their weights in the
    derivative.
    """
    engine, base, n = system.engine, found.instant, len(found.names)
    here = PlanarEquations(system, engine.independent)
    x, away, weights = here.neighbours(base, np.r_[: 2 * n, 3 * n : 3 * n + engine.inputs])
    middle, states = engine.row(base.t), list[Unfolded]()
    for row in x:
        engine.stand(middle)
        engine.motion[0][here.which] += row[:n]
        engine.motion[1][here.which] += row[n : 2 * n]
        engine.numbers(at.INPUT, engine.inputs)[:] = row[3 * n :]
        state = system.unfold(engine.row(base.t)[None]) if engine.project(base.t) else None
        engine.numbers(at.INPUT, engine.inputs)[:] = 0.0
        if state is None:
            raise ArithmeticError(f"the loops don't close near t = {base.t:.6g} s")
        states.append(state)
    every = Unfolded(**{name: np.concatenate([getattr(state, name) for state in states]) for name in vars(states[0])})
    # free courses need ascending times: instants so close that nothing else changes
    apart = 1e-15 * max(1.0, abs(base.t)) * bool(system.mechanism.free)
    times = base.t + apart * np.arange(len(states))
    trajectory = by_themselves(times, every.q, every.v, every.a, every.reactions)
    return trajectory, away.ravel(), weights.ravel()
