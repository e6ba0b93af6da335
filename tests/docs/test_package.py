"""The README, what a package index shows and citations say: examples run, links hold, one version."""

import re
import tomllib

from pages import blocks, check_printed
from places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGE = (ROOT / PROJECT["readme"]).read_text(encoding="utf-8")


def test_the_page_of_the_index_leads_nowhere_that_is_not_there():
    targets = re.findall(r"\]\(([^)]+)\)", PAGE)
    assert all(target.startswith("https://") for target in targets)
    for path in re.findall(r"`(docs/[^`]+)`", PAGE):
        assert (ROOT / path).is_file()


def test_its_example_prints_what_it_says(capsys):
    check_printed(PAGE, capsys)


def test_citation_and_changes_name_the_version_and_the_authors():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, flags=re.MULTILINE)[1] == PROJECT["version"]
    assert re.findall(r"^  - name: (.*)$", citation, flags=re.MULTILINE) == [a["name"] for a in PROJECT["authors"]]
    assert f"\n## {PROJECT['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_links_of_the_pages_beside_the_readme_lead_somewhere():
    for name in ("CHANGELOG.md", "CONTRIBUTING.md"):
        for target in re.findall(r"\]\(([^)]+)\)", (ROOT / name).read_text(encoding="utf-8")):
            assert target.startswith("https://") or (ROOT / target).exists(), target


README = (ROOT / "README.md").read_text(encoding="utf-8")
SCENE = re.search(r"```toml\n(# crank\.toml\n.*?)```", README, flags=re.DOTALL)[1]


def test_the_examples_run_and_print_what_their_comments_say(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "crank.toml").write_text(SCENE)
    check_printed(README, capsys)


def test_it_is_short_and_its_example_fits_on_a_screen():
    assert len(README.split()) <= 700
    assert len(SCENE.splitlines()) == 13  # twelve lines below the file's name
    assert len(blocks(README, "python")[0].splitlines()) == 5


def test_every_link_and_picture_exists():
    root = ROOT
    targets = [t for t in re.findall(r"\]\(([^)]+)\)", README) if not t.startswith("http")]
    assert targets
    headings = {f"#{heading.lower().replace(' ', '-')}" for heading in re.findall(r"^#+ (.+)$", README, re.M)}
    assert [target for target in targets if target not in headings and not (root / target).exists()] == []
