"""The motion that repeats itself, from one cycle of every unit state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.integrate.stepping import Progress, Setup, State, Stored, advance

_UNSTABLE = 1e-6  # growth in a cycle that steps of finite length explain (1e-7 on the undamped engine at 1440 steps)
_NEAR_ONE = 1e-6  # a double multiplier 1 (a free body) appears split by the root of the rounding error


@dataclass(frozen=True, eq=False)
class Beginning:
    """State at the start of a run (None where there is none), the Floquet multipliers, and what to say."""

    state: State | None
    multipliers: np.ndarray | None
    outcome: Outcome
    message: str


@dataclass(frozen=True, eq=False)
class Cycle:
    """Monodromy matrix of a cycle, what the loads add to a state in it (None where it broke off), and what to say."""

    monodromy: np.ndarray | None
    forced: np.ndarray | None
    outcome: Outcome
    message: str


def periodic_state(setup: Setup, period_steps: int, progress: Progress | None) -> Beginning:
    """Solve (I - Phi) x = b: Phi, the monodromy matrix, moves a state over a cycle; zero moves to b.

    x = (z, h v) and, where the method carries accelerations of its own, h^2 a: what is found then repeats
    itself to rounding, whatever the step. `multipliers` are the 2 n eigenvalues of Phi of largest modulus;
    more are the method's own. Floquet's theory: Nayfeh and Mook 1979, section 5.2.
    """
    over = over_a_cycle(setup, period_steps, progress)
    if over.outcome is not Outcome.COMPLETED:
        return Beginning(None, None, over.outcome, over.message)
    multipliers = leading(np.linalg.eigvals(over.monodromy), setup.system.n)
    outcome, message = _verdict(multipliers, _blur(setup, period_steps))
    if outcome is not Outcome.COMPLETED:
        return Beginning(None, multipliers, outcome, message)
    x = np.linalg.solve(np.eye(len(over.forced)) - over.monodromy, over.forced)
    return Beginning(_state_of(setup, x, _scales(setup)), multipliers, outcome, message)


def over_a_cycle(setup: Setup, period_steps: int, progress: Progress | None) -> Cycle:
    """Where a cycle moves every unit state, and zero; all share one factorisation a step."""
    n, scales = setup.system.n, _scales(setup)
    size = n * len(scales)
    state = State.zeros(size + 1, n)
    for part, scale in enumerate(scales):
        state[part][part * n : (part + 1) * n] = np.eye(n) / scale
    load = np.zeros(size + 1)
    load[size] = 1.0  # the last column starts from zero and is forced, the others are free
    if not setup.consistent(state, load):
        outcome = Outcome.SINGULAR
        return Cycle(None, None, outcome, f"{outcome.value}: M is singular at the start of the cycle")
    if setup.method.carried == 2:
        state.a[:] = state.q
    nothing = Stored(*(np.zeros((1, n)) for _ in Stored._fields))
    came = advance(setup, state, load, period_steps, period_steps + 1, nothing, False, progress)
    if came.outcome is not Outcome.COMPLETED:
        at = setup.feed.t0 + came.steps * setup.feed.step
        message = f"{came.outcome.value}, at t = {at:.9g} s, in the first cycle"
        return Cycle(None, None, came.outcome, message)
    ends = np.hstack([part * scale for part, scale in zip(state[: len(scales)], scales, strict=True)])
    return Cycle(ends[:size].T, ends[size], came.outcome, "")


def leading(multipliers: np.ndarray, n: int) -> np.ndarray:
    """The 2 n multipliers of largest modulus, largest first."""
    return multipliers[np.argsort(-np.abs(multipliers), kind="stable")][: 2 * n].astype(complex)


def _scales(setup: Setup) -> tuple[float, ...]:
    """Factors of z, v and, where the method carries accelerations of its own, a in the state x."""
    step = setup.feed.step
    return (1.0, step, step * step)[: setup.method.carried]


def _state_of(setup: Setup, x: np.ndarray, scales: tuple[float, ...]) -> State:
    n = setup.system.n
    state = State.zeros(1, n)
    for part, scale in enumerate(scales):
        state[part][0] = x[part * n : (part + 1) * n] / scale
    setup.consistent(state, np.ones(1))
    if len(scales) == 2:
        state.a[:] = state.q
    return state


def _blur(setup: Setup, period_steps: int) -> float:
    """What rounding may do to a multiplier of modulus one in a cycle.

    A step of h multiplies a vibration of frequency omega by a number of modulus one, which balances terms in
    (omega h)^2: where a step is thousands of periods long, little of that balance is left.
    """
    row = setup.feed.first_row()
    stiffness, mass = (np.diag(setup.system.dense(name, row)) for name in "KM")
    fastest = setup.feed.step**2 * np.abs(stiffness / mass).max()
    return float(period_steps * np.finfo(float).eps * fastest)


def _verdict(multipliers: np.ndarray, blur: float) -> tuple[Outcome, str]:
    closest = multipliers[np.argmin(np.abs(multipliers - 1.0))]
    if abs(closest - 1.0) < _NEAR_ONE:
        outcome, cure = Outcome.NO_PERIODIC_STATE, "give a start state, or damp or hold the free motion"
        return outcome, f"{outcome.value}: {_said(closest)}; {cure}"
    largest = multipliers[0]
    if 1.0 + _UNSTABLE < abs(largest) < 1.0 + blur:
        outcome, cure = Outcome.NO_PERIODIC_STATE, "take integrator generalised-alpha, preset quasistatic or more steps"
        reason = f"{_said(largest)}, to the rounding of steps that are far longer than the fastest periods"
        return outcome, f"{outcome.value}: {reason}; {cure}"
    if abs(largest) > 1.0 + _UNSTABLE:
        outcome = Outcome.UNSTABLE
        modulus = f" of modulus {abs(largest):.9g}" if largest.imag else ""
        multiplier = f"Floquet multiplier {_said(largest)}{modulus}"
        return outcome, f"{outcome.value}: {multiplier} exceeds one"
    if abs(largest) > 1.0 - _UNSTABLE:
        return Outcome.COMPLETED, "neutrally stable: the slowest disturbance neither grows nor dies in these steps"
    return Outcome.COMPLETED, ""


def _said(multiplier: complex) -> str:
    return f"{multiplier.real:.9g}{multiplier.imag:+.9g}i" if multiplier.imag else f"{multiplier.real:.9g}"
