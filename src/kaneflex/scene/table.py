"""Base class of the tables of a scene file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

from pydantic import BaseModel, ConfigDict

from kaneflex.support.errors import Fault


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


def the_one_given(table: SceneTable, names: Sequence[str]) -> str:
    """Name of the one given entry among `names`. Raises Fault unless exactly one is given."""
    given = [name for name in names if getattr(table, name) is not None]
    if len(given) != 1:
        reason = f"{' and '.join(given)} exclude each other" if given else f"none of {', '.join(names)} is given"
        raise Fault(reason, f"Give exactly one of {', '.join(names)}")
    return given[0]


def first_given(table: SceneTable, names: Sequence[str]) -> str:
    """Name of the given entry among `names` in a validated table; cached."""
    values = table.__dict__
    return next(name for name in names if values[name] is not None)
