"""The coupled equations linearised about a motion, in independent coordinates of the tree.

What a motion asks for (:mod:`kaneflex.multibody.reduction`) is a function D(t, y, y', y'', u) of the independent
coordinates, of loads and of prescribed accelerations u, and zero where the equations hold. So small motions about it
satisfy

    M y'' + C y' + K y = B u,   M = dD/dy'', C = dD/dy', K = dD/dy, B = -dD/du:

geometric stiffening, the loops and how fast they turn are in these derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kaneflex.generated import joints as laws
from kaneflex.multibody import tables as at
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.linear_equations import OFFSETS, STEP, WEIGHTS, Linear
from kaneflex.multibody.load_steps import FARTHEST, in_load_steps
from kaneflex.multibody.system import CoupledSystem, Unfolded
from kaneflex.multibody.trajectory import CoupledTrajectory, by_themselves


@dataclass(frozen=True, eq=False)
class Instant:
    """Independent coordinates with their rates and accelerations (n,) at the time t [s]."""

    t: float
    y: np.ndarray
    v: np.ndarray
    a: np.ndarray

    def row(self, inputs: int) -> np.ndarray:
        """As an argument of :meth:`Engine.demand`."""
        return np.concatenate([[self.t], self.y, self.v, self.a, np.zeros(inputs)])


def prepare(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> Engine:
    """The engine at a state of the bodies, the coordinates of free drives among the independent ones if they can be."""
    engine = system.engine
    system.fold(q, v)
    drives = engine.tables.acts[engine.count(at.DRIVES) : engine.count(at.LOADS), at.COURSE_AT]
    engine.choose(t, drives[drives >= 0].tolist())
    return engine


def slopes(
    engine: Engine, base: Instant, columns: Sequence[int] | np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """D (n,) at an instant and its derivatives by y, v, a, u (n, 3 n + inputs), or by some of these.

    The tables are left there. Raises ArithmeticError where loops don't close about it.
    """
    inputs = len(engine.numbers(at.INPUT, engine.inputs))
    middle = base.row(inputs)
    engine.demand(middle[None])
    steps = _steps(engine)
    chosen = np.arange(len(steps)) if columns is None else np.asarray(columns, dtype=int)
    rows = np.tile(middle, (4 * len(chosen) + 1, 1))
    for k, column in enumerate(chosen):
        rows[4 * k : 4 * k + 4, 1 + column] += OFFSETS * steps[column]
    found = engine.demand(rows)
    moved = found[:-1].reshape(len(chosen), 4, found.shape[1])
    return found[-1], np.einsum("j,cjn->nc", WEIGHTS, moved) / steps[chosen]


def _steps(engine: Engine) -> np.ndarray:
    """Steps in y, v, a, u about where the tables are."""
    n, which = engine.size, engine.independent
    measure, (_, v, a, reactions) = engine.numbers(at.MEASURE, n), engine.motion
    rate, acceleration = (max(1.0, (abs(part) / measure).max(initial=0.0)) for part in (v, a))
    loads = engine.count(at.SPRINGS) - engine.count(at.LOADS)
    push = np.full(engine.inputs, max(1.0, abs(reactions).max(initial=0.0)))
    push[loads:] = acceleration
    own = measure[which]
    return np.concatenate([STEP * own, 1e-2 * rate * own, acceleration * own, push])


def equilibrium(engine: Engine, t: float, rates: tuple[np.ndarray, np.ndarray] | None = None) -> Instant | None:
    """The motion whose shapes stand still, deformed as its loads and accelerations ask for, by Newton's method.

    Joints' independent coordinates and rates are those of the tables; they take the accelerations that the balance
    leaves them. ``rates``: speeds and accelerations (n,) of the shapes instead of none. None where no balance is found.
    """
    which = engine.independent
    still = engine.shapes[which]
    y, v, a = (part[which].copy() for part in engine.motion[:3])
    a[:] = 0.0
    v[still], a[still] = (0.0, 0.0) if rates is None else (part[still] for part in rates)
    begin, x = engine.row(t), np.where(still, y, a)

    def instant(x: np.ndarray) -> Instant:
        return Instant(t, np.where(still, x, y), v, np.where(still, a, x))

    def corrected(x: np.ndarray, left: np.ndarray) -> np.ndarray | None:
        """x that leaves so much of the demand; None where 50 steps, none of them long, don't lead there."""
        here = engine.row(t)
        try:
            for _ in range(50):
                found, slope = slopes(engine, instant(x), columns)
                step = np.linalg.solve(slope, left - found)
                x, size = x + step, (abs(step) / measure)[still].max(initial=0.0)
                if size < 1e-12:
                    return x
                if not size < FARTHEST:
                    break
        except (ArithmeticError, np.linalg.LinAlgError):
            pass
        engine.stand(here)
        return None

    columns = np.where(still, 0, 2 * len(x)) + np.arange(len(x))
    measure = engine.numbers(at.MEASURE, engine.size)[which]
    try:
        demand = engine.demand(instant(x).row(engine.inputs)[None])[0]
    except ArithmeticError:
        return None
    engine.stand(begin)
    found = in_load_steps(x, demand, corrected)
    return None if found is None else instant(found)


def linear(engine: Engine, instant: Instant) -> Linear[Instant]:
    """The linear equations about an instant. Raises ArithmeticError where loops don't close about it."""
    n = len(instant.y)
    K, C, M, by_inputs = np.split(slopes(engine, instant)[1], [n, 2 * n, 3 * n], axis=1)
    return Linear(instant, engine.names, M, C, K, -by_inputs)


def at_rest(engine: Engine, t: float) -> tuple[np.ndarray, np.ndarray]:
    """M and K where the coordinates of the tables are, K of the strain of shapes and springs, whatever these carry."""
    n, which = len(engine.independent), engine.independent
    if not n:  # everything is prescribed
        return np.zeros((0, 0)), np.zeros((0, 0))
    still = Instant(t, engine.motion[0][which].copy(), np.zeros(n), np.zeros(n))
    M = slopes(engine, still, range(2 * n, 3 * n))[1]
    rows = np.tile(still.row(engine.inputs), (n + 1, 1))
    rows[1:, 1 + n : 1 + 2 * n] = np.eye(n)
    sections, rates = [], []
    for row in rows:
        engine.demand(row[None])
        rates.append(engine.motion[1].copy())
        sections.append(engine.sections.copy())
    N = (np.array(rates[1:]) - rates[0]).T
    K = N.T @ (np.where(engine.shapes, engine.numbers(at.STIFFNESS, engine.size), 0.0)[:, None] * N)
    for fields in engine.tables.acts[engine.count(at.SPRINGS) : engine.count(at.CONTACTS)]:
        parts = np.array([_parts(engine, fields, sections[0], moved - sections[0]) for moved in sections[1:]])
        K += engine.tables.w[fields[at.NUMBERS_AT]] * parts @ parts.T
    return M, K


def _parts(engine: Engine, fields: np.ndarray, sections: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """How far a spring's ends part in a small motion ``moved`` (sections, 9) of the speeds.

    What a unit damper in its place, or where it needs no direction a unit spring, makes of that motion.
    """
    first, second = int(fields[at.AT]), int(fields[at.ON])
    _, c, free = engine.tables.w[fields[at.NUMBERS_AT] :][:3]
    out, sec = np.zeros(at.SPRING_SIZE), sections.copy()
    sec[:, 3:6] = moved[:, 3:6]
    if fields[at.WHAT] == at.TORSIONAL:
        laws.twist(sec.ravel(), first, second, 0.0, 1.0, 0.0, out, 0)
        return out[1:2]
    if c or free:
        laws.pull(sec.ravel(), first, second, 0.0, 1.0, 0.0, out, 0)
    else:
        sec[:, :3] = moved[:, 3:6]
        laws.pull(sec.ravel(), first, second, 1.0, 0.0, 0.0, out, 0)
    return out[2:4]


def probes(system: CoupledSystem, found: Linear[Instant]) -> tuple[CoupledTrajectory, np.ndarray, np.ndarray]:
    """States about an instant, from whose differences derivatives by y, y' and u follow.

    Returns a trajectory with four of them for every one of these, how far each is from the instant, and the weight with
    which it makes up the derivative.
    """
    engine, base, n = system.engine, found.instant, len(found.names)
    engine.demand(base.row(engine.inputs)[None])
    which, middle, steps = engine.independent, engine.row(base.t), _steps(engine)
    steps = np.delete(steps, np.arange(2 * n, 3 * n))
    away = np.outer(steps, OFFSETS)
    states: list[Unfolded] = []
    for k, part in enumerate(away):
        for distance in part:
            engine.stand(middle)
            x = np.zeros(len(steps))
            x[k] = distance
            engine.motion[0][which] += x[:n]
            engine.motion[1][which] += x[n : 2 * n]
            engine.numbers(at.INPUT, engine.inputs)[:] = x[2 * n :]
            state = system.unfold(engine.row(base.t)[None]) if engine.project(base.t) else None
            engine.numbers(at.INPUT, engine.inputs)[:] = 0.0
            if state is None:
                raise ArithmeticError(f"no motion beside that at t = {base.t:.6g} s: its loops don't close")
            states.append(state)
    every = Unfolded(**{name: np.concatenate([getattr(state, name) for state in states]) for name in vars(states[0])})
    # The course of what is free needs an order: instants so close that nothing else depends on their difference.
    apart = 1e-15 * max(1.0, abs(base.t)) * bool(system.mechanism.free)
    times = base.t + apart * np.arange(len(states))
    trajectory = by_themselves(times, every.q, every.v, every.a, every.reactions)
    return trajectory, away.ravel(), (WEIGHTS / steps[:, None]).ravel()
