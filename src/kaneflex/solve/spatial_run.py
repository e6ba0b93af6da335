"""Runs of mechanisms in space whose motion the drives do not prescribe: of free joints and of deforming bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from kaneflex.multibody.model.bound_model import Model
from kaneflex.multibody.model.building import moving, reference_instant
from kaneflex.multibody.model.independent_speeds import choose, choose_for_all
from kaneflex.multibody.model.spatial_initial_state import start_of
from kaneflex.multibody.model.spatial_system import SpatialSystem
from kaneflex.multibody.model.state import Choice, State
from kaneflex.multibody.time.cycles import SpatialCycles
from kaneflex.multibody.time.harmonic_balance import HARMONICS, orbit_start
from kaneflex.multibody.time.linearisation import Equations
from kaneflex.multibody.time.shooting import COMPLETED, Verdict
from kaneflex.multibody.time.spatial_curves import Curve, Followed
from kaneflex.multibody.time.spatial_forward import Run
from kaneflex.multibody.time.spatial_motion import SpatialKinematics, SpatialModule
from kaneflex.solve.coupled import beginning, method_of
from kaneflex.solve.coupled_state import SavedState, state_after
from kaneflex.solve.law_checks import check_finite, check_repeats, check_springs
from kaneflex.solve.spatial_loading import check_stage, with_open_reactions

Share = Callable[[float], None]
Near = tuple[State, Mapping[str, float] | None]
"""A state, and the angles of joints that close loops if their turns count from there, else None."""
_POSITIONS = 200
"""Positions in a cycle at which independent shapes must not become dependent."""


def integrated_in_space(model: Model, share: Share, after: SavedState | None = None, closer: float = 1.0) -> Model:
    """Variant of :func:`kaneflex.solve.free_motion.integrated` for mechanisms in space."""
    begun, coupled, options = model.in_space, model.coupled_in_space, model.options
    assert begun is not None
    system, verdict = begun.module.system, COMPLETED
    near = None if after is None else state_after(system, after, lambda given: choose(system, given.q))
    if coupled is not None and options.start == "periodic":
        run, verdict = _cycle(model, system, near, share, closer)
    else:
        start, turned = near or (begun.curve.start if coupled is None else beginning(model), None)
        run = Run(system, start, start.t + model.step * np.arange(options.steps + 1), method_of(model))
        run.turned = turned
        run.go(share)
    return with_run(model, run, verdict)


def with_run(model: Model, run: Run, verdict: Verdict = COMPLETED) -> Model:
    """Model in space along an integrated motion, with the warnings of its run."""
    scene, options, system, coupled = model.scene, model.options, run.system, model.coupled_in_space
    motion = SpatialKinematics(SpatialModule(system), system.parameters, run)
    energy = run.energy(motion)
    if coupled is not None:
        motion = replace(coupled.along(run), verdict=verdict)
    if model.motion.is_start:
        motion = with_open_reactions(motion, options)
        check_springs(scene, motion, options)
        check_finite(scene, motion, options)
    if coupled is not None:
        reference = model.reference_time
        if run.turned is not None:
            reference = run.start.t
        elif model.motion.is_start:
            reference = reference_instant(scene, options, motion)[0]
        found = replace(model, motion=motion, reference_time=reference, energy=energy)
    else:
        found = moving(model, motion, energy)
        check_stage(found)
    return found


def _cycle(
    model: Model, system: SpatialSystem, near: Near | None, share: Share, closer: float
) -> tuple[Run, Verdict]:
    """Periodic motion near a state, by default that of its harmonics or an equilibrium, and the verdict on it.

    Raises SceneError if drives or loads are not periodic, or the motion can't continue.
    """
    start, (state, turned) = start_of(system), near or (None, None)
    begin, period = (state or start).t, model.options.duration
    check_repeats(system, system.driven, state or start, period)
    equations, path = Equations(system, start.choice), Followed(system, start)
    if equations.shapes.all():
        times = begin + np.linspace(0.0, period, _POSITIONS)
        choice = choose_for_all(system, system.instants(path.rows(times)).q)
        equations, start = Equations(system, choice), system.project(0.0, start.q, start.u, choice)
        bare = partial(_undeformed, path, choice)
        state = state or orbit_start(equations, bare, begin, period, HARMONICS)
    # fast motion may have no equilibrium nearby
    start = state or equations.equilibrium(start) or start
    instants = begin + model.step * np.arange(model.options.steps + 1)
    run, verdict = SpatialCycles(equations, instants, method_of(model), closer).repeated(start, share)
    run.turned = turned
    if verdict is None:
        assert run.stopped is not None
        raise run.stopped
    return run, verdict


def _undeformed(path: Curve, choice: Choice, times: np.ndarray) -> list[State]:
    """States of the undeformed mechanism at ``times`` [s]."""
    found, none = path.system.instants(path.rows(times)), np.zeros(path.system.engine.size)
    states = zip(times.tolist(), found.q, found.u, strict=True)
    return [State(t, q, u, none, path.start.sizes, choice) for t, q, u in states]
