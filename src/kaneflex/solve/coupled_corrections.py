"""Error stages of a run of preset ``coupled`` by richer models, and the effect of that preset on a one-way run.

Coupled equations are integrated again with the richer model, over the same time from the same start.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from kaneflex.integrate.outcome import Outcome
from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.shapes import Shapes
from kaneflex.multibody.time.run import integrate
from kaneflex.response.motion import Motion
from kaneflex.scene import Scene
from kaneflex.scene.options import Options, acting
from kaneflex.solve.coupled import as_result, beginning, method_of, repeated, simulate_coupled
from kaneflex.solve.coupled_state import State
from kaneflex.solve.error_stages import Progress, Read, Stage, Unknown, values_of, with_half_elements
from kaneflex.solve.initial import start_coordinates
from kaneflex.solve.loading import load, refined
from kaneflex.solve.one_way_run import run_one_way, storing
from kaneflex.solve.run_result import RunResult
from kaneflex.solve.spatial_loading import state_after
from kaneflex.solve.spatial_run import integrated_in_space

_TIGHTER, _LEAST = 32.0, 1e-13
"""Factor by which the tolerance of richer runs is smaller, and its least value. The error is of fifth order
in the step, so half the step leaves about 1/30."""
_CLOSER = 1e-3
"""Tolerance of a richer model's cycle, relative to that of the run's."""
_MANY = 6
"""Modes of each link in the coupled model of a one-way run, per plane of bending; twice as many in the plane, limited
by its elements."""


def coupled_stages(solution: RunResult, progress: Progress) -> tuple[Read, list[Stage]]:
    """Values of a run of preset ``coupled``, and stages of successively richer models."""
    read = Read.of(solution, solution.model.options.start == "periodic")
    moved = _in_space if solution.model.scene.is_spatial else _in_plane
    richer, stages = list(_richer(solution.model)), list[Stage]()

    def share(done: float) -> None:
        progress((len(stages) + done) / len(richer))

    for kind, scene, options in richer:
        stages.append((kind, values_of(moved(read, scene, options, share))))
    return read, stages


def _richer(model: Model) -> Iterator[tuple[str, Scene, Options]]:
    """Successively richer models and the part that each adds; those without effect are left out."""
    scene, options = model.given or model.scene, model.options
    tolerance, forward = (max(_LEAST, each / _TIGHTER) for each in (options.tolerance, options.forward_tolerance))
    options = replace(options, tolerance=tolerance, forward_tolerance=forward, steps=2 * options.steps)
    yield "time", scene, options
    if not any(body.elastic for body in scene.bodies.values()):
        return
    # twice as many covers symmetric links, too; every third mode is one of stretch
    modes = max(4, 2 * int(options.modes) + 1)
    scene, options = _with_modes(scene, modes), replace(options, modes=modes)
    yield "modes", scene, options
    yield "elements", with_half_elements(scene), options


def _with_modes(scene: Scene, modes: int, **update: object) -> Scene:
    """Scene with ``modes`` modes per link, limited by its elements."""
    solve = scene.solve.model_copy(update=update | {"modes": modes})
    solve.model_fields_set.discard("modes")  # a number that a user gives is not limited
    return scene.seen(solve=solve)


def _in_plane(read: Read, scene: Scene, options: Options, progress: Progress) -> Motion:
    """Motion of a richer planar model at the compared instants, with half the run's steps."""
    model, first = refined(read.model, scene, options), read.run.trajectory.times[0]
    assert model.coupled is not None
    count = options.steps if read.periodic else 2 * int(read.stored[-1])
    times = first + model.step * np.arange(count + 1)
    state = _embedded(read, model)
    begun = state.q, state.v
    if read.periodic:
        found = repeated(model, times, begun, progress, _CLOSER)
    else:
        start = beginning(model) if options.start == "quasistatic" and first == 0.0 else begun
        found = integrate(model.coupled, *start, times, method_of(model), progress)
    _check(found.outcome, found.message)
    return as_result(model, found, 0.0).motion.taken(2 * read.stored)


def _in_space(read: Read, scene: Scene, options: Options, progress: Progress) -> Motion:
    """Motion of a richer model in space at the compared instants."""
    model, own, near = refined(read.model, scene, options), read.model.in_space, None
    assert model.in_space is not None and own is not None
    if options.start in ("given", "periodic") or own.begin != 0.0:
        near = state_after(model.in_space.module.system, _embedded(read, model))[0], own.curve.turned
    model = integrated_in_space(model, progress, _CLOSER, near)
    coupled = model.coupled_in_space
    assert coupled is not None and coupled.verdict is not None
    _check(*coupled.verdict[:2])
    return _spatial_motion(model, read)


def _spatial_motion(model: Model, read: Read) -> Motion:
    from kaneflex.response.spatial_coupled_motion import SpatialCoupledMotion

    return SpatialCoupledMotion(model, model.motion.at(read.times))


def _check(outcome: Outcome, message: str) -> None:
    if outcome is not Outcome.COMPLETED:
        raise Unknown(f"a richer model fails: {message}")


def _embedded(read: Read, richer: Model) -> State:
    """Initial state of a richer model."""
    names, state = start_coordinates(read.model), [part[:, 0] for part in read.motion.state]
    wanted, known = start_coordinates(richer), dict(zip(names, np.transpose(state), strict=True))
    found = np.array([known.get(name, np.zeros(2)) for name in wanted]).T
    others = _shapes(richer)
    for body, shapes in _shapes(read.model).items():
        if isinstance(shapes, Shapes):  # those from a file are the same
            named = re.compile(rf"{re.escape(body)}\.(axial|transverse|shape)_\d+")
            own, into = ([k for k, name in enumerate(each) if named.fullmatch(name)] for each in (names, wanted))
            found[:, into] = np.array(state)[:, own] @ _carried(shapes, others[body]).T
    return State("the run", float(read.times[0]), wanted, *found)


def _shapes(model: Model) -> Mapping[str, Any]:
    """Shapes of every deforming body of a coupled model."""
    if model.in_space is not None:
        return model.in_space.module.system.layout.shapes
    assert model.coupled is not None
    return model.coupled.shapes


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
    found = (run_one_way if model.scene.is_spatial else simulate_coupled)(model, progress)
    _check(found.outcome, found.message)
    motion: Motion
    if model.scene.is_spatial:
        motion = _spatial_motion(found.model, read)
    else:
        motion = found.motion.taken(read.stored * storing(read.model))
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
