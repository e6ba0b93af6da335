"""The README's scene and Python run as printed, and print what they say."""

import re

from places import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
SCENE = re.search(r"```toml\n(# crank\.toml\n.*?)```", README, flags=re.DOTALL)[1]
PYTHON = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


def test_the_examples_run_and_print_what_their_comments_say(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "crank.toml").write_text(SCENE)
    namespace: dict[str, object] = {}
    for block in PYTHON:
        exec(compile(block, "README.md", "exec"), namespace)
    printed = capsys.readouterr().out.splitlines()
    promised = re.findall(r"^print\(.*\)  +# (.*)$", "\n".join(PYTHON), flags=re.MULTILINE)
    assert promised
    assert printed == promised


def test_it_is_short_and_its_example_fits_on_a_screen():
    assert len(README.split()) <= 700
    assert len(SCENE.splitlines()) == 13 and len(PYTHON[0].splitlines()) == 5  # twelve lines below the file's name


def test_every_link_and_picture_exists():
    root = ROOT
    targets = [t for t in re.findall(r"\]\(([^)]+)\)", README) if not t.startswith("http")]
    assert targets
    headings = {f"#{heading.lower().replace(' ', '-')}" for heading in re.findall(r"^#+ (.+)$", README, re.M)}
    assert [target for target in targets if target not in headings and not (root / target).exists()] == []
