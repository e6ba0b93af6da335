"""Bases of tables of files, types of rare ones, and key `like`: start from another scene or body, and change it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, Self, cast

from pydantic import BaseModel, ConfigDict
from pydantic_core import core_schema

from kaneflex.support.errors import Fault, SceneError, nearest

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler


class SceneTable(BaseModel):
    """Base of every table of a scene file: frozen, without unknown keys."""

    # Tables are rarely validated on their own, so their validators are built on first use.
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants", defer_build=True)

    @property
    def says_a_file(self) -> bool:
        """True if the table contains numbers of a file, which may have changed."""
        return False

    def refuse(self, fields: Iterable[str], reason: str, cure: str = "Leave it out") -> None:
        """Raise Fault for the first of these fields that is given."""
        for field in fields:
            if field in self.model_fields_set:
                raise Fault(reason, cure, below=field)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy with other entries, without cached values."""
        found = super().model_copy(update=update, deep=deep)
        for name in found.__dict__.keys() - type(self).model_fields.keys():
            del found.__dict__[name]
        return found


class PlainTable(BaseModel):
    """Table of ``summary.json``; its fields have descriptions."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


@dataclass(frozen=True)
class LateType:
    """Mark of an annotation that stands for a table's class in another module."""

    module: str
    name: str

    @cached_property
    def table(self) -> type[BaseModel]:
        """The class; imported at the first request."""
        return getattr(import_module(self.module), self.name)

    def __get_pydantic_core_schema__(self, source: object, handler: object) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(lambda value: self.table.model_validate(value))

    def __get_pydantic_json_schema__(self, own: object, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        self.table.model_rebuild()
        reference = f"{self.module}.{self.name}:{id(self.table)}"
        found = cast(core_schema.CoreSchema, {**self.table.__pydantic_core_schema__, "ref": reference})
        to_found = core_schema.definition_reference_schema(reference)
        return handler(core_schema.definitions_schema(to_found, [found]))


def late(module: str, *names: str) -> tuple[Any, ...]:
    """Annotations for fields with tables of these names of a module."""
    return tuple(Annotated[Any, LateType(module, name)] for name in names)


def the_one_given(table: SceneTable, names: Sequence[str]) -> str:
    """Name of the one given entry among `names`. Raises Fault unless exactly one is given."""
    given = [name for name in names if getattr(table, name) is not None]
    if len(given) != 1:
        keys = ", ".join(names).replace("from_", "from")
        reason = f"{' and '.join(given)} exclude each other" if given else f"none of {keys} is given"
        raise Fault(reason, f"Give exactly one of {keys}")
    return given[0]


def first_given(table: SceneTable, names: Sequence[str]) -> str:
    """Name of the given entry among `names` in a validated table; cached."""
    values = table.__dict__
    return next(name for name in names if values[name] is not None)


REMOVED = "none"
_OWN_WORD = ("reduction",)  # here "none" is a value of its own


def merged(base: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Merge `changes` over `base`, table by table, in the order of `base`; new entries come last.

    "none" removes an entry of the base.
    """
    result = dict(base)
    for key, value in changes.items():
        old = base.get(key)
        if value == REMOVED and key in base and key not in _OWN_WORD:
            del result[key]
        elif isinstance(old, dict) and isinstance(value, dict):
            result[key] = merged(old, value)
        else:
            result[key] = value
    return result


def reuse_bodies(raw: dict[str, Any]) -> dict[str, Any]:
    """Bodies merged over those that their `like` names; removes `like`."""
    bodies = raw.get("bodies")
    if not isinstance(bodies, dict):
        return raw
    return raw | {"bodies": {name: _reused(name, bodies, ()) for name in bodies}}


def _reused(name: str, bodies: dict[str, Any], users: tuple[str, ...]) -> Any:
    body = bodies[name]
    if not isinstance(body, dict) or not isinstance(body.get("like"), str):
        return body
    model = body["like"]
    if model not in bodies:
        raise SceneError(f"bodies.{name}.like", model, "no body of that name", nearest(model, bodies))
    if model in (*users, name):
        raise SceneError(f"bodies.{name}.like", model, "bodies refer to each other in a circle", "Remove one reference")
    rest = {key: value for key, value in body.items() if key != "like"}
    base = _reused(model, bodies, (*users, name))
    if not isinstance(base, dict):
        raise SceneError(f"bodies.{name}.like", model, "that body is not a table", "Write a table, like {key = value}")
    return merged(base, rest)
