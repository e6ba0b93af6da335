"""A study with its scene read and its points numbered: what is computed, wherever that happens."""

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
from kaneflex.scene.merge import merged
from kaneflex.scene.read import FILE_KEYS, file_entries
from kaneflex.scene.settings import demand_once, nested, resolved, split_setting
from kaneflex.study.poincare import Poincare
from kaneflex.study.sensitivity.parameters import place_of
from kaneflex.study.study import Point, Study, Value, points_of, read_study, size_of, study_of
from kaneflex.support.errors import SceneError, nearest
from kaneflex.support.machine import gib, installed
from kaneflex.support.module_cache import sources_digest

if TYPE_CHECKING:
    from kaneflex.solve.variants import Variants

OWN_NAMES = ("point", "statistic", "instant", "outcome", "reason", "time")
"""Names in the dataset that are not sensors."""


_MANY = 20
"""Runs in the time of reading which reading is compiled, or more."""
_POINT, _VALUE = 500, 70
"""Bytes of a point as it is planned and numbered, and of each of its values."""


def names_file(path: str) -> bool:
    """Whether the entry at a path of the scene names a file."""
    return path.rpartition(".")[2] in FILE_KEYS.values()


@dataclass(frozen=True, eq=False)
class Plan:
    """What a sweep computes.

    Attributes
    ----------
    scene : Scene
        With the study's settings laid over it.
    points : mapping of int to Point
        By number; only some of them where they are solved in chunks.
    series : bool
        Whether every sensor is kept over time.
    sensitivities : tuple of str
        Paths of what the sensors are differentiated by.
    frozen : bool
        Whether modal bases keep their shapes in the derivatives.
    files : mapping of str to bytes
        Tables and modal data that the scene or a point names, by absolute path.
    poincare : Poincare or None
        Which instants alone are kept as series.
    alike : bool
        Whether most points differ from the one before by drives' speeds alone.
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
        """The models of its points."""
        from kaneflex.solve.variants import Variants

        return Variants(self.scene, self.alike)

    def with_points(self, points: Mapping[int, Point]) -> Plan:
        """The same of other points, whose models take what they can from those of these."""
        found = replace(self, points=points)
        vars(found)["variants"] = self.variants
        return found

    def at(self, index: int) -> Scene:
        """The scene at a point. Raises SceneError for values that the scene can't have."""
        return with_settings(self.scene, self.settings(index))

    def settings(self, index: int) -> list[str]:
        """What makes the scene that of a point, as path=value."""
        own = [setting(path, value) for path, value in self.points[index].items()]
        return own + self.poincare.settings(with_settings(self.scene, own)) if self.poincare else own

    @cached_property
    def digest(self) -> str:
        """Of all that the results depend on."""
        kept = (self.series, self.sensitivities, self.frozen, self.poincare and self.poincare.model_dump())
        return digest(self.scene, self.files, list(self.points.values()), kept)


def make_plan(given: Path | str | Mapping[str, Any], more: Sequence[str] = ()) -> Plan:
    """The plan of a study's file, or of its tables, whose ``scene`` may also be a Scene.

    Files that tables name stand relative to the current folder, as do those of ``more``: settings beside the study's.

    Raises
    ------
    SceneError
        For what is no study, a scene that can't be read, a path that leads nowhere, an entry that is set twice, or
        names of sensors that the dataset needs itself. Values that only some points have are not tried.
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
    demand_once((*_set(read, settings), *_varied(scene, study)))
    demand_once(("sensitivities", name, place_of(scene, name)) for name in study.sensitivities)
    for sensor in scene.sensors:
        if sensor in (*OWN_NAMES, *points[0]) or sensor.removesuffix("_series") in scene.sensors.keys() - {sensor}:
            raise SceneError(f"sensors.{sensor}", None, "the dataset has that name already", "Rename the sensor")
    if study.poincare is not None:
        study.poincare.settings(scene)  # raises SceneError
    kept_series = study.series or study.poincare is not None
    kept = (kept_series, _files(scene, points), study.sensitivities, study.basis == "frozen", study.poincare)
    return Plan(scene, dict(enumerate(points)), *kept, _alike(scene, points))


def _check_memory(study: Study) -> None:
    """Refuse more points than the machine's memory holds, before the first of them is made."""
    count, there = size_of(study), installed()
    each = _POINT + _VALUE * (len(study.parameters) + len(study.points[0] if study.points else ()))
    if there is not None and count * each > there:
        reason = f"{count:,} points need {gib(count * each)}, and this machine has {gib(there)}"
        raise SceneError("study", study.scene, reason, f"Ask for {there // (2 * each):,} at most")


def _alike(scene: Scene, points: Sequence[Point]) -> bool:
    """Whether on the average _MANY points follow each other that differ by drives' speeds alone."""
    places = {path: resolved(scene.raw, path) for path in points[0]}
    others = [path for path, keys in places.items() if keys[0] != "drives" or keys[2:] != ["speed"]]
    changes = sum(any(one[path] != two[path] for path in others) for one, two in pairwise(points))
    return len(points) >= _MANY * (changes + 1)


def digest(scene: Scene, files: Mapping[str, bytes], *more: object) -> str:
    """Sixteen hexadecimal digits of a scene, the files that it names, kaneflex's own sources, and what else counts."""
    contents = {path: hashlib.sha256(data).hexdigest() for path, data in files.items()}
    about = [sources_digest(), scene.raw, contents, *more]
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


def _set(scene: Scene, settings: Sequence[str]) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """What settings change, as :func:`demand_once` takes it; each may name what those before it add to the scene."""
    raw = scene.raw
    for text in settings:
        name = text.partition("=")[0].strip()
        yield "settings", name, tuple(resolved(raw, name))
        raw = merged(raw, nested(raw, *split_setting(text)))


def _varied(scene: Scene, study: Study) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """The same of what varies: every listed point has the paths of the first one."""
    yield from (("parameters", name, tuple(resolved(scene.raw, name))) for name in study.parameters)
    for point in study.points[:1]:
        yield from (("points", name, tuple(resolved(scene.raw, name))) for name in point)


def _named(name: str, folder: Path) -> Scene:
    if name not in shipped_scenes() and not (folder / name).is_file():
        cure = nearest(name, [*shipped_scenes(), *(file.name for file in folder.glob("*.toml"))])
        raise SceneError("scene", name, "no shipped scene and no file of that name beside the study", cure)
    return read_scene(name if name in shipped_scenes() else folder / name)


def _whole_path(key: str, value: Value, folder: Path) -> Value:
    """The absolute path of a file that is named relative to the study's folder; any other value as it is."""
    if names_file(key) and isinstance(value, str) and value != "none":
        return str((folder / value).resolve())
    return value


def file_places(scene: Scene) -> dict[str, str]:
    """Path of every entry of the scene that names a file -> that file."""
    return {path: entry[key] for path, (entry, key) in file_entries(scene.raw).items()}


def _files(scene: Scene, points: list[Point]) -> dict[str, bytes]:
    named = set(file_places(scene).values())
    named |= {value for point in points for key, value in point.items() if names_file(key)}
    return {name: Path(name).read_bytes() for name in sorted(named) if Path(name).is_file()}
