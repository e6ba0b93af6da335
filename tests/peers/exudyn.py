"""A scene in Exudyn: absolute coordinates, ANCF cable elements, joints by Lagrange multipliers, generalised-alpha.

Exudyn: Gerstmayr (2023), Multibody System Dynamics. Elements: Gerstmayr & Shabana (2006), Nonlinear Dynamics 45.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Any

from kaneflex.solve.curves import FINE_ENOUGH, Curves, Resolution
from kaneflex.support.errors import SceneError, installed, naming
from kaneflex_peers.buildable import check_buildable, cycles_to_steady_state, has_elastic, touches

if TYPE_CHECKING:
    from kaneflex.multibody.model.bound_model import Model
    from kaneflex.scene import Scene
    from kaneflex_peers.exudyn_spatial import Built as SpatialBuilt
    from kaneflex_peers.exudyn_system import Built
    from kaneflex_peers.readings import Recorder

_NEWTON_TOLERANCE = 1e-6
"""Newton's absolute tolerance: a mechanism that starts from rest has no residual to be relative to."""
_RHO_INFINITY = 0.9


def solve(
    scene: Scene, resolution: Resolution = FINE_ENOUGH, progress: Callable[[str], None] = lambda stage: None
) -> Curves:
    """Build a scene in Exudyn, run it and read the scene's sensors.

    Parameters
    ----------
    scene : Scene
    resolution : Resolution
    progress : callable
        Called with the name of each stage.

    Returns
    -------
    Curves
        Over one cycle or the scene's duration, at the instants at which the scene itself is solved.

    Raises
    ------
    SceneError
        Without the package exudyn, for what can't be built there, and where its solver stops.
    """
    exudyn = check(scene)
    from kaneflex.scene import with_settings
    from kaneflex.solve.loading import integrated, load

    own = has_elastic(scene) or touches(scene)
    preset = "stiffened" if not scene.is_spatial else scene.solve.preset if own else "rigid"
    model = integrated(load(with_settings(scene, [f"solve.preset={preset}"]), progress))
    progress("building the scene in Exudyn")
    steps = resolution.steps or 4 * model.options.steps
    build, recorder_of = _planar_or_spatial(scene)
    built = build(exudyn, model, resolution)
    recorder = recorder_of(model, built)
    rigid = scene.is_spatial and not has_elastic(scene)
    cycles = 1 if rigid else cycles_to_steady_state(scene, model.options)
    progress("solving in Exudyn")
    seconds = _run(built, model, steps, cycles)
    values, missing = recorder.read((cycles - 1) * model.step * model.options.steps)
    notes = built.notes if rigid else (*built.notes, *_run_notes(model, cycles))
    return Curves(recorder.times, values, missing, notes, seconds)


def _planar_or_spatial(scene: Scene) -> tuple[Callable[..., Any], Callable[..., Recorder]]:
    """Functions that build a scene and read its sensors."""
    if scene.is_spatial:
        from kaneflex_peers import exudyn_spatial, spatial_readings

        return exudyn_spatial.build, spatial_readings.SpatialRecorder
    from kaneflex_peers import exudyn_system, readings

    return exudyn_system.build, readings.PlanarRecorder


def check(scene: Scene) -> ModuleType:
    """Package exudyn; raises SceneError if it is missing or can't build the scene."""
    with naming("--with", "exudyn"), installed("the package exudyn", "peer", "exudyn"):
        import exudyn
    check_buildable(scene)
    return exudyn


def _run_notes(model: Model, cycles: int) -> list[str]:
    notes = []
    if model.scene.damping is not None:
        notes.append(
            "damping proportional to the stiffness alone, with the scene's ratio at the lower of its two frequencies"
        )
    if cycles > 1:
        notes.append(f"from the undeformed state; cycle {cycles} is taken for the periodic state")
    return notes


def _run(built: Built | SpatialBuilt, model: Model, steps: int, cycles: int) -> float:
    """Solve; returns the wall time [s] of the solver alone."""
    system, horizon = built.system, model.step * model.options.steps
    system.Assemble()
    settings = built.exudyn.SimulationSettings()
    settings.timeIntegration.endTime = cycles * horizon
    settings.timeIntegration.numberOfSteps = cycles * steps
    settings.timeIntegration.adaptiveStep = False
    settings.timeIntegration.discontinuous.useRecommendedStepSize = False
    settings.timeIntegration.generalizedAlpha.spectralRadius = _RHO_INFINITY
    settings.timeIntegration.newton.absoluteTolerance = _NEWTON_TOLERANCE
    settings.solution.file.write = False
    if model.scene.is_spatial:
        if not has_elastic(model.scene):  # beams' forces are rounded to more than that
            settings.timeIntegration.newton.absoluteTolerance = 0.01 * _NEWTON_TOLERANCE  # for the sake of multipliers
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = True
        if model.motion.module.open_reactions:  # as many multipliers too many
            settings.linearSolver.solverType = built.exudyn.LinearSolverType.EigenDense
            settings.linearSolver.ignoreSingularJacobian = True
    settings.solution.sensors.writePeriod = model.step * max(1, model.options.steps // steps)
    config = built.exudyn.config
    printed, config.printToConsole = config.printToConsole, False
    started = time.perf_counter()
    try:
        system.SolveDynamic(settings)
    except built.exudyn.SolverError:
        cure = "Give it more steps with --peer-steps, or other elements with --peer-elements"
        raise SceneError("--with", "exudyn", "its Newton iteration did not converge", cure) from None
    finally:
        config.printToConsole = printed
    return time.perf_counter() - started
