"""Error stages of a run whose joints or links are integrated together, and the effect of preset ``coupled`` on others.

Equations of preset ``coupled``, and those of rigid bodies with free joints, are integrated again with the richer model,
over the same time from the same start.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from kaneflex.integrate.system import Outcome
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.response.motion import Motion
from kaneflex.scene import Scene
from kaneflex.scene.options import Options, acting
from kaneflex.solve.coupled import simulate_coupled
from kaneflex.solve.error_stages import TOGETHER, Progress, Read, Stage, Unknown, values_of, with_half_elements
from kaneflex.solve.initial import SavedState, start_coordinates, with_turns
from kaneflex.solve.loading import load, neighbour
from kaneflex.solve.one_way_run import run_one_way, storing
from kaneflex.solve.run_result import RunResult

_ORDER, _LEAST = 3, 1e-13
"""Power of their steps' length with which the tolerance of richer runs changes, and its least value: half as long steps
of fifth order leave about an eighth of the error."""
_TIGHT = 1e-7
"""Largest tolerance at which a richer run has longer steps instead of shorter ones: their error, eight times as large,
is small beside that of modes and elements, or of the data. At 1e-5 longer steps missed half of an error."""
_CLOSER = 1e-3
"""Tolerance of a richer model's cycle, relative to that of the run's."""
_MANY = 6
"""Modes of each link in the coupled model of a one-way run, per plane of bending; twice as many in the plane, limited
by its elements."""


def coupled_stages(solution: RunResult, progress: Progress) -> tuple[Read, list[Stage]]:
    """Values of a run of preset ``coupled`` or of rigid bodies, and stages of successively richer models.

    By default the richest one alone, which has all parts of the error.
    """
    model, longer = solution.model, step_of_richer(solution.model)
    apart = 1 if model.scene.contacts else max(1, int(longer))
    read = Read.of(solution, model.options.start == "periodic", apart)
    richer, stages = list(_richer(model, longer)), list[Stage]()
    if model.options.errors != "all":
        richer = [(TOGETHER, *richer[-1][1:])]

    def share(done: float) -> None:
        progress((len(stages) + done) / len(richer))

    for kind, scene, options in richer:
        stages.append((kind, values_of(_moved(read, scene, options, share))))
    return read, stages


def in_steps(longer: float, tolerance: float) -> float:
    """Tolerance of steps ``longer`` times as long as those of a tolerance."""
    return max(_LEAST, longer**_ORDER * tolerance)


def step_of_richer(model: Model) -> float:
    """Step of a richer run, relative to the model's."""
    options = model.options
    tolerance = options.tolerance if options.dynamics == "coupled" else options.forward_tolerance
    closed = options.start == "periodic" and not model.scene.is_elastic  # what the search for the cycle leaves decides
    if options.errors == "all" or tolerance > _TIGHT or closed:
        return 0.5
    return 0.5 if options.steps % 2 and not model.scene.contacts else 2.0


def _richer(model: Model, longer: float = 0.5) -> Iterator[tuple[str, Scene, Options]]:
    """Successively richer models with steps ``longer`` times the model's, and the part that each adds; those without
    effect are left out."""
    scene, options = model.given or model.scene, model.options
    tolerance, forward = (in_steps(longer, each) for each in (options.tolerance, options.forward_tolerance))
    # peaks of contacts need all stored instants
    steps = options.steps if scene.contacts and longer > 1.0 else round(options.steps / longer)
    options = options._replace(tolerance=tolerance, forward_tolerance=forward, steps=steps)
    yield "time", scene, options
    if not scene.is_elastic:
        return
    # of three more one is of stretch, and one at least moves the middle of a symmetric link
    modes = int(options.modes)
    modes = max(4, min(2 * modes + 1, modes + 3))
    scene, options = _with_modes(scene, modes), options._replace(modes=modes)
    yield "modes", scene, options
    yield "elements", with_half_elements(scene), options


def _with_modes(scene: Scene, modes: int, **update: object) -> Scene:
    """Scene with ``modes`` modes per link, limited by its elements."""
    solve = scene.solve.model_copy(update=update | {"modes": modes})
    solve.model_fields_set.discard("modes")  # a number that a user gives is not limited
    return scene.seen(solve=solve)


def _moved(read: Read, scene: Scene, options: Options, progress: Progress) -> Motion:
    """Motion of a richer model at the compared instants."""
    reached, steps, given = len(read.run.times) - 1, options.steps, read.model.options.steps
    if reached < given:  # an event stopped the run
        fewer = reached * steps // given
        options = options._replace(steps=fewer, duration=options.duration / steps * fewer)
    scene = scene.seen(events={})
    coupled = options.dynamics == "coupled"
    model = neighbour(read.model, scene, options=options) if coupled else replace(load(scene), options=options)
    as_before = options.start in ("given", "periodic") or read.times[0] != 0.0
    near = _embedded(read, model) if as_before else None
    found, instants = _run(model, progress, near).motion, read.stored * steps // given
    return found.taken(instants) if len(instants) < len(found.times) else found  # with contacts all of many


def _run(model: Model, progress: Progress, near: SavedState | None = None) -> RunResult:
    """Run of a coupled model, from or near a state; raises Unknown if it stops early."""
    if model.options.dynamics == "coupled":
        found = simulate_coupled(model, progress, near, 1.0 if near is None else _CLOSER)
    else:
        found = run_one_way(model, progress)
    if found.outcome is not Outcome.COMPLETED:
        raise Unknown(f"the motion of a richer model is {found.message}")
    return found


def _embedded(read: Read, richer: Model) -> SavedState:
    """Initial state of a richer model."""
    names, state = start_coordinates(read.model), [part[:, 0] for part in read.motion.state]
    wanted, known = start_coordinates(richer), dict(zip(names, np.transpose(state), strict=True))
    found = np.array([known.get(name, np.zeros(2)) for name in wanted]).T
    for body, shapes in read.model.coupled_system.engine.layout.shapes.items():
        others = richer.coupled_system.engine.layout.shapes[body]
        if isinstance(shapes, Shapes) and isinstance(others, Shapes):  # those from a file are the same
            named = re.compile(rf"{re.escape(body)}\.(axial|transverse|shape)_\d+")
            own, into = ([k for k, name in enumerate(each) if named.fullmatch(name)] for each in (names, wanted))
            found[:, into] = np.array(state)[:, own] @ _carried(shapes, others).T
    t = float(read.times[0])
    turned = {} if read.model.in_space is None else read.model.in_space.turned(t)
    return SavedState("the run", t, *with_turns(wanted, found[0], found[1], turned))


def _carried(shapes: Shapes, richer: Shapes) -> np.ndarray:
    """Amplitudes of another mesh's shapes of the same link, nearest by mass."""
    link, n = shapes.link, shapes.link.dofs
    rows = [
        link.shape(e, local)[:n] @ shapes.basis[n * e : n * (e + 2)] for e, local in map(link.locate, richer.link.nodes)
    ]
    weighted = richer.basis.T @ richer.link.part.matrices["M"].value({})
    return np.linalg.solve(weighted @ richer.basis, weighted @ np.concatenate(rows))


def coupling_change(read: Read, stages: list[Stage], progress: Progress) -> dict[str, np.ndarray]:
    """Change of a one-way run's sensors by preset ``coupled``, relative to the richest stage.

    The coupled model has more modes than by default, since truncated modes are not part of this change; its elements
    are the run's.
    """
    model = load(_as_coupled(read))
    motion = _run(model, progress).motion.taken(read.stored * storing(read.model))
    beside = [read.values, *(values for kind, values in stages if kind != "elements")][-1]
    return {name: new - beside[name] for name, new in values_of(motion).items() if name in beside}


def _as_coupled(read: Read) -> Scene:
    """Scene of a one-way run under preset coupled, with the corresponding start."""
    model, options = read.model, read.model.options
    if options.start == "given" and not read.periodic:
        raise Unknown("the initial state can't be transferred to the coupled model's coordinates")
    slow = "quasistatic" in (options.start, options.dynamics)
    start = "periodic" if read.periodic else "quasistatic" if slow else options.start
    scene = acting(model.given or model.scene, options).seen(events={})
    update = {
        "preset": "coupled", "start": start, "steps": options.steps, "integrator": None,
        "reduction": None, "terms": {}, "tolerance": None, "bounded": (),
    }  # fmt: skip
    return _with_modes(scene, _MANY if scene.is_spatial else 2 * _MANY, **update)
