"""What a package index shows and citations say: links that hold there, an example that runs, one version."""

import re
import tomllib

from places import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PAGE = (ROOT / PROJECT["readme"]).read_text(encoding="utf-8")


def test_the_page_of_the_index_leads_nowhere_that_is_not_there():
    targets = re.findall(r"\]\(([^)]+)\)", PAGE)
    assert all(target.startswith("https://") for target in targets)
    for path in re.findall(r"`(docs/[^`]+)`", PAGE):
        assert (ROOT / path).is_file()


def test_its_example_prints_what_it_says(capsys):
    block = re.search(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)[1]
    exec(compile(block, PROJECT["readme"], "exec"), {})
    assert capsys.readouterr().out.splitlines() == re.findall(r"^print\(.*\)  # (.*)$", block, flags=re.MULTILINE)


def test_citation_and_changes_name_the_version_and_the_authors():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.*)$", citation, flags=re.MULTILINE)[1] == PROJECT["version"]
    assert re.findall(r"^  - name: (.*)$", citation, flags=re.MULTILINE) == [a["name"] for a in PROJECT["authors"]]
    assert f"\n## {PROJECT['version']}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_links_of_the_pages_beside_the_readme_lead_somewhere():
    for name in ("CHANGELOG.md", "CONTRIBUTING.md"):
        for target in re.findall(r"\]\(([^)]+)\)", (ROOT / name).read_text(encoding="utf-8")):
            assert target.startswith("https://") or (ROOT / target).exists(), target
