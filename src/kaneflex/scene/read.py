"""From a TOML file, or a shipped scene's name, to a validated `Scene`; every problem is named at once."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from pydantic import BaseModel, ValidationError

from kaneflex.scene.fields import known_keys
from kaneflex.scene.merge import REMOVED, merged, reuse_bodies
from kaneflex.scene.scene import Scene, given_value
from kaneflex.scene.settings import nested, split_setting
from kaneflex.support.arguments import takes
from kaneflex.support.errors import LONGEST_NAME, Fault, Problem, SceneError, nearest, told
from kaneflex.support.escaping import visible
from kaneflex.support.reading import beside, is_file, read_text

if TYPE_CHECKING:
    import kaneflex

SceneLike: TypeAlias = "Scene | kaneflex.Model | kaneflex.Solution | Path | str"
"""A scene, what was made of it, or a shipped scene's name or a file; :func:`scene_from` gives the scene."""

_DEEPEST = 20
"""Tables within tables at most: no scene has more than six."""
FILE_KEYS = {"loads": "table", "drives": "table", "bodies": "modal_data", "solve": "file"}
"""Table of named entries -> the key by which one of them names a file."""
_SHIPPED = Path(__file__).parent.parent / "scenes"


def shipped_scenes() -> dict[str, Path]:
    """Name and file of every scene that comes with the package, sorted."""
    files = {path.stem: path for path in _SHIPPED.glob("*.toml")}
    return {name: files[name] for name in sorted(files)}


def descriptions() -> dict[str, str]:
    """Name and description of every shipped scene; nothing else of them is validated."""
    return {name: _read_raw(path, ()).get("description", "") for name, path in shipped_scenes().items()}


@takes(name_or_path="path")
def read_scene(name_or_path: str | Path) -> Scene:
    """The scene of a file, or the shipped one of that name. Raises SceneError with every problem found."""
    path = located(name_or_path, Path.cwd(), "scene")
    return _validated(_read_raw(path, ()), path.stem if path.parent == _SHIPPED else path.name)


def scene_from(given: SceneLike) -> Scene:
    """Scene of a Scene, a Model or a Solution; a shipped scene's name or a path is read."""
    if isinstance(given, Scene):
        return given
    if isinstance(given, str | Path):
        return read_scene(given)
    model: Any = getattr(given, "model", given)
    return model.given or model.scene


@takes(given="tables", folder="path")
def scene_of(given: Mapping[str, Any] | str, folder: str | Path = ".") -> Scene:
    """The scene of tables, or of a text in TOML: what a file would hold, with the same checks and the same errors.

    Parameters
    ----------
    given : mapping or str
        Tables within tables; numbers of NumPy's, arrays and paths stand for what a file could say of them.
    folder : path
        What the files that it names, and scenes that it is ``like``, stand relative to.

    Raises
    ------
    SceneError
        With every problem found.
    TypeError
        For what is neither tables nor a text.
    """
    if isinstance(given, str):
        raw = _parsed(given, "text")
    else:
        raw = _plain(given)
        _demand_shallow(raw, "tables")
    raw = _whole(raw, "scene", Path(folder).resolve(), ())
    return _validated(raw, str(raw["name"]))


@takes(scene="scene", settings="settings")
def with_settings(scene: SceneLike, settings: Iterable[str] | Mapping[str, Any]) -> Scene:
    """The scene with settings, {path: value} or a list of "path=value", validated anew.

    "rod.elements=1" is short for "bodies.rod.beam.elements=1"; "loads.gas=none" removes what the scene has.
    Raises SceneError: a path that leads nowhere or to several places, a value the scene cannot have.
    """
    if isinstance(settings, str):
        raise SceneError("settings", settings, "one text, where a list of settings is wanted", f"Write [{settings!r}]")
    scene = scene_from(scene)
    raw = scene.raw
    given = settings.items() if isinstance(settings, Mapping) else map(split_setting, settings)
    for setting in given:
        raw = merged(raw, nested(raw, *setting))
    return _validated(raw, scene.source, scene)


def json_schema() -> dict[str, Any]:
    """JSON Schema of a scene file, for editors. Nothing is required: `like` may give any of it."""
    schema = _removable(Scene.model_json_schema(by_alias=True))
    for table in (schema, *schema["$defs"].values()):
        table.pop("required", None)
    return schema | {"$schema": "https://json-schema.org/draft/2020-12/schema"}


def _removable(schema: Any) -> Any:
    """The schema with "none" allowed for every named table."""
    if isinstance(schema, list):
        return [_removable(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return {"anyOf": [schema, {"const": REMOVED}]}
    return {key: _removable(value) for key, value in schema.items()}


def located(name_or_path: str | Path, folder: Path, key: str) -> Path:
    """The file of a shipped scene or of a path relative to `folder`; `key` is where it was named."""
    text, shipped = str(name_or_path), shipped_scenes()
    if text in shipped:
        return shipped[text]
    path = folder / text
    if is_file(path):
        return path
    reason = "no such file" if path.suffix == ".toml" else "no shipped scene and no file of that name"
    raise SceneError(key, text, reason, _other_scene(text, path, shipped))


def _other_scene(text: str, path: Path, shipped: Iterable[str]) -> str:
    """What to say to someone who named a scene that isn't there: the nearest file beside it, or shipped scene."""
    try:
        neighbours = sorted(path.parent.glob("*.toml"))
    except (OSError, ValueError):  # no folder can have that name
        neighbours = []
    files = {file.stem: str(Path(text).parent / file.name) for file in neighbours}
    close = difflib.get_close_matches(path.stem[:LONGEST_NAME], [*files, *shipped], n=1)
    if close and close[0] in files:
        return f"There is a file {files[close[0]]!r}"
    return nearest(path.stem, shipped).replace("Known", "Shipped scenes")


def _read_raw(path: Path, readers: tuple[Path, ...]) -> dict[str, Any]:
    """The file's tables over those that `like` names; the paths of CSV tables, modal data and states are absolute."""
    path = path.resolve()
    if path in readers:
        chain = " -> ".join(reader.name for reader in (*readers, path))
        raise SceneError("like", path.stem, f"scenes start from each other: {chain}", "Break the circle")
    return _whole(_toml(path), path.stem, path.parent, (*readers, path))


def _whole(raw: dict[str, Any], name: str, folder: Path, readers: tuple[Path, ...]) -> dict[str, Any]:
    """Tables as :func:`_read_raw` gives them, of what a file in that folder holds."""
    raw.setdefault("name", visible(name))  # bytes of a file's name need not be text
    for entry, key in file_entries(raw).values():
        if entry[key] != REMOVED:
            entry[key] = str(beside(folder, entry[key]))
    if isinstance(raw.get("like"), str):
        raw = merged(_read_raw(located(raw["like"], folder, "like"), readers), raw)
    return reuse_bodies(raw)


def _toml(path: Path) -> dict[str, Any]:
    """A file's tables. Raises SceneError: unreadable, not TOML, numbers or tables beyond any scene's."""
    with told("scene", path.name):
        try:
            text = read_text(path)
        except FileNotFoundError:  # gone since it was looked for
            raise Fault("no such file", "Give the path of a scene") from None
    return _parsed(text, path.name)


def _parsed(text: str, name: str) -> dict[str, Any]:
    """The tables of a text in TOML. Raises SceneError: not TOML, numbers or tables beyond any scene's."""
    try:
        raw = tomllib.loads(text)
    except RecursionError:
        raise SceneError("scene", name, "lists or tables stand too deep in each other", "Flatten them") from None
    except tomllib.TOMLDecodeError as error:
        from kaneflex.support.mistakes import toml_advice

        raise SceneError("scene", name, *toml_advice(str(error), text)) from None
    except ValueError:  # Python makes no whole number of more than 4300 digits, and names no line
        line, digits = _longest_number(text)
        reason = f"line {line}: a whole number of {digits} digits"
        raise SceneError("scene", name, reason, "Write it like 1.5e9") from None
    _demand_shallow(raw, name)
    return raw


def _demand_shallow(raw: dict[str, Any], name: str) -> None:
    level = [raw]
    for _ in range(_DEEPEST):
        level = [inner for table in level for inner in table.values() if isinstance(inner, dict)]
    if level:
        raise SceneError("scene", name, f"tables stand more than {_DEEPEST} deep in each other", "Flatten them")


def _plain(value: Any, depth: int = 0) -> Any:
    """A value as TOML would give it: mappings, sequences, paths and NumPy's numbers become plain ones."""
    if depth > _DEEPEST:  # which is refused, and may go on without end
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(each, depth + 1) for key, each in value.items()}
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    return [_plain(each, depth + 1) for each in value] if isinstance(value, (list, tuple)) else value


def _longest_number(text: str) -> tuple[int, int]:
    """Line and digits of the whole number that has most of them; TOML lets underscores stand between them."""
    numbers = ((line, row) for line, text in enumerate(text.split("\n"), 1) for row in re.findall(r"[0-9_]+", text))
    return max(((line, len(number.replace("_", ""))) for line, number in numbers), key=lambda found: found[1])


def file_entries(raw: Mapping[str, Any]) -> dict[str, tuple[dict[str, Any], str]]:
    """Path of every entry of a scene's tables that names a file -> the table that it stands in, and its key there."""
    tables = {table: raw.get(table) for table in FILE_KEYS}
    return {
        f"{table}.{name}.{FILE_KEYS[table]}": (entry, FILE_KEYS[table])
        for table, entries in tables.items() if isinstance(entries, dict)
        for name, entry in entries.items()
        if isinstance(entry, dict) and isinstance(entry.get(FILE_KEYS[table]), str)
    }  # fmt: skip


def _validated(raw: dict[str, Any], source: str, like: Scene | None = None) -> Scene:
    """The scene of its tables; those that it shares with another one are not validated again."""
    from kaneflex.scene.check import problems_of

    try:
        scene = Scene.model_validate(raw if like is None else like.known(raw))
    except ValidationError as error:
        # A table's default that needs a broken entry is no problem of its own.
        found = [e for e in error.errors() if e["type"] != "default_factory_not_called"]
        raise SceneError.gather(problem_in(item, raw) for item in found) from None
    scene.remember(raw, source)
    problems = problems_of(scene)
    if problems:
        raise SceneError.gather(problems)
    return scene.with_clearances()


def _place_of(path: list[str], model: type[BaseModel]) -> str | None:
    """Where a key belongs that stands in the wrong table: in one within that table, around it, or at the top."""
    *table, key = path
    within = [[*table, inner] for inner in known_keys(table, model)]
    around = [table[:depth] for depth in range(len(table) - 1, 1, -1)]
    top = [[name] for name in known_keys((), model)]
    fitting = [place for place in (*within, *around, *top) if place != table and key in known_keys(place, model)]
    return f"It belongs to {'.'.join(fitting[0])}" if fitting else None


_COUPLINGS = {"gear", "worm", "rack", "screw", "belt", "chain", "cam", "differential", "ratio", "pitch", "lead"}
"""Words for what ties one joint to another, which there is no key for."""


def _coupling(path: list[str]) -> tuple[str, str] | None:
    """Reason and cure of a key that would couple joints, which only laws of loads do."""
    table, key = path[0], path[-1]
    if len(path) != 3 or not ((table == "joints" and key in _COUPLINGS) or (table == "drives" and key == "against")):
        return None
    what = "no key couples a joint with another one" if table == "joints" else "a drive's table is over the time"
    cure = "Let the joints be free, and couple them by laws of torques and forces in their coordinates and speeds"
    return f"unknown key: {what}", f"{cure}, as 'Brakes and belts' in docs/scene/loads.md does"


def problem_in(error: dict[str, Any], raw: dict[str, Any], model: type[BaseModel] = Scene) -> Problem:
    """pydantic's description of one error in a file of such a `model` in our terms."""
    path = [str(part) for part in error["loc"]]
    fault = error.get("ctx", {}).get("error")
    if isinstance(fault, Fault):
        path += fault.below.split(".") if fault.below else []
        reason, cure = fault.reason, fault.cure
    elif error["type"] == "extra_forbidden":
        reason, cure = _coupling(path) or (
            "unknown key", _place_of(path, model) or nearest(path[-1], known_keys(path[:-1], model))
        )  # fmt: skip
    elif error["type"] == "missing":
        reason, cure = "missing", "Write schema = 1 first" if path == ["schema"] else f"Give {path[-1]}"
    elif error["type"] == "literal_error":
        expected = error["ctx"]["expected"]
        reason, cure = f"must be {expected}", "Write one of these" if " or " in expected else f"Write {expected}"
    elif error["type"] in ("dict_type", "model_type"):
        reason, cure = "not a table", "Write a table, like {key = value}"
    elif error["type"] == "string_type":
        reason, cure = "not a text", "Write it in quotes"
    elif error["type"] in ("tuple_type", "list_type"):
        reason, cure = "not a list", "Write it in brackets, like [...]"
    elif error["type"] == "too_short":
        reason, cure = "empty", f"Give at least {error['ctx']['min_length']}"
    elif error["type"] in ("bool_type", "bool_parsing"):
        reason, cure = "neither true nor false", "Write true or false, without quotes"
    else:
        reason, cure = error["msg"][:1].lower() + error["msg"][1:], f"Write another {path[-1]}, see the scene reference"
    return Problem(".".join(path), given_value(raw, path), reason, cure)
