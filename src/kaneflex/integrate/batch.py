"""Integrate runs of several systems side by side, one in each lane."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kaneflex.integrate.lanes import LANES
from kaneflex.integrate.methods import method_named
from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.integrate.periodic import (
    Beginning,
    Cycle,
    can_be_cut,
    periodic_beginning,
    states_of,
    unit_states,
    vectors_of,
)
from kaneflex.integrate.run import Run, check_arguments, given_state, set_up
from kaneflex.integrate.stepping import Advance, Setup, State, Stored, advance
from kaneflex.integrate.streams import BatchStream, Systems
from kaneflex.support.errors import UserError

Ready = tuple[Run, Setup]

_MOST_NUMBERS = 2e7
"""In the table of all lanes, and in what is stored of them: 160 MB."""
_MOST_WORK = 3e7
"""Multiplications of a run: some 10 ms. A longer one would gain little, and lose much where lanes stay empty."""


def integrate_batch(runs: Sequence[Run]) -> list[Trajectory | None]:
    """Integrate runs side by side, LANES at a time: what `integrate` gives of each, to rounding.

    Runs share the lanes where they have as many coordinates, the same method, as many steps and the same kind of start.
    What a run gives depends on nothing beside it, to the last bit. None stands for a run that `integrate` is to take
    by itself: it is long, its method has no lanes, its arguments can't be used, or it does not complete.
    """
    found: list[Trajectory | None] = [None] * len(runs)
    kinds: dict[tuple[object, ...], list[tuple[int, Ready]]] = {}
    for k, run in enumerate(runs):  # lanes take their steps together: what steers the loop must be the same in all
        setup = _set_up(run)
        if setup is not None:
            kind = (setup.system.n, run.method, run.n_steps, run.every, run.period_steps, run.start == "periodic")
            kinds.setdefault(kind, []).append((k, (run, setup)))
    for members in kinds.values():
        for first in range(0, len(members), LANES):
            numbers, group = zip(*members[first : first + LANES], strict=True)
            for k, trajectory in zip(numbers, _side_by_side(group), strict=True):
                found[k] = trajectory
    return found


def _set_up(run: Run) -> Setup | None:
    """What the run reads; None where it can't share lanes."""
    try:
        method = method_named(run.method)
        if not method.lanes:
            return None
        check_arguments(run)
        setup = set_up(run)
        given_state(run)
        if not _fits(run, len(method.nodes)) or (run.start == "periodic" and not can_be_cut(setup, run.period_steps)):
            return None
        if run.period_steps is not None:
            setup.stream.cycle()
    except UserError:
        return None
    return setup


def _fits(run: Run, nodes: int) -> bool:
    """Whether the run is short, and table and results of LANES such runs fit the memory."""
    system, periodic = run.system, run.start == "periodic"
    steps, columns = (run.period_steps, 2 * system.n + 1) if periodic else (run.n_steps, 1)
    slots = system.n * (2 * system.half_bandwidth + 1)
    sums = system.M.nnz + system.C.nnz + system.K.nnz + system.F.nnz
    work = steps * nodes * (sums + slots * (system.half_bandwidth + 1 + columns))
    in_table = nodes * (run.period_steps or 0) * system.n_scalars
    stored = len(Stored._fields) * (steps if periodic else steps // run.every) * system.n
    return work <= _MOST_WORK and LANES * max(in_table, stored) <= _MOST_NUMBERS


def _side_by_side(group: Sequence[Ready]) -> list[Trajectory | None]:
    """What comes of at most LANES runs. Where one stops them, each is tried without the others."""
    # empty lanes go along with the last run, and what they give is left out: no loop asks how many are full
    full = [group[min(lane, len(group) - 1)] for lane in range(LANES)]
    try:
        found = _periodic(full) if full[0][0].start == "periodic" else _from_given(full)
    except UserError:  # in a later piece of somebody's table
        found = None
    if found is not None:
        return found[: len(group)]
    return [None] if len(group) == 1 else [_side_by_side([each])[0] for each in group]


def _in_lanes(group: Sequence[Ready]) -> Setup:
    setups = [setup for _, setup in group]
    systems = Systems(tuple(setup.system for setup in setups))
    coefficients = np.stack([setup.coefficients for setup in setups], axis=-1)
    scales = tuple(np.array(scale) for scale in zip(*(setup.scales for setup in setups), strict=True))
    stream = BatchStream(tuple(setup.stream for setup in setups))
    return Setup(systems, setups[0].method, stream, coefficients, scales)


def _periodic(group: Sequence[Ready]) -> list[Trajectory | None] | None:
    """None in the place of a run without a periodic state that attracts; in place of all where one breaks off."""
    run, lanes = group[0][0], _in_lanes(group)
    state, load_factor = unit_states(lanes, LANES)
    if not lanes.consistent(state, load_factor):
        return None
    advanced = advance(lanes, state, load_factor, run.period_steps, run.period_steps + 1, Stored.of(state, 1), False)
    if advanced.outcome is not Outcome.COMPLETED:
        return None
    ends = vectors_of(lanes, state)
    beginnings = []
    for lane, (_, setup) in enumerate(group):
        over = Cycle(ends[:-1, :, lane].T.copy(), ends[-1, :, lane].copy(), Outcome.COMPLETED, "")
        beginnings.append(periodic_beginning(over, setup, run.period_steps))
    none = states_of(group[0][1], np.zeros((1, ends.shape[1])))
    states = [none if beginning.state is None else beginning.state for beginning in beginnings]
    state = State(*(np.stack(parts, axis=-1) for parts in zip(*states, strict=True)))
    if not lanes.consistent(state, np.ones(1)):
        return None
    stored = Stored.of(state, run.period_steps + 1)
    advanced = advance(lanes, state, np.ones(1), run.period_steps, 1, stored, False)
    steps = run.every * np.arange(run.n_steps // run.every + 1)
    rows = (steps - 1) % run.period_steps + 1  # ends of steps, as `TimeSegments.joined` has them
    return _trajectories(group, beginnings, advanced, stored, rows)


def _from_given(group: Sequence[Ready]) -> list[Trajectory | None] | None:
    """None where one of them does not complete."""
    run, lanes = group[0][0], _in_lanes(group)
    state = State(*(np.zeros((1, lanes.system.n, LANES)) for _ in State._fields))
    for lane, (each, _) in enumerate(group):
        state.z[0, :, lane], state.v[0, :, lane] = given_state(each)
    if not lanes.consistent(state, np.ones(1)):
        return None
    state.a[:] = state.q
    stored = Stored.of(state, run.n_steps // run.every + 1)
    advanced = advance(lanes, state, np.ones(1), run.n_steps, run.every, stored, True)
    begun = Beginning(None, None, Outcome.COMPLETED, "")
    return _trajectories(group, [begun] * LANES, advanced, stored, np.arange(len(stored.z)))


def _trajectories(
    group: Sequence[Ready], beginnings: Sequence[Beginning], advanced: Advance, stored: Stored, rows: np.ndarray
) -> list[Trajectory | None] | None:
    """The stored rows of every lane; None where one of them broke off."""
    if advanced.outcome is not Outcome.COMPLETED:
        return None
    found: list[Trajectory | None] = []
    for lane, ((run, _), begun) in enumerate(zip(group, beginnings, strict=True)):
        if begun.outcome is not Outcome.COMPLETED:
            found.append(None)
            continue
        times = run.t0 + run.step * (run.every * np.arange(len(rows)))
        message = "; ".join(filter(None, (Outcome.COMPLETED.value, begun.message)))
        motion = (each[rows, :, lane] for each in stored)
        ended = (Outcome.COMPLETED, message, begun.multipliers, advanced.ns_per_step / LANES)
        found.append(Trajectory(times, *motion, *ended))
    return found
