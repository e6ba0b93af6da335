"""What every sensor may be off by, and why: a plus-minus from corrections of the finished motion.

A richer model of the same mechanism (a finer grid of time, all modes, all terms, twice the elements) is given the
motion that was found. What is left of its equations, its residual, drives a correction of that motion, and what this
changes in a sensor is the estimate: a hierarchical a-posteriori estimator (Bank and Smith 1993). Over a cycle the
correction is found on the motion's harmonics. Elsewhere, and where these converge too slowly, it is found by steps: as
the equations are linear, the motion with its correction is their own motion from the same start, and costs as much.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

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
from kaneflex.response.sensors import measure
from kaneflex.scene.options import left_out, resolve_options
from kaneflex.scene.structure import pruned_hash
from kaneflex.solve.initial import given_state
from kaneflex.solve.quasistatic import slow_start
from kaneflex.solve.simulation import not_repeated, storing
from kaneflex.support.errors import SceneError
from kaneflex.support.spatial_contract import SPATIAL_NODE

if TYPE_CHECKING:
    from kaneflex.scene.bodies import Body
    from kaneflex.solve.solution import Solution

KINDS = ("time", "modes", "terms", "elements")
"""What an error comes from, in the order in which a model is made richer."""
_RICHEST: Mapping[str, object] = {
    "preset": "stiffened", "reduction": None, "modes": "all", "terms": {}, "integrator": None,
}  # fmt: skip
_MOST, _READ = 2048, 256
"""Instants of the cycle at which the equations are to hold, at most, and at about which sensors are compared."""
_SECOND_ORDER = 4.0 / 3.0
"""What is left of a change by elements half as long, and itself: forces converge by the square of the length."""
_COUNTS = 1e-6
"""Share of a coordinate's largest harmonic below which one does not count."""
Stage = tuple[str, Mapping[str, np.ndarray]]
"""What a richer model adds, and the sensors' values by it at the instants that are read."""


@dataclass(frozen=True)
class ErrorEstimate:
    """A sensor's estimated error: the largest over the run, in its SI unit.

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

    For runs of the one-way presets whose rigid motion is prescribed. What the one-way coupling itself leaves out, the
    acting back of the deformation on the motion, is not estimated: preset ``coupled`` has it.
    """
    reason = _impossible(solution)
    if reason:
        return {}, f"not estimated{reason}"
    try:
        richer = list(_richer(solution.model))
        read = _Read.of(solution, _is_periodic(solution.model, richer))
        base = before = _values(read.motion)
        stages = list(_by_harmonics(read, richer)) if read.periodic else []
        stages += _by_steps(read, richer, stages)
    except _Unknown as reason:
        return {}, f"not estimated: {reason}"
    except SceneError as error:  # of a rigid run, whose deformation can't follow its motion
        return {}, f"not estimated, as no richer model can be set up: {error.key}: {error.reason}"
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
    if model.module.FREE:
        return ": what the deformation does to the motion of free joints is not known"
    if solution.outcome is not Outcome.COMPLETED:
        return f": the run is {solution.outcome.value}"
    if len(solution.times) < 3:
        return ": the run has too few instants"
    without = left_out(options)
    if without and model.module.STRUCTURE == pruned_hash(model.scene, without):
        return ": the module has no terms but those that were chosen"
    return ""


@dataclass(frozen=True, eq=False)
class _Read:
    """A run, and the stored instants at which its sensors are compared: about _READ, equally far apart.

    run: all of it, where instants or a part of it were asked for; stored: the numbers of these instants
    periodic: whether richer models are to repeat themselves after it
    steps: of the run from one of them to the next
    """

    run: Solution
    stored: np.ndarray
    periodic: bool
    steps: int

    @classmethod
    def of(cls, solution: Solution, periodic: bool) -> _Read:
        run = solution
        while run.whole is not None:
            run = run.whole
        reached = int(np.searchsorted(run.times, solution.times[-1], side="right"))
        count = len(run.times) - 1 if periodic else reached
        every = max(1, count // _READ)
        return cls(run, np.arange(0, count, every), periodic, every * storing(run.model))

    @property
    def model(self) -> Model:
        return self.run.model

    @property
    def times(self) -> np.ndarray:
        return self.run.times[self.stored]

    @cached_property
    def motion(self) -> ElasticMotion:
        """The run at these instants."""
        z, v, a = (part[:, self.stored] for part in self.run.coordinates)
        return self.motion_of(self.model, (z, v, a))

    def motion_of(self, richer: Model, coordinates: Rates) -> ElasticMotion:
        """By a model's coordinates at these instants."""
        return elastic_motion(richer, richer.motion.at(self.times), coordinates)


def _values(motion: ElasticMotion) -> dict[str, np.ndarray]:
    return {name: series.values for name, series in measure(motion).items()}


def _is_periodic(model: Model, richer: Sequence[tuple[str, Model]]) -> bool:
    """Whether richer models are to repeat themselves after a run of a model."""
    options = model.options
    if not options.cycles or (options.dynamics == "dynamic" and options.start != "periodic"):
        return False
    repeats = not any(not_repeated(own) for _, own in richer)
    if options.start == "periodic" and not repeats:
        raise _Unknown("the motion or its loads don't repeat themselves")
    return repeats


def _by_harmonics(read: _Read, richer: Sequence[tuple[str, Model]]) -> Iterator[Stage]:
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
        yield kind, _values(read.motion_of(own, (z, v, a)))


def _by_steps(read: _Read, richer: Sequence[tuple[str, Model]], done: Sequence[Stage]) -> Iterator[Stage]:
    """The stages after those that are done, by steps of radau, each beside the model before it by the same steps.

    What a run of radau is itself off by is seen in half its steps.
    """
    if len(done) == len(richer):
        return
    options, trajectory = read.model.options, read.run.trajectory
    by_radau = isinstance(trajectory, Trajectory) and trajectory.solver.startswith("radau")
    same_steps = by_radau or options.integrator == "radau" or options.dynamics != "dynamic"
    before, values = (richer[len(done) - 1][1], done[-1][1]) if done else (read.model, _values(read.motion))
    motion = read.motion if same_steps and not done else None
    for kind, model in richer[len(done) :]:
        if kind == "time":
            if options.integrator == "scipy":  # whose tolerance is beyond what steps reach
                continue
            of_second_order = method_named(options.integrator).order == 2
            values = _values(_stepped(read, model, read.motion, 1 if of_second_order else 2))
        else:
            motion = motion or _stepped(read, before, read.motion)
            now = _stepped(read, model, motion)
            old = _values(motion)
            values = {name: values[name] + new - old[name] for name, new in _values(now).items()}
            motion = now
        before = model
        yield kind, values


def _stepped(read: _Read, richer: Model, near: ElasticMotion, finer: int = 1) -> ElasticMotion:
    """The motion of a richer model by steps of radau, of which one of the run's takes `finer`.

    A periodic one is found near another.
    """
    model, every = read.model, finer * read.steps
    run = Run(richer.system, richer.scalars, 0.0, model.step / finer, every * (len(read.stored) - 1), "radau",
              _start(richer, near, read), every=every)  # fmt: skip
    if read.periodic:
        found = periodic_near(replace(run, n_steps=finer * model.options.steps))
        if found is None:
            raise _Unknown("corrections contract too slowly, on harmonics and by cycles")
        run = replace(run, start=found)
    moved = integrate(run)
    if moved.outcome is not Outcome.COMPLETED:
        raise _Unknown(f"the motion of a richer model is {moved.message}")
    basis = richer.modal_basis
    z, v, a = (part.T if basis is None else basis @ part.T for part in (moved.z, moved.v, moved.a))
    return read.motion_of(richer, (z, v, a))


def _start(richer: Model, near: ElasticMotion, read: _Read) -> tuple[np.ndarray, np.ndarray]:
    """State that a richer model starts from: where the run does, or near where the cycle of another motion begins."""
    options, own = read.model.options, near.model
    if not read.periodic and "quasistatic" in (options.start, options.dynamics):
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
