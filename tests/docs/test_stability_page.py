"""docs/stability.md: its commands run, and the page shows what they print."""

import re

import pytest
from command_line import cli
from pages import check_printed, commands, page

TEXT = page("stability.md")


@pytest.fixture(scope="module")
def printed(tmp_path_factory) -> str:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        results = [cli(*arguments) for arguments in commands(TEXT)]
    assert [result.exit_code for result in results] == [0, 0]
    return "\n".join(result.stdout for result in results)


def test_the_page_shows_what_is_printed(printed):
    (shown,) = re.findall(r"```\n(  speeds .*\n)```", TEXT)
    assert shown in printed


def test_the_page_has_every_finding(printed):
    assert set(re.findall(r"^\| `(\w+)` \|", TEXT, flags=re.MULTILINE)) == set(
        re.findall(r"^  (\w+) ", printed, flags=re.MULTILINE)
    )


def test_the_python_prints_what_its_comment_says(capsys):
    check_printed(TEXT, capsys)
