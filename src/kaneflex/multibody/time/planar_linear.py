"""Equations of a planar mechanism in independent coordinates of the tree, for linear models and equilibria."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.time.linearisation import Equations, Linear, pulled
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves


@dataclass(frozen=True, eq=False)
class Instant:
    """Independent coordinates with rates and accelerations (n,) at the time t [s]; ``row``: all of the engine's
    nearby, from which loops are closed, if not those of its tables."""

    t: float
    y: np.ndarray
    v: np.ndarray
    a: np.ndarray
    row: np.ndarray | None = None


def prepare(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> PlanarEquations:
    """Equations at a state of the bodies, with the coordinates of free drives independent if possible."""
    engine = system.engine
    system.fold(q, v)
    drives = engine.tables.acts[engine.count(at.DRIVES) : engine.count(at.LOADS), at.COURSE_AT]
    engine.choose(t, drives[drives >= 0].tolist())
    return PlanarEquations(engine)


@dataclass(frozen=True, eq=False)
class PlanarEquations(Equations[Instant]):
    """Equations of an engine with its current independent coordinates; the tables keep the last instant."""

    engine: Engine

    @cached_property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        return self.engine.names

    @cached_property
    def which(self) -> np.ndarray:
        """Numbers of the independent coordinates."""
        return self.engine.independent

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
        if base.row is not None:
            self.engine.stand(base.row)
        return self.engine.demand(rows)

    def rates(self, base: Instant) -> tuple[np.ndarray, np.ndarray]:
        return base.v, base.a

    def moved(self, base: Instant, x: np.ndarray) -> Instant:
        self.residuals(base, x[None])
        y, v, a = np.split(x, 3)
        return Instant(base.t, base.y + y, base.v + v, base.a + a, self.engine.row(base.t))

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
    engine, base, n, here = system.engine, found.instant, len(found.names), PlanarEquations(system.engine)
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
