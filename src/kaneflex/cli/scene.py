"""What commands share: a scene with the changes of the command line, the folder to write, and configurations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kaneflex.support.errors import SceneError, nearest

if TYPE_CHECKING:
    from kaneflex.scene import Scene

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
        """All changes as settings."""
        return all_settings(self.preset, self.settings, self.steps, self.integrator)

    def read(self) -> Scene:
        """The scene with them."""
        return read(self.name, self.changes)


@dataclass(frozen=True)
class Target:
    """The folder to make, if one is named, whether to draw, and whether to replace an earlier folder.

    default: its name where the command line gives none
    """

    output: Path | None
    plots: bool = True
    force: bool = False
    default: str = ""

    @property
    def folder(self) -> Path:
        """The folder to make."""
        return self.output or Path(self.default)


def gathered(**kinds: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
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


def scene_options(command: Callable[..., None]) -> Callable[..., None]:
    """SCENE and what can be changed in it."""
    options = (
        click.argument("name", metavar="SCENE"),
        click.option("--preset", metavar="NAME", help="Named model, see `kaneflex list`."),
        click.option(
            "--set", "settings", multiple=True, metavar="PATH=VALUE",
            help='Change an entry of the scene: rod.elements=1, rod.length="140 mm", solve.start=zero, loads.gas=none. '
            "Can be repeated.",
        ),
        click.option("--steps", metavar="N", help="Steps per cycle, or per run where there is no cycle."),
        click.option("--integrator", metavar="NAME", help="Integrator, see `kaneflex list`."),
    )  # fmt: skip
    for option in reversed(options):
        command = option(command)
    return command


def all_settings(
    preset: str | None, settings: tuple[str, ...], steps: str | None = None, integrator: str | None = None
) -> list[str]:
    """All changes as settings; the options of their own come last and win."""
    own = {"preset": preset, "steps": steps, "integrator": integrator}
    return [*settings, *(f"solve.{key}={value}" for key, value in own.items() if value is not None)]


def read(name: str, settings: list[str]) -> Scene:
    """The scene of that name or path with the settings laid over it."""
    from kaneflex.scene import read_scene, with_settings

    scene = read_scene(name)
    return with_settings(scene, settings) if settings else scene


def configuration(scene: Scene, at: str) -> tuple[str, float]:
    """Drive and coordinate [rad or m] of "DRIVE=ANGLE", like main=90deg; a guide's like bore=20mm; plain numbers SI."""
    from kaneflex.support.errors import Fault
    from kaneflex.support.units import ANGLE, LENGTH, to_si

    drive, equals, angle = at.partition("=")
    if not equals:
        raise SceneError("--at", at, "not of the form DRIVE=ANGLE", "Write like --at main=90deg")
    if drive not in scene.drives:
        raise SceneError("--at", at, f"the scene has no drive {drive!r}", nearest(drive, scene.drives))
    dimension = LENGTH if scene.slides(drive) else ANGLE
    try:
        coordinate = to_si(float(angle) if _is_number(angle) else angle, dimension)
    except Fault as fault:
        raise SceneError("--at", at, fault.reason, fault.cure) from None
    if _is_number(angle) and coordinate:
        read = scene.written_coordinate(drive, coordinate)
        click.echo(f"--at {at}: a plain number is in {dimension.unit}, so {read}", err=True)
    return drive, coordinate


def mode_angle(scene: Scene, at: str) -> float:
    """The coordinate [rad or m] of "DRIVE=ANGLE", where DRIVE is the scene's first drive."""
    drive, angle = configuration(scene, at)
    first = next(iter(scene.drives))
    if drive != first:
        cure = f"Give the angle of {first}"
        raise SceneError("--at", at, "a configuration is given by the first drive's angle", cure)
    return angle


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
