"""Plan of a study: its scene and its numbered points."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kaneflex.scene import Scene, read_scene, shipped_scenes, with_settings
from kaneflex.scene.read import FILE_KEYS, file_entries
from kaneflex.scene.settings import demand_once, nested, resolved, split_setting
from kaneflex.scene.table import merged
from kaneflex.study.sensitivity.parameters import place_of
from kaneflex.study.study import Poincare, Point, Study, Value, points_of, read_study, size_of, study_of
from kaneflex.support.errors import SceneError, nearest
from kaneflex.support.machine import gib, installed
from kaneflex.support.module_cache import sources_digest

if TYPE_CHECKING:
    from kaneflex.solve.variants import Variants

OWN_NAMES = ("point", "statistic", "instant", "outcome", "reason", "time")
"""Names in the dataset that are not sensors."""


_MANY = 20
"""Number of runs that take as long as compiling the sensors' kernels."""
_POINT, _VALUE = 500, 70
"""Bytes of a planned point, and of each of its values."""


def names_file(path: str) -> bool:
    """True if the entry at a path of the scene is a file name."""
    return path.rpartition(".")[2] in FILE_KEYS.values()


@dataclass(frozen=True, eq=False)
class Plan:
    """Scene, points and options of a sweep.

    Attributes
    ----------
    scene : Scene
        With the study's settings applied.
    points : mapping of int to Point
        By number; a chunk's plan has only some of them.
    series : bool
        Whether every sensor is kept over time.
    sensitivities : tuple of str
        Paths of the numbers by which sensors are differentiated.
    frozen : bool
        Whether the derivatives keep the modal bases fixed.
    files : mapping of str to bytes
        Contents of tables and modal data of the scene and its points, by absolute path.
    poincare : Poincare or None
        Poincare section: its instants alone are kept as series.
    alike : bool
        Whether most points differ from the previous one only in drives' speeds.
    """

    scene: Scene
    points: Mapping[int, Point]
    series: bool
    files: Mapping[str, bytes]
    sensitivities: tuple[str, ...] = ()
    frozen: bool = True
    poincare: Poincare | None = None
    alike: bool = False

    @cached_property
    def variants(self) -> Variants:
        """Models of its points."""
        from kaneflex.solve.variants import Variants

        return Variants(self.scene, self.alike)

    def with_points(self, points: Mapping[int, Point]) -> Plan:
        """The same plan with other points, which reuse what these points' models have computed."""
        found = replace(self, points=points)
        vars(found)["variants"] = self.variants
        return found

    def at(self, index: int) -> Scene:
        """The scene at a point. Raises SceneError if the scene does not allow its values."""
        return with_settings(self.scene, self.settings(index))

    def settings(self, index: int) -> list[str]:
        """Settings path=value of a point."""
        own = [setting(path, value) for path, value in self.points[index].items()]
        return own + self.poincare.settings(with_settings(self.scene, own)) if self.poincare else own

    @cached_property
    def digest(self) -> str:
        """Digest of everything that the results depend on."""
        kept = (self.series, self.sensitivities, self.frozen, self.poincare and self.poincare.model_dump())
        return digest(self.scene.raw, self.files, list(self.points.values()), kept)


def make_plan(given: Path | str | Mapping[str, Any], more: Sequence[str] = ()) -> Plan:
    """Make the plan of a study's file or of its tables, whose ``scene`` may also be a Scene.

    File names in tables and in ``more`` (further settings) are relative to the current folder.

    Raises
    ------
    SceneError
        If the study or its scene can't be read, a path does not exist, an entry is set twice, or a sensor has a
        reserved name. Values other than the first point's are not checked.
    """
    own = None
    if isinstance(given, Mapping):
        folder, tables = Path.cwd(), dict(given)
        if isinstance(tables.get("scene"), Scene):
            own = tables["scene"]
            tables["scene"] = own.name
        study = study_of(tables)
    else:
        study, folder = read_study(given), Path(given).resolve().parent
    _check_memory(study)
    read = _named(study.scene, folder) if own is None else own
    settings = [*_settings(study.settings, folder), *_settings(more, Path.cwd())]
    scene = with_settings(read, settings) if settings else read
    points = [{key: _whole_path(key, value, folder) for key, value in point.items()} for point in points_of(study)]
    for key, value in points[0].items():
        nested(scene.raw, key, value)
    demand_once((*_set(read.raw, settings), *_varied(scene.raw, study)))
    demand_once(("sensitivities", name, place_of(scene.raw, name)) for name in study.sensitivities)
    for sensor in scene.sensors:
        if sensor in (*OWN_NAMES, *points[0]) or sensor.removesuffix("_series") in scene.sensors.keys() - {sensor}:
            raise SceneError(f"sensors.{sensor}", None, "the dataset uses that name itself", "Rename the sensor")
    if study.poincare is not None:
        study.poincare.settings(scene)  # raises SceneError
    kept_series = study.series or study.poincare is not None
    kept = (kept_series, _files(scene.raw, points), study.sensitivities, study.basis == "frozen", study.poincare)
    return Plan(scene, dict(enumerate(points)), *kept, _alike(scene.raw, points))


def _check_memory(study: Study) -> None:
    """Raise SceneError if the points need more memory than the machine has."""
    count, there = size_of(study), installed()
    each = _POINT + _VALUE * (len(study.parameters) + len(study.points[0] if study.points else ()))
    if there is not None and count * each > there:
        reason = f"{count:,} points need {gib(count * each)}, and this machine has {gib(there)}"
        raise SceneError("study", study.scene, reason, f"Use at most {there // (2 * each):,} points")


def _alike(raw: Mapping[str, Any], points: Sequence[Point]) -> bool:
    """True if on average at least _MANY successive points differ only in drives' speeds."""
    places = {path: resolved(raw, path) for path in points[0]}
    others = [path for path, keys in places.items() if keys[0] != "drives" or keys[2:] != ["speed"]]
    changes = sum(any(one[path] != two[path] for path in others) for one, two in pairwise(points))
    return len(points) >= _MANY * (changes + 1)


def digest(raw: Mapping[str, Any], files: Mapping[str, bytes], *more: object) -> str:
    """Sixteen hexadecimal digits of a scene, its files, kaneflex's own sources and ``more``."""
    contents = {path: hashlib.sha256(data).hexdigest() for path, data in files.items()}
    about = [sources_digest(), raw, contents, *more]
    return hashlib.sha256(json.dumps(about, sort_keys=True, default=str).encode()).hexdigest()[:16]


def setting(path: str, value: Value) -> str:
    """The setting "path=value" in TOML's spelling."""
    return f"{path}={json.dumps(value, ensure_ascii=False)}"


def _settings(given: Sequence[str], folder: Path) -> list[str]:
    """Settings with whole paths of files."""
    settings = []
    for text in given:
        key, equals, value = text.partition("=")
        whole = _whole_path(key.strip(), value.strip().strip("\"'"), folder)
        settings.append(setting(key, whole) if equals and names_file(key.strip()) else text)
    return settings


def _set(raw: dict[str, Any], settings: Sequence[str]) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Entries that settings change, for :func:`demand_once`; a setting may refer to what those before it add."""
    for text in settings:
        name = text.partition("=")[0].strip()
        yield "settings", name, tuple(resolved(raw, name))
        raw = merged(raw, nested(raw, *split_setting(text)))


def _varied(raw: Mapping[str, Any], study: Study) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Entries that vary, for :func:`demand_once`; all listed points have the paths of the first one."""
    yield from (("parameters", name, tuple(resolved(raw, name))) for name in study.parameters)
    for point in study.points[:1]:
        yield from (("points", name, tuple(resolved(raw, name))) for name in point)


def _named(name: str, folder: Path) -> Scene:
    if name not in shipped_scenes() and not (folder / name).is_file():
        cure = nearest(name, [*shipped_scenes(), *(file.name for file in folder.glob("*.toml"))])
        raise SceneError("scene", name, "neither a shipped scene nor a file in the study's folder", cure)
    return read_scene(name if name in shipped_scenes() else folder / name)


def _whole_path(key: str, value: Value, folder: Path) -> Value:
    """Absolute path of a file named relative to the study's folder; other values unchanged."""
    if names_file(key) and isinstance(value, str) and value != "none":
        return str((folder / value).resolve())
    return value


def file_places(raw: Mapping[str, Any]) -> dict[str, str]:
    """Path of every entry that names a file -> that file."""
    return {path: entry[key] for path, (entry, key) in file_entries(raw).items()}


def _files(raw: Mapping[str, Any], points: list[Point]) -> dict[str, bytes]:
    named = set(file_places(raw).values())
    named |= {value for point in points for key, value in point.items() if names_file(key)}
    return {name: Path(name).read_bytes() for name in sorted(named) if Path(name).is_file()}
