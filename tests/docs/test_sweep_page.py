"""docs/sweep.md: its study and commands run as they stand, its Python prints what it says, its table has every key."""

import re
from pathlib import Path

import pytest
import xarray
from command_line import cli, unrendered
from pages import blocks, check_printed, commands, page

from kaneflex.study.study import Axis, Sample, Study

TEXT = page("sweep.md")


@pytest.fixture(scope="module", autouse=True)
def outputs(tmp_path_factory):
    """What the commands of the page print, run in a folder that has its study."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        unrendered(patch, drawn=False)
        (study,) = blocks(TEXT, "toml")
        Path("rod.toml").write_text(study)
        yield [cli(*arguments) for arguments in commands(TEXT)]


def test_the_commands_give_the_same_dataset(outputs):
    assert [result.exit_code for result in outputs] == [0, 0]
    assert all("24 of 36 points completed" in result.stdout for result in outputs)
    with xarray.open_dataset("rod-sweep/sweep.nc") as one, xarray.open_dataset("rod-2/sweep.nc") as two:
        assert one.identical(two)


def test_the_python_prints_what_its_comments_say(capsys):
    check_printed(TEXT, capsys)


def test_the_table_has_every_key():
    assert re.findall(r"^\| `(\w+)` \|", TEXT, flags=re.MULTILINE) == list(Study.model_fields)
    for table in (Axis, Sample):
        for name, field in table.model_fields.items():
            assert name == "values" or re.search(rf"\b{field.alias or name}\b", TEXT), name


def test_options_and_links_of_the_page_are_there():
    shown = cli("sweep", "--help").stdout
    assert all(option in shown for option in set(re.findall(r"--(?:workers|format|force)", TEXT)))
