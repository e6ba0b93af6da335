"""Commands by the groups of ``kaneflex --help``, options that take lists, and spellings of earlier versions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import click

from kaneflex.support.terminal import echo

GROUPS = ("Inspect", "Run", "Study", "Export")


class Command(click.Command):
    """A command of a group, which also takes its options as an earlier version spelled them, with a warning."""

    group = ""
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


def command(
    group: str, short: str, name: str | None = None, renamed: Mapping[str, str] | None = None
) -> Callable[[Callable[..., None]], Command]:
    """Decorator of a command: one of GROUPS, its line in ``kaneflex --help``, and new names of options by old ones."""

    def decorate(function: Callable[..., None]) -> Command:
        made = click.command(name, cls=Command, short_help=short)(function)
        made.group, made.renamed = group, renamed or {}
        return made

    return decorate


def names_option(*names: str, metavar: str = "NAMES", help: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """An option that takes names with commas between them, and can be repeated."""

    def split(ctx: click.Context, parameter: click.Parameter, given: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(name for text in given for part in text.split(",") if (name := part.strip()))

    return click.option(*names, multiple=True, metavar=metavar, help=help, callback=split)


def grouped(commands: Mapping[str, Any], formatter: click.HelpFormatter) -> None:
    """Write the commands into a help page, group by group."""
    for group in GROUPS:
        rows = [(name, each.short_help or "") for name, each in commands.items() if each.group == group]
        with formatter.section(group):
            formatter.write_dl(rows)
