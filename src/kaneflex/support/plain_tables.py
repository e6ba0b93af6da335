"""Tables of files: their plain base, and types of entries that few files have, imported at the first one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Any, cast

from pydantic import BaseModel, ConfigDict
from pydantic_core import core_schema

if TYPE_CHECKING:
    from pydantic import GetJsonSchemaHandler


class PlainTable(BaseModel):
    """Table of ``summary.json``; its fields have descriptions."""

    model_config = ConfigDict(frozen=True, extra="forbid")


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
