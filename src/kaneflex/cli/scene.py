"""What commands share: a scene with the changes of the command line, quantities and configurations."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import wraps
from importlib import import_module
from typing import TYPE_CHECKING, Any

import click

from kaneflex.cli.command import Decorator
from kaneflex.cli.folders import together
from kaneflex.support.errors import SceneError, nearest, told
from kaneflex.support.terminal import echo

if TYPE_CHECKING:
    from kaneflex.scene import Scene
    from kaneflex.support.units import Dimension

USER_ERROR, STOPPED_EARLY, INTERRUPTED = 2, 3, 130
"""Exit codes: something to cure, a run that went unstable or found no periodic state, Ctrl-C."""


@dataclass(frozen=True)
class SceneArguments:
    """SCENE and what the command line changes in it, as :func:`scene_options` has them."""

    name: str
    preset: str | None = None
    settings: tuple[str, ...] = ()
    steps: str | None = None
    integrator: str | None = None

    @property
    def changes(self) -> list[str]:
        """All changes as settings; the options of their own come last and win."""
        own = {"preset": self.preset, "steps": self.steps, "integrator": self.integrator}
        return [*self.settings, *(f"solve.{key}={value}" for key, value in own.items() if value is not None)]

    def read(self) -> Scene:
        """The scene with them."""
        return read(self.name, self.changes)

    def read_at(self, at: str | None) -> Scene:
        """The scene with them, its reference configuration that of "DRIVE=ANGLE", where one is given."""
        scene = self.read()
        return scene if at is None else read(self.name, [*self.changes, f"solve.mode_angle={mode_angle(scene, at)!r}"])


def gathered(**kinds: type) -> Decorator:
    """A command whose options that are fields of a dataclass come as one argument: its name, and the dataclass."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def wrapped(**given: object) -> None:
            for name, kind in kinds.items():
                own = {field.name: given.pop(field.name) for field in fields(kind) if field.name in given}
                given[name] = kind(**own)
            command(**given)

        return wrapped

    return decorate


def completed(kind: str) -> Callable[..., Any]:
    """Completion of :mod:`kaneflex.cli.completion`, which is imported when the shell asks."""

    def complete(ctx: click.Context, parameter: click.Parameter, begun: str) -> Any:
        return getattr(import_module("kaneflex.cli.completion"), kind)(ctx, parameter, begun)

    return complete


preset_option = click.option(
    "--preset", metavar="NAME", shell_complete=completed("presets"), help="Named model, see `kaneflex list`."
)
settings_option = click.option(
    "--set", "settings", multiple=True, metavar="PATH=VALUE", shell_complete=completed("entries"),
    help='Change an entry of the scene: rod.elements=1, rod.length="140 mm", solve.start=zero, loads.gas=none. '
    "Can be repeated.",
)  # fmt: skip
_OPTIONS = {
    "preset": preset_option,
    "settings": settings_option,
    "steps": click.option("--steps", metavar="N", help="Steps per cycle, or per run where there is no cycle."),
    "integrator": click.option(
        "--integrator", metavar="NAME", shell_complete=completed("integrators"), help="Integrator, see `kaneflex list`."
    ),
}  # fmt: skip
"""By the fields of :class:`SceneArguments`."""
at_option = click.option(
    "--at", metavar="DRIVE=ANGLE",
    help="Configuration, like main=90deg or bore=20mm; plain numbers are SI. [default: solve.mode_angle of the scene]",
)  # fmt: skip


scene_argument = click.argument("name", metavar="SCENE", shell_complete=completed("scenes"))


def scene_options(*names: str) -> Decorator:
    """SCENE and what can be changed in it: by all options, or by those of these names."""
    return together(scene_argument, *(_OPTIONS[name] for name in names or _OPTIONS))


def read(name: str, settings: list[str]) -> Scene:
    """The scene of that name or path with the settings laid over it."""
    from kaneflex.scene import read_scene, with_settings

    scene = read_scene(name)
    return with_settings(scene, settings) if settings else scene


def quantity(option: str, text: str, dimension: Dimension, whole: str | None = None) -> float:
    """What an option says in SI: a plain number is in SI, any other has a unit; ``text`` may be a part of the whole."""
    from kaneflex.support.units import plain_number, to_si

    plain = plain_number(text)
    with told(option, whole or text):
        found = to_si(text if plain is None else plain, dimension)
    return found


def say_plain(option: str, text: str, part: str, unit: str, read: str) -> None:
    """Say how a part of an option was read, where it is a number without a unit."""
    from kaneflex.support.units import plain_number

    if plain_number(part):
        echo(f"{option} {text}: a plain number is in {unit}, so {read}", err=True)


def configuration(scene: Scene, at: str) -> tuple[str, float]:
    """Drive and coordinate [rad or m] of "DRIVE=ANGLE", like main=90deg; a guide's like bore=20mm; plain numbers SI."""
    from kaneflex.support.units import ANGLE, LENGTH

    drive, equals, angle = at.partition("=")
    if not equals:
        raise SceneError("--at", at, "not of the form DRIVE=ANGLE", "Write like --at main=90deg")
    if drive not in scene.drives:
        raise SceneError("--at", at, f"the scene has no drive {drive!r}", nearest(drive, scene.drives))
    dimension = LENGTH if scene.slides(drive) else ANGLE
    coordinate = quantity("--at", angle, dimension, at)
    say_plain("--at", at, angle, dimension.unit, scene.written_coordinate(drive, coordinate))
    return drive, coordinate


def mode_angle(scene: Scene, at: str) -> float:
    """The coordinate [rad or m] of "DRIVE=ANGLE", where DRIVE is the scene's first drive."""
    drive, angle = configuration(scene, at)
    first = next(iter(scene.drives))
    if drive != first:
        cure = f"Give the angle of {first}"
        raise SceneError("--at", at, "a configuration is given by the first drive's angle", cure)
    return angle


@contextmanager
def uncollected() -> Iterator[None]:
    """No garbage collection, now or later, of what is made within.

    Most of it are modules, which live until the end; to look through them again and again for garbage, and once
    more at the end, takes a third of a warm run.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
