"""Numbers of a scene by which sensors are differentiated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from kaneflex.scene import Scene, with_settings
from kaneflex.scene.scene import given_value
from kaneflex.scene.settings import demand_once, dimensions, resolved
from kaneflex.support.errors import SceneError
from kaneflex.support.units import RATIO, to_si

_TABLES = ("gravity", "ground", "bodies", "masses", "drives", "loads", "springs", "joints", "damping", "sensors")
"""Tables of the scene whose numbers enter the equations or the sensors."""
_UNITS_IN_LISTS = {"gravity": "m/s^2", "ground": "m", "points": "m", "centre": "m", "section": "m", "taper": "m",
                   "rayleigh": "Hz", "fibre": "m", "at": "m", "inertia": "kg m^2", "velocity": "m/s",
                   "angular_velocity": "rad/s"}  # fmt: skip
"""Key of a list of numbers -> their unit; lists of other keys hold plain numbers."""
_DIRECTIONS = ("direction", "axis", "x", "y")
"""Lists that are normalised when read."""

_OF_SPRINGS = {"stiffness": ("N/m", "N m/rad"), "damping": ("N s/m", "N m s/rad")}
"""Units of translational and of torsional springs."""


@dataclass(frozen=True)
class Parameter:
    """A number of a scene.

    Attributes
    ----------
    name : str
        As requested, like "rod.E".
    path : tuple of str
        Keys of the entry, like ("bodies", "rod", "beam", "E").
    value : float
        In SI, never zero; components of directions as written, not normalised.
    unit : str
        Its SI unit; "1" for a plain number.
    index : int or None
        Index in a list, from 0; None for a single number.
    """

    name: str
    path: tuple[str, ...]
    value: float
    unit: str
    index: int | None = None

    def scaled(self, scene: Scene, factor: float) -> Scene:
        """The scene with the value multiplied by ``factor``."""
        written: object = self.value * factor
        if self.index is not None:
            numbers = list(_written_at(scene, self.path))
            numbers[self.index] = written
            written = numbers
        return with_settings(scene, [f"{'.'.join(self.path)}={written!r}"])


def find_parameters(scene: Scene, names: Sequence[str]) -> tuple[Parameter, ...]:
    """Parameters of these paths, short ones as in ``with_settings``; numbers of lists end with their index.

    Raises
    ------
    SceneError
        If a path does not exist or is not a number of the mechanism, or the number is zero.
    """
    found = [_find(scene, name) for name in names]
    demand_once(("sensitivities", parameter.name, (parameter.path, parameter.index)) for parameter in found)
    return tuple(found)


def place_of(raw: Mapping[str, Any], name: str) -> tuple[tuple[str, ...], int | None]:
    """Keys of a parameter's short or full name, and its index in a list, if any.

    Raises SceneError if the path does not exist or is ambiguous.
    """
    if not name.strip():
        raise SceneError("sensitivities", name, "an empty path", "Write for example rod.E,main.speed")
    whole, _, last = name.rpartition(".")
    index = int(last) if whole and last.isdecimal() else None
    return tuple(resolved(raw, name if index is None else whole)), index


def _find(scene: Scene, name: str) -> Parameter:
    path, index = place_of(scene.raw, name)
    whole = name.removesuffix(f".{index}")
    value = _written_at(scene, path)
    if isinstance(value, tuple) and index is not None and index < len(value):
        value = value[index]
    elif isinstance(value, tuple):
        cure = f"Choose one of its {len(value)} numbers, for example {whole}.0"
        raise SceneError(name, str(value), "a list of numbers", cure)
    elif index is not None:
        raise SceneError(name, value, "not a list of numbers", f"Write {whole}")
    if path[0] not in _TABLES:
        cure = f"Give a path within {', '.join(_TABLES[:-1])} or {_TABLES[-1]}"
        raise SceneError(name, value, "not a number of the mechanism", cure)
    if value is None:
        raise SceneError(name, None, "the scene gives no such number", f"Set it: --set {name}=VALUE")
    if not isinstance(value, float):
        raise SceneError(name, str(value), "not a real number", "Choose a quantity")
    if value == 0.0:
        cure = "Give it a value"
        raise SceneError(name, value, "no derivative at zero: the equations may omit zero terms", cure)
    unit = _unit(scene, path) if index is None else _unit_in_list(path, index)
    return Parameter(name, path, value, unit, index)


def _written_at(scene: Scene, path: Sequence[str]) -> object:
    """Value at a path in SI; directions as written, not normalised, so that differences are those of the input."""
    value, written = _value_at(scene, path), given_value(scene.raw, path)
    if path[-1] in _DIRECTIONS and isinstance(value, tuple) and isinstance(written, list):
        return tuple(to_si(component, RATIO) for component in written)
    return value


def _value_at(scene: Scene, path: Sequence[str]) -> object:
    value: object = scene
    for key in path:
        if isinstance(value, dict):
            value = value.get(key)
        elif value is not None:
            fields = type(value).model_fields.items()
            value = getattr(value, next(name for name, field in fields if key == (field.alias or name)))
    return value


def _unit_in_list(path: tuple[str, ...], index: int) -> str:
    if path[0] == "springs":  # a bushing's, three along axes and three about them
        return _OF_SPRINGS[path[-1]][index // 3]
    if path[-1] == "ratio":
        return "1"
    return next((_UNITS_IN_LISTS[word] for word in path if word in _UNITS_IN_LISTS), "1")


def _unit(scene: Scene, path: tuple[str, ...]) -> str:
    """SI unit of the number at a path, which may depend on the joint's or load's kind."""
    table, owner, *rest = path
    known = [dimension.unit for dimension in dimensions(path)]
    if len(known) == 2:
        return known[scene.slides(owner)]
    if table == "loads" and rest == ["value"]:
        load = scene.loads[owner]
        return "N m" if load.torque_at is not None else "N/m" if load.spread_on is not None else "N"
    if table == "loads" and rest[0] in ("period", "offset"):
        return scene.loads[owner].read_table().x_dimension.unit
    if table == "springs" and rest[0] in ("stiffness", "damping"):
        return _OF_SPRINGS[rest[0]][scene.springs[owner].torsional_at is not None]
    return (known or [""])[0] or "1"
