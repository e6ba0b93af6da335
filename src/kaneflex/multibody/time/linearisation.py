"""Coupled equations linearised about a motion, in independent coordinates of the tree.

The residual (:mod:`kaneflex.multibody.dynamics.reduction`) is a function D(t, y, y', y'', u) of the independent
coordinates, loads and prescribed accelerations u, zero on the motion. Small motions about it satisfy

    M y'' + C y' + K y = B u,   M = dD/dy'', C = dD/dy', K = dD/dy, B = -dD/du:

these derivatives include geometric stiffening and the loops' kinematics.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kaneflex.generated import joints as laws
from kaneflex.multibody.engine import Engine
from kaneflex.multibody.model import layout as at
from kaneflex.multibody.model.system import CoupledSystem, Unfolded
from kaneflex.multibody.time.linear_equations import OFFSETS, STEP, WEIGHTS, Linear
from kaneflex.multibody.time.load_steps import FARTHEST, in_load_steps
from kaneflex.multibody.time.trajectory import CoupledTrajectory, by_themselves


@dataclass(frozen=True, eq=False)
class Instant:
    """Independent coordinates with rates and accelerations (n,) at the time t [s]."""

    t: float
    y: np.ndarray
    v: np.ndarray
    a: np.ndarray

    def row(self, inputs: int) -> np.ndarray:
        """Argument of :meth:`Engine.demand`."""
        return np.concatenate([[self.t], self.y, self.v, self.a, np.zeros(inputs)])


def prepare(system: CoupledSystem, t: float, q: np.ndarray, v: np.ndarray) -> Engine:
    """Engine at a state of the bodies, with the coordinates of free drives independent if possible."""
    engine = system.engine
    system.fold(q, v)
    drives = engine.tables.acts[engine.count(at.DRIVES) : engine.count(at.LOADS), at.COURSE_AT]
    engine.choose(t, drives[drives >= 0].tolist())
    return engine


def slopes(
    engine: Engine, base: Instant, columns: Sequence[int] | np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Residual D (n,) at an instant and its derivatives by y, v, a, u (n, 3 n + inputs), or by some of these.

    The tables keep that state. Raises ArithmeticError if loops don't close nearby.
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
    """Steps in y, v, a, u about the state of the tables."""
    n, which = engine.size, engine.independent
    measure, (_, v, a, reactions) = engine.numbers(at.MEASURE, n), engine.motion
    rate, acceleration = (max(1.0, (abs(part) / measure).max(initial=0.0)) for part in (v, a))
    loads = engine.count(at.SPRINGS) - engine.count(at.LOADS)
    push = np.full(engine.inputs, max(1.0, abs(reactions).max(initial=0.0)))
    push[loads:] = acceleration
    own = measure[which]
    return np.concatenate([STEP * own, 1e-2 * rate * own, acceleration * own, push])


def equilibrium(engine: Engine, t: float, rates: tuple[np.ndarray, np.ndarray] | None = None) -> Instant | None:
    """Steady deformation under the loads and accelerations at an instant, by Newton's method; None if not found.

    Joints' independent coordinates and rates are those of the tables; their accelerations follow from the equations.
    ``rates``: speeds and accelerations (n,) of the shapes, zero by default.
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
        """State x with the residual ``left``; None if 50 short steps don't converge."""
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
    """Linear equations about an instant. Raises ArithmeticError if loops don't close nearby."""
    n = len(instant.y)
    K, C, M, by_inputs = np.split(slopes(engine, instant)[1], [n, 2 * n, 3 * n], axis=1)
    return Linear(instant, engine.names, M, C, K, -by_inputs)


def at_rest(engine: Engine, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Matrices M and K at the coordinates of the tables, K from strain of shapes and springs without geometric
    stiffness."""
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
    """Relative motion of a spring's ends for small motions ``moved`` (sections, 9) of the speeds.

    Computed as the force of a unit damper, or of a unit spring without direction.
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
    """States around an instant for central differences by y, y' and u.

    Returns a trajectory with four states for each of these, their distances from the instant, and their weights in the
    derivative.
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
                raise ArithmeticError(f"the loops don't close near t = {base.t:.6g} s")
            states.append(state)
    every = Unfolded(**{name: np.concatenate([getattr(state, name) for state in states]) for name in vars(states[0])})
    # free courses need ascending times: instants so close that nothing else changes
    apart = 1e-15 * max(1.0, abs(base.t)) * bool(system.mechanism.free)
    times = base.t + apart * np.arange(len(states))
    trajectory = by_themselves(times, every.q, every.v, every.a, every.reactions)
    return trajectory, away.ravel(), (WEIGHTS / steps[:, None]).ravel()
