"""New scene of a user: a commented template, or a copy of a shipped scene with its tables."""

from __future__ import annotations

import tomllib
from pathlib import Path

from kaneflex.scene import shipped_scenes
from kaneflex.support.errors import SceneError, nearest
from kaneflex.support.files import refuse_existing, write_text

_TEMPLATE = Path(__file__).with_name("template.toml")
_HEADER = """\
# {name}: a scene of your own, started from the {like}. Change it, then
#   kaneflex show {file} -o {name}.png     draws it and counts its degrees of freedom
#   kaneflex check {file}                  checks every entry, and that it closes
#   kaneflex run {file}                    solves it; results in {name}-results
# Numbers are SI, or a text with a unit: "137 mm", "6000 rpm". An address is "body.point": start, mid, end, or a point
# that the body names. `kaneflex check --json-schema` prints everything that can stand here, for editors.

name = "{name}"

"""


def new_scene(name: str, like: str | None, path: Path, force: bool = False) -> list[Path]:
    """Write the template, or the text of a shipped scene with its CSV tables.

    Parameters
    ----------
    name : str
        Name of the new scene.
    like : str or None
        Shipped scene; None: the template, a slider-crank with an elastic rod.
    path : Path
        New scene file; its tables go into the same folder.
    force : bool
        Permission to replace existing files. An existing table with the same content is kept.

    Returns
    -------
    list of Path
        Written files, the scene first.

    Raises
    ------
    SceneError
        If there is no shipped scene ``like``, or one is called ``name``.
    OutputError
        If a file exists already, or can't be written; nothing is written then.
    """
    shipped = shipped_scenes()
    if like is not None and like not in shipped:
        raise SceneError("--like", like, "no shipped scene of that name", nearest(like, shipped))
    if name in shipped:
        raise SceneError("name", name, "a shipped scene has this name", "Choose another name")
    if not name.replace("-", "_").isidentifier():
        raise SceneError("name", name, "not a name", "Use letters, digits, - and _, a letter first")
    source = _TEMPLATE if like is None else shipped[like]
    origin = "template, a slider-crank with an elastic rod" if like is None else f"shipped scene {like}"
    text = source.read_text(encoding="utf-8")
    tables = {path.parent / table: source.parent / table for table in _tables(text)}
    texts = {path: _HEADER.format(name=name, like=origin, file=path) + text}
    for target, table in tables.items():
        content = table.read_text(encoding="utf-8")
        if not target.is_file() or target.read_text(encoding="utf-8", errors="replace") != content:
            texts[target] = content
    for target in texts:
        refuse_existing(target, force, f"{name}.toml")
    for target, content in texts.items():
        write_text(target, content)
    return list(texts)


def _tables(text: str) -> list[str]:
    """Names of CSV files in a scene's text, each once."""
    raw = tomllib.loads(text)
    entries = [*raw.get("loads", {}).values(), *raw.get("drives", {}).values()]
    return list(dict.fromkeys(entry["table"] for entry in entries if isinstance(entry, dict) and "table" in entry))
