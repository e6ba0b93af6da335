"""The README's examples run as printed, and print what they say."""

import re
from pathlib import Path

README = (Path(__file__).parent.parent / "README.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)


def test_the_examples_run_and_print_what_their_comments_say(capsys):
    namespace: dict[str, object] = {}
    for block in PYTHON:
        exec(compile(block, "README.md", "exec"), namespace)
    printed = capsys.readouterr().out.splitlines()
    promised = re.findall(r"^print\(.*\)  +# (.*)$", "\n".join(PYTHON), flags=re.MULTILINE)
    assert promised
    assert printed == promised


def test_every_link_and_picture_exists():
    root = Path(__file__).parent.parent
    targets = [t for t in re.findall(r"\]\(([^)]+)\)", README) if not t.startswith("http")]
    assert targets
    assert [target for target in targets if not (root / target).exists()] == []
