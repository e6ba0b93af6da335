"""Initial state of a run, given by a scene."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, ValidationError

from kaneflex.scene.quantities import either, written
from kaneflex.scene.table import SceneTable, merged
from kaneflex.support.errors import Fault, within
from kaneflex.support.files import read_text
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, LENGTH, SPEED, Dimension

_TABLES = "Give tables displacements and velocities, as solution.state() returns them"


def _one_of(*dimensions: Dimension) -> Any:
    """Quantity of one of these kinds, unconverted: its coordinate decides the kind later."""

    def check(value: object) -> object:
        either(value, *dimensions)
        return value

    units = " or ".join(dimension.unit for dimension in dimensions)
    return Annotated[float | str, BeforeValidator(check), written(f"in {units}; or a string with a unit")]


class Start(SceneTable):
    """Coordinates of the elastic mechanism at t = 0 and their rates, by name; by default zero.

    Under preset coupled they are those of all bodies, and the defaults are those of the rigid mechanism. The tables
    override values of a file.
    """

    file: str | None = Field(default=None, description="JSON or TOML file of the two tables, relative to the scene")
    displacements: dict[str, _one_of(LENGTH, ANGLE)] = Field(default={})
    velocities: dict[str, _one_of(SPEED, ANGULAR_SPEED)] = Field(default={})


def start_of(value: object) -> object:
    """Start as a table merged with its file. Raises Fault, or pydantic's error with the path."""
    if isinstance(value, Start):
        return value
    if isinstance(value, dict):
        if isinstance(value.get("file"), str):
            with within("file"):
                value = merged(_of_file(Path(value["file"])), value)
        return Start.model_validate(value)
    raise Fault("must be 'zero', 'quasistatic', 'periodic' or a table of a state", "Write one of these")


def _of_file(path: Path) -> dict[str, Any]:
    """Tables of a state's file. Raises Fault: unreadable, neither JSON nor TOML, or other content."""
    try:
        text = read_text(path)
        found = json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
        state = Start.model_validate(found)
    except Fault:
        raise
    except FileNotFoundError:
        raise Fault("no such file", "Give the path of a state's file, relative to the scene") from None
    except ValidationError as error:
        first = error.errors()[0]
        fault = first.get("ctx", {}).get("error")
        reason, cure = (fault.reason, fault.cure) if isinstance(fault, Fault) else (first["msg"].lower(), _TABLES)
        raise Fault(f"{'.'.join(map(str, first['loc'])) or 'the file'}: {reason}", cure) from None
    except (ValueError, RecursionError) as error:  # errors of JSON's and TOML's parsers
        kind = "JSON" if path.suffix == ".json" else "TOML"
        raise Fault(f"not {kind}: {error}", _TABLES) from None
    if state.file is not None:
        raise Fault("the state's file names another file", _TABLES)
    return found
