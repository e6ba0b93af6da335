"""What a person sees while waiting."""

import sys
import time

import pytest

import kaneflex
from kaneflex.solve.simulation import solve
from kaneflex.support import terminal


def test_only_a_stage_that_lasts_is_shown(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_PATIENCE", 0.1)
    with terminal.Waiting() as waiting:
        waiting("brief")
        waiting("compiling, first time only")
        time.sleep(0.4)
        share = waiting.share_of("solving")
        share(0.5)
        share(1.0)
    time.sleep(0.2)
    shown = capsys.readouterr()
    assert (shown.out, shown.err) == ("", "compiling, first time only ...\n")


def test_a_terminal_shows_a_line_with_the_share_and_takes_it_off(capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_PATIENCE", 0.05)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with terminal.Waiting() as waiting:
        share = waiting.share_of("solving")
        share(0.0)
        deadline = time.monotonic() + 10.0
        while not waiting._line and time.monotonic() < deadline:
            time.sleep(0.02)
        share(0.25)
        share(0.251)
        terminal.echo("a result")
        waiting("writing")
    shown = capsys.readouterr()
    assert shown.err == f"\rsolving ...\rsolving ... 25%\r{' ' * 15}\r"
    assert shown.out == "a result\n"


@pytest.mark.parametrize(
    ("scene", "settings"),
    [("spinning-top", ["solve.duration=0.1 s"]), ("double-pendulum", ["solve.preset=rigid"]),
     ("spatial-slider-crank-elastic", ["solve.preset=coupled", "solve.start=zero", "solve.duration=5 ms"])],
)  # fmt: skip
def test_motions_that_a_run_integrates_tell_their_share(scene, settings):
    told = []
    solve(kaneflex.load(kaneflex.with_settings(kaneflex.read_scene(scene), settings)), told.append)
    assert told == sorted(told) and 0.99 < told[-1] <= 1.0
