"""Pictures of a solution: one module for each kind, written as PNG and SVG, the animation as GIF.

Each kind's function returns its pictures by file name, none where the scene has nothing to show.
matplotlib is imported with the first picture, never with this package.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from kaneflex.support.arguments import takes
from kaneflex.support.errors import SceneError, nearest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kaneflex.scene.read import SceneLike
    from kaneflex.solve.solution import Solution

Progress = Callable[[float], None]


KINDS: dict[str, str] = {
    "mechanism": "deformed.figures",
    "sensors": "sensors.figures",
    "loads": "loads.figures",
    "motion": "motion.figures",
    "paths": "paths.figures",
    "modes": "modes.figures",
    "displacements": "displacements.figures",
    "surfaces": "displacements.surfaces",
    "stresses": "stress.figures",
    "clearances": "clearances.figures",
    "spectra": "spectra.figures",
    "energy": "loads.energy",
    "animation": "animation.animate",
}
"""Kinds of pictures by the name that a user asks for, and the functions that make them."""
_IN_THE_PLANE = ("motion", "displacements", "surfaces")
"""Kinds of pictures of planar mechanisms alone."""
_SVG, _ALL = "svg", "all"
"""Names beside those of the kinds: each still picture as SVG, too; everything."""
_WITHOUT_MOTION = ("modes",)
"""Kinds of pictures that do not need an instant of a run."""


def kinds_of(text: str) -> tuple[str, ...]:
    """Kinds of pictures that a comma-separated list names, and "svg" for SVG beside PNG; "all" is everything.

    Raises SceneError for a name that is no kind.
    """
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))
    known = (*KINDS, _SVG)
    for name in names:
        if name not in known and name != _ALL:
            raise SceneError("plots", name, "no such kind of picture", nearest(name, [_ALL, *known]))
    return known if _ALL in names else names


@takes(solution="solution", folder="path", progress="function", frames="whole", seconds="number", kinds="text")
def draw_all(
    solution: Solution, folder: Path | str, progress: Progress | None = None, frames: int | None = None,
    seconds: float | None = None, kinds: str = _ALL,
) -> list[Path]:  # fmt: skip
    """Write the pictures of a run; kinds that do not apply to its scene are left out.

    Parameters
    ----------
    solution : Solution
        From :func:`kaneflex.simulate`; one that stopped early is drawn up to where it stopped.
    folder : path
        Created if needed; pictures of the same names are replaced.
    progress : callable, optional
        Called with the finished share of the work, 0 to 1.
    frames : int, optional
        Instants of the animation; by default 60.
    seconds : float, optional
        Duration of the animation; by default 12 frames per second.
    kinds : str
        Comma-separated names of :data:`kaneflex.plots.KINDS`; "svg" also writes SVG files, "all" draws everything.

    Returns
    -------
    list of Path
        The files, in the order of writing. The same solution gives the same bytes.

    Raises
    ------
    OSError
        If the folder or a file in it can't be written.
    SceneError
        If a kind is unknown.
    """
    from kaneflex.plots.style import save, styled
    from kaneflex.plots.view import FRAMES

    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    wanted = kinds_of(kinds)
    makers = _makers(solution, wanted)
    with styled():
        for done, (kind, make) in enumerate(makers, 1):
            if kind == "animation":
                written.append(folder / "animation.gif")
                make(solution, written[-1], frames or FRAMES, seconds)
            else:
                for name, figure in make(solution).items():
                    written += save(figure, folder / name, _SVG in wanted)
            if progress is not None:
                progress(done / len(makers))
    return written


def draw(kind: str, found: object, folder: Path) -> list[Path]:
    """Write the picture of a study's result into an existing folder, as KIND.png.

    ``kind`` is the function that makes it: "overlay" of a comparison, "sensitivities", "stability", "trade", "terms";
    of a sweep's labelled arrays "sweep", "bifurcation", "poincare".
    """
    from kaneflex.plots.style import save, styled

    module = import_module(f"kaneflex.plots.{'stability' if kind == 'stability' else 'studies'}")
    with styled():
        return save(getattr(module, kind)(found), folder / kind, svg=False)


@takes(solution="solution", kinds="text")
def figures(solution: Solution, kinds: str = _ALL) -> dict[str, Figure]:
    """Still pictures of a solution as matplotlib Figures by name, of all kinds or of the comma-separated ones."""
    from kaneflex.plots.style import styled

    with styled():
        made = [make(solution) for kind, make in _makers(solution, kinds_of(kinds)) if kind != "animation"]
    return {name: figure for pictures in made for name, figure in pictures.items()}


@takes(scene="scene", at="places")
def show(scene: SceneLike, at: Mapping[str, float] | None = None) -> Figure:
    """Drawing of a scene with its bodies, joints, drives, loads and sensors; the scene is not solved.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
    at : mapping of str to float, optional
        Coordinates of drives by name [rad or m]; by default those at the start of the run.

    Raises
    ------
    SceneError
        If the loops cannot close there, or if ``at`` is given for a scene in space, which is drawn at its start.
    """
    from kaneflex.plots.style import styled
    from kaneflex.scene.read import scene_from

    scene = scene_from(scene)
    with styled():
        from kaneflex.plots.scheme import refuse_places, scheme

        if scene.is_spatial:
            from kaneflex.solve.engine_loading import spatial_start

            refuse_places(at or {})
            return scheme(scene, spatial_start(scene)[2])
        from kaneflex.mechanism.mechanism import mechanism_of
        from kaneflex.mechanism.position_analysis import place
        from kaneflex.mechanism.tight_start import as_it_starts

        scene = as_it_starts(scene)
        return scheme(scene, place(mechanism_of(scene), at or {}))


@overload
def explore(
    scene: SceneLike, vary: Sequence[str], sensors: Sequence[str] = (), window: Literal[True] = True
) -> list[str]: ...
@overload
def explore(
    scene: SceneLike, vary: Sequence[str], sensors: Sequence[str] = (), *, window: Literal[False]
) -> Figure: ...
@takes(scene="scene", vary="texts", sensors="texts")
def explore(
    scene: SceneLike, vary: Sequence[str], sensors: Sequence[str] = (), window: bool = True
) -> list[str] | Figure:
    """Open a window with a slider for each number that varies; the curves of the sensors follow.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
    vary : sequence of str
        Entries of the scene with their ends: "main.speed=2000:6000rpm", "rod.elements=1:8".
    sensors : sequence of str, optional
        Sensors to show; by default the first four groups of similar sensors.
    window : bool
        False opens no window and returns its first picture as a Figure.

    Returns
    -------
    list of str or Figure
        When the window closes, the settings of its sliders, as :func:`kaneflex.with_settings` takes them.

    Raises
    ------
    SceneError
        For an entry that cannot vary, and an unknown sensor.
    UserError
        If matplotlib cannot open a window.
    """
    from kaneflex.plots import explorer
    from kaneflex.plots.style import styled
    from kaneflex.scene.read import scene_from
    from kaneflex.study.exploration import Exploration, varied

    scene = scene_from(scene)
    exploration = Exploration(scene, tuple(varied(scene, text) for text in vary), tuple(sensors))
    if window:
        return explorer.open_window(exploration)
    with styled():
        return explorer.figure(exploration)


def _makers(solution: Solution, kinds: Iterable[str]) -> list[tuple[str, Callable[..., Any]]]:
    """Kinds of pictures to draw with their functions; a run without a periodic state has no instant to draw."""
    found = []
    spatial, moves = solution.model.in_space is not None, len(solution.times) > 1
    for kind in (kind for kind in kinds if kind != _SVG):
        if (moves or kind in _WITHOUT_MOTION) and not (spatial and kind in _IN_THE_PLANE):
            module, function = KINDS[kind].split(".")
            found.append((kind, getattr(import_module(f"kaneflex.plots.{module}"), function)))
    return found
