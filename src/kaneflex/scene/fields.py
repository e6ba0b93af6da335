"""Keys that a scene file may have, found by walking the models along a path."""

from __future__ import annotations

import types
import typing

from pydantic import BaseModel

from kaneflex.scene.scene import Scene
from kaneflex.support.units import Dimension

ANY_NAME = "*"
"""Placeholder for names that a user gives."""


def known_keys(path: typing.Sequence[str], top: type[BaseModel] = Scene) -> tuple[str, ...]:
    """Keys of the table at `path`: ("*",) if users give the names, empty if it is not a table."""
    kind: object = top
    for key in path:
        kind = _entry(kind, key)
    if typing.get_origin(kind) is dict:
        return (ANY_NAME,)
    if _is_table(kind):
        return tuple(field.alias or name for name, field in kind.model_fields.items())
    return ()


def _entry(kind: object, key: str) -> object:
    """Type of the entry `key` of a table of type `kind`; None if there is no such entry."""
    if typing.get_origin(kind) is dict:
        return _plain(typing.get_args(kind)[1])
    if _is_table(kind):
        for name, field in kind.model_fields.items():
            if key == (field.alias or name):
                return _plain(field.annotation)
    return None


def dimensions(path: typing.Sequence[str]) -> tuple[Dimension, ...]:
    """Dimensions of the quantity at `path`: one, or two for a rotating or sliding joint; empty for other entries."""
    kind: object = Scene
    for key in path[:-1]:
        kind = _entry(kind, key)
    fields = kind.model_fields if _is_table(kind) else {}
    field = next((field for name, field in fields.items() if path[-1] == (field.alias or name)), None)
    if field is None:
        return ()
    options = [field.annotation, *typing.get_args(field.annotation)]
    known = [*field.metadata, *(entry for option in options for entry in getattr(option, "__metadata__", ()))]
    return tuple(entry for entry in known if isinstance(entry, Dimension))


def has_entry(path: typing.Sequence[str]) -> bool:
    """True if a scene file may have an entry at `path`."""
    keys = known_keys(path[:-1])
    return path[-1] in keys or keys == (ANY_NAME,)


def _plain(kind: object) -> object:
    """Type `kind` without None and annotations."""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        rest = [option for option in typing.get_args(kind) if option is not type(None)]
        return _plain(rest[0])
    if typing.get_origin(kind) is typing.Annotated:
        return _plain(typing.get_args(kind)[0])
    return kind


def _is_table(kind: object) -> typing.TypeGuard[type[BaseModel]]:
    return isinstance(kind, type) and issubclass(kind, BaseModel)
