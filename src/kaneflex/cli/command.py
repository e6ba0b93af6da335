"""Commands, lists and numbers in their options, and the files that they make."""

from __future__ import annotations

import csv
import json
import logging
import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stdout
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import click

from kaneflex.support.errors import OutputError
from kaneflex.support.files import file_stem, refuse_existing, whole_folder, writing
from kaneflex.support.terminal import LOG, Waiting, echo
from kaneflex.support.units import plain_number

if TYPE_CHECKING:
    from kaneflex.scene import Scene

Decorator = Callable[[Callable[..., None]], Callable[..., None]]
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")


def _set_log_level(ctx: click.Context, level: int) -> None:
    """Set the log level until the command ends."""
    ctx.call_on_close(partial(LOG.setLevel, LOG.level))
    LOG.setLevel(level)


def _less_output(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        nowhere = ctx.with_resource(open(os.devnull, "w", encoding="utf-8"))
        ctx.with_resource(redirect_stdout(nowhere))
        _set_log_level(ctx, logging.WARNING)


def _more_output(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        logging.basicConfig(format="%(message)s")
        _set_log_level(ctx, logging.INFO)


_LOUDNESS = (
    click.Option(
        ["-q", "--quiet"], is_flag=True, is_eager=True, expose_value=False, callback=_less_output,
        help="Print only errors and warnings.",
    ),
    click.Option(
        ["-v", "--verbose"], is_flag=True, is_eager=True, expose_value=False, callback=_more_output,
        help="Print each stage and its time on stderr.",
    ),
)  # fmt: skip


def command(name: str | None = None) -> Callable[[Callable[..., None]], click.Command]:
    """Decorator of a command, which adds -q and -v."""

    def decorate(function: Callable[..., None]) -> click.Command:
        made = click.command(name)(function)
        made.params += _LOUDNESS
        return made

    return decorate


def names_option(*names: str, help: str, metavar: str = "NAMES") -> Decorator:
    """Repeatable option that takes comma-separated names."""

    def split(ctx: click.Context, parameter: click.Parameter, given: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(part.strip() for text in given for part in text.split(","))

    return click.option(*names, multiple=True, metavar=metavar, help=help, callback=split)


def print_json(data: object) -> None:
    """Print plain data as JSON."""
    echo(json.dumps(data, indent=2, ensure_ascii=False))


class Count(click.IntRange):
    """Integer within bounds, in ASCII digits only: int() also accepts 1_000 and digits of other scripts."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and re.fullmatch(r"[+-]?[0-9]+", value.strip()) is None:
            self.fail(f"{value!r} is not a valid integer.", param, ctx)
        return super().convert(value, param, ctx)


class Real(click.FloatRange):
    """Finite number within optional bounds."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if isinstance(value, str) and plain_number(value) is None:
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return super().convert(value, param, ctx)

    def _describe_range(self) -> str:
        return "" if self.min is None and self.max is None else super()._describe_range()  # else "x<=None"


Found = TypeVar("Found")
_PICTURES = (".png", ".svg", ".pdf")

force_option = click.option("--force", is_flag=True, help="Replace an existing file.")


def path_option(*names: str, metavar: str, help: str, required: bool = False) -> Decorator:
    """Option that names a file or a folder."""
    return click.option(*names, type=click.Path(path_type=Path), metavar=metavar, help=help, required=required)


def output_option(metavar: str, help: str = "File to write.", required: bool = False) -> Decorator:
    """Option that names the output."""
    return path_option("-o", "--output", metavar=metavar, help=help, required=required)


def combined_options(*parts: Decorator) -> Decorator:
    """Combine several options, in their order."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for part in reversed(parts):
            command = part(command)
        return command

    return decorate


class Target(NamedTuple):
    """Output of a command: the folder if named; pictures to draw, and whether also for ParaView; frames and length
    [s] of a motion (None: the animation's default); whether to replace an earlier folder."""

    output: Path | None
    plots: bool = True
    force: bool = False
    vtk: bool = False
    frames: int | None = None
    seconds: float | None = None
    kinds: str | None = None

    def named(self, scene: Scene, ending: str) -> Target:
        """Copy with a folder: by default the scene's name with that ending."""
        return self._replace(output=self.folder if self.output else Path(f"{file_stem(scene.name)}-{ending}"))

    @property
    def folder(self) -> Path:
        """Folder to make."""
        assert self.output is not None
        return self.output


no_plots = click.option("--no-plots", "plots", is_flag=True, flag_value=False, default=True, help="Draw no pictures.")
which_pictures = combined_options(
    click.option(
        "--plots", "kinds", metavar="KINDS",
        help="Pictures to draw, comma-separated, see `kaneflex plot --help`. [default: mechanism,sensors,loads]",
    ),
    no_plots,
)  # fmt: skip
moving_options = combined_options(
    click.option("--frames", type=Count(min=2), metavar="N", help="Number of frames of an animation. [default: 60]"),
    click.option(
        "--seconds", type=Real(min=0.1, max=3600.0), metavar="S",
        help="Duration of the animation. [default: 12 frames a second]",
    ),
)  # fmt: skip


def folder_options(ending: str, plots: Decorator = no_plots) -> Decorator:
    """Options that give a :class:`Target`; ``ending`` is the default ending of the folder's name."""
    return combined_options(
        output_option("DIR", f"Folder to make. [default: NAME-{ending}]"),
        plots,
        click.option("--force", is_flag=True, help="Replace an existing folder of this command."),
    )


def write_into_folder(
    target: Target, mark: str, compute: Callable[[Callable[[str], None]], Found],
    write: Callable[[Found, Path], None], picture: str,
) -> Found:  # fmt: skip
    """Compute something and write it into a new folder, which appears when it is complete.

    Parameters
    ----------
    target : Target
    mark : str
        File that identifies an earlier folder of the same kind.
    compute : callable
        Called with the function to report the name of each stage to.
    write : callable
        Called with the result and the folder to write it into.
    picture : str
        Kind of picture that :func:`kaneflex.plots.draw` makes of the result.

    Raises
    ------
    OutputError
        If the folder exists or can't be written, before anything is computed where that can be known.
    """
    folder = target.folder
    with whole_folder(folder, mark=mark, force=target.force) as partial, Waiting() as waiting:
        found = compute(waiting)
        waiting("writing")
        with writing(folder):
            write(found, partial)
            if target.plots:
                from kaneflex.plots import draw

                waiting("drawing the pictures")
                draw(picture, found, partial)
    return found


def check_picture(path: Path, force: bool, example: str) -> None:
    """Raise OutputError for a name that is not a picture's, and unless ``force`` for an existing file."""
    if path.suffix not in _PICTURES:
        raise OutputError(str(path), None, "not a kind of picture", f"End the name in {', '.join(_PICTURES)}")
    refuse_existing(path, force, example)


def check_file(path: Path, what: str, suffix: str, force: bool, more: str = "") -> None:
    """Raise OutputError for another ending than ``suffix``; ``what`` is the kind of file, ``more`` further advice."""
    refuse_existing(path, force, f"engine{suffix}")
    if path.suffix != suffix:
        raise OutputError(str(path), None, f"not the name of {what}", f"End it in {suffix}{more}")


def write_json(path: Path, data: object) -> None:
    """Write plain data as JSON."""
    text = json.dumps(data, indent=2, ensure_ascii=False) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")


def write_csv(path: Path, head: Sequence[str], rows: Sequence[Mapping[str, object]]) -> None:
    """Write rows as CSV; the first row gives the columns."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(head), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
