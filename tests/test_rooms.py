"""The rooms of the house and their floors: imports point down only, those inside functions included."""

import ast
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FLOORS = (
    ("support",),
    ("generated", "scene", "integrate"),
    ("mechanism",),
    ("derive", "fem"),
    ("multibody",),
    ("response",),
    ("solve",),
    ("study", "peers"),
    ("report", "plots"),
    ("cli",),
)
"""From the ground up. Rooms of one floor don't import each other."""
FLOOR = {room: number for number, rooms in enumerate(FLOORS, start=1) for room in rooms}
FOLDERS = {
    **{path.name: path for path in (ROOT / "src/kaneflex").iterdir() if any(path.glob("*.py"))},
    "derive": ROOT / "derive",
    "generated": ROOT / "generated",
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
