"""Run of a scene into a complete result folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kaneflex.cli.command import Target
from kaneflex.cli.scene import uncollected, undocumented
from kaneflex.scene import with_settings
from kaneflex.support.errors import Fault, OutputError
from kaneflex.support.files import whole_folder, writing
from kaneflex.support.terminal import Waiting, share_of

if TYPE_CHECKING:
    from kaneflex.report.summary import Summary
    from kaneflex.scene import Scene
    from kaneflex.solve.solution import Solution
    from kaneflex.solve.summary_tables import Choice
    from kaneflex.study.sensitivity.report import Sensitivities

SUMMARY_FILE, RESULTS_FILE, SENSITIVITIES_FILE = "summary.json", "results.nc", "sensitivities.nc"
SCENE_FILE = "scene.toml"
TABLE_FILE, VTK_FOLDER = "results.csv", "vtk"
_SAME = 1e-6
"""Permitted difference between two runs of one scene, as a share of a sensor's peak: rounding on another machine."""


class Demand(NamedTuple):
    """Permitted error of the named sensors (default: all), as a share of their peaks; ``kept``: whether the model is
    for more than this run."""

    tolerance: float
    sensors: Sequence[str] | None = None
    kept: bool = False


def run_into(
    scene: Scene, target: Target, settings: Sequence[str] = (), after: Path | None = None,
    parameters: Sequence[str] = (), frozen: bool = True, demand: Demand | None = None,
    tell: Callable[[Summary], None] = lambda summary: None,
) -> Summary:  # fmt: skip
    """Solve a scene and write ``results.nc`` and ``.csv``, ``summary.json`` and the pictures into a new folder.

    Also ``scene.toml``, the scene with all settings, from which :func:`draw_again` draws more; with parameters to
    differentiate by ``sensitivities.nc``; for ParaView the folder ``vtk``.

    Parameters
    ----------
    scene : Scene
        Scene with all settings applied.
    target : Target
        Output; its folder appears when it is complete, and not after an error. A run that stopped early is not drawn.
    settings : sequence of str
        The settings, for the summary.
    after : Path, optional
        Results of a coupled run to continue from its last state.
    parameters, frozen
        Paths and basis, see :func:`kaneflex.sensitivities`.
    demand : Demand, optional
        Choose the cheapest model for it, or take it from the user's cache; the summary holds the choice.
    tell : callable
        Called with the summary before anything is drawn.

    Returns
    -------
    Summary
        Also for a run that stopped early; its folder holds the results up to then.

    Raises
    ------
    OutputError
        If the folder exists or can't be written, before anything is computed where that can be known.
    SceneError
        If the scene can't be solved, or nothing can be chosen.
    """
    folder = target.folder
    with whole_folder(folder, mark=SUMMARY_FILE, force=target.force) as partial, Waiting() as waiting:
        choice, solved = (None, None) if demand is None else _chosen(scene, demand, waiting)
        if choice is not None:
            scene, settings = with_settings(scene, choice.settings), [*settings, *choice.settings]
        with uncollected():
            solution = solved or _solve(scene, waiting, after, parameters)
            summary = _summary(solution, settings, choice, waiting)
            found = _differentiated(solution, parameters, frozen, waiting)
            if found is not None:
                summary = summary.model_copy(update={"sensitivities": found.summary()})
            with writing(folder):
                _write(solution, summary, partial)
                if found is not None:
                    found.labelled.to_netcdf(partial / SENSITIVITIES_FILE)
        tell(summary)
        with writing(folder):
            whole = summary.outcome == "completed" or summary.stored > summary.steps  # else what stopped it early
            pictures = _show(solution, found, partial, target, waiting) if whole else []
            _report(solution, partial, pictures, summary)
    return summary


def _chosen(scene: Scene, demand: Demand, waiting: Waiting) -> tuple[Choice, Solution | None]:
    from kaneflex.study.trade.choice import remembered_choice

    return remembered_choice(scene, demand.tolerance, demand.sensors, waiting, "model" if demand.kept else "run")


def _solve(scene: Scene, waiting: Waiting, after: Path | None, parameters: Sequence[str]) -> Solution:
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import solve

    state = None
    if after is not None:
        from kaneflex.solve.initial import read_state

        state = read_state(after)
    if parameters:  # what can't be differentiated is known before anything is derived
        from kaneflex.study.sensitivity.parameters import find_parameters
        from kaneflex.study.sensitivity.report import check_differentiable

        check_differentiable(scene, continued=after is not None)
        find_parameters(scene, parameters)
    model = load(scene, waiting)
    waiting("solving" if model.options.integrator == "spectral" else "compiling the integrator, first time only")
    return solve(model, waiting.share_of("solving"), state)


def _summary(solution: Solution, settings: Sequence[str], choice: Choice | None, waiting: Waiting) -> Summary:
    from kaneflex.report.summary import summarise

    if choice is not None and not solution.model.scene.contacts:  # else of peaks and rms
        solution.judge({name: error + choice.doubt[name] for name, error in choice.errors.items()} | choice.open)
    solution.estimated(share_of(waiting, "estimating the errors"))
    waiting("writing the results")
    return summarise(solution, settings, choice)


def _differentiated(
    solution: Solution, parameters: Sequence[str], frozen: bool, waiting: Waiting
) -> Sensitivities | None:
    """Derivatives of a run by its parameters; None without parameters or after an early stop."""
    if not parameters:
        return None
    from kaneflex.integrate.system import Outcome
    from kaneflex.study.sensitivity.report import sensitivities

    if solution.outcome is not Outcome.COMPLETED:
        return None
    return sensitivities(solution, parameters, frozen, share_of(waiting, "differentiating"))


def _write(solution: Solution, summary: Summary, folder: Path) -> None:
    from kaneflex.scene.read import whole_text

    text = summary.model_dump_json(indent=2) + "\n"
    (folder / SUMMARY_FILE).write_text(text, encoding="utf-8", newline="\n")
    (folder / SCENE_FILE).write_text(whole_text(solution.model.given or solution.model.scene), "utf-8", newline="\n")
    if summary.sensors:
        found = solution.labelled
        found.to_netcdf(folder / RESULTS_FILE)
        found.to_csv(folder / TABLE_FILE, along="time")


def _show(
    solution: Solution, found: Sensitivities | None, folder: Path, target: Target, waiting: Waiting
) -> list[Path]:
    """Draw the pictures, write the motion for ParaView; return the pictures."""
    drawn: list[Path] = []
    if target.plots:
        from kaneflex.plots import draw

        drawn = _draw_all(solution, folder, target, waiting)
        drawn += [] if found is None else draw("sensitivities", found, folder)
    if target.vtk:
        from kaneflex.plots.vtk import write_vtk

        waiting("writing the motion for ParaView")
        write_vtk(solution, folder / VTK_FOLDER, target.frames)
    return drawn


def _report(solution: Solution, folder: Path, pictures: list[Path], summary: Summary) -> None:
    from kaneflex.report.page import write_report

    write_report(solution, folder, pictures, summary)


def _draw_all(solution: Solution, folder: Path, target: Target, waiting: Waiting) -> list[Path]:
    from kaneflex.plots import draw_all
    from kaneflex.solve.solution import PLOTS

    share = share_of(waiting, "drawing the pictures")
    with uncollected():
        undocumented()
    return draw_all(solution, folder, share, target.frames, target.seconds, target.kinds or PLOTS)


def draw_again(folder: Path, target: Target) -> list[Path]:
    """Draw pictures of a finished run into its folder, after solving its scene again.

    Raises
    ------
    OutputError
        If the folder holds no run, or its scene no longer gives its results.
    SceneError
        If a kind of picture is unknown.
    """
    from kaneflex.plots import kinds_of
    from kaneflex.scene import read_scene
    from kaneflex.solve.loading import load
    from kaneflex.solve.simulation import solve

    kinds_of(target.kinds or "")
    for name in (SCENE_FILE, RESULTS_FILE):
        if not (folder / name).is_file():
            raise OutputError(str(folder), None, f"the folder has no {name}", "Give a folder that `kaneflex run` made")
    with Waiting() as waiting, writing(folder):
        with uncollected():
            model = load(read_scene(folder / SCENE_FILE), waiting)
            solution = solve(model, waiting.share_of("solving"))
        _demand_same(solution, folder)
        return _draw_all(solution, folder, target, waiting)


def _demand_same(solution: Solution, folder: Path) -> None:
    """Raise OutputError unless the sensors of a solution are those in the folder's results, to rounding."""
    from kaneflex.support.labelled import read_labelled

    try:
        read = read_labelled(folder / RESULTS_FILE)
    except Fault as fault:
        raise OutputError(str(folder / RESULTS_FILE), None, fault.reason, "Run the scene again with --plots") from fault
    before = {name: entry[1] for name, entry in read.variables.items() if entry[1].dtype.kind == "f"}
    for name, series in solution.series.items():
        found = before.get(name, np.zeros(0))
        if found.shape != series.values.shape or not np.allclose(
            found, series.values, rtol=0.0, atol=_SAME * abs(series.values).max(initial=0.0), equal_nan=True
        ):
            raise OutputError(
                str(folder / RESULTS_FILE), None, f"{name} differs from a new solution of {SCENE_FILE}: kaneflex "
                "or a file of the scene has changed, or the run continued another run",
                "Run the scene again with --plots",
            )  # fmt: skip
