"""What every sensor may be off by, and why: a plus-minus from corrections of the finished motion.

A richer model of the same mechanism (a finer grid of time, all modes, all terms, twice the elements) is given the
motion that was found. What is left of its equations, its residual, drives a correction of that motion, and what this
changes in a sensor is the estimate: a hierarchical a-posteriori estimator (Bank and Smith 1993), here over a cycle.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.fem.links import DOFS
from kaneflex.integrate.outcome import Outcome
from kaneflex.integrate.spectral import FEWEST, Grid, at_instants, improved
from kaneflex.mechanism.body_frame import Rates
from kaneflex.multibody.building import build_model
from kaneflex.multibody.model import Model
from kaneflex.response.elastic_motion import ElasticMotion, elastic_motion
from kaneflex.response.sensors import measure
from kaneflex.scene.options import left_out, resolve_options
from kaneflex.scene.structure import pruned_hash
from kaneflex.solve.simulation import not_repeated
from kaneflex.support.errors import SceneError
from kaneflex.support.spatial_contract import SPATIAL_NODE

if TYPE_CHECKING:
    from kaneflex.scene.bodies import Body
    from kaneflex.solve.solution import Solution

KINDS = ("time", "modes", "terms", "elements")
"""What an error comes from, in the order in which a model is made richer."""
_RICHEST: Mapping[str, object] = {
    "preset": "stiffened", "reduction": None, "modes": "all", "terms": {}, "integrator": None, "start": "periodic",
}  # fmt: skip
_MOST, _READ = 2048, 256
"""Instants of the cycle at which the equations are to hold, at most, and at about which sensors are compared."""
_SECOND_ORDER = 4.0 / 3.0
"""What is left of a change by elements half as long, and itself: forces converge by the square of the length."""
_COUNTS = 1e-6
"""Share of a coordinate's largest harmonic below which one does not count."""


@dataclass(frozen=True)
class ErrorEstimate:
    """A sensor's estimated error: the largest over the cycle, in its SI unit.

    Attributes
    ----------
    total : float
        Of all that is left out together.
    time, modes, terms, elements : float
        Of the discretisation in time; the modes that a reduction left out; the groups of terms, and all of the
        deformation or its dynamics where the preset has none; elements half as long. In this order, each beside those
        before it.
    """

    total: float
    time: float
    modes: float
    terms: float
    elements: float


def error_estimates(solution: Solution) -> tuple[Mapping[str, ErrorEstimate], str]:
    """Each sensor's estimate, and why there is none where there is none.

    For periodic motions of the one-way presets. What the one-way coupling itself leaves out, the acting back of the
    deformation on the motion, is not estimated: preset ``coupled`` has it.
    """
    reason = _impossible(solution)
    if reason:
        return {}, f"not estimated{reason}"
    try:
        first, *stages = _refined(solution)
    except _Unknown as reason:
        return {}, f"not estimated: {reason}"
    except SceneError as error:  # of a rigid run, whose deformation can't follow its motion
        return {}, f"not estimated, as no richer model can be set up: {error.key}: {error.reason}"
    base = before = first[1]
    found: dict[str, dict[str, float]] = {kind: {} for kind in KINDS}
    for kind, values in stages:
        if kind == "elements":
            values = {name: before[name] + _SECOND_ORDER * (values[name] - before[name]) for name in values}
        found[kind] = {name: _apart(values[name], before[name]) for name in values}
        before = values
    return {
        name: ErrorEstimate(_apart(before[name], base[name]), *(found[kind].get(name, 0.0) for kind in KINDS))
        for name in solution.model.scene.sensors
    }, ""


class _Unknown(Exception):
    """What a richer model adds is not found; its argument says why."""


def _apart(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.abs(one - other).max(initial=0.0))


def _impossible(solution: Solution) -> str:
    """Why nothing is estimated, in words; empty where it can be."""
    model = solution.model
    options = model.options
    if options.dynamics in ("coupled", "frozen"):
        return f" under preset {options.preset}"
    if not any(body.elastic for body in model.scene.bodies.values()):
        return ": no body is elastic"
    if model.module.FREE or not options.cycles or (options.dynamics == "dynamic" and options.start != "periodic"):
        return ": the motion is not a periodic one"
    if solution.outcome is not Outcome.COMPLETED or len(solution.times) < FEWEST:
        return ": the run has no whole cycle of instants"
    if abs(solution.times[-1] - options.duration) > 1e-9 * options.duration:
        return ": the instants that are stored don't end with the cycle"
    without = left_out(options)
    if without and model.module.STRUCTURE == pruned_hash(model.scene, without):
        return ": the module has no terms but those that were chosen"
    return ""


def _refined(solution: Solution) -> Iterator[tuple[str, dict[str, np.ndarray]]]:
    """The sensors by the motion itself, then by ever richer models, with what each adds."""
    model, period = solution.model, solution.model.options.duration
    steps, count = len(solution.times) - 1, _instants(solution)
    read = np.arange(0, steps, max(1, steps // _READ))
    instants, shown = period / count * np.arange(count), solution.times[read]
    rigid, there = model.motion.at(instants), model.motion.at(shown)

    def values(richer: Model, coordinates: Rates) -> dict[str, np.ndarray]:
        z, v, a = (part[:, read] for part in coordinates)
        here = there if richer.motion is model.motion else richer.motion.at(shown)  # in space each has its own scalars
        return {name: series.values for name, series in measure(elastic_motion(richer, here, (z, v, a))).items()}

    yield "", values(model, solution.coordinates)
    z, v, a = (at_instants(part[:, :-1], count) for part in solution.coordinates)
    motion = elastic_motion(model, rigid, (z, v, a))
    for kind, richer in _richer(model):
        if not_repeated(richer):
            raise _Unknown("the motion or its loads don't repeat themselves")
        z = motion.coordinates[0] if richer is model else embedded(richer, motion)
        grid = Grid.of(richer.system, richer.scalars, 0.0, period, count)
        basis = richer.modal_basis
        found = improved(grid, z if basis is None else np.linalg.lstsq(basis, z, rcond=None)[0])
        if found is None:
            raise _Unknown(f"corrections by {kind} contract too slowly")
        z, v, a = (part if basis is None else basis @ part for part in (found.z, *grid.rates(found.z)))
        rigid = rigid if richer.motion is motion.model.motion else richer.motion.at(instants)
        motion = elastic_motion(richer, rigid, (z, v, a))
        z, v, a = (at_instants(part, steps) for part in motion.coordinates)
        yield kind, values(richer, (z, v, a))


def _instants(solution: Solution) -> int:
    """Of the grid: four for each of the motion's harmonics that count, a power of two; sensors have about as many."""
    z = solution.coordinates[0][:, :-1]
    if not z.size:
        return _READ
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
    finer = {name: body if not body.elastic else _halved(body) for name, body in model.scene.bodies.items()}
    yield "elements", build_model(model.scene.seen(bodies=finer), replace(terms, elements=None), model.motion)


def _halved(body: Body) -> Body:
    """The body with elements half as long."""
    assert body.beam is not None
    return body.model_copy(update={"beam": body.beam.model_copy(update={"elements": 2 * body.beam.elements})})


def embedded(richer: Model, motion: ElasticMotion) -> np.ndarray:
    """The motion in the coordinates of a richer model, shape (n, n_times): at its nodes by the elements' own shapes."""
    known = dict(zip(motion.model.coordinates, motion.coordinates[0], strict=True))
    z = np.zeros((len(richer.coordinates), len(motion.times)))
    nodes, names = {}, SPATIAL_NODE if motion.model.scene.is_spatial else DOFS
    for name, link in motion.model.links.items():
        q = motion.nodes(name)
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
