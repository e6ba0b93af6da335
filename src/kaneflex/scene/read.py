"""Reading of a TOML file, or a shipped scene by name, into a validated `Scene`; all problems are reported at once."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from pydantic import BaseModel, ValidationError

from kaneflex.scene.scene import Scene, given_value
from kaneflex.scene.table import REMOVED, merged, reuse_bodies
from kaneflex.support.arguments import takes
from kaneflex.support.errors import LONGEST_NAME, Fault, Problem, SceneError, naming, nearest
from kaneflex.support.escaping import visible
from kaneflex.support.files import beside, is_file, read_text

if TYPE_CHECKING:
    import kaneflex

SceneLike: TypeAlias = "Scene | kaneflex.Model | kaneflex.Solution | Path | str"
"""A scene, what was made of it, or a shipped scene's name or a file; :func:`scene_from` gives the scene."""

_DEEPEST = 20
"""Largest depth of nested tables; scenes have at most six."""
FILE_KEYS = {"loads": "table", "drives": "table", "bodies": "modal_data", "solve": "file"}
"""Table of named entries -> the key with which its entries name a file."""
_SHIPPED = Path(__file__).parent.parent / "scenes"


def shipped_scenes() -> dict[str, Path]:
    """Name and file of every scene that comes with the package, sorted."""
    files = {path.stem: path for path in _SHIPPED.glob("*.toml")}
    return {name: files[name] for name in sorted(files)}


def descriptions() -> dict[str, str]:
    """Name and description of every shipped scene, without further validation."""
    return {name: _read_raw(path, ()).get("description", "") for name, path in shipped_scenes().items()}


@takes(name_or_path="path")
def read_scene(name_or_path: str | Path) -> Scene:
    """Read the scene of a file, or the shipped scene of that name. Raises SceneError with all problems."""
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
    """Make a scene from tables, or from a text in TOML, with the same checks and errors as for a file.

    Parameters
    ----------
    given : mapping or str
        Nested tables; NumPy's numbers, arrays and paths are converted to plain values.
    folder : path
        Folder to which paths of files, and scenes named by ``like``, are relative.

    Raises
    ------
    SceneError
        With all problems found.
    TypeError
        If it is neither tables nor a text.
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
    """Apply settings, {path: value} or a list of "path=value", to a scene and validate it again.

    "rod.elements=1" is short for "bodies.rod.beam.elements=1"; "loads.gas=none" removes an entry. Raises SceneError for
    an unknown or ambiguous path, or an invalid value.
    """
    if isinstance(settings, str):
        raise SceneError("settings", settings, "a single text instead of a list of settings", f"Write [{settings!r}]")
    from kaneflex.scene.settings import nested, split_setting

    scene = scene_from(scene)
    raw = scene.raw
    given = settings.items() if isinstance(settings, Mapping) else map(split_setting, settings)
    for setting in given:
        raw = merged(raw, nested(raw, *setting))
    return _validated(raw, scene.source, scene)


def json_schema() -> dict[str, Any]:
    """JSON Schema of a scene file, for editors. No entry is required, since `like` may give it."""
    schema = _removable(Scene.model_json_schema(by_alias=True))
    for table in (schema, *schema["$defs"].values()):
        table.pop("required", None)
    return schema | {"$schema": "https://json-schema.org/draft/2020-12/schema"}


def _removable(schema: Any) -> Any:
    """Schema that also allows "none" for every named table."""
    if isinstance(schema, list):
        return [_removable(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return {"anyOf": [schema, {"const": REMOVED}]}
    return {key: _removable(value) for key, value in schema.items()}


def located(name_or_path: str | Path, folder: Path, key: str) -> Path:
    """File of a shipped scene or of a path relative to `folder`; `key` is the entry that names it."""
    text, shipped = str(name_or_path), shipped_scenes()
    if text in shipped:
        return shipped[text]
    path = folder / text
    if is_file(path):
        return path
    reason = "no such file" if path.suffix == ".toml" else "no shipped scene and no file of that name"
    raise SceneError(key, text, reason, _other_scene(text, path, shipped))


def _other_scene(text: str, path: Path, shipped: Iterable[str]) -> str:
    """Advice for a missing scene: the most similar file in its folder, or shipped scene."""
    try:
        neighbours = sorted(path.parent.glob("*.toml"))
    except (OSError, ValueError):  # the name is not valid for a folder
        neighbours = []
    files = {file.stem: str(Path(text).parent / file.name) for file in neighbours}
    close = difflib.get_close_matches(path.stem[:LONGEST_NAME], [*files, *shipped], n=1)
    if close and close[0] in files:
        return f"A similar file is {files[close[0]]!r}"
    if close:
        return f"The nearest known one is {close[0]!r}"
    return "Give the path of a file, or the name of a shipped scene, see `kaneflex list`"


def _read_raw(path: Path, readers: tuple[Path, ...]) -> dict[str, Any]:
    """Tables of the file merged over those of `like`; paths of tables, modal data and states become absolute."""
    path = path.resolve()
    if path in readers:
        chain = " -> ".join(reader.name for reader in (*readers, path))
        raise SceneError("like", path.stem, f"scenes refer to each other in a circle: {chain}", "Remove one reference")
    return _whole(tables_of(path), path.stem, path.parent, (*readers, path))


def _whole(raw: dict[str, Any], name: str, folder: Path, readers: tuple[Path, ...]) -> dict[str, Any]:
    """Tables as :func:`_read_raw` gives them, from the content of a file in that folder."""
    raw.setdefault("name", visible(name))  # a file's name may not be valid text
    for entry, key in file_entries(raw).values():
        if entry[key] != REMOVED:
            entry[key] = str(beside(folder, entry[key]))
    if isinstance(raw.get("like"), str):
        raw = merged(_read_raw(located(raw["like"], folder, "like"), readers), raw)
    return reuse_bodies(raw)


def tables_of(path: Path, kind: str = "scene") -> dict[str, Any]:
    """Tables of a scene or study. Raises SceneError: unreadable, not TOML, numbers or nesting too large."""
    with naming(kind, path.name):
        try:
            text = read_text(path)
        except FileNotFoundError:
            raise Fault("no such file", f"Give the path of a {kind}") from None
    return _parsed(text, path.name, kind)


def _parsed(text: str, name: str, kind: str = "scene") -> dict[str, Any]:
    """Tables of a text in TOML. Raises SceneError: not TOML, numbers or nesting too large."""
    try:
        raw = tomllib.loads(text)
    except RecursionError:
        raise SceneError(kind, name, "lists or tables are nested too deeply", "Flatten them") from None
    except tomllib.TOMLDecodeError as error:
        from kaneflex.support.mistakes import toml_advice

        raise SceneError(kind, name, *toml_advice(str(error), text)) from None
    except ValueError:  # Python makes no whole number of more than 4300 digits, and names no line
        line, digits = _longest_number(text)
        reason = f"line {line}: a whole number of {digits} digits"
        raise SceneError(kind, name, reason, "Write it like 1.5e9") from None
    _demand_shallow(raw, name, kind)
    return raw


def _demand_shallow(raw: dict[str, Any], name: str, kind: str = "scene") -> None:
    level = [raw]
    for _ in range(_DEEPEST):
        level = [inner for table in level for inner in table.values() if isinstance(inner, dict)]
    if level:
        raise SceneError(kind, name, f"tables are nested more than {_DEEPEST} deep", "Flatten them")


def _plain(value: Any, depth: int = 0) -> Any:
    """Value as TOML would give it: mappings, sequences, paths and NumPy's numbers become plain values."""
    if depth > _DEEPEST:  # not supported, and possibly endless
        return value
    if isinstance(value, Mapping):
        return {str(key): _plain(each, depth + 1) for key, each in value.items()}
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    return [_plain(each, depth + 1) for each in value] if isinstance(value, (list, tuple)) else value


def _longest_number(text: str) -> tuple[int, int]:
    """Line and number of digits of the longest integer; TOML permits underscores between digits."""
    numbers = ((line, row) for line, text in enumerate(text.split("\n"), 1) for row in re.findall(r"[0-9_]+", text))
    return max(((line, len(number.replace("_", ""))) for line, number in numbers), key=lambda found: found[1])


def file_entries(raw: Mapping[str, Any]) -> dict[str, tuple[dict[str, Any], str]]:
    """Path of every entry that names a file -> its table, and its key there."""
    tables = {table: raw.get(table) for table in FILE_KEYS}
    return {
        f"{table}.{name}.{FILE_KEYS[table]}": (entry, FILE_KEYS[table])
        for table, entries in tables.items() if isinstance(entries, dict)
        for name, entry in entries.items()
        if isinstance(entry, dict) and isinstance(entry.get(FILE_KEYS[table]), str)
    }  # fmt: skip


def _validated(raw: dict[str, Any], source: str, like: Scene | None = None) -> Scene:
    """Scene from its tables; those shared with another scene are not validated again."""
    from kaneflex.scene.check import problems_of

    try:
        scene = Scene.model_validate(raw if like is None else like.known(raw))
    except ValidationError as error:
        # A table's default that needs a faulty entry is not a separate problem.
        found = [e for e in error.errors() if e["type"] != "default_factory_not_called"]
        raise SceneError.gather(problem_in(item, raw) for item in found) from None
    scene.remember(raw, source)
    problems = problems_of(scene)
    if problems:
        raise SceneError.gather(problems)
    return scene.with_clearances()


def _place_of(path: list[str], model: type[BaseModel]) -> str | None:
    """Advice for a key in the wrong table: the matching table within it, around it, or at the top."""
    from kaneflex.scene.settings import known_keys

    *table, key = path
    within = [[*table, inner] for inner in known_keys(table, model)]
    around = [table[:depth] for depth in range(len(table) - 1, 1, -1)]
    top = [[name] for name in known_keys((), model)]
    fitting = [place for place in (*within, *around, *top) if place != table and key in known_keys(place, model)]
    return f"It belongs to {'.'.join(fitting[0])}" if fitting else None


_COUPLINGS = {"gear", "worm", "rack", "screw", "belt", "chain", "cam", "differential", "ratio", "pitch", "lead"}
"""Words of keys for couplings between joints, which do not exist."""


def _coupling(path: list[str]) -> tuple[str, str] | None:
    """Reason and advice for a key that would couple joints; only laws of loads can."""
    table, key = path[0], path[-1]
    if len(path) != 3 or not ((table == "joints" and key in _COUPLINGS) or (table == "drives" and key == "against")):
        return None
    what = "there is no key that couples joints" if table == "joints" else "a drive's table is over time"
    cure = "Let the joints be free, and couple them by laws of torques and forces in their coordinates and speeds"
    return f"unknown key: {what}", f"{cure}, as 'Brakes and belts' in docs/scene/loads.md does"


def problem_in(error: dict[str, Any], raw: dict[str, Any], model: type[BaseModel] = Scene) -> Problem:
    """Problem for one of pydantic's errors in a file of such a `model`."""
    path = [str(part) for part in error["loc"]]
    fault = error.get("ctx", {}).get("error")
    if path[:1] == ["ground"] and len(path) == 2 and isinstance(error.get("input"), dict):
        reason = "a fixed point is a vector, not a table"
        cure = "Write points directly under ground, like far = [0.1, 0]"
    elif isinstance(fault, Fault):
        path += fault.below.split(".") if fault.below else []
        reason, cure = fault.reason, fault.cure
    elif error["type"] == "extra_forbidden":
        from kaneflex.scene.settings import known_keys

        reason, cure = _coupling(path) or (
            "unknown key", _place_of(path, model) or nearest(path[-1], known_keys(path[:-1], model))
        )  # fmt: skip
    elif error["type"] == "missing":
        reason, cure = "missing", "Write schema = 1 first" if path == ["schema"] else f"Give {path[-1]}"
    elif error["type"] == "literal_error":
        expected = error["ctx"]["expected"]
        reason, cure = f"must be {expected}", "Write one of these" if " or " in expected else f"Write {expected}"
    elif error["type"] == "too_short":
        reason, cure = "empty", f"Give at least {error['ctx']['min_length']}"
    elif error["type"] in ("dict_type", "model_type"):
        reason, cure = "not a table", "Write a table, like {key = value}"
    elif error["type"] == "string_type":
        reason, cure = "not a text", "Write it in quotes"
    elif error["type"] in ("tuple_type", "list_type"):
        reason, cure = "not a list", "Write it in brackets, like [...]"
    elif error["type"] in ("bool_type", "bool_parsing"):
        reason, cure = "neither true nor false", "Write true or false, without quotes"
    else:
        reason, cure = error["msg"][:1].lower() + error["msg"][1:], f"Write another {path[-1]}, see the scene reference"
    return Problem(".".join(path), given_value(raw, path), reason, cure)


def whole_text(scene: Scene) -> str:
    """TOML text of a scene with its merged tables and all settings; files have full paths."""
    raw = {key: value for key, value in scene.raw.items() if key != "like"}
    text = [f"{key} = {_in_toml(value)}" for key, value in raw.items() if not isinstance(value, dict)]
    for table, entries in raw.items():
        if isinstance(entries, dict):
            text += ["", f"[{table}]", *(f"{_key(name)} = {_in_toml(entry)}" for name, entry in entries.items())]
    return "\n".join([*text, ""])


def _key(name: str) -> str:
    return name if name.isidentifier() and name.isascii() else _in_toml(name)


def _in_toml(value: Any) -> str:
    """Value in TOML on one line; tomlkit, which keeps comments, takes longer to import than this."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_key(name)} = {_in_toml(entry)}' for name, entry in value.items())}}}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_in_toml, value))}]"
    if isinstance(value, float):
        return repr(value)
    # JSON's escapes are those of TOML, which also asks for that of DEL
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
