"""Calling the command line in this process."""

from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from matplotlib.figure import Figure

from kaneflex.cli import main
from kaneflex.plots import style


def unrendered(monkeypatch: pytest.MonkeyPatch, drawn: bool = True) -> None:
    """From now on pictures are made and their files stay empty: those of folders are ``drawn`` once, on nothing. To lay
    them out and to write them as PNG and as SVG takes longer than most runs."""

    def begun(figure: Figure, stem: Path, svg: bool = True) -> list[Path]:
        if drawn:
            figure.set_layout_engine("none")
            figure.draw_without_rendering()
        files = [stem.with_name(f"{stem.name}.{kind}") for kind in ("png", *["svg"] * svg)]
        for file in files:
            file.touch()
        return files

    def made(make: Callable[[], Figure], kind: str) -> bytes:
        with style.styled():
            make()
        return b""

    monkeypatch.setattr(style, "save", begun)
    monkeypatch.setattr(style, "picture", made)


def cli(*arguments: object) -> Result:
    """`cli("run", "engine")`: output and exit code; any exception but an exit is passed on."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    if not isinstance(result.exception, SystemExit | None):
        raise result.exception
    return result


def refused(result: Result, *words: str) -> None:
    """Exit code 2, and every word in the message on stderr, which is no traceback.

    Stages that lasted may stand before it: "compiling, first time only ...".
    """
    assert result.exit_code == 2
    stages, error, _ = result.stderr.partition("Error: ")
    assert error and all(line.endswith(" ...") for line in stages.splitlines())
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr
