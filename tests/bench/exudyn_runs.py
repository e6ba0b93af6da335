"""Section: whole runs of kaneflex and of Exudyn at equal error.

Each program is refined until its mid-rod deflection is within 1e-3 (rms, of the largest) of its own converged answer;
the quickest that are so are timed in turn. Timed is solving alone: no compiling, building or reading of sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from bench.interleave import interleave
from bench.rows import Row, Target
from kaneflex.peers import exudyn
from kaneflex.scene import Scene, read_scene, with_settings
from kaneflex.solve.curves import Curves, Resolution
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import simulate
from kaneflex.support.errors import SceneError

TITLE = "Whole runs against Exudyn"
ABOUT = """Time to an error of 1e-3 (rms of the mid-rod deflection, of its largest, against each program's own converged
answer), solving alone; the ratio is to kaneflex. Under preset `stiffened` kaneflex is linear about the prescribed
motion where Exudyn solves the nonlinear equations with Lagrange multipliers, so that ratio is also one of models;
preset `coupled` is nonlinear in both."""
SENSOR = "mid_transverse"
ERROR, ROUNDS = 1e-3, 7
SCENES = {
    "engine": (("solve.start=zero",), (180, 360, 720, 1440, 2880, 5760), 11520, Target(100.0, 400.0, at_least=True)),
    "slider-crank-150-coupled": ((), (125, 250, 500, 1000, 2000, 4000, 8000), 16000, None),
}
"""Scene -> settings, steps to try, steps of the converged answer, target of the ratio."""
TOLERANCE = 1e-5
"""Of a step of the coupled equations, far below the error asked for; the converged answer keeps the scene's own."""
ELEMENTS = (2, 4, 8)
FINEST = 16
Solver = Callable[[int, int], Curves]


def rows() -> Iterator[Row]:
    for name, (settings, steps, finest, target) in SCENES.items():
        scene = scene_of(name, settings)
        try:
            exudyn.check(scene)
        except SceneError:
            yield Row(name, "Exudyn", None, missing="exudyn is not installed")
            continue
        solvers = {"kaneflex": by_kaneflex(scene), "Exudyn": by_exudyn(scene, steps[0])}
        yield from raced(scene, solvers, steps, finest, target)


def raced(
    scene: Scene, solvers: dict[str, Solver], steps: tuple[int, ...], finest: int, target: Target | None
) -> Iterator[Row]:
    """Both programs at the coarsest resolution that is within the error, in turn."""
    chosen = {program: coarsest(solve, steps, finest) for program, solve in solvers.items()}
    race = interleave(
        {
            program: lambda solve=solve, at=chosen[program][:2]: solve(*at).seconds
            for program, solve in solvers.items()
        },
        ROUNDS,
    )  # fmt: skip
    apart = error(chosen["kaneflex"][3], chosen["Exudyn"][3])
    for program, (elements, count, found, _) in chosen.items():
        note = f"{elements} elements, {count} steps, error {found:.1e}"
        ours = program == "kaneflex"
        note += f"; preset {scene.solve.preset}" if ours else f", fully nonlinear; converged answers {apart:.1e} apart"
        ratio = race.ratio(program, "kaneflex")
        yield Row(scene.name, program, race[program], ratio, None if ours else target, differs=note)


def scene_of(name: str, settings: tuple[str, ...]) -> Scene:
    """With one sensor, so that neither program records what is not read."""
    scene = with_settings(read_scene(name), list(settings))
    return with_settings(scene, [f"sensors.{other}=none" for other in scene.sensors if other != SENSOR])


def by_kaneflex(scene: Scene) -> Solver:
    models = {}

    def solve(elements: int, steps: int) -> Curves:
        if (elements, steps) not in models:
            changes = [f"bodies.rod.beam.elements={elements}", f"solve.steps={steps}"]
            changes += [f"solve.tolerance={TOLERANCE}"] * (elements < FINEST)
            models[elements, steps] = load(with_settings(scene, changes))
        solution = simulate(models[elements, steps])
        return Curves(solution.times, {SENSOR: solution.series[SENSOR].values}, {}, (), solution.seconds)

    return solve


def by_exudyn(scene: Scene, recorded: int) -> Solver:
    """It records at few instants, since its own storing would otherwise take longer than its solving."""

    def solve(elements: int, steps: int) -> Curves:
        return exudyn.solve(with_settings(scene, [f"solve.steps={recorded}"]), Resolution(elements, steps))

    return solve


def error(found: Curves, exact: Curves) -> float:
    """Rms difference over the coarser one's instants, as a share of the largest value."""
    reference = np.interp(found.times, exact.times, exact.values[SENSOR])
    return float(np.sqrt(np.mean((found.values[SENSOR] - reference) ** 2)) / abs(reference).max())


def coarsest(solve: Solver, steps: tuple[int, ...], finest: int) -> tuple[int, int, float, Curves]:
    """Elements and steps of the quickest run that is within the error, the error, and the converged curves."""
    exact = solve(FINEST, finest)
    good = []
    for elements in ELEMENTS:
        for count in steps:
            found = error(solve(elements, count), exact)
            if found <= ERROR:
                good.append((solve(elements, count).seconds, elements, count, found))
                break
    _, elements, count, found = min(good)
    return elements, count, found, exact
