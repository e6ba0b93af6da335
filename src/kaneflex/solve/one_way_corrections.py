"""Corrections of a finished one-way motion by richer models of the same mechanism.

The residual of a richer model's equations drives a correction of the motion. Over a cycle the correction is found on
the motion's harmonics; otherwise, or if these converge too slowly, by time steps. Since the equations are linear, the
corrected motion is then simply the richer model's motion from the same start.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from kaneflex.integrate.grid import Grid, rates
from kaneflex.integrate.run import Run, integrate
from kaneflex.integrate.spectral import FEWEST, at_instants, improved
from kaneflex.integrate.system import Outcome, Trajectory
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.scene.options import Options, resolve_options
from kaneflex.solve.error_stages import (
    READ,
    REQUEST,
    Read,
    Stage,
    Unknown,
    embedded,
    max_difference,
    motion_of,
    values_of,
    with_half_elements,
)
from kaneflex.solve.one_way_run import not_repeated
from kaneflex.solve.run_result import RunResult, seconds_of_steps

_RICHEST: Mapping[str, object] = {
    "preset": "stiffened", "reduction": None, "modes": "all", "terms": {}, "integrator": None,
}  # fmt: skip
_MOST = 2048
"""Largest number of instants of the cycle at which the equations hold."""
_LEFT, _LEFT_MOST = 0.03, 3e-6
"""Share of the run's tolerance that corrections by harmonics may leave, since the error is larger if they are slow; and
the largest share of the motion, else coarse tolerances would be errors of the elements."""
_COUNTS = 1e-6
"""Share of a coordinate's largest harmonic below which a harmonic is neglected."""
LONGEST = 60.0
"""Nominal seconds that steps of richer models may take by default."""
_SMALL, _NEGLIGIBLE = 0.3, 1e-7
"""Change of a sensor by longer steps that is accepted as an estimate of their error: as a share of the total change,
and of the peak."""


def one_way_stages(solution: RunResult) -> tuple[Read, list[Stage]]:
    """Values of a one-way run, and stages of successively richer models."""
    richer = list(_richer(solution.model))
    periodic = _is_periodic(solution.model, richer)
    read = Read.of(solution, periodic, 1 if periodic or len(solution.times) < 2 * READ else 2)  # allows longer steps
    stages = list(_by_harmonics(read, richer)) if read.periodic else []
    if len(stages) < len(richer):
        stages += _by_steps(read, richer, stages)
    return read, stages


def _is_periodic(model: Model, richer: Sequence[tuple[str, Model]]) -> bool:
    """True if richer models are periodic after a run of a model."""
    options = model.options
    if not options.cycles or (options.dynamics == "dynamic" and options.start != "periodic"):
        return False
    repeats = not not_repeated(richer[-1][1])  # which has all scalars of the others
    if options.start == "periodic" and not repeats:
        raise Unknown("the motion or its loads are not periodic")
    return repeats


def _by_harmonics(read: Read, richer: Sequence[tuple[str, Model]]) -> Iterator[Stage]:
    """Stages up to the first whose corrections converge too slowly."""
    model, period = read.model, read.model.options.duration
    steps, count = len(read.run.times) - 1, _instants(read.run)
    instants = period / count * np.arange(count)
    rigid = model.motion.at(instants)
    z, v, a = (at_instants(part[:, :-1], count) for part in read.run.coordinates)
    motion = ElasticMotion(model, rigid, (z, v, a))
    for kind, own in richer:
        z = motion.coordinates[0] if own is model else embedded(own, motion)
        rigid = rigid if own.motion is motion.model.motion else own.motion.at(instants)
        grid = Grid.of(own.system, own.scalars_of(rigid), period)
        basis = own.modal_basis
        z = z if basis is None else np.linalg.lstsq(basis, z, rcond=None)[0]
        found = improved(grid, z, min(_LEFT * model.options.tolerance, _LEFT_MOST))
        if found is None:
            return
        z, v, a = (part if basis is None else basis @ part for part in (found.z, *rates(found.z, grid.omega)))
        motion = ElasticMotion(own, rigid, (z, v, a))
        z, v, a = (at_instants(part, steps)[:, read.stored] for part in motion.coordinates)
        yield kind, values_of(motion_of(read, own, (z, v, a)))


def _instants(solution: RunResult) -> int:
    """Number of instants of the grid: four per significant harmonic, a power of two."""
    z = solution.coordinates[0][:, :-1]
    if not z.size:
        return READ
    harmonics = np.abs(np.fft.rfft(z, axis=1))
    harmonics[:, 0] = 0.0
    share = (harmonics / np.maximum(harmonics.max(axis=1, keepdims=True), 1e-300)).max(axis=0)
    highest = int(np.flatnonzero(share > _COUNTS).max(initial=1))
    return min(_MOST, max(FEWEST, 2 ** math.ceil(math.log2(4 * highest))))


def _richer(model: Model) -> Iterator[tuple[str, Model]]:
    """Successively richer models, with the part that each adds; models that add nothing are left out."""
    options = model.options
    if options.dynamics == "dynamic":
        yield "time", model
    rich = resolve_options(model.scene.seen(solve=model.scene.solve.model_copy(update=_RICHEST)))
    own, whole = model, options._replace(reduction="none", modes="all")
    if options.reduction != "none":
        own = build_model(model.scene, whole, model.motion)
        yield "modes", own
    terms = rich._replace(elements=options.elements, mode_angle=options.mode_angle, weld_pins=options.weld_pins)
    terms = terms._replace(free_drives=options.free_drives, steps=options.steps)
    alike = terms._replace(preset=whole.preset, integrator=whole.integrator, start=whole.start)
    if alike._replace(tolerance=whole.tolerance) != whole:
        yield "terms", _with_terms(own, terms)
    yield "elements", build_model(with_half_elements(model.scene), terms._replace(elements=None), model.motion)


def _with_terms(model: Model, options: Options) -> Model:
    """The model with other groups of terms; its equations have them all, unless they are of another form."""
    module, form = model.module, (options.dynamics, options.convective)
    lost = model.in_space and module.open_reactions & {name for name, *_ in module.more}  # forces that are not known
    if lost or form != (model.options.dynamics, model.options.convective):
        return build_model(model.scene, options, model.motion)
    return replace(model, options=options)


# ---- by time steps ------------------------------------------------------------------------------------------------


def _by_steps(read: Read, richer: Sequence[tuple[str, Model]], done: Sequence[Stage]) -> Iterator[Stage]:
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
    from kaneflex.integrate.methods import method_named

    same_steps = by_radau or options.dynamics != "dynamic"
    motion = cast(ElasticMotion, read.motion) if same_steps and not done else None
    of_second_order = timed and method_named(options.integrator).order == 2
    yield from _in_steps(read, richer, done, 1 if of_second_order else 2, motion)


def _is_small(read: Read, coarser: Mapping[str, np.ndarray], richest: Mapping[str, np.ndarray]) -> bool:
    """True if longer steps change every sensor by a small part of the change of the richest model in them."""
    for name, own in read.values.items():
        allowed = max(_SMALL * max_difference(richest[name], own), _NEGLIGIBLE * max_difference(0.0 * own, own))
        if not max_difference(coarser[name], own) <= allowed:
            return False
    return True


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
