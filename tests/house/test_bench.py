"""The benchmarks compare like with like: every candidate that is timed computes the same numbers."""

import json
import re
import sys
import time
from dataclasses import replace
from types import SimpleNamespace

import bench.__main__
import csv_tables
import numpy as np
import pytest
from bench import cycles, exudyn_runs, impacts, kernels, latency, peers, quick, report, spatial_peers
from bench.__main__ import SECTIONS
from bench.interleave import Race, Spread, interleave, repeated
from bench.ivp_runs import jitted_slope, lambdified_slope
from bench.kernels import AGREEMENT, candidates_of, check_agreement, disagreement, in_space, single_kernels
from bench.rows import Row, Target
from bench.tasks import element_task, motion_task
from places import DOCS

from kaneflex import load, read_scene, with_settings

TASKS = {"element": element_task, "motion": motion_task}


@pytest.fixture(scope="module")
def hand(compiler, tmp_path_factory):
    return peers.library(tmp_path_factory.mktemp("hand"), compiler)


@pytest.mark.exhaustive(group="agree", share=9)
@pytest.mark.parametrize("name", TASKS)
def test_hand_written_c_and_lambdify_agree_with_the_generated_kernels(name, hand):
    task = TASKS[name]()
    ours = peers.generated_kernels(task)
    for other in (peers.hand_written(task, hand), peers.lambdified(task, False), peers.lambdified(task, True)):
        assert disagreement(task, ours, other) < AGREEMENT


def test_what_is_called_in_a_loop_is_what_was_found_to_agree(hand):
    """The loops leave the last sample's numbers in the arrays; n = 16 ends with the sixteenth."""
    task = element_task()
    p, s = task.sample(0)
    arrays = peers.zeros(task)
    peers._element_many(16, task.values, p, s, *arrays.values())
    expected = peers.hand_written(task, hand).outputs(15)
    for name, matrix in expected.items():
        np.testing.assert_allclose(arrays[name], matrix, rtol=0.0, atol=AGREEMENT * abs(matrix).max())


@pytest.mark.exhaustive(group="agree", share=9)
@pytest.mark.parametrize("name", TASKS)
def test_all_programs_that_are_installed_agree(name, hand, compiler, tmp_path):
    task = TASKS[name]()
    candidates, missing = candidates_of(task, tmp_path, compiler, hand)
    check_agreement(task, candidates)
    assert [one.name for one in candidates][:2] == ["hand-written C", "kaneflex"]
    assert len(candidates) + len(missing) == 8
    assert all(re.fullmatch(r"\w+ is not installed", row.missing) for row in missing)


def test_a_candidate_that_computes_something_else_is_not_timed():
    task = element_task()
    ours = peers.lambdified(task, True)

    def wrong(k):
        found = ours.outputs(k)
        found["K_g"][1, 1] *= 1.0 + 1e-11
        return found

    check_agreement(task, [ours, ours])
    with pytest.raises(ValueError, match="beam element: other differs from lambdify, cse by"):
        check_agreement(task, [ours, replace(ours, name="other", outputs=wrong)])


def test_candidates_take_turns():
    order = []
    timed = {name: lambda name=name: order.append(name) or float(len(order)) for name in "ab"}
    times = interleave(timed, 3)
    assert order == ["a", "b"] * 4  # the first turn is for compiling and is not counted
    assert times["a"] == Spread(median=5.0, low=4.0, high=6.0, rounds=3)
    assert times["b"] == Spread(median=6.0, low=5.0, high=7.0, rounds=3)
    assert times.ratio("a", "a") is None
    assert times.ratio("b", "a") == 6.0 / 5.0


def test_a_ratio_is_one_of_rounds_not_of_medians():
    """A machine that is ten times as slow in every second round leaves it alone."""
    race = Race({"a": (1.0, 10.0, 1.0, 10.0, 10.0), "b": (2.0, 2.0, 2.0, 20.0, 20.0)})
    assert race.ratio("b", "a") == 2.0


def test_the_fastest_rounds_are_compared_where_a_machine_is_busy():
    """Nine of ten rounds of the second are interrupted."""
    race = Race({"a": (1.0,) * 10, "b": (7.0, 7.0, 9.0, 7.0, 1.5, 7.0, 8.0, 7.0, 7.0, 7.0)})
    assert race.ratio("b", "a") == 7.0
    assert race.ratio_of_best("b", "a") == 1.5 and race.ratio_of_best("a", "a") is None


def test_an_interruption_does_not_cut_the_repetitions_short(monkeypatch):
    """The first go of 16 calls takes long since something else ran: the next one shows that it was not the calls."""
    calls, now = [], 0.0

    def many(n):
        nonlocal now
        calls.append(n)
        now += 5e-3 if calls.count(16) == 1 else n * 1e-5

    monkeypatch.setattr(time, "perf_counter", lambda: now)
    assert repeated(many, at_least=2e-3)() == pytest.approx(1e-5)
    assert calls[-1] == 256


def test_quick_judges_the_fastest_rounds(monkeypatch, compiler):
    """Interrupted in two of three rounds, kernels that are as fast as C pass."""
    seconds = {"hand-written C": (1.0, 1.0, 1.0), "kaneflex": (7.0, 1.0, 7.0)}
    busy = {"lambdify": (40.0, 60.0, 40.0), "lambdify, cse": (40.0, 60.0, 40.0)}
    monkeypatch.setattr(kernels, "interleave", lambda timed, *_: Race({name: (seconds | busy)[name] for name in timed}))
    monkeypatch.setattr(kernels, "repeated", lambda many, go: many)
    assert quick.broken(quick.rows()) == []


def test_a_call_is_repeated_until_the_clock_sees_it():
    calls = []
    repeated(lambda n: calls.append(n) or sum(range(100 * n)), at_least=1e-3)()
    assert calls[0] == 1 and calls[-1] == calls[-2] >= 32


def test_verdicts_of_targets():
    low, high = Target(1.15, 0.9), Target(100.0, 400.0, at_least=True)
    assert [low.verdict(ratio) for ratio in (0.9, 1.15, 1.16)] == ["dream", "met", "missed"]
    assert [high.verdict(ratio) for ratio in (400.0, 100.0, 99.0)] == ["dream", "met", "missed"]
    assert Row("task", "peer", None, 2.0).verdict() is None


def test_single_kernels_are_compared_with_c(hand):
    found = list(single_kernels(hand, 1, 0.0))
    assert [row.candidate for row in found] == ["hand-written C", "kaneflex"] * 6
    assert all(row.time.median > 0.0 for row in found)
    assert [row.ratio is None for row in found] == [True, False] * 6


@pytest.mark.exhaustive(group="agree", share=9)
def test_kernels_in_space_are_compared_with_c_that_agrees(monkeypatch, compiler, tmp_path):
    hand = spatial_peers.library(tmp_path, compiler)
    assert spatial_peers.disagreement(hand) < AGREEMENT
    found = list(in_space(hand, 1, 0.0))
    assert [row.candidate for row in found] == ["hand-written C", "kaneflex"] * 7
    assert all(row.time.median > 0.0 for row in found)
    assert [row.ratio is None for row in found] == [True, False] * 7
    monkeypatch.setattr(spatial_peers, "disagreement", lambda hand: 2e-12)
    with pytest.raises(ValueError, match=r"beam element in space: kaneflex differs from hand-written C by 2\.0e-12"):
        next(in_space(hand, 1, 0.0))


@pytest.mark.exhaustive(group="agree", share=9)
def test_right_hand_sides_of_solve_ivp_are_the_equations_that_are_integrated():
    """Lambdified and jitted slopes against the model's own matrices, at a state and time of no symmetry."""
    model = load(with_settings(read_scene("engine"), ["solve.start=zero", "solve.modes=2"]))
    n, t = model.system.n, 0.0031
    x = np.random.default_rng(7).normal(size=2 * n)
    (row,) = model.scalars(np.array([t]))
    M, C, K, F = (model.system.dense(name, row) for name in "MCKF")
    expected = np.concatenate((x[n:], np.linalg.solve(M, F - C @ x[n:] - K @ x[:n])))
    for slope in (jitted_slope(model), lambdified_slope(model)):
        np.testing.assert_allclose(slope(t, x), expected, rtol=1e-11)


def row(task, candidate, ratio, target=None):
    return Row(task, candidate, Spread(2.5e-8, 2.4e-8, 2.6e-8, 9), ratio, target, differs="a note")


def test_quick_names_the_ratio_that_is_out_of_bounds():
    good = [row("x, in a loop", "kaneflex", 1.9), row("x, from Python", "lambdify", 6.0), row("x, in a loop", "C", 9.0)]
    assert quick.broken(good) == []
    bad = [row("x, in a loop", "kaneflex", 2.1), row("x, from Python", "lambdify", 4.0)]
    assert quick.broken(bad) == [
        "x, in a loop, kaneflex: ratio 2.10 is above 2", "x, from Python, lambdify: ratio 4.00 is below 5"
    ]  # fmt: skip


def test_the_page_shows_every_row_and_keeps_the_sections_that_are_not_measured_again(tmp_path):
    modules = {"kernels": kernels, "exudyn": exudyn_runs}
    found = [row("x, in a loop", "hand-written C", None), row("x, in a loop", "kaneflex", 1.2, Target(1.15))]
    report.store(tmp_path, "kernels", [*found, Row("x", "PyDy", None, missing="pydy is not installed")])
    report.store(tmp_path, "exudyn", [Row("engine", "Exudyn", None, missing="exudyn is not installed")])
    report.show(tmp_path, modules)
    assert csv_tables.read("benchmarks-exudyn", tmp_path) == [["engine", "Exudyn", "exudyn is not installed"]]
    report.store(tmp_path, "exudyn", [row("engine", "Exudyn", 150.0, Target(100.0, 400.0, True))])
    report.show(tmp_path, modules)
    page = (tmp_path / "benchmarks.md").read_text()
    kernel_rows = csv_tables.read("benchmarks-kernels", tmp_path)
    assert ["x, in a loop", "kaneflex", "25 ns", "24 to 26", "1.2", "<= 1.15: missed", "a note"] in kernel_rows
    assert kernel_rows[-1][:3] == ["x", "PyDy", "pydy is not installed"]
    peer_rows = csv_tables.read("benchmarks-exudyn", tmp_path)
    assert ["engine", "Exudyn", "25 ns", "24 to 26", "150", ">= 100 (400): met", "a note"] in peer_rows
    assert page.index(kernels.TITLE) < page.index(exudyn_runs.TITLE)
    stored = json.loads((tmp_path / "benchmarks.json").read_text())
    assert stored["kernels"]["rows"][1]["time"] == {"median": 2.5e-8, "low": 2.4e-8, "high": 2.6e-8, "rounds": 9}
    assert {"date", "processor", "cores", "Python", "C compiler", "numba"} <= set(stored["kernels"]["machine"])
    assert (tmp_path / "pictures" / "benchmarks.png").stat().st_size > 10_000


def test_an_interruption_keeps_the_sections_that_are_finished(tmp_path, monkeypatch, capsys):
    def interrupted():
        yield row("second", "kaneflex", None)
        raise KeyboardInterrupt

    finished = SimpleNamespace(TITLE="First", ABOUT="One.", rows=lambda: iter([row("first", "kaneflex", None)]))
    stopped = SimpleNamespace(TITLE="Second", ABOUT="Two.", rows=interrupted)
    monkeypatch.setattr(bench.__main__, "SECTIONS", {"first": finished, "second": stopped})
    assert bench.__main__.main(["-o", str(tmp_path)]) == 130
    assert "interrupted; finished sections are in" in capsys.readouterr().err
    assert list(report.read(tmp_path)) == ["first"]
    assert "## First" in (tmp_path / "benchmarks.md").read_text()


def test_an_unknown_section_is_named(capsys):
    with pytest.raises(SystemExit):
        bench.__main__.main(["kernel"])
    assert "no section 'kernel': there are latency, kernels, exudyn, precision" in capsys.readouterr().err


def test_benchmarks_page_is_what_its_data_say():
    docs = DOCS
    sections = report.sections_of(docs, SECTIONS)
    assert list(sections) == list(SECTIONS)
    assert (docs / "benchmarks.md").read_text(encoding="utf-8") == report.page(sections, SECTIONS)
    for name, section in sections.items():
        assert csv_tables.read(f"benchmarks-{name}") == report.table(section.rows)[1:]


@pytest.mark.exhaustive(group="agree", share=9)
def test_cycles_by_harmonics_are_nearer_to_the_answer_than_by_newmark(monkeypatch):
    for name, value in {"SPEEDS": 4, "STEPS": 360, "FINER": 8, "ROUNDS": 1}.items():
        monkeypatch.setattr(cycles, name, value)
    found = {row.candidate: row for row in cycles.rows()}
    assert list(found) == [
        "newmark", "gauss", "spectral, 0.0001", "spectral, 0.0001, its motion", "spectral, 1e-06",
        "spectral, 1e-06, its motion",
    ]  # fmt: skip
    newmark, gauss, rough, fine = (
        float(re.search(r"error (\S+)", found[name].differs)[1])
        for name in ("newmark", "gauss", "spectral, 0.0001", "spectral, 1e-06")
    )
    assert 1e-6 < gauss < 0.7 * newmark < 0.01
    assert fine < rough < newmark


def test_a_mass_on_a_stop_falls_alike_in_both_programs_and_by_its_closed_form(peer):
    """Exudyn's steps begin and end impacts anywhere: it takes 128,000 of them to come close."""
    times, ours, _ = impacts.by_kaneflex(1e-8)
    assert ours == pytest.approx(impacts.height(times), abs=1e-8 * impacts.HEIGHT)
    peer("exudyn")
    errors = []
    for steps in (8000, 128000):
        times, theirs, _ = impacts.by_exudyn(steps)
        errors.append(abs(theirs - impacts.height(times)).max() / impacts.HEIGHT)
    assert errors[1] < 1e-4 and 4 * errors[1] < errors[0]


@pytest.mark.exhaustive(group="agree", share=9)
@pytest.mark.parametrize("task", impacts.CASES)
def test_impacts_that_are_timed_happen(task):
    text, laws = impacts.CASES[task]
    counts = [impacts.an_impact(text.replace("CONTACT", contact))[1] for _, contact in laws.values()]
    assert min(counts) > 5


ASKED = {
    ("install", "by make run"): (20.0, "s"),
    ("install", "by make run, no bytecode"): (450.0, "MB"),
    ("make run on a fresh clone", "clock"): (40.0, "s"),
    ("cold", "engine"): (5.0, "s"),
    ("cold", "four-bar-motor"): (8.0, "s"),
    ("cold", "slider-crank-clearance"): (10.0, "s"),
    ("cold", "spatial-slider-crank-elastic"): (10.0, "s"),
    **{("cold, from a wheel", scene): (2.0, "s") for scene in latency.COLD},
    ("warm", "run engine"): (2.0, "s"),
    ("warm", "run engine --no-plots"): (0.5, "s"),
    **{("warm", command): (0.4, "s") for command in ("check engine", "modes engine", "list", "show engine")},
    ("warm", "the README's first example"): (0.8, "s"),
    ("make test", "clock, without compiling"): (360.0, "s"),
    ("run engine --no-plots", "lines of kaneflex"): (4500, "lines"),
    ("run engine --no-plots", "modules of kaneflex"): (80, "modules"),
}
"""What latency is to be at most."""


def test_latency_measures_all_that_is_asked_of_it_beside_a_fixed_piece_of_work(monkeypatch, tmp_path):
    ran = []

    def pretended(folder, command, within=None):
        ran.append([str(word) for word in command])
        if "wheel" in ran[-1]:
            (within / ".build" / "dist").mkdir(parents=True)
            (within / ".build" / "dist" / "kaneflex.whl").touch()
        return latency.Spent(0.5 if latency.FIXED in ran[-1] else 3.0, 7.0)

    monkeypatch.setattr(latency, "execute", pretended)
    monkeypatch.setattr(latency, "environment", lambda folder: folder)
    monkeypatch.setattr(latency, "SUITE_SECONDS", tmp_path / "test-seconds")
    latency.SUITE_SECONDS.write_text("354\n")
    found = {(each.task, each.candidate): each for each in latency.rows()}
    asked = {name: (each.target.reach, each.unit or "s") for name, each in found.items() if each.target}
    assert asked.items() >= ASKED.items()
    assert all(each.of_time for each in found.values() if each.target)
    assert found["make run on a fresh clone", "clock"].time.median == 14.0
    assert found["make test", "clock, without compiling"].verdict() == "met"
    in_seconds = {name for name in found if name[0] in ("install", "cold", "cold, from a wheel", "warm")}
    in_seconds -= {name for name in found if found[name].unit} | {("warm", "reference computation")}
    assert {found[name].ratio for name in in_seconds} == {6.0}
    assert ["make", "run"] in ran and any("import kaneflex" in command[-1] for command in ran)


def test_a_process_is_measured_as_a_user_starts_it(monkeypatch, tmp_path):
    """Nothing of the measuring process's own settings; what it computes counts, and what it waits for does not."""
    monkeypatch.setenv("PYTHONPATH", "tests")
    code = "import os, time; assert 'PYTHONPATH' not in os.environ; time.sleep(0.3); sum(range(3_000_000))"
    found = latency.execute(tmp_path, [sys.executable, "-S", "-c", code])
    assert 0.01 < found.cpu < found.clock - 0.2
    with pytest.raises(RuntimeError, match="no such thing"):
        latency.execute(tmp_path, [sys.executable, "-c", "raise SystemExit('no such thing')"])


def test_sizes_count_each_file_once_and_bytecode_where_it_is_asked_for(tmp_path):
    for name, length in {"a.so": 3_000_000, "b.py": 1_000_000, "__pycache__/b.pyc": 500_000}.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(bytes(length))
    (tmp_path / "link").symlink_to("a.so")
    assert latency.megabytes(tmp_path, bytecode=False) == pytest.approx(4.0)
    assert latency.megabytes(tmp_path, bytecode=True) == pytest.approx(4.5)


@pytest.mark.skipif(not (latency.ROOT / ".git").exists(), reason="no clone: nothing knows which files belong to it")
def test_a_copy_has_the_files_of_a_clone_and_nothing_that_was_built(tmp_path):
    copy = latency.copied(tmp_path / "clone")
    assert (copy / "Makefile").is_file() and (copy / "generated" / "engine.py").is_file()
    assert not (copy / ".build").exists()
