"""The single steps of a finished coupled run, found by taking them once more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.coupled import instant, stepping
from kaneflex.coupled.run import FIRST_PASSES, CoupledTrajectory, Method, first_step
from kaneflex.coupled.system import CoupledSystem


@dataclass(frozen=True, eq=False)
class Steps:
    """States (n_steps + 1, ...) at the ends of all steps, as in a trajectory, whose instants are ``rows`` of them."""

    times: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    multipliers: np.ndarray
    rows: np.ndarray


def every_step(system: CoupledSystem, trajectory: CoupledTrajectory, method: Method) -> Steps:
    """The steps that a run of Gauss-Legendre or generalised-alpha took from each of its instants to the next one."""
    states = (trajectory.q, trajectory.v, trajectory.a, trajectory.multipliers)
    if method.integrator != "gauss":
        return Steps(trajectory.times, *states, np.arange(len(trajectory.times)))
    walk = _Walk(system, trajectory, method)
    parts, rows, count = [[trajectory.times[:1], *(state[:1] for state in states)]], [0], 0
    for row, end in enumerate(trajectory.times[1:]):
        first = [trajectory.times[row : row + 1], *(state[row : row + 1] for state in states)]
        lengths = walk.lengths(first, end)
        for k, length in enumerate(lengths):
            first = walk.step(first, first[0][0] + length if k + 1 < len(lengths) else end)
            parts.append(first)
        count += len(lengths)
        rows.append(count)
    return Steps(*(np.concatenate(part) for part in zip(*parts, strict=True)), np.array(rows))


class _Walk:
    """Steps of Gauss-Legendre under the control of their error."""

    def __init__(self, system: CoupledSystem, trajectory: CoupledTrajectory, method: Method) -> None:
        self.system = system
        self.scale = method.tolerance * system.measure(method.length)
        self.longest = float(trajectory.times[1] - trajectory.times[0])
        self.wanted = first_step(trajectory.a[0], self.scale, self.longest)
        stepping.compile_stepper(method.integrator)

    def lengths(self, first: list[np.ndarray], end: float) -> np.ndarray:
        """Lengths [s] of the steps from tables of one row (time, q, v, a, multipliers) to the time ``end``."""
        room = 8
        while True:
            state = np.zeros(3 + room)
            state[:2] = self.wanted, self.longest
            taken, _ = self._integrate(state, first, end)
            if taken <= room:
                self.wanted = float(state[0])
                return state[3 : 3 + taken]
            room = taken

    def step(self, first: list[np.ndarray], end: float) -> list[np.ndarray]:
        """The same tables at the end of a single step."""
        length = end - first[0][0]
        taken, tables = self._integrate(np.array([length, length, 0.0]), first, end)
        assert taken == 1, "the run has gone this way"
        return tables

    def _integrate(self, state: np.ndarray, first: list[np.ndarray], end: float) -> tuple[int, list[np.ndarray]]:
        """How many steps lead to a time, and the tables there."""
        module, counts = self.system.module, np.zeros(5)
        powers = 3 + len(module.LOADS)
        works = np.zeros((2, powers - 2 + len(self.system.constraints)))
        tables = [np.array([first[0][0], end]), *(np.repeat(part, 2, axis=0) for part in first[1:])]
        ended = stepping.integrate(
            module.equations, module.constraints, module.tangent, module.energy, self.system.parameters, self.scale,
            state, *tables, works, powers, counts,
        )  # fmt: skip
        assert ended == stepping.DONE, "the run has gone this way"
        return int(counts[0]), [part[1:] for part in tables]


def first_rates(system: CoupledSystem, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The rates with which a run from q and v at t = 0 begins: v on the constraints, (n,)."""
    found, n, m = v.copy(), system.size, len(system.constraints)
    stepping.compile_stepper()
    instant.settle(
        system.module.equations, system.module.constraints, system.parameters, 0.0, q.copy(), found, np.zeros(n),
        np.zeros(m), FIRST_PASSES, np.zeros(2),
    )  # fmt: skip
    return found
