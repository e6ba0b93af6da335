"""Which keys a scene file may have where: the models, walked along a path of keys."""

from __future__ import annotations

import types
import typing

from pydantic import BaseModel

from kaneflex.scene.scene import Scene
from kaneflex.support.units import Dimension

ANY_NAME = "*"
"""Stands for the names that a user gives, where a table has any."""


def known_keys(path: typing.Sequence[str], top: type[BaseModel] = Scene) -> tuple[str, ...]:
    """Keys of the table at `path`: ("*",) where users give the names, none where it is no table."""
    kind: object = top
    for key in path:
        kind = _entry(kind, key)
    if typing.get_origin(kind) is dict:
        return (ANY_NAME,)
    if _is_table(kind):
        return tuple(field.alias or name for name, field in kind.model_fields.items())
    return ()


def _entry(kind: object, key: str) -> object:
    """The type of the entry `key` of a table of type `kind`; None where there is no such entry."""
    if typing.get_origin(kind) is dict:
        return _plain(typing.get_args(kind)[1])
    if _is_table(kind):
        for name, field in kind.model_fields.items():
            if key == (field.alias or name):
                return _plain(field.annotation)
    return None


def dimensions(path: typing.Sequence[str]) -> tuple[Dimension, ...]:
    """Of the quantity at `path`: one, or that of a joint that turns and of one that slides; none of anything else."""
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
    """Whether a scene file may have an entry at `path`."""
    keys = known_keys(path[:-1])
    return path[-1] in keys or keys == (ANY_NAME,)


def _plain(kind: object) -> object:
    """`kind` without None and annotations."""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        rest = [option for option in typing.get_args(kind) if option is not type(None)]
        return _plain(rest[0])
    if typing.get_origin(kind) is typing.Annotated:
        return _plain(typing.get_args(kind)[0])
    return kind


def _is_table(kind: object) -> typing.TypeGuard[type[BaseModel]]:
    return isinstance(kind, type) and issubclass(kind, BaseModel)
