"""Time of kaneflex and of Exudyn at equal error. A script: python tests/bench_exudyn.py

Each program is refined until its mid-rod deflection is within 1e-3 (rms, of the largest) of its own converged answer;
the two coarsest that are so are timed in turn. Timed is solving alone: no compiling, building or reading of sensors.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable

import numpy as np

from kaneflex.comparison import Curves, Resolution
from kaneflex.loading import load
from kaneflex.peers import exudyn
from kaneflex.scene import Scene, read_scene, with_settings
from kaneflex.simulation import simulate

SENSOR = "mid_transverse"
ERROR, ROUNDS = 1e-3, 7
SCENES = {
    "engine": (("solve.start=zero",), (180, 360, 720, 1440, 2880, 5760), 11520),
    "slider-crank-150-coupled": ((), (125, 250, 500, 1000, 2000, 4000, 8000), 16000),
}
TOLERANCE = 1e-5
"""Of a step of the coupled equations, far below the error asked for; the converged answer keeps the scene's own."""
ELEMENTS = (2, 4, 8)
FINEST = 16
Solver = Callable[[int, int], Curves]


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


def main() -> None:
    for name, (settings, steps, finest) in SCENES.items():
        scene = scene_of(name, settings)
        solvers = {"kaneflex": by_kaneflex(scene), "exudyn": by_exudyn(scene, steps[0])}
        chosen = {program: coarsest(solve, steps, finest) for program, solve in solvers.items()}
        seconds: dict[str, list[float]] = {program: [] for program in solvers}
        for _ in range(ROUNDS):
            for program, solve in solvers.items():
                elements, count, *_ = chosen[program]
                seconds[program].append(solve(elements, count).seconds)
        print(f"{name}: converged answers {error(chosen['kaneflex'][3], chosen['exudyn'][3]):.2e} apart")
        for program, (elements, count, found, _) in chosen.items():
            taken = statistics.median(seconds[program])
            print(f"  {program:9} {elements} elements, {count} steps, error {found:.1e}: {1e3 * taken:.2f} ms")
        ratio = statistics.median(seconds["exudyn"]) / statistics.median(seconds["kaneflex"])
        print(f"  kaneflex is {ratio:.1f} times as fast")


if __name__ == "__main__":
    main()
