"""docs/tutorial.md, and docs/results.md: their scenes are read, their commands run, what they promise is printed."""

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner
from pages import check_printed, commands, page
from places import DOCS

from kaneflex.cli import main


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which all that the tutorial says was done, in its order; pictures of runs apart."""
    made = tmp_path_factory.mktemp("tutorial")
    text = page("tutorial.md")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(made)
        for kind, block in re.findall(r"```(toml|sh)\n(.*?)```", text, flags=re.DOTALL):
            if kind == "toml":
                Path(re.match(r"# (\S+)\n", block)[1]).write_text(block, encoding="utf-8")
                continue
            for line in block.splitlines():
                words = shlex.split(line)[1:]
                done = CliRunner().invoke(main, [*words, "--no-plots"] if words[0] == "run" else words)
                assert done.exit_code == 0, (line, done.output)
                Path(f"{words[0]}-{words[1]}.txt").write_text(done.output, encoding="utf-8")
    return made


def test_the_tutorial_runs_and_leaves_what_it_says(folder):
    for name in ("engine", "slower", "blade", "press"):
        assert (folder / name / "results.nc").exists()
    for name in ("plus.png", "minus.png", "press.png"):
        assert (folder / name).stat().st_size > 10_000


def test_the_press_is_as_the_tutorial_tells(folder):
    assert "a stroke of 134.8 mm" in (folder / "show-press.toml.txt").read_text()
    table = (folder / "run-press.toml.txt").read_text()
    assert float(re.search(r"^push +kN +(\S+)", table, flags=re.MULTILINE)[1]) == pytest.approx(-309.3, abs=0.1)
    torque = re.search(r"^torque +N m +\S+ +\S+ +(\S+)", table, flags=re.MULTILINE)[1]
    assert float(torque) == pytest.approx(3677, abs=2)


def test_stability_says_where_an_order_meets_a_mode(folder):
    """What the page promises: order 3 of the gust meets the first mode."""
    said = re.search(r"^  orders +(.*)$", (folder / "stability-blade.toml.txt").read_text(), flags=re.MULTILINE)[1]
    assert re.search(r"\b3 meets mode 1 at \d+ rpm", said)
    assert said.endswith("(frequencies in axes that turn with the links)")


def test_a_loop_that_cannot_close_is_refused_in_the_words_of_the_page(folder, monkeypatch):
    monkeypatch.chdir(folder)
    done = CliRunner().invoke(main, ["check", "four.toml", "--set", "bodies.coupler.length=100 mm"])
    assert done.exit_code == 2
    assert "Error: joints.knee.branch = '+': the loop cannot close: " in done.output


def test_the_page_about_results_runs(tmp_path, monkeypatch, capsys):
    text = page("results.md")
    monkeypatch.chdir(tmp_path)
    assert CliRunner().invoke(main, commands(text)[0]).exit_code == 0
    check_printed(text, capsys)


def test_every_message_on_the_site_has_a_topic_and_a_fix(monkeypatch):
    pytest.importorskip("sphinx", reason="sphinx is not installed; pip install 'kaneflex[docs]'")
    monkeypatch.syspath_prepend(str(DOCS))
    from site_directives import TOPICS, messages

    found = set(messages())
    assert len(found) > 300 and {topic for topic, *_ in found} == set(TOPICS)
    assert all(reason.strip(". ") and cure.strip(". ") for *_, reason, cure in found)
