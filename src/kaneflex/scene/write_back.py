"""Settings written into the user's scene file, around which every other line and comment stays."""

from __future__ import annotations

import json
import re
import stat
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kaneflex.scene.merge import REMOVED
from kaneflex.scene.read import read_scene, shipped_scenes, with_settings
from kaneflex.scene.scene import Scene
from kaneflex.support.atomic_output import write_bytes
from kaneflex.support.errors import SceneError

_MARK = "\N{BYTE ORDER MARK}".encode()
_HEADER = re.compile(r"^\s*\[([^\[\]]+)\]\s*(#.*)?$")
_ENTRY = re.compile(r"^\s*([A-Za-z0-9_-]+)\s*=\s*")


def file_to_write(name: str, settings: Sequence[str]) -> Path:
    """The scene's file, where a choice can be written into it.

    Raises
    ------
    SceneError
        For a shipped scene, and where the command line changes the scene: what is chosen is not for the file then.
    """
    if name in shipped_scenes():
        raise SceneError(
            "--write-back", name, "a shipped scene is not changed", f"Make one of your own: kaneflex new my-{name} "
            f"--like {name}",
        )  # fmt: skip
    if settings:
        raise SceneError(
            "--write-back", ", ".join(settings), "the model is chosen for the changed scene, not for the file",
            "Write the changes into the file first",
        )  # fmt: skip
    return Path(name)


def write_settings(path: Path, settings: Sequence[str]) -> None:
    """Lay settings of ``solve`` and of links' elements over a scene's file, atomically; its line ends and mode stay.

    The new text is read and compared with the scene that the settings give before it replaces the file.

    Raises
    ------
    SceneError
        Where the file is written in a way that can't be changed line by line; it names the settings.
    OutputError
        If the file can't be written.
    """
    before = read_scene(path)
    wanted = with_settings(before, settings)
    path = path.resolve()  # a link stays one: what it leads to is changed
    data = path.read_bytes()
    mark, text = data[:3] * data.startswith(_MARK), data.decode("utf-8-sig").replace("\r\n", "\n")
    new = _with_solve(text, before.raw.get("solve", {}), wanted.raw.get("solve", {}))
    for name, body in wanted.bodies.items():
        if body.elastic and body.beam.elements != before.bodies[name].beam.elements:
            new = _with_elements(new, name, body.beam.elements)
    if not _gives(new, path, wanted):
        raise SceneError(
            str(path), ", ".join(settings), "the file is written in a way that can't be changed line by line",
            "Write these settings into it yourself",
        )  # fmt: skip
    lines = new.replace("\n", "\r\n") if b"\r\n" in data else new
    write_bytes(path, mark + lines.encode(), stat.S_IMODE(path.stat().st_mode))


def _gives(text: str, path: Path, wanted: Scene) -> bool:
    """Whether the text, at the file's place, is the scene that is wanted; read from a file beside it."""
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
    """The text with its own section [solve] giving the table ``new``, where it gave ``old`` with what it is like."""
    own = tomllib.loads(text).get("solve", {})
    given = {key: value for key, value in new.items() if key in own or old.get(key) != value}
    removed = {key: REMOVED for key in old if key not in new and key not in own}
    written = {key: _toml(value) for key, value in (given | removed).items()}
    lines = text.rstrip("\n").splitlines()
    start, end = _section(lines, "solve")
    if start is None:
        body = "\n".join(f"{key} = {value}" for key, value in written.items())
        return text.rstrip("\n") + f"\n\n[solve]\n{body}\n"
    section = []
    for line in lines[start + 1 : end]:
        entry = _ENTRY.match(line)
        key = entry[1] if entry else None
        if key in written and own.get(key) != new.get(key):
            line = f"{key} = {written[key]}{_comment(line)}"
        if key is None or key in written:
            section.append(line)
        written.pop(key, None)
    while section and not section[-1].strip():
        section.pop()
    section += [f"{key} = {value}" for key, value in written.items()]
    rest = lines[end:]
    return "\n".join([*lines[: start + 1], *section, *([""] if rest else []), *rest]) + "\n"


def _with_elements(text: str, body: str, count: int) -> str:
    """The text with so many elements of a body's beam: in its own table, in an inline one, or in a new section."""
    lines = text.rstrip("\n").splitlines()
    entry = f"elements = {count}"
    for path, keys in ((f"bodies.{body}.beam", ()), (f"bodies.{body}", ("beam",)), ("bodies", (body, "beam"))):
        start, end = _section(lines, path)
        if start is None:
            continue
        for k in range(start + 1, end):
            match = _ENTRY.match(lines[k])
            if match and match[1] == (*keys, "elements")[0]:
                lines[k] = _inside(lines[k], match.end(), keys[1:], entry) if keys else _replaced(lines[k], entry)
                return "\n".join(lines) + "\n"
        if not keys:
            return "\n".join([*lines[: start + 1], entry, *lines[start + 1 :]]) + "\n"
    return "\n".join([*lines, "", f"[bodies.{body}.beam]", entry]) + "\n"


def _inside(line: str, begin: int, keys: Sequence[str], entry: str) -> str:
    """The line with an entry in the inline table that begins at ``begin``, or in the one that the keys lead to."""
    end = _closing(line, begin)
    table = line[begin:end]
    if keys:
        found = re.search(rf"\b{re.escape(keys[0])}\s*=\s*(?={{)", table)
        if found:
            return _inside(line, begin + found.end(), keys[1:], entry)
        entry = f"{keys[0]} = {{{entry}}}"
    found = re.search(r"\belements\s*=\s*[0-9_]+", table)
    if found and not keys:
        return line[: begin + found.start()] + entry + line[begin + found.end() :]
    return f"{line[:end]}{', ' if table.strip('{ ') else ''}{entry}{line[end:]}"


def _closing(line: str, begin: int) -> int:
    """Where the brace of the inline table that begins at ``begin`` is closed; texts in quotes are skipped."""
    depth, quote = 0, ""
    for k in range(begin, len(line)):
        character = line[k]
        if quote:
            quote = "" if character == quote else quote
        elif character in "\"'":
            quote = character
        elif character == "{":
            depth += 1
        elif character == "}":
            depth -= 1
            if depth == 0:
                return k
    return len(line)


def _replaced(line: str, entry: str) -> str:
    return f"{entry}{_comment(line)}"


def _comment(line: str) -> str:
    """What follows a value on its line from the "#" on; "" where a text in quotes may hold it."""
    value, mark, comment = line.partition(" #")
    return f" {mark.strip()}{comment}" if mark and value.count('"') % 2 == 0 else ""


def _section(lines: Sequence[str], path: str) -> tuple[int | None, int]:
    """The line of a table's header, None where it has none, and the one after its last."""
    headers = [k for k, line in enumerate(lines) if _HEADER.match(line) or line.lstrip().startswith("[[")]
    for at, following in zip(headers, [*headers[1:], len(lines)], strict=False):
        match = _HEADER.match(lines[at])
        if match and match[1].replace(" ", "") == path:
            return at, following
    return None, len(lines)


def _toml(value: Any) -> str:
    """A value of ``solve`` in TOML's spelling: text, number, flag, or a table of such."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + "}"
    return json.dumps(value, ensure_ascii=False)
