"""Periodic motion, from one cycle of every unit state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from kaneflex.integrate.gmres import gmres
from kaneflex.integrate.stepping import Setup, State, Stored, advance
from kaneflex.integrate.system import Outcome, leading
from kaneflex.support.errors import SceneError

_GROWS = 1e6  # in a cycle, of which rounding becomes 1e-10
_UNSTABLE = 1e-6  # growth in a cycle that steps of finite length explain (1e-7 on the undamped engine at 1440 steps)
_FOR_A_STEP, _MOST_OPERATIONS = 300, 1.5e12  # by n^2: of all 2 n states (engine: 4e10 in 6.5 s of a core); of a cycle
_SHARE, _MOST_CYCLES = 1e-4, 100
"""Relative residual of the periodic state after its correction, and largest number of cycles for it."""
_NEAR_ONE = 1e-6  # a double multiplier 1 (a free body) appears split by the root of the rounding error


@dataclass(frozen=True, eq=False)
class Beginning:
    """State at the start of a run, without accelerations (None if there is none), Floquet multipliers, and message.
    """

    state: State | None
    multipliers: np.ndarray | None
    outcome: Outcome
    message: str


@dataclass(frozen=True, eq=False)
class Cycle:
    """Monodromy matrix of a cycle, contribution of the loads (None if it stopped), and message.
    """

    monodromy: np.ndarray | None
    forced: np.ndarray | None
    outcome: Outcome
    message: str


def periodic_state(setup: Setup, period_steps: int) -> Beginning:
    """Solve (I - Phi) x = b: Phi, the monodromy matrix, moves a state over a cycle; zero moves to b.

    x is the state in the units of `Setup.scales`, with the method's own accelerations where it carries them: what is
    found then repeats itself to rounding, whatever the step. `multipliers` are the 2 n eigenvalues of Phi of largest
    modulus; more are the method's own. Floquet's theory: Nayfeh and Mook 1979, section 5.2. A motion whose
    disturbances grow is found, too, unless rounding would leave nothing of it by the end of the cycle.
    """
    n = setup.system.n
    if (work := _FOR_A_STEP * period_steps * float(n) ** 2) > _MOST_OPERATIONS:
        reason = f"{n} coordinates and {period_steps} steps would need {work:.1g} operations for the map of a cycle"
        cure = "Set solve.reduction = 'craig-bampton' and solve.modes, use fewer elements, or start from zero"
        raise SceneError("solve.start", "periodic", reason, cure)
    cycle = over_a_cycle(setup, period_steps)
    if cycle.outcome is not Outcome.COMPLETED:
        return Beginning(None, None, cycle.outcome, cycle.message)
    multipliers = leading(np.linalg.eigvals(cycle.monodromy), setup.system.n)
    outcome, message = _verdict(multipliers, _blur(setup, period_steps))
    unstable = outcome is Outcome.UNSTABLE and abs(multipliers[0]) < _GROWS
    if outcome is not Outcome.COMPLETED and not unstable:
        return Beginning(None, multipliers, outcome, message)
    x = np.linalg.solve(np.eye(len(cycle.forced)) - cycle.monodromy, cycle.forced)
    return Beginning(states_of(setup, x[:, None]), multipliers, outcome, message)


def corrected_state(
    setup: Setup, period_steps: int, z: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Periodic state near (z, v), from the residual after a cycle: (I - Phi) d = S(x) - x, S(x) after a cycle.

    d is found by generalised minimal residuals (Saad and Schultz 1986), a cycle an iteration: as many as there are
    disturbances that last a cycle. None where these are too many, or a cycle goes wrong.
    """
    n = setup.system.n

    def after(x: np.ndarray, load: float) -> np.ndarray:
        state, load_factor = states_of(setup, x[:, None]), np.array([load])
        if not setup.consistent(state, load_factor):
            raise FloatingPointError
        advanced = advance(setup, state, load_factor, period_steps, period_steps + 1, Stored.of(state, 1), False)
        if advanced.outcome is not Outcome.COMPLETED:
            raise FloatingPointError
        return vectors_of(setup, state)[:, 0]

    scales = np.repeat(setup.scales, n)
    x = scales * np.pad(np.concatenate((z, v)), (0, len(scales) - 2 * n))
    try:
        left = after(x, 1.0) - x
        d, missed = gmres(lambda y: y - after(y, 0.0), left, _SHARE, _MOST_CYCLES)
    except (FloatingPointError, np.linalg.LinAlgError):
        return None
    z, v, *_ = np.split((x + d) / scales, len(setup.scales))
    return (z, v) if missed <= _SHARE else None


def over_a_cycle(setup: Setup, period_steps: int) -> Cycle:
    """Final states of a cycle from every unit state and from zero, with one factorisation per step."""
    state, load_factor = unit_states(setup)
    if not setup.consistent(state, load_factor):
        outcome = Outcome.SINGULAR
        return Cycle(None, None, outcome, f"{outcome.value}: M is singular at the start of the cycle")
    advanced = advance(setup, state, load_factor, period_steps, period_steps + 1, Stored.of(state, 1), False)
    if advanced.outcome is not Outcome.COMPLETED:
        at = setup.stream.t0 + advanced.steps * setup.stream.step
        message = f"{advanced.outcome.value}, at t = {at:.9g} s, in the first cycle"
        return Cycle(None, None, advanced.outcome, message)
    ends = vectors_of(setup, state)
    return Cycle(ends[:, :-1], ends[:, -1], advanced.outcome, "")


def unit_states(setup: Setup) -> tuple[State, np.ndarray]:
    """Columns of all unit states x without loads, and of zero with loads; and the load factors."""
    size = setup.system.n * len(setup.scales)
    load_factor = np.zeros(size + 1)
    load_factor[size] = 1.0
    return states_of(setup, np.eye(size, size + 1)), load_factor


def states_of(setup: Setup, x: np.ndarray) -> State:
    """States of the vectors x, shape (size, columns); without accelerations."""
    state = State.zeros(setup.system.n, x.shape[1])
    for part, own, scale in zip(state, np.split(x, len(setup.scales)), setup.scales, strict=False):
        part[:] = own / scale
    return state


def vectors_of(setup: Setup, state: State) -> np.ndarray:
    """Inverse of `states_of`."""
    scales = setup.scales
    return np.concatenate([part * scale for part, scale in zip(state[: len(scales)], scales, strict=True)])


def _blur(setup: Setup, period_steps: int) -> float:
    """Error by rounding, per cycle, of a multiplier of modulus one.

    A step of h multiplies a vibration of frequency omega by a number of modulus one, which balances terms in
    (omega h)^2: where a step is thousands of periods long, little of that balance is left.
    """
    fastest = (setup.stream.step / setup.scales[1]) ** 2
    return float(period_steps * np.finfo(float).eps * fastest)


def _verdict(multipliers: np.ndarray, blur: float) -> tuple[Outcome, str]:
    closest = multipliers[np.argmin(np.abs(multipliers - 1.0))]
    if abs(closest - 1.0) < _NEAR_ONE:
        outcome, cure = Outcome.NO_PERIODIC_STATE, "start from a given state, add damping, or restrain the free motion"
        return outcome, f"{outcome.value}: {_multiplier_text(closest)}; {cure}"
    largest = multipliers[0]
    if 1.0 + _UNSTABLE < abs(largest) < 1.0 + blur:
        outcome, cure = Outcome.NO_PERIODIC_STATE, "use integrator generalised-alpha, preset quasistatic or more steps"
        reason = f"{_multiplier_text(largest)} within rounding, as the steps are far longer than the shortest periods"
        return outcome, f"{outcome.value}: {reason}; {cure}"
    if abs(largest) > 1.0 + _UNSTABLE:
        return Outcome.UNSTABLE, exceeds_one(largest)
    if abs(largest) > 1.0 - _UNSTABLE:
        return Outcome.COMPLETED, "neutrally stable: the slowest disturbance neither grows nor decays in these steps"
    return Outcome.COMPLETED, ""


def exceeds_one(multiplier: complex) -> str:
    """Message about a cycle with this Floquet multiplier."""
    modulus = f" of modulus {abs(multiplier):.9g}" if multiplier.imag else ""
    return f"{Outcome.UNSTABLE.value}: Floquet multiplier {_multiplier_text(multiplier)}{modulus} exceeds one"


def _multiplier_text(multiplier: complex) -> str:
    return f"{multiplier.real:.9g}{multiplier.imag:+.9g}i" if multiplier.imag else f"{multiplier.real:.9g}"
