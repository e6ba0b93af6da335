"""Shell completion of scenes, presets, integrators and the entries of a scene."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import click
from click.shell_completion import CompletionItem

from kaneflex.support.errors import UserError


def _items(words: Iterable[str], begun: str) -> list[CompletionItem]:
    return [CompletionItem(word) for word in words if word.startswith(begun)]


def scenes(ctx: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Names of shipped scenes, and the shell's completion of files."""
    from kaneflex.scene import shipped_scenes

    return [*_items(shipped_scenes(), begun), CompletionItem(begun, type="file")]


def presets(ctx: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Names of presets."""
    from kaneflex.scene.parts import PRESETS

    return _items(PRESETS, begun)


def integrators(ctx: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Names of integrators."""
    from kaneflex.integrate.methods import METHODS

    return _items(METHODS, begun)


def entries(ctx: click.Context, parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Entries of the scene named on the command line, each followed by an equals sign."""
    from kaneflex.scene import read_scene
    from kaneflex.scene.parts import Solve

    given = [*filter(None, [ctx.params.get("name")]), *ctx.args]  # click stops parsing at the option without a value
    try:
        raw = read_scene(given[0]).raw if given else {}
    except UserError:
        raw = {}
    solve = (f"solve.{key}" for key in Solve.model_fields)
    return _items((f"{path}=" for path in (*_paths(raw), *solve)), begun)


def _paths(raw: dict[str, Any]) -> Iterator[str]:
    """Paths of settings; those of bodies and beams omit the table's name."""
    for table, parts in raw.items():
        if not isinstance(parts, dict) or table in ("solve", "assumptions"):
            continue
        for name, keys in parts.items():
            own = name if table == "bodies" else f"{table}.{name}"
            given = keys if isinstance(keys, dict) else {}
            beam = given.get("beam")
            more = beam if isinstance(beam, dict) else {}
            yield from (f"{own}.{key}" for key in (*given, *more) if key != "beam")
