"""docs/stability.md: its commands run, and the page shows what they print."""

import re
import shlex

import pytest
from command_line import cli
from places import DOCS

PAGE = DOCS / "stability.md"
TEXT = PAGE.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def printed(tmp_path_factory) -> str:
    commands = [line for block in re.findall(r"```sh\n(.*?)```", TEXT, flags=re.DOTALL) for line in block.splitlines()]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        results = [cli(*shlex.split(command)[1:]) for command in commands]
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
    (block,) = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)
    exec(compile(block, "stability.md", "exec"), {})
    assert capsys.readouterr().out.splitlines() == re.findall(r"^print\(.*\)  # (.*)$", block, flags=re.MULTILINE)
