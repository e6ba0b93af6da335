"""Commands with earlier spellings of their options, and options that take lists and numbers."""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from functools import partial
from typing import Any

import click

from kaneflex.support.terminal import LOG, echo
from kaneflex.support.units import plain_number

Decorator = Callable[[Callable[..., None]], Callable[..., None]]
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of tables.")


def _tell(ctx: click.Context, level: int) -> None:
    """Set the log level until the command ends."""
    ctx.call_on_close(partial(LOG.setLevel, LOG.level))
    LOG.setLevel(level)


def _say_less(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        nowhere = ctx.with_resource(open(os.devnull, "w", encoding="utf-8"))
        ctx.with_resource(redirect_stdout(nowhere))
        _tell(ctx, logging.WARNING)


def _say_more(ctx: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        logging.basicConfig(format="%(message)s")
        _tell(ctx, logging.INFO)


_LOUDNESS = (
    click.Option(
        ["-q", "--quiet"], is_flag=True, is_eager=True, expose_value=False, callback=_say_less,
        help="Print only errors and warnings.",
    ),
    click.Option(
        ["-v", "--verbose"], is_flag=True, is_eager=True, expose_value=False, callback=_say_more,
        help="Print each stage and its time on stderr.",
    ),
)  # fmt: skip


class Command(click.Command):
    """Command that accepts earlier spellings of its options with a warning."""

    renamed: Mapping[str, str] = {}

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        words = []
        for word in args:
            option, equals, value = word.partition("=")
            new = self.renamed.get(option, option)
            if new != option:
                echo(f"Warning: {option} is now called {new}", err=True)
            words.append(f"{new}{equals}{value}")
        return super().parse_args(ctx, words)


def command(name: str | None = None, renamed: Mapping[str, str] | None = None) -> Callable[..., Command]:
    """Decorator of a command; ``renamed`` maps old names of options to new ones."""

    def decorate(function: Callable[..., None]) -> Command:
        made = click.command(name, cls=Command)(function)
        made.renamed = renamed or {}
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
