"""Corrections of a finished one-way motion: what richer models of the same mechanism, given it, change in sensors.

What is left of a richer model's equations, its residual, drives a correction of the motion. Over a cycle the correction
is found on the motion's harmonics. Elsewhere, and where these converge too slowly, it is found by steps: as the
equations are linear, the motion with its correction is their own motion from the same start, and costs as much.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from kaneflex.fem.links import DOFS
from kaneflex.integrate.methods import method_named
from kaneflex.integrate.outcome import Outcome, Trajectory
from kaneflex.integrate.run import Run, integrate, periodic_near
from kaneflex.integrate.spectral import FEWEST, Grid, at_instants, improved
from kaneflex.mechanism.body_frame import Rates
from kaneflex.multibody.building import build_model
from kaneflex.multibody.model import Model
from kaneflex.response.elastic_motion import ElasticMotion, elastic_motion
from kaneflex.scene.options import resolve_options
from kaneflex.solve.error_stages import READ, Read, Stage, Unknown, values_of, with_half_elements
from kaneflex.solve.initial import given_state
from kaneflex.solve.simulation import not_repeated
from kaneflex.solve.solution import Solution
from kaneflex.solve.work import seconds_of_steps
from kaneflex.support.spatial_contract import SPATIAL_NODE

_RICHEST: Mapping[str, object] = {
    "preset": "stiffened", "reduction": None, "modes": "all", "terms": {}, "integrator": None,
}  # fmt: skip
LONGEST = 60.0
"""Nominal seconds that the steps of richer models may take without being asked for."""
_MOST = 2048
"""Instants of the cycle at which the equations are to hold, at most."""
_COUNTS = 1e-6
"""Share of a coordinate's largest harmonic below which one does not count."""


def one_way_stages(solution: Solution) -> tuple[Read, list[Stage]]:
    """What is read of a run, and the stages of models that are ever richer than its own."""
    richer = list(_richer(solution.model))
    read = Read.of(solution, _is_periodic(solution.model, richer))
    stages = list(_by_harmonics(read, richer)) if read.periodic else []
    return read, [*stages, *_by_steps(read, richer, stages)]


def _motion(read: Read) -> ElasticMotion:
    return cast(ElasticMotion, read.motion)


def _motion_of(read: Read, richer: Model, coordinates: Rates) -> ElasticMotion:
    """By a model's coordinates at the instants that are read."""
    return elastic_motion(richer, richer.motion.at(read.times), coordinates)


def _is_periodic(model: Model, richer: Sequence[tuple[str, Model]]) -> bool:
    """Whether richer models are to repeat themselves after a run of a model."""
    options = model.options
    if not options.cycles or (options.dynamics == "dynamic" and options.start != "periodic"):
        return False
    repeats = not any(not_repeated(own) for _, own in richer)
    if options.start == "periodic" and not repeats:
        raise Unknown("the motion or its loads don't repeat themselves")
    return repeats


def _by_harmonics(read: Read, richer: Sequence[tuple[str, Model]]) -> Iterator[Stage]:
    """The stages up to the first whose corrections contract too slowly."""
    model, period = read.model, read.model.options.duration
    steps, count = len(read.run.times) - 1, _instants(read.run)
    instants = period / count * np.arange(count)
    rigid = model.motion.at(instants)
    z, v, a = (at_instants(part[:, :-1], count) for part in read.run.coordinates)
    motion = elastic_motion(model, rigid, (z, v, a))
    for kind, own in richer:
        z = motion.coordinates[0] if own is model else embedded(own, motion)
        grid = Grid.of(own.system, own.scalars, 0.0, period, count)
        basis = own.modal_basis
        found = improved(grid, z if basis is None else np.linalg.lstsq(basis, z, rcond=None)[0])
        if found is None:
            return
        z, v, a = (part if basis is None else basis @ part for part in (found.z, *grid.rates(found.z)))
        rigid = rigid if own.motion is motion.model.motion else own.motion.at(instants)
        motion = elastic_motion(own, rigid, (z, v, a))
        z, v, a = (at_instants(part, steps)[:, read.stored] for part in motion.coordinates)
        yield kind, values_of(_motion_of(read, own, (z, v, a)))


def _by_steps(read: Read, richer: Sequence[tuple[str, Model]], done: Sequence[Stage]) -> Iterator[Stage]:
    """The stages after those that are done, by steps of radau, each beside the model before it by the same steps.

    What a run of radau is itself off by is seen in half its steps.
    """
    if len(done) == len(richer):
        return
    _check_work(read, [model for _, model in richer[len(done) :]])
    options, trajectory = read.model.options, read.run.trajectory
    by_radau = isinstance(trajectory, Trajectory) and trajectory.solver.startswith("radau")
    same_steps = by_radau or options.integrator == "radau" or options.dynamics != "dynamic"
    before, values = (richer[len(done) - 1][1], done[-1][1]) if done else (read.model, read.values)
    motion = _motion(read) if same_steps and not done else None
    for kind, model in richer[len(done) :]:
        if kind == "time":
            if options.integrator == "scipy":  # whose tolerance is beyond what steps reach
                continue
            of_second_order = method_named(options.integrator).order == 2
            values = values_of(_stepped(read, model, _motion(read), 1 if of_second_order else 2))
        else:
            motion = motion or _stepped(read, before, _motion(read))
            now = _stepped(read, model, motion)
            old = values_of(motion)
            values = {name: values[name] + new - old[name] for name, new in values_of(now).items()}
            motion = now
        before = model
        yield kind, values


def _check_work(read: Read, richer: Sequence[Model]) -> None:
    """Raise Unknown where the steps of richer models take long and were not asked for."""
    seconds = sum(seconds_of_steps(model, 2 * read.model.options.steps) for model in richer)
    if seconds > LONGEST and read.model.options.errors != "all":
        reason = f"by their steps richer models take about {seconds:.2g} s"
        raise Unknown(f'{reason}; solve.errors = "all" asks for it')


def _stepped(read: Read, richer: Model, near: ElasticMotion, finer: int = 1) -> ElasticMotion:
    """The motion of a richer model by steps of radau, of which one of the run's takes `finer`.

    A periodic one is found near another.
    """
    model, every = read.model, finer * read.steps
    run = Run(richer.system, richer.scalars, 0.0, model.step / finer, every * (len(read.stored) - 1), "radau",
              _start(richer, near, read), every=every)  # fmt: skip
    if read.periodic:
        found = periodic_near(replace(run, n_steps=finer * model.options.steps))
        if found is None:
            raise Unknown("corrections contract too slowly, on harmonics and by cycles")
        run = replace(run, start=found)
    moved = integrate(run)
    if moved.outcome is not Outcome.COMPLETED:
        raise Unknown(f"the motion of a richer model is {moved.message}")
    basis = richer.modal_basis
    z, v, a = (part.T if basis is None else basis @ part.T for part in (moved.z, moved.v, moved.a))
    return _motion_of(read, richer, (z, v, a))


def _start(richer: Model, near: ElasticMotion, read: Read) -> tuple[np.ndarray, np.ndarray]:
    """State that a richer model starts from: where the run does, or near where the cycle of another motion begins."""
    options, own = read.model.options, near.model
    if not read.periodic and "quasistatic" in (options.start, options.dynamics):
        from kaneflex.solve.slow_start import slow_start

        return slow_start(richer)
    basis = richer.modal_basis
    if options.start == "given" and (basis is not None or own.modal_basis is not None or not own.reduced.size):
        return given_state(richer)
    first = near.taken(np.arange(1))
    state = np.hstack([embedded(richer, first, rate) for rate in (0, 1)])
    z, v = (state if basis is None else np.linalg.lstsq(basis, state, rcond=None)[0]).T
    return z, v


def _instants(solution: Solution) -> int:
    """Of the grid: four for each of the motion's harmonics that count, a power of two; sensors have about as many."""
    z = solution.coordinates[0][:, :-1]
    if not z.size:
        return READ
    harmonics = np.abs(np.fft.rfft(z, axis=1))
    harmonics[:, 0] = 0.0
    share = (harmonics / np.maximum(harmonics.max(axis=1, keepdims=True), 1e-300)).max(axis=0)
    highest = int(np.flatnonzero(share > _COUNTS).max(initial=1))
    return min(_MOST, max(FEWEST, 2 ** math.ceil(math.log2(4 * highest))))


def _richer(model: Model) -> Iterator[tuple[str, Model]]:
    """Ever richer models, with what each adds: those that add nothing are left out."""
    options = model.options
    if options.dynamics == "dynamic":
        yield "time", model
    rich = resolve_options(model.scene.seen(solve=model.scene.solve.model_copy(update=_RICHEST)))
    whole = replace(options, reduction="none", modes="all")
    if options.reduction != "none":
        yield "modes", build_model(model.scene, whole, model.motion)
    terms = replace(rich, elements=options.elements, mode_angle=options.mode_angle, weld_pins=options.weld_pins)
    terms = replace(terms, free_drives=options.free_drives, steps=options.steps)
    if replace(terms, preset=whole.preset, integrator=whole.integrator, start=whole.start,
               tolerance=whole.tolerance) != whole:  # fmt: skip
        yield "terms", build_model(model.scene, terms, model.motion)
    yield "elements", build_model(with_half_elements(model.scene), replace(terms, elements=None), model.motion)


def embedded(richer: Model, motion: ElasticMotion, rate: int = 0) -> np.ndarray:
    """The motion in the coordinates of a richer model, shape (n, n_times): at its nodes by the elements' own shapes.

    rate 1: the velocities of these coordinates
    """
    known = dict(zip(motion.model.coordinates, motion.coordinates[rate], strict=True))
    z = np.zeros((len(richer.coordinates), len(motion.times)))
    nodes, names = {}, SPATIAL_NODE if motion.model.scene.is_spatial else DOFS
    for name, link in motion.model.links.items():
        q = motion.nodes(name, rate)
        places = (link.locate(x) for x in richer.links[name].nodes)
        n = link.dofs
        nodes[name] = [link.shape(e, local)[:n] @ q[n * e : n * (e + 2)] for e, local in places]
    for row, name in enumerate(richer.coordinates):
        owner, _, place = name.partition(".")
        node, _, component = place.partition(".")
        if owner in nodes and component:
            z[row] = nodes[owner][int(node)][names.index(component)]
        elif name in known:
            z[row] = known[name]
    return z
