"""Section: whole runs of kaneflex and of Exudyn at equal error.

Each program is refined until the deflection of an elastic link's middle is within 1e-3 (rms, of the largest) of its own
converged answer; the quickest that are so are timed in turn. Timed is solving alone: no compiling, building or reading
of sensors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bench.interleave import interleave
from bench.rows import Row
from kaneflex import Scene, SceneError, load, read_scene, with_settings
from kaneflex.solve.curves import Curves, Resolution
from kaneflex.solve.simulation import solve as solved
from kaneflex_peers import exudyn

TITLE = "Whole runs against Exudyn"
ABOUT = """\
Times are those to compute the deflection of an elastic link with an rms error of 1e-3 of its peak. The error is
relative to the converged result of the same program; the ratio is to kaneflex. Preset `stiffened` is linear about
the prescribed motion. `coupled` is nonlinear like Exudyn, but with modes in floating axes. kaneflex finds periodic
motions by harmonics; Exudyn integrates until the transient has decayed to 1e-4."""
ERROR, ROUNDS = 1e-3, 7


@dataclass(frozen=True)
class Race:
    """A scene with the link whose middle a sensor reads, steps to try, steps of the converged answer.

    ``recorded``: instants at which answers to a tolerance are stored, periodic ones and nonlinear ones.
    """

    scene: str
    settings: tuple[str, ...]
    link: str
    sensor: str
    steps: tuple[int, ...]
    finest: int
    recorded: int = 0

    def efforts(self, program: str) -> tuple[float, ...]:
        """What to try, from the coarsest on: numbers of steps, or tolerances where the error chooses the steps."""
        return TOLERANCES if program == "kaneflex" and self.recorded else self.steps

    @property
    def name(self) -> str:
        what = [word for setting, word in _NAMED.items() if setting in self.settings]
        return ", ".join([self.scene, *what])


_NAMED = {"solve.preset=coupled": "coupled", "solve.start=periodic": "its periodic motion"}
_ENGINE = (180, 360, 720, 1440, 2880, 5760)
RACES = (
    Race("engine", ("solve.start=periodic",), "rod", "mid_transverse", _ENGINE, 11520, recorded=90),
    Race("engine", ("solve.start=zero",), "rod", "mid_transverse", _ENGINE, 11520),
    Race(
        "engine", ("solve.start=zero", "solve.preset=coupled", "solve.modes=3"), "rod", "mid_transverse",
        _ENGINE, 11520, recorded=90,
    ),
    Race(
        "slider-crank-150-coupled", ("solve.integrator=radau",), "rod", "mid_transverse",
        (125, 250, 500, 1000, 2000, 4000, 8000), 16000, recorded=60,
    ),
    Race(
        "four-bar-motor", ("solve.duration=0.3 s",), "coupler", "coupler_mid",
        (300, 600, 1200, 2400, 4800, 9600), 19200, recorded=60,
    ),
)  # fmt: skip
TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(4, 17))
"""Errors allowed of the coupled equations."""
ELEMENTS = (2, 4, 8)
FINEST = 16
Solver = Callable[[int, float], Curves]


def rows() -> Iterator[Row]:
    for race in RACES:
        scene = scene_of(race)
        try:
            exudyn.check(scene)
        except SceneError:
            yield Row(race.name, "Exudyn", None, missing="exudyn is not installed")
            continue
        solvers = {"kaneflex": by_kaneflex(race, scene), "Exudyn": by_exudyn(scene, race.recorded or race.steps[0])}
        yield from raced(race, scene, solvers)


def raced(race: Race, scene: Scene, solvers: dict[str, Solver]) -> Iterator[Row]:
    """Both programs at the coarsest resolution that is within the error, in turn."""
    chosen = {program: coarsest(race, program, solve) for program, solve in solvers.items()}
    timed = interleave(
        {program: lambda solve=solve, at=chosen[program][:2]: solve(*at).seconds for program, solve in solvers.items()},
        ROUNDS,
    )  # fmt: skip
    apart = error(race.sensor, chosen["kaneflex"][3], chosen["Exudyn"][3])
    for program, (elements, effort, found, _) in chosen.items():
        ours = program == "kaneflex"
        work = f"a tolerance of {effort:.0e}" if ours and race.recorded else f"{effort} steps"
        note = f"{elements} elements, {work}, error {found:.1e}"
        note += f"; preset {scene.solve.preset}" if ours else f", fully nonlinear; converged answers {apart:.1e} apart"
        ratio = timed.ratio(program, "kaneflex")
        yield Row(race.name, program, timed[program], ratio, differs=note)


def scene_of(race: Race) -> Scene:
    """With one sensor, so that neither program records what is not read."""
    scene = with_settings(read_scene(race.scene), list(race.settings))
    return with_settings(scene, [f"sensors.{other}=none" for other in scene.sensors if other != race.sensor])


def by_kaneflex(race: Race, scene: Scene) -> Solver:
    models = {}

    def solve(elements: int, effort: float) -> Curves:
        if (elements, effort) not in models:
            changes = [f"bodies.{race.link}.beam.elements={elements}", f"solve.steps={race.recorded or effort}"]
            changes += [f"solve.tolerance={effort}"] * bool(race.recorded)
            models[elements, effort] = load(with_settings(scene, changes))
        solution = solved(models[elements, effort])
        return Curves(solution.times, {race.sensor: solution.series[race.sensor].values}, {}, (), solution.seconds)

    return solve


def by_exudyn(scene: Scene, recorded: int) -> Solver:
    """It records at few instants, since its own storing would otherwise take longer than its solving."""

    def solve(elements: int, steps: float) -> Curves:
        return exudyn.solve(with_settings(scene, [f"solve.steps={recorded}"]), Resolution(elements, int(steps)))

    return solve


def error(sensor: str, found: Curves, exact: Curves) -> float:
    """Rms difference over the coarser one's instants, as a share of the largest value."""
    reference = np.interp(found.times, exact.times, exact.values[sensor])
    return float(np.sqrt(np.mean((found.values[sensor] - reference) ** 2)) / abs(reference).max())


def coarsest(race: Race, program: str, solve: Solver) -> tuple[int, float, float, Curves]:
    """Elements and effort of the quickest run that is within the error, the error, and the converged curves."""
    efforts = race.efforts(program)
    exact = solve(FINEST, efforts[-1] if program == "kaneflex" and race.recorded else race.finest)
    good = []
    for elements in ELEMENTS:
        for effort in efforts:
            found = error(race.sensor, solve(elements, effort), exact)
            if found <= ERROR:
                good.append((solve(elements, effort).seconds, elements, effort, found))
                break
    _, elements, effort, found = min(good)
    return elements, effort, found, exact
