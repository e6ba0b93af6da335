"""Section: time over error of the nonlinear equations, by each integrator there is for them and by Exudyn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from bench.exudyn_runs import RACES, Race, by_exudyn, by_kaneflex, error, scene_of
from bench.interleave import interleave
from bench.rows import Row
from kaneflex import SceneError, with_settings
from kaneflex_peers import exudyn

TITLE = "Work over precision"
ABOUT = """\
Preset `coupled` and Exudyn use the same number of elements. Tolerances are tightened, or steps added, from row to row.
The table gives the time, and the rms error of the deflection in the middle of an elastic link relative to the converged
result of the same program."""
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
SLOW = (1e-3, 1e-4, 1e-5, 1e-6)
"""Those of scipy."""
ELEMENTS, ROUNDS, BUDGET = 8, 5, 5.0


def rows() -> Iterator[Row]:
    for race in (race for race in RACES if race.recorded and "solve.start=periodic" not in race.settings):
        scene = scene_of(race)
        for integrator in ("radau", "gauss", "scipy"):
            of = replace(race, settings=(*race.settings, f"solve.integrator={integrator}"))
            yield from measured(of, f"kaneflex, {integrator}", SLOW if integrator == "scipy" else TOLERANCES)
        try:
            exudyn.check(scene)
        except SceneError:
            yield Row(race.name, "Exudyn", None, missing="exudyn is not installed")
            continue
        yield from measured(race, "Exudyn", race.steps)


def measured(race: Race, candidate: str, efforts: tuple[float, ...]) -> Iterator[Row]:
    """A row for every tolerance or number of steps, from the coarsest on."""
    scene, ours = scene_of(race), candidate != "Exudyn"
    if ours:
        solve = by_kaneflex(race, scene)
        finest = by_kaneflex(race, with_settings(scene, ["solve.integrator=gauss"]))(ELEMENTS, 1e-10)
    else:
        solve = by_exudyn(scene, race.recorded)
        finest = solve(ELEMENTS, race.finest)
    for effort in efforts:
        found = error(race.sensor, solve(ELEMENTS, effort), finest)
        timed = interleave({candidate: lambda effort=effort: solve(ELEMENTS, effort).seconds}, ROUNDS, BUDGET)
        work = f"a tolerance of {effort:.0e}" if ours else f"{effort} steps"
        yield Row(race.name, candidate, timed[candidate], differs=f"{work}, error {found:.1e}", error=found)
