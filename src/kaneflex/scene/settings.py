"""Paths in a scene: `--set path=value`, and the keys that a file may have."""

from __future__ import annotations

import difflib
import tomllib
import types
import typing
from collections.abc import Hashable, Iterable, Mapping
from typing import Any

from pydantic import BaseModel

from kaneflex.scene.scene import Scene
from kaneflex.scene.table import LateType
from kaneflex.support.errors import SceneError, nearest
from kaneflex.support.units import Dimension

_MOST_NAMES = 3
"""Largest number of names that a message lists."""
_NAMED = ("bodies", "joints", "drives", "masses", "loads", "springs", "contacts", "sensors", "events")
"""Top-level tables whose entries users name."""


def split_setting(setting: str) -> tuple[str, Any, str]:
    """Path, value and the value's text of "path=value". Raises SceneError without "=" or path."""
    path, equals, text = setting.partition("=")
    if not equals or not path.strip():
        raise SceneError("setting", setting, "not of the form path=value", "Write it like rod.elements=1")
    return path.strip(), _value(text.strip()), text.strip()


def nested(raw: Mapping[str, Any], path: str, value: Any, text: str | None = None) -> dict[str, Any]:
    """Setting as nested tables, to be merged over `raw`; an error shows the value as ``text``.

    Raises SceneError: an unknown path, or an ambiguous short path.
    """
    result = value
    for key in reversed(resolved(raw, path, str(value) if text is None else text)):
        result = {key: result}
    return result


def _value(text: str) -> Any:
    """Value in TOML, or the text itself, so that quotes may be left out."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # not TOML, or too large for Python's parser
        return text


def resolved(raw: Mapping[str, Any], path: str, text: str | None = None) -> list[str]:
    """Full keys of a short or full path in a scene's tables; an error shows the value as ``text``.

    Raises SceneError for an unknown or ambiguous path.
    """
    keys = path.split(".")
    if keys[0] in known_keys(()):
        _demand_entry(raw, keys, path, text)
        return keys
    places = [[table, *keys] for table in _NAMED if keys[0] in raw.get(table, {})]
    if not places:
        raise SceneError(path, text, f"the scene has no {keys[0]!r}", _other_path(raw, keys))
    places += [[*place[:2], "beam", *keys[1:]] for place in places if place[0] == "bodies"]
    fitting = [place for place in places if len(keys) > 1 and has_entry(place)]
    if len(fitting) > 1:
        choices = " or ".join(".".join(place) for place in fitting)
        raise SceneError(path, text, "this path is ambiguous", f"Write {choices}")
    if not fitting:
        known = {key for place in places for key in known_keys(place[: 2 + ("beam" in place[2:3])])}
        last = keys[1] if len(keys) > 1 else ""
        names = [drive for drive in _drives_of(raw, keys[0]) if has_entry(["drives", drive, last])]
        drives = [".".join([drive, *keys[1:]]) for drive in names]
        cure = f"Write {' or '.join(drives)}, of the drive" if drives else nearest(last, known - {ANY_NAME})
        raise SceneError(path, text, f"{keys[0]!r} has no such entry", cure)
    return fitting[0]


def demand_once(given: Iterable[tuple[str, str, Hashable]]) -> None:
    """Raise SceneError if an entry is given twice, in any spelling; ``given`` holds key, name, place."""
    known: dict[Hashable, tuple[str, str]] = {}
    for key, name, place in given:
        if place in known:
            before = known[place]
            also = "" if before == (key, name) else f", first as {before[1]} in {before[0]}"
            raise SceneError(key, name, f"given twice{also}", "Give each entry once")
        known[place] = (key, name)


def _drives_of(raw: Mapping[str, Any], body: str) -> list[str]:
    """Drives of a body's joints, in the order of the scene; the tables are not validated yet."""
    joints = raw.get("joints", {})
    found = []
    for drive in raw.get("drives", {}):
        ends = (end for entry in joints.get(drive, {}).values() if isinstance(entry, list) for end in entry)
        if any(str(end).partition(".")[0] == body for end in ends):
            found.append(drive)
    return found


def _other_path(raw: Mapping[str, Any], keys: list[str]) -> str:
    """Advice for an unknown name at the beginning of a path: similar names, or names with such an entry."""
    names = dict.fromkeys([*(name for table in _NAMED for name in raw.get(table, {})), *known_keys(())])
    close = difflib.get_close_matches(keys[0], names, n=3)
    if len(keys) == 1:
        rather = f"; similar names are {', '.join(close)}" if close else ""
        return f"Write the path of an entry, like rod.elements=1{rather}"
    if close:
        return f"The nearest known one is {close[0]!r}"
    owners = [
        name
        for table in _NAMED
        for name in raw.get(table, {})
        for place in ([table, name], [table, name, "beam"])
        if has_entry([*place, *keys[1:]])
    ]
    having = list(dict.fromkeys(owners))[:_MOST_NAMES]
    if having:
        return f"Write {' or '.join('.'.join([name, *keys[1:]]) for name in having)}"
    return "Begin with the name of a body, joint, drive, mass, load or sensor, or with solve"


def _demand_entry(raw: Mapping[str, Any], keys: list[str], path: str, text: str | None) -> None:
    """Raise SceneError unless the scene may have an entry at `keys` and contains its owner."""
    for depth in range(1, len(keys) + 1):
        if not has_entry(keys[:depth]):
            known, owner = known_keys(keys[: depth - 1]), ".".join(keys[: depth - 1])
            if not known:
                raise SceneError(path, text, f"{owner} is not a table", f"Give all of it: {owner}=VALUE")
            cure = nearest(keys[depth - 1], known)
            raise SceneError(path, text, f"no key {keys[depth - 1]!r} there", cure)
    is_new = len(keys) == 2 and (text or "").startswith("{")  # a whole table adds an entry
    if keys[0] in _NAMED and len(keys) > 1 and not is_new and keys[1] not in raw.get(keys[0], {}):
        cure = f"{nearest(keys[1], raw.get(keys[0], {}))}; a whole table adds it: {keys[0]}.{keys[1]}={{...}}"
        raise SceneError(path, text, f"the scene has no {keys[1]!r} among its {keys[0]}", cure)


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
    """Type `kind` without None and annotations; of several types the table."""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is typing.Union:
        rest = [_plain(option) for option in typing.get_args(kind) if option is not type(None)]
        return next(filter(_is_table, rest), rest[0])
    if typing.get_origin(kind) is typing.Annotated:
        late = next((mark for mark in typing.get_args(kind) if isinstance(mark, LateType)), None)
        return _plain(typing.get_args(kind)[0]) if late is None else late.table
    return kind


def _is_table(kind: object) -> typing.TypeGuard[type[BaseModel]]:
    return isinstance(kind, type) and issubclass(kind, BaseModel)
