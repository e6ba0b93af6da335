"""Numbers of a scene that sensors are differentiated by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from kaneflex.errors import SceneError
from kaneflex.scene import Scene, with_settings
from kaneflex.scene.fields import dimensions
from kaneflex.scene.settings import resolved

_TABLES = ("bodies", "masses", "drives", "loads", "springs", "joints", "damping", "sensors")
"""Tables of the scene whose numbers the equations or the sensors hold."""


@dataclass(frozen=True)
class Parameter:
    """A number of a scene.

    Attributes
    ----------
    name : str
        As it was asked for, like "rod.E".
    path : tuple of str
        Where it stands, like ("bodies", "rod", "beam", "E").
    value : float
        In SI, never zero.
    unit : str
        Its SI unit; "1" for a plain number.
    """

    name: str
    path: tuple[str, ...]
    value: float
    unit: str

    def scaled(self, scene: Scene, factor: float) -> Scene:
        """The scene with ``factor`` times the value."""
        return with_settings(scene, [f"{'.'.join(self.path)}={self.value * factor!r}"])


def find_parameters(scene: Scene, names: Sequence[str]) -> tuple[Parameter, ...]:
    """The parameters of these paths, short ones as ``with_settings`` takes them.

    Raises
    ------
    SceneError
        For a path that leads nowhere or is no number of the mechanism, and for a number that is zero.
    """
    found = [_find(scene, name) for name in names]
    paths = [parameter.path for parameter in found]
    for parameter in found:
        if paths.count(parameter.path) > 1:
            raise SceneError("sensitivities", parameter.name, "asked for twice", "Give each parameter once")
    return tuple(found)


def _find(scene: Scene, name: str) -> Parameter:
    path = tuple(resolved(scene.raw, name))
    value = _value_at(scene, path)
    if path[0] not in _TABLES:
        cure = f"Give a path within {', '.join(_TABLES[:-1])} or {_TABLES[-1]}"
        raise SceneError(name, value, "no number of the mechanism", cure)
    if value is None:
        raise SceneError(name, None, "the scene gives no such number", f"Set it, like --set {name}=VALUE")
    if not isinstance(value, float):
        raise SceneError(name, str(value), "not a number that can change a little", "Give the path of a quantity")
    if value == 0.0:
        cure = "Give it a value"
        raise SceneError(name, value, "the derivative at zero is not available: equations may leave a zero out", cure)
    return Parameter(name, path, value, _unit(scene, path))


def _value_at(scene: Scene, path: Sequence[str]) -> object:
    value: object = scene
    for key in path:
        if isinstance(value, dict):
            value = value.get(key)
        elif value is not None:
            fields = type(value).model_fields.items()
            value = getattr(value, next(name for name, field in fields if key == (field.alias or name)))
    return value


def _unit(scene: Scene, path: tuple[str, ...]) -> str:
    """SI unit of the number at a path; of what a joint's or load's kind decides, by that kind."""
    table, owner, *rest = path
    known = [dimension.unit for dimension in dimensions(path)]
    if len(known) == 2:
        return known[scene.slides(owner)]
    if table == "loads" and rest == ["value"]:
        load = scene.loads[owner]
        return "N m" if load.torque_at is not None else "N/m" if load.spread_on is not None else "N"
    if table == "loads" and rest[0] in ("period", "offset"):
        return "s" if scene.loads[owner].against == "t" else "rad"
    if table == "springs" and rest[0] in ("stiffness", "damping"):
        linear, torsional = {"stiffness": ("N/m", "N m/rad"), "damping": ("N s/m", "N m s/rad")}[rest[0]]
        return linear if scene.springs[owner].torsional_at is None else torsional
    return (known or [""])[0] or "1"
