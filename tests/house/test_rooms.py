"""The rooms of the house and their floors: imports point down only, those inside functions included."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest
from places import ROOT

FLOORS = (
    ("support",),
    ("generated", "scene", "integrate"),
    ("mechanism",),
    ("derive", "fem"),
    ("multibody",),
    ("response",),
    ("solve",),
    ("study", "export"),
    ("report", "plots"),
    ("cli",),
)
"""From the ground up. Rooms of one floor don't import each other."""
FLOOR = {room: number for number, rooms in enumerate(FLOORS, start=1) for room in rooms}
FOLDERS = {
    **{path.name: path for path in (ROOT / "src/kaneflex").iterdir() if any(path.glob("*.py"))},
    "derive": ROOT / "derive", "generated": ROOT / "generated",
}
FACES = {"scenes"}
"""Packages of data alone."""


def imports(path: Path) -> set[str]:
    """Dotted names under kaneflex that a file imports, wherever in it the import stands."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return {name for name in found if name.startswith("kaneflex.")}


def taken(room: str) -> dict[str, list[str]]:
    """Other room -> files of ``room`` that import it."""
    found = defaultdict(list)
    for path in sorted(FOLDERS[room].rglob("*.py")):
        for other in {name.split(".")[1] for name in imports(path)} & FLOOR.keys() - {room}:
            found[other].append(str(path.relative_to(ROOT)))
    return found


def test_every_folder_is_a_room_on_one_floor():
    assert set(FOLDERS) - FACES == set(FLOOR)
    assert len(FLOOR) <= 16 and len(FLOORS) <= 10


def test_the_top_of_the_package_holds_its_face_alone():
    assert {path.name for path in (ROOT / "src/kaneflex").glob("*.py")} == {"__init__.py", "__main__.py"}


@pytest.mark.parametrize("room", FLOOR)
def test_imports_point_down(room):
    up = {f"{room} imports {other}": files for other, files in taken(room).items() if FLOOR[other] >= FLOOR[room]}
    assert up == {}


# ---- files ------------------------------------------------------------------------------------------------------


CYCLES: tuple[set[str], ...] = ()
"""Files that still import each other. Remove what has been untangled; never add."""


def modules() -> dict[str, Path]:
    """Dotted name under kaneflex -> file, of the runtime and of derive."""
    found = {}
    for base, folder in (("", ROOT / "src/kaneflex"), ("derive.", ROOT / "derive")):
        for path in folder.rglob("*.py"):
            found[base + ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__")] = path
    return found


def cycles(edges: dict[str, set[str]]) -> list[set[str]]:
    """Groups of several modules that reach each other."""
    reached = {}
    for name in edges:
        seen, rest = set(), [name]
        while rest:
            new = edges[rest.pop()] - seen
            seen |= new
            rest += new
        reached[name] = seen
    groups = {frozenset({name, *(each for each in reached[name] if name in reached[each])}) for name in edges}
    return [set(group) for group in groups if len(group) > 1]


def test_files_do_not_import_each_other():
    """Imports within functions and for type checkers count, too."""
    known = modules()
    edges = {name: {each.removeprefix("kaneflex.") for each in imports(path)} for name, path in known.items()}
    edges = {
        name: {each if each in known else each.rpartition(".")[0] for each in found} & known.keys() - {name, "__init__"}
        for name, found in edges.items()
    }
    found = cycles(edges)
    assert [sorted(group) for group in found if not any(group <= allowed for allowed in CYCLES)] == []
    gone = [sorted(allowed) for allowed in CYCLES if not any(group <= allowed for group in found)]
    assert gone == [], "untangled: remove them from CYCLES"


def test_cycles_are_found():
    edges = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": {"e"}, "e": set(), "f": {"f"}}
    assert cycles(edges) == [{"a", "b", "c"}]
