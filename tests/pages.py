"""Pages of the documentation as tests read them: their text, blocks of code and commands, and what Python prints."""

import re
import shlex
from pathlib import Path

from places import DOCS


def page(*names: str, folder: Path = DOCS) -> str:
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in names)


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def commands(text: str) -> list[list[str]]:
    """Arguments of each command of kaneflex that a page shows."""
    found = [shlex.split(line) for block in blocks(text, "sh") for line in block.splitlines()]
    assert all(program == "kaneflex" for program, *_ in found)
    return [arguments for _, *arguments in found]


def check_printed(text: str, capsys, said: str = r"^ *print\(.*\)  +# (.*)$") -> dict[str, object]:
    """A page's Python, run from top to bottom, prints what its comments say; returns what it defines."""
    code, namespace = "\n".join(blocks(text, "python")), dict[str, object]()
    exec(compile(code, "page", "exec"), namespace)
    promised = re.findall(said, code, flags=re.MULTILINE)
    assert promised and capsys.readouterr().out.splitlines() == promised
    return namespace
