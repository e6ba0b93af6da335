"""What every table of a scene file is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Self

from pydantic import BaseModel, ConfigDict

from kaneflex.support.errors import Fault


class SceneTable(BaseModel):
    """Base of every table of a scene file: frozen, and no key that it does not know."""

    # The whole scene's validator holds those of its tables, which few ask for by themselves: built on first use.
    model_config = ConfigDict(frozen=True, extra="forbid", ser_json_inf_nan="constants", defer_build=True)

    @property
    def says_a_file(self) -> bool:
        """Whether numbers of a file stand in it, which may say something else by now."""
        return False

    def refuse(self, fields: Iterable[str], reason: str, cure: str = "Leave it out") -> None:
        """Raise Fault for the first of some fields that is given."""
        for field in fields:
            if field in self.model_fields_set:
                raise Fault(reason, cure, below=field)

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with other entries, which knows nothing of what was computed of these ones."""
        found = super().model_copy(update=update, deep=deep)
        for name in found.__dict__.keys() - type(self).model_fields.keys():
            del found.__dict__[name]
        return found


def the_one_given(table: SceneTable, names: Sequence[str]) -> str:
    """Which of `names` is given, if it is exactly one."""
    given = [name for name in names if getattr(table, name) is not None]
    if len(given) != 1:
        reason = f"{' and '.join(given)} exclude each other" if given else f"none of {', '.join(names)} is given"
        raise Fault(reason, f"Give exactly one of {', '.join(names)}")
    return given[0]


def first_given(table: SceneTable, names: Sequence[str]) -> str:
    """The one of `names` that is given in a table that was checked: asked many times."""
    values = table.__dict__
    return next(name for name in names if values[name] is not None)
