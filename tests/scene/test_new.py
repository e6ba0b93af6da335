"""A new scene from a shipped one: commented, complete with its tables, never over something else."""

from pathlib import Path

import pytest
from command_line import cli, refused

from kaneflex.scene import read_scene, shipped_scenes

pytestmark = pytest.mark.usefixtures("empty_folder")


@pytest.mark.exhaustive
@pytest.mark.parametrize("like", shipped_scenes())
def test_a_new_scene_is_the_shipped_one_under_its_own_name(like):
    made = cli("new", "mine", "--like", like)
    assert made.exit_code == 0, made.output
    found, shipped = read_scene("mine.toml"), read_scene(like)
    assert found.name == "mine"
    same = {"name": "mine", "like": found.like}
    ours = found.model_dump(exclude={"loads"})
    assert ours == shipped.model_dump(exclude={"loads"}) | same
    for name, load in shipped.loads.items():
        copied = found.loads[name]
        assert copied.model_dump(exclude={"table"}) == load.model_dump(exclude={"table"})
        if load.table is not None:
            assert Path(copied.table).read_bytes() == Path(load.table).read_bytes()
    assert made.stdout == "".join(f"Written to {path.name}\n" for path in sorted(Path().iterdir(), reverse=True))


def test_the_header_tells_how_to_go_on():
    cli("new", "press", "--like", "four-bar", "-o", "deep/press.toml")
    text = Path("deep/press.toml").read_text()
    head = text.split("\nname = ")[0]
    for command in ("kaneflex show deep/press.toml", "kaneflex check deep/press.toml", "kaneflex run deep/press.toml"):
        assert command in head
    assert all(line.startswith("#") for line in head.strip().splitlines())
    assert text.endswith(shipped_scenes()["four-bar"].read_text())


def test_the_name_is_the_scenes_whatever_the_file_is_called():
    cli("new", "mine", "--like", "engine", "-o", "other.toml")
    assert read_scene("other.toml").name == "mine"
    assert sorted(path.name for path in Path().iterdir()) == ["gas.csv", "other.toml"]


def test_nothing_is_overwritten_without_force():
    Path("gas.csv").write_text("mine,too\n")
    refused(cli("new", "mine", "--like", "engine"), "gas.csv", "the file exists", "--force")
    assert [path.name for path in Path().iterdir()] == ["gas.csv"]
    assert Path("gas.csv").read_text() == "mine,too\n"
    assert cli("new", "mine", "--like", "engine", "--force").exit_code == 0
    Path("mine.toml").write_text("mine")
    refused(cli("new", "mine", "--like", "engine"), "mine.toml", "the file exists")
    assert Path("mine.toml").read_text() == "mine"


def test_a_table_that_is_there_already_is_shared():
    cli("new", "one", "--like", "engine")
    made = cli("new", "two", "--like", "engine")
    assert made.stdout == "Written to two.toml\n"


BAD = {
    ("mine", "--like", "engin"): ("--like = 'engin'", "'engine'"),
    ("engine", "--like", "engine"): ("name = 'engine'", "a shipped scene has this name"),
    ("my scene", "--like", "engine"): ("name = 'my scene'", "not a name"),
    ("../mine", "--like", "engine"): ("name = '../mine'", "not a name"),
    ("mine", "--like", "engine", "-o", "mine.txt"): ("mine.txt", ".toml"),
}


@pytest.mark.parametrize("arguments", BAD, ids=" ".join)
def test_bad_input_is_named_and_nothing_is_written(arguments):
    refused(cli("new", *arguments), *BAD[arguments])
    assert list(Path().iterdir()) == []
