"""Options that commands share: the scene and its changes, quantities, configurations, and the choice of a model."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from kaneflex.cli.command import Decorator, combined_options, names_option
from kaneflex.support.errors import SceneError, naming, nearest
from kaneflex.support.terminal import echo

if TYPE_CHECKING:
    from kaneflex.scene import Scene
    from kaneflex.solve.summary_tables import Choice
    from kaneflex.support.units import Dimension

USER_ERROR, STOPPED_EARLY, INTERRUPTED = 2, 3, 130
"""Exit codes: an error of the user; a run that went unstable or found no periodic state; Ctrl-C."""


class SceneArguments(NamedTuple):
    """SCENE and its changes on the command line, see :func:`scene_options`."""

    name: str
    preset: str | None = None
    settings: tuple[str, ...] = ()
    steps: str | None = None
    integrator: str | None = None

    @property
    def changes(self) -> list[str]:
        """All changes as settings. Raises SceneError for an entry that both an option and --set give."""
        options = {"preset": self.preset, "steps": self.steps, "integrator": self.integrator}
        own = {key: value for key, value in options.items() if value is not None}
        for text in self.settings:
            key = text.partition("=")[0].strip().removeprefix("solve.")
            if key in own:
                raise SceneError(f"--{key}", own[key], f"--set {text} gives the same entry", "Leave out one of the two")
        return [*self.settings, *(f"solve.{key}={value}" for key, value in own.items())]

    def read(self) -> Scene:
        """Scene with the changes."""
        return read(self.name, self.changes)

    def read_at(self, at: str | None) -> Scene:
        """Scene with the changes; "DRIVE=ANGLE", if given, becomes its reference configuration."""
        scene = self.read()
        return scene if at is None else read(self.name, [*self.changes, f"solve.mode_angle={mode_angle(scene, at)!r}"])


def gathered(**kinds: Any) -> Decorator:
    """Decorator that collects the options that are fields of a named tuple into one argument of its type."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def wrapped(**given: object) -> None:
            for name, kind in kinds.items():
                own = {field: given.pop(field) for field in kind._fields if field in given}
                given[name] = kind(**own)
            command(**given)

        return wrapped

    return decorate


def completed(kind: str) -> Callable[..., Any]:
    """Completion by :mod:`kaneflex.cli.completion`, imported when the shell requests it."""

    def complete(ctx: click.Context, parameter: click.Parameter, begun: str) -> Any:
        return getattr(import_module("kaneflex.cli.completion"), kind)(ctx, parameter, begun)

    return complete


preset_option = click.option(
    "--preset", metavar="NAME", shell_complete=completed("presets"), help="Model preset, see `kaneflex list`."
)
settings_option = click.option(
    "--set", "settings", multiple=True, metavar="PATH=VALUE", shell_complete=completed("entries"),
    help='Change an entry of the scene: rod.elements=1, rod.length="140 mm", solve.start=zero, loads.gas=none. '
    "Can be repeated.",
)  # fmt: skip
_OPTIONS = {
    "preset": preset_option,
    "settings": settings_option,
    "steps": click.option("--steps", metavar="N", help="Steps per cycle, or per run if there is no cycle."),
    "integrator": click.option(
        "--integrator", metavar="NAME", shell_complete=completed("integrators"), help="Integrator, see `kaneflex list`."
    ),
}  # fmt: skip
"""Options by the fields of :class:`SceneArguments`."""
at_option = click.option(
    "--at", metavar="DRIVE=ANGLE",
    help="Configuration, like main=90deg or bore=20mm; plain numbers are SI. [default: solve.mode_angle of the scene]",
)  # fmt: skip


scene_argument = click.argument("name", metavar="SCENE", shell_complete=completed("scenes"))


def scene_options(*names: str) -> Decorator:
    """Argument SCENE and the options that change it: all, or those of these names."""
    return combined_options(scene_argument, *(_OPTIONS[name] for name in names or _OPTIONS))


def read(name: str, settings: list[str]) -> Scene:
    """Scene of that name or path with the settings applied."""
    from kaneflex.scene import read_scene, with_settings

    scene = read_scene(name)
    return with_settings(scene, settings) if settings else scene


def quantity(option: str, text: str, dimension: Dimension, whole: str | None = None) -> float:
    """Value of an option in SI: a plain number, or one with a unit; ``text`` may be a part of the whole."""
    from kaneflex.support.units import plain_number, to_si

    plain = plain_number(text)
    with naming(option, whole or text):
        found = to_si(text if plain is None else plain, dimension)
    return found


def say_plain(option: str, text: str, part: str, unit: str, read: str) -> None:
    """Print the interpretation of a number without a unit."""
    from kaneflex.support.units import plain_number

    if plain_number(part):
        echo(f"{option} {text}: a plain number is in {unit}, so {read}", err=True)


def configuration(scene: Scene, at: str) -> tuple[str, float]:
    """Drive and coordinate [rad or m] of "DRIVE=ANGLE", like main=90deg; a guide's like bore=20mm; plain numbers SI."""
    from kaneflex.mechanism.mechanism import mechanism_of
    from kaneflex.support.units import ANGLE, LENGTH

    drive, equals, angle = at.partition("=")
    if not equals:
        raise SceneError("--at", at, "not of the form DRIVE=ANGLE", "Write it like --at main=90deg")
    if drive not in scene.drives:
        raise SceneError("--at", at, f"the scene has no drive {drive!r}", nearest(drive, scene.drives))
    dimension = LENGTH if scene.slides(drive) else ANGLE
    coordinate = quantity("--at", angle, dimension, at)
    say_plain("--at", at, angle, dimension.unit, mechanism_of(scene).written_coordinate(drive, coordinate))
    return drive, coordinate


def mode_angle(scene: Scene, at: str) -> float:
    """Coordinate [rad or m] of "DRIVE=ANGLE", where DRIVE is the scene's first drive."""
    drive, angle = configuration(scene, at)
    first = next(iter(scene.drives))
    if drive != first:
        cure = f"Give the angle of {first} only"
        raise SceneError("--at", at, f"only {first}, the first drive, sets the configuration of modes", cure)
    return angle


@contextmanager
def uncollected() -> Iterator[None]:
    """Exclude all objects made within from garbage collection.

    Most of them are modules, which live until the end; searching them for garbage takes a third of a warm run.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


def undocumented() -> None:
    """Import matplotlib without lists of properties in its docstrings and without its argument ``data``.

    They take a third of the time.
    """
    modules: list[Any] = [import_module(f"matplotlib{name}") for name in ("", ".artist", "._docstring")]
    whole, artist, docstrings = modules
    for kind in (docstrings.Substitution, type(docstrings.interpd)):
        kind.__call__ = lambda own, of: of
    artist.Artist._update_set_signature_and_docstring = classmethod(lambda of: None)
    whole._preprocess_data = lambda of=None, **named: of or (lambda each: each)


UNKNOWN = "Not verified"


class Choosing(NamedTuple):
    """Request for a model: the permitted error, the sensors, and whether to write the model into the scene's file."""

    tolerance: str | None = None
    sensors: tuple[str, ...] = ()
    write_back: bool = False


def tolerance_of(text: str) -> float:
    """Share given as "1%" or 0.01."""
    from kaneflex.support.units import RATIO

    percent = text.strip().endswith("%")
    return quantity("--tolerance", text.strip().removesuffix("%"), RATIO, text) * (0.01 if percent else 1.0)


tolerance_option = click.option(
    "--tolerance", metavar="SHARE",
    help="Choose the cheapest model (least computing time) whose error in each sensor is within this share of its "
    "peak, like 1%.",
)  # fmt: skip
tolerance_options = combined_options(
    tolerance_option, names_option("--sensors", help="With --tolerance: sensors that must meet it. [default: all]")
)


def chosen_settings(
    choosing: Choosing, scenes: Sequence[Scene], option: str, paths: Iterable[str], where: str
) -> list[str]:
    """Settings of the fastest model within a tolerance in all scenes, which is reported with ``where`` these are.

    Raises SceneError also if one of the varied ``paths`` of the option is part of the choice.
    """
    from kaneflex.study.trade.choice import check_varied, remembered_choice
    from kaneflex.support.terminal import Waiting

    check_varied(scenes[0].raw, option, paths)
    with Waiting() as waiting:
        share, (scene, *others) = tolerance_of(choosing.tolerance or ""), scenes
        choice, _ = remembered_choice(scene, share, choosing.sensors or None, waiting, others=others)
    echo(f"{chosen_lines(choice)}\n  Compared at {where}; elsewhere errors may be larger")
    return choice.settings


def chosen_lines(choice: Choice) -> str:
    """Report of the chosen model, its worst sensor, its time and the reference."""
    sensor = max(choice.errors, key=choice.errors.__getitem__)
    again = ", as found before" if choice.remembered else f", found in {choice.seconds:.1f} s"
    settings = " ".join(f"--set {setting}" for setting in choice.settings)
    note = f"\n  {UNKNOWN}: {choice.reference_note}" if choice.reference_note else ""
    judged = sum(each.error is not None for each in choice.attempts)
    beyond = ", ".join(f"{sensor} {percent(doubt)}" for sensor, doubt in choice.open.items())
    missed = f"  Not within {percent(choice.tolerance)}: {beyond}; those named by --sensors must be\n"
    own, richest = choice.run_s, choice.richest_s
    time = f"A run takes {own:.2g} s, the richest model {richest:.2g} s"
    if not choice.compared:
        time = "The richest model is the answer, as it was run first; the next command tries cheaper ones"
    elif own >= richest:
        time = f"Nothing to trade: the richest model takes {richest:.2g} s"
    return (
        f"Chosen within {percent(choice.tolerance)}: {choice.model}{again}\n  {settings}\n"
        f"  {sensor} differs by {percent(choice.errors[sensor])} from {choice.reference}; "
        f"error estimate of the reference: {percent(max(choice.doubt.values()))}{note}\n"
        + (missed if beyond else "")
        + f"  {time}. Models tried: {judged}"
    )


def refuse_with_tolerance(tolerance: str | None, others: Mapping[str, object]) -> None:
    """Raise SceneError for an option that contradicts --tolerance."""
    for option, value in others.items():
        if tolerance is not None and value is not None:
            raise SceneError(option, str(value), "--tolerance chooses the model", "Leave out one of the two")


def demand_tolerance(tolerance: str | None, others: Mapping[str, object]) -> None:
    """Raise SceneError for an option that requires --tolerance."""
    for option, value in others.items():
        if tolerance is None and value:
            raise SceneError(option, None, "requires --tolerance", "Add --tolerance 1%, or leave it out")


def percent(share: float) -> str:
    return f"{100 * share:.2g} %" if abs(share) < 1 else f"{100 * share:.0f} %"
