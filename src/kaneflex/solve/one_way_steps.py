"""Motions of richer models by time steps, from the start of a finished one-way run.

Since the equations are linear, the corrected motion is simply the richer model's motion from the same start.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from kaneflex.integrate.methods import method_named
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.solve.error_stages import REQUEST, Read, Stage, Unknown, apart, embedded, motion_of, values_of
from kaneflex.solve.run_result import seconds_of_steps

LONGEST = 60.0
"""Nominal seconds that steps of richer models may take by default."""
_SMALL, _NEGLIGIBLE = 0.3, 1e-7
"""Change of a sensor by longer steps that is accepted as an estimate of their error: as a share of the total change,
and of the peak."""


def by_steps(read: Read, richer: Sequence[tuple[str, Model]], done: Sequence[Stage]) -> Iterator[Stage]:
    """Remaining stages, by steps of radau, each compared with the model before it in the same steps.

    The error of a run of radau itself is the change by half its steps; by steps of twice the length, which take a
    quarter of the time, if these change every sensor by less than the richer models do. The change by richer models is
    that in the longer steps.
    """
    _check_work(read, [model for _, model in richer[len(done) :]])
    options, trajectory = read.model.options, read.run.trajectory
    by_radau = isinstance(trajectory, Trajectory) and trajectory.solver.startswith("radau")
    by_radau = by_radau or options.integrator == "radau"
    timed = richer[0][0] == "time"
    if timed and by_radau and not (read.periodic or read.steps % 2):
        found = list(_in_steps(read, richer, done, 0.5, None))
        longer = found[0][1]
        if not _is_small(read, longer, found[-1][1]):
            finer = values_of(_stepped(read, richer[0][1], cast(ElasticMotion, read.motion), 2))
            found = [(kind, {name: finer[name] + own[name] - longer[name] for name in own}) for kind, own in found]
        yield from found
        return
    same_steps = by_radau or options.dynamics != "dynamic"
    motion = cast(ElasticMotion, read.motion) if same_steps and not done else None
    of_second_order = timed and method_named(options.integrator).order == 2
    yield from _in_steps(read, richer, done, 1 if of_second_order else 2, motion)


def _is_small(read: Read, coarser: Mapping[str, np.ndarray], richest: Mapping[str, np.ndarray]) -> bool:
    """True if longer steps change every sensor by a small part of the change of the richest model in them."""
    return all(
        apart(coarser[name], own) <= max(_SMALL * apart(richest[name], own), _NEGLIGIBLE * apart(0.0 * own, own))
        for name, own in read.values.items()
    )


def _in_steps(
    read: Read, richer: Sequence[tuple[str, Model]], done: Sequence[Stage], finer: float, motion: ElasticMotion | None
) -> Iterator[Stage]:
    """Stages by steps of radau: the first one in ``finer`` steps for each of the run's, others in the run's own.

    Steps longer than the run's are those of all stages. ``motion``: the run's, if it is one of radau.
    """
    before, values = (richer[len(done) - 1][1], done[-1][1]) if done else (read.model, read.values)
    own, others = cast(ElasticMotion, read.motion), min(finer, 1)
    for kind, model in richer[len(done) :]:
        if kind == "time":
            now = _stepped(read, model, own, finer)
            values, motion = values_of(now), motion or (now if others < 1 else None)
        else:
            motion = motion or _stepped(read, before, own, others)
            now = _stepped(read, model, motion, others)
            old = values_of(motion)
            values = {name: values[name] + new - old[name] for name, new in values_of(now).items()}
            motion = now
        before = model
        yield kind, values


def _check_work(read: Read, richer: Sequence[Model]) -> None:
    """Raise Unknown if the steps of richer models take long and were not requested."""
    seconds = sum(seconds_of_steps(model, 2 * read.model.options.steps) for model in richer)
    if seconds > LONGEST and read.model.options.errors == "quick":
        raise Unknown(f"richer models take about {seconds:.2g} s; {REQUEST}")


def _stepped(read: Read, richer: Model, near: ElasticMotion, finer: float = 1) -> ElasticMotion:
    """Motion of a richer model by steps of radau, ``finer`` for each of the run's.

    A periodic motion is searched near the given one.
    """
    model, every = read.model, round(finer * read.steps)
    run = Run(richer.system, richer.scalars, 0.0, model.step / finer, every * (len(read.stored) - 1), "radau",
              _start(richer, near, read), every=every)  # fmt: skip
    if read.periodic:
        from kaneflex.integrate.by_steps import periodic_near

        moved = periodic_near(replace(run, period_steps=round(finer * model.options.steps)))
    else:
        moved = integrate(run)
    if moved is None:
        raise Unknown("corrections converge too slowly, by harmonics and by cycles")
    if moved.outcome is not Outcome.COMPLETED:
        raise Unknown(f"a richer model fails: {moved.message}")
    basis = richer.modal_basis
    z, v, a = (part.T if basis is None else basis @ part.T for part in (moved.z, moved.v, moved.a))
    return motion_of(read, richer, (z, v, a))


def _start(richer: Model, near: ElasticMotion, read: Read) -> tuple[np.ndarray, np.ndarray]:
    """Initial state of a richer model: that of the run, or for periodic motions near the start of another cycle."""
    options, own = read.model.options, near.model
    if not read.periodic and "quasistatic" in (options.start, options.dynamics):
        from kaneflex.solve.quasistatic import slow_start

        return slow_start(richer)
    basis = richer.modal_basis
    if options.start == "given" and (basis is not None or own.modal_basis is not None or not own.reduced.size):
        from kaneflex.solve.initial import given_state

        return given_state(richer)
    first = near.taken(np.arange(1))
    state = np.hstack([embedded(richer, first, rate) for rate in (0, 1)])
    z, v = (state if basis is None else np.linalg.lstsq(basis, state, rcond=None)[0]).T
    return z, v
