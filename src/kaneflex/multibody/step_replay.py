"""The single steps of a finished coupled run, found by taking them once more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.multibody import instant, stepping
from kaneflex.multibody.run import FIRST_PASSES, CoupledTrajectory, Method, first_step
from kaneflex.multibody.system import CoupledSystem


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
    return _walked(system, trajectory, method)


def _walked(system: CoupledSystem, trajectory: CoupledTrajectory, method: Method) -> Steps:
    """Steps of Gauss-Legendre under the control of their error, one after the other."""
    module, parameters = system.module, system.parameters
    n, m, powers = system.size, len(system.constraints), 3 + len(module.LOADS)
    scale, longest = method.tolerance * system.measure(method.length), float(trajectory.times[1] - trajectory.times[0])
    first = (trajectory.q[0], trajectory.v[0], trajectory.a[0], trajectory.multipliers[0])
    here = np.concatenate([trajectory.times[:1], *first, np.zeros(powers - 2 + m)])
    tables = [np.zeros((2, width)) for width in (n, n, n, m, powers - 2 + m)]
    control = np.array([first_step(first[2], scale, longest), longest, 1.0, 0.0])
    stepping.compile_stepper(method.integrator)
    ends, rows, counts = [here.copy()], [0], np.zeros(5)
    for row in range(len(trajectory.times) - 1):
        ended = stepping.PAUSED
        while ended == stepping.PAUSED:
            before = counts[0]
            ended = stepping.integrate(
                module.equations, module.constraints, module.tangent, module.energy, parameters, scale, control, here,
                trajectory.times[row : row + 2], *tables, powers, counts,
            )  # fmt: skip
            if counts[0] > before:
                ends.append(here.copy())
        assert ended == stepping.DONE, "the run has gone this way"
        rows.append(len(ends) - 1)
    times, q, v, a, multipliers, _ = np.split(np.array(ends), np.cumsum([1, n, n, n, m]), axis=1)
    return Steps(times[:, 0].copy(), q.copy(), v.copy(), a.copy(), multipliers.copy(), np.array(rows))


def first_rates(system: CoupledSystem, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The rates with which a run from q and v at t = 0 begins: v on the constraints, (n,)."""
    found, n, m = v.copy(), system.size, len(system.constraints)
    stepping.compile_stepper()
    instant.settle(
        system.module.equations, system.module.constraints, system.parameters, 0.0, q.copy(), found, np.zeros(n),
        np.zeros(m), FIRST_PASSES, np.zeros(2),
    )  # fmt: skip
    return found
