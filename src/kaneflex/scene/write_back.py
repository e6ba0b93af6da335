"""Writing of settings into the user's scene file; all other lines and comments are kept."""

from __future__ import annotations

import stat
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import InlineTable

from kaneflex.scene.read import read_scene, shipped_scenes, with_settings
from kaneflex.scene.scene import Scene
from kaneflex.scene.table import REMOVED
from kaneflex.support.errors import SceneError
from kaneflex.support.files import write_bytes

_MARK = "\N{BYTE ORDER MARK}".encode()


def file_to_write(name: str, settings: Sequence[str]) -> Path:
    """File of the scene, if a choice can be written into it.

    Raises
    ------
    SceneError
        For a shipped scene, and if the command line changes the scene, since the choice is not for the file then.
    """
    if name in shipped_scenes():
        raise SceneError(
            "--write-back", name, "a shipped scene is not changed", f"Make your own copy: kaneflex new my-{name} "
            f"--like {name}",
        )  # fmt: skip
    if settings:
        raise SceneError(
            "--write-back", ", ".join(settings), "the model is chosen for the changed scene, not for the file",
            "Write the changes into the file first",
        )  # fmt: skip
    return Path(name)


def write_settings(path: Path, settings: Sequence[str]) -> None:
    """Write settings of ``solve`` and of links' elements into a scene's file atomically; line ends and mode are kept.

    The new text is read and compared with the scene that the settings give before it replaces the file.

    Raises
    ------
    SceneError
        If the file's layout does not allow the change; it names the settings.
    OutputError
        If the file can't be written.
    """
    before = read_scene(path)
    wanted = with_settings(before, settings)
    path = path.resolve()  # a symbolic link is kept; its target is changed
    data = path.read_bytes()
    mark, text = data[:3] * data.startswith(_MARK), data.decode("utf-8-sig").replace("\r\n", "\n")
    new = _with_solve(text, before.raw.get("solve", {}), wanted.raw.get("solve", {}))
    for name, body in wanted.bodies.items():
        if body.elastic and body.beam.elements != before.bodies[name].beam.elements:
            new = _with_elements(new, name, body.beam.elements)
    if not _gives(new, path, wanted):
        raise SceneError(
            str(path), ", ".join(settings), "the file's layout does not allow this change",
            "Write these settings into it yourself",
        )  # fmt: skip
    lines = new.replace("\n", "\r\n") if b"\r\n" in data else new
    write_bytes(path, mark + lines.encode(), stat.S_IMODE(path.stat().st_mode))


def _gives(text: str, path: Path, wanted: Scene) -> bool:
    """True if the text gives the expected scene; checked with a temporary file in the same folder."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=".toml")
    try:
        with open(handle, "w", encoding="utf-8") as file:
            file.write(text)
        found = read_scene(name)
    except SceneError:
        return False
    finally:
        Path(name).unlink()
    same = {"name": wanted.name}
    return found.model_copy(update=same).model_dump() == wanted.model_dump()


def _with_solve(text: str, old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Text with a section [solve] that gives the table ``new`` instead of ``old``, which includes `like`."""
    document = tomlkit.parse(text)
    own = tomllib.loads(text).get("solve", {})
    if "solve" not in document:
        document["solve"] = tomlkit.table()
    section = document["solve"]
    for key in own.keys() - new.keys() - old.keys():
        del section[key]
    for key, value in new.items():
        if own.get(key) != value and old.get(key) != value:
            section[key] = _item(value)
    for key in old.keys() - new.keys():
        if key in own:
            del section[key]
        else:
            section[key] = REMOVED
    return tomlkit.dumps(document)


def _with_elements(text: str, body: str, count: int) -> str:
    """Text with this number of elements of a body's beam: at the existing entry, else in a new table."""
    document = tomlkit.parse(text)
    if body not in document.get("bodies", {}):
        # a separate table; the tables above it need no headers
        document.setdefault("bodies", tomlkit.table(is_super_table=True))[body] = tomlkit.table(is_super_table=True)
    found = document["bodies"][body]
    if isinstance(found, InlineTable) and "beam" not in found:
        found.append("beam", tomlkit.value(f"{{elements = {count}}}"))
    else:
        found.setdefault("beam", tomlkit.table())["elements"] = count
    return tomlkit.dumps(document)


def _item(value: Any) -> Any:
    """Value of ``solve`` in TOML; a table stays on the line of its key."""
    if not isinstance(value, Mapping):
        return value
    table = tomlkit.inline_table()
    for key, each in value.items():
        table[key] = _item(each)
    return table
