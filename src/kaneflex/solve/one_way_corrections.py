"""Corrections of a finished one-way motion by richer models of the same mechanism.

The residual of a richer model's equations drives a correction of the motion. Over a cycle the correction is found on
the motion's harmonics; otherwise, or if these converge too slowly, by time steps: :mod:`kaneflex.solve.one_way_steps`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from kaneflex.integrate.grid import Grid, rates
from kaneflex.integrate.spectral import FEWEST, at_instants, improved
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import build_model
from kaneflex.response.elastic_motion import ElasticMotion
from kaneflex.scene.options import Options, resolve_options
from kaneflex.solve.error_stages import READ, Read, Stage, Unknown, embedded, motion_of, values_of, with_half_elements
from kaneflex.solve.one_way_run import not_repeated
from kaneflex.solve.run_result import RunResult

_RICHEST: Mapping[str, object] = {
    "preset": "stiffened", "reduction": None, "modes": "all", "terms": {}, "integrator": None,
}  # fmt: skip
_MOST = 2048
"""Largest number of instants of the cycle at which the equations hold."""
_LEFT = 0.03
"""Share of the run's tolerance that corrections by harmonics may leave, since the error is larger if they are slow."""
_COUNTS = 1e-6
"""Share of a coordinate's largest harmonic below which a harmonic is neglected."""


def one_way_stages(solution: RunResult) -> tuple[Read, list[Stage]]:
    """Values of a one-way run, and stages of successively richer models."""
    richer = list(_richer(solution.model))
    periodic = _is_periodic(solution.model, richer)
    read = Read.of(solution, periodic, 1 if periodic or len(solution.times) < 2 * READ else 2)  # allows longer steps
    stages = list(_by_harmonics(read, richer)) if read.periodic else []
    if len(stages) < len(richer):
        from kaneflex.solve.one_way_steps import by_steps

        stages += by_steps(read, richer, stages)
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
        found = improved(grid, z, _LEFT * model.options.tolerance)
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
