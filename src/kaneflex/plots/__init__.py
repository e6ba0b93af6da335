"""Pictures of a solution: one module for each kind, written as PNG and SVG, the animation as GIF.

Every module's ``figures(solution)`` returns its pictures by file name, none where the scene has nothing to show.
matplotlib is imported with the first picture, never with this package.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kaneflex.scene import Scene
    from kaneflex.solve.solution import Solution

Progress = Callable[[float], None]


def draw_all(
    solution: Solution, folder: Path | str, progress: Progress | None = None, frames: int | None = None,
    seconds: float | None = None, mp4: bool = False,
) -> list[Path]:  # fmt: skip
    """Write every picture that applies to the scene.

    Parameters
    ----------
    solution : Solution
        From :func:`kaneflex.simulate`; one that stopped early is drawn up to where it stopped.
    folder : path
        Made where it does not exist; pictures of the same names are replaced.
    progress : callable, optional
        Called with the finished share of the work, 0 to 1.
    frames : int, optional
        Instants of the animation; by default 60.
    seconds : float, optional
        How long the animation lasts; by default 12 instants are shown in a second.
    mp4 : bool
        Whether it is written as MP4, too; extra ``mp4`` brings the encoder.

    Returns
    -------
    list of Path
        The files, in the order of writing. The same solution gives the same bytes.

    Raises
    ------
    OSError
        If the folder or a file in it can't be written.
    SceneError
        If an MP4 is wanted and no encoder installed.
    """
    from kaneflex.plots import animation, spatial
    from kaneflex.plots.style import save, styled
    from kaneflex.plots.view import FRAMES

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    with styled():
        kinds = _kinds(solution)
        for done, pictures in enumerate(kinds):
            for name, figure in pictures(solution).items():
                written += save(figure, folder / name)
            if progress is not None:
                progress((done + 1) / (len(kinds) + 1))
        if _moves(solution):
            kind = spatial if solution.model.scene.is_spatial else animation
            moving = [folder / f"animation.{ending}" for ending in ("gif", *["mp4"] * mp4)]
            kind.animate(solution, moving, frames or FRAMES, seconds)
            written += moving
    if progress is not None:
        progress(1.0)
    return written


def draw(kind: str, found: object, folder: Path) -> list[Path]:
    """Write the picture of what a study found into a folder that exists, as KIND.png and KIND.svg.

    ``kind`` is the module that makes it: "overlay" of a comparison, "sensitivities", "stability", "terms", "trade"; of
    a sweep's dataset "sweep", "bifurcation" or "poincare".
    """
    from kaneflex.plots.style import save, styled

    with styled():
        return save(import_module(f"kaneflex.plots.{kind}").figure(found), folder / kind)


def figures(solution: Solution) -> dict[str, Figure]:
    """Every still picture of a solution as a matplotlib Figure, by name, for a notebook or another page."""
    from kaneflex.plots.style import styled

    with styled():
        return {name: figure for pictures in _kinds(solution) for name, figure in pictures(solution).items()}


def show(scene: Scene, at: Mapping[str, float] | None = None) -> Figure:
    """The drawing of a scene with its bodies, joints, drives, loads and sensors; nothing is solved for it.

    Parameters
    ----------
    scene : Scene
    at : mapping of str to float, optional
        Drive -> coordinate [rad or m] at which it is drawn; by default as the run starts.

    Raises
    ------
    SceneError
        If the mechanism can't stand there; for a place of one in space, which is drawn as it starts.
    """
    from kaneflex.plots.style import styled

    with styled():
        if scene.is_spatial:
            from kaneflex.plots import spatial
            from kaneflex.solve.spatial_loading import spatial_start

            spatial.refuse_places(at or {})
            return spatial.scheme(scene, spatial_start(scene)[2])
        from kaneflex.mechanism.position_analysis import place, with_branches
        from kaneflex.plots.scheme import scheme

        scene = with_branches(scene)
        return scheme(scene, place(scene, at or {}))


def _moves(solution: Solution) -> bool:
    """Whether there is a motion to draw: a run that found no periodic state holds no instant."""
    return len(solution.times) > 1


def _kinds(solution: Solution) -> tuple[Callable[[Solution], dict[str, Figure]], ...]:
    from kaneflex.plots import (
        clearances,
        displacements,
        energy,
        loads,
        modes,
        motion,
        orders,
        paths,
        records,
        sensors,
        spatial,
        stress,
    )

    of_any = (loads.figures, sensors.figures, orders.figures, energy.figures)
    if solution.model.scene.is_spatial:
        moving = (spatial.figures, spatial.hodographs, spatial.deformed, stress.figures, *of_any)
        return (*(moving if _moves(solution) else ()), spatial.modes)
    if not _moves(solution):
        return (modes.figures,)
    kinds = (motion, paths, modes, displacements, stress, clearances, records)
    return (*(kind.figures for kind in kinds), *of_any)
