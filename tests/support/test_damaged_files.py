"""Files that are read back after they were damaged: an error that names the file and the way out, and nothing is lost.

A damaged line of a sweep's journal is a point that is computed again.
"""

import json
import os
import shutil

import numpy as np
import pytest
from runs import run

from kaneflex import OutputError, SceneError, read_state, sweep
from kaneflex.study.plan import make_plan
from kaneflex.study.records import Record
from kaneflex.study.study import read_study

STUDY = {"scene": "four-bar", "parameters": {"solve.steps": [90, 91, 92, 93]}, "series": True}


def truncated(file):
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def empty(file):
    file.write_bytes(b"")


def binary(file):
    file.write_bytes(bytes(range(256)) * 4)


def zeros(file):
    file.write_bytes(bytes(file.stat().st_size))


def in_other_letters(file):
    file.write_bytes(file.read_bytes().decode("latin-1").encode("utf-16"))


def folder(file):
    file.unlink()
    file.mkdir()


def pipe(file):
    file.unlink()
    os.mkfifo(file)


def in_a_circle(file):
    file.unlink()
    file.symlink_to(file)


def unreadable(file):
    if os.geteuid() == 0:
        pytest.skip("root reads every file")
    file.chmod(0)


def cut_at_the_head(file):
    file.write_bytes(file.read_bytes()[7:])


def changed_in_a_byte(file):
    data = bytearray(file.read_bytes())
    data[3] ^= 0x55
    file.write_bytes(data)


def text(content):
    def write(file):
        file.write_text(content)

    return write


DAMAGE = (truncated, empty, binary, zeros, in_other_letters, folder, pipe, in_a_circle, unreadable, cut_at_the_head,
          changed_in_a_byte)  # fmt: skip
OF_JSON = {
    "a list": text("[]"), "a number": text("1"), "null": text("null"), "a number for a text": text('{"digest": 1}'),
    "missing keys": text("{}"), "two values": text("{}{}"), "no end": text('{"digest": "x'),
    "deep": text("[" * 100_000),
    "NaN": text('{"digest": NaN}'),
}  # fmt: skip


def found(plan, todo, times=(0.0, 1.0)):
    """Points that nothing is solved for."""
    for point in todo:
        values = np.array([1.0, 2.0 + point])
        numbers = dict.fromkeys(("angle", "speed"), (1.0, 2.0 + point, 1.5, 1.5))
        labels = {"angle": ("rad", "an angle"), "speed": ("rad/s", "a speed")}
        yield Record(point, "completed", "", numbers, labels, np.array(times), dict.fromkeys(numbers, values))


@pytest.fixture(scope="module")
def plan():
    return make_plan(STUDY)


@pytest.fixture(scope="module")
def complete(plan, tmp_path_factory):
    place = tmp_path_factory.mktemp("complete") / "out"
    return place, sweep(plan, place, found).dataset


def begun(plan, place):
    """A sweep that was interrupted after three of its four points."""

    def interrupted(plan, todo):
        yield from found(plan, todo[:3])
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(plan, place, interrupted)


def contents(place):
    return {file: file.read_bytes() for file in place.rglob("*") if file.is_file() and not file.name.startswith(".")}


@pytest.mark.parametrize("damage", [*DAMAGE, *OF_JSON.values()], ids=[*(each.__name__ for each in DAMAGE), *OF_JSON])
def test_a_damaged_study_is_named_and_its_points_stay(damage, plan, tmp_path):
    begun(plan, tmp_path / "out")
    damage(tmp_path / "out" / "study.json")
    before = contents(tmp_path / "out")
    with pytest.raises(OutputError, match=r"study\.json: .*(Restore it from a copy|--force)") as caught:
        sweep(plan, tmp_path / "out", found)
    assert "Traceback" not in str(caught.value) and len(str(caught.value)) < 500
    assert contents(tmp_path / "out") == before


def test_force_begins_anew_in_a_damaged_folder(plan, tmp_path):
    begun(plan, tmp_path / "out")
    empty(tmp_path / "out" / "study.json")
    assert sweep(plan, tmp_path / "out", found, force=True).total == 4


@pytest.mark.parametrize("damage", DAMAGE, ids=lambda each: each.__name__)
def test_points_of_a_damaged_journal_are_computed_again(damage, plan, tmp_path, complete):
    place = tmp_path / "out"
    begun(plan, place)
    damage(place / "journal.jsonl")
    if damage in (folder, pipe, in_a_circle, unreadable):
        with pytest.raises(OutputError, match=r"journal\.jsonl: .*Restore it from a copy"):
            sweep(plan, place, found)
        return
    solved = []

    def counted(plan, todo):
        for record in found(plan, todo):
            solved.append(record.point)
            yield record

    assert sweep(plan, place, counted).dataset.identical(complete[1])
    assert set(solved) == {0, 1, 2, 3} or damage in (truncated, cut_at_the_head, changed_in_a_byte)
    assert 3 in solved


def test_a_digit_that_changed_in_a_journal_is_no_result(plan, tmp_path, complete, caplog):
    place = tmp_path / "out"
    begun(plan, place)
    lines = (place / "journal.jsonl").read_text().splitlines(keepends=True)
    assert all(json.loads(line)["statistics"]["angle"][1] == 2.0 + point for point, line in enumerate(lines))
    for k, (old, new) in enumerate([("2.0", "9.0"), ("3.0", "NaN"), ('"point": 2', '"point": 1')]):
        assert old in lines[k]
        lines[k] = lines[k].replace(old, new, 1)
    (place / "journal.jsonl").write_text("".join(lines))
    assert sweep(plan, place, found).dataset.identical(complete[1])
    assert "3 lines are damaged; 4 points remain" in caplog.text


@pytest.mark.parametrize("damage", DAMAGE, ids=lambda each: each.__name__)
def test_a_damaged_dataset_is_named_and_stays(damage, plan, tmp_path, complete):
    place = tmp_path / "out"
    shutil.copytree(complete[0], place)
    damage(place / "sweep.nc")
    before = contents(place)
    with pytest.raises(OutputError, match=r"sweep\.nc: .*Restore it from a copy, .*, or start again"):
        sweep(plan, place, found)
    assert contents(place) == before


def test_a_dataset_of_another_study_is_not_taken(plan, tmp_path, complete):
    other = make_plan(STUDY | {"parameters": {"solve.steps": [90, 91]}})
    sweep(other, tmp_path / "out", found)
    shutil.copy(complete[0] / "sweep.nc", tmp_path / "out" / "sweep.nc")
    with pytest.raises(OutputError, match=r"sweep\.nc: it belongs to another study"):
        sweep(other, tmp_path / "out", found)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    place = tmp_path_factory.mktemp("results") / "results.nc"
    run("double-pendulum", "solve.preset=coupled", "solve.duration=0.02 s").labelled.to_netcdf(place)
    return place


@pytest.mark.parametrize("damage", DAMAGE, ids=lambda each: each.__name__)
def test_damaged_results_are_not_continued(damage, results, tmp_path):
    file = tmp_path / "results.nc"
    shutil.copy(results, file)
    assert read_state(file).names == read_state(tmp_path).names
    damage(file)
    with pytest.raises(SceneError, match=r"^after = .*\. Give the folder of a run of preset coupled, or its"):
        read_state(file)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_last_state_that_is_no_number_is_not_continued(value, tmp_path):
    solution = run("double-pendulum", "solve.preset=coupled", "solve.duration=0.02 s")
    found = solution.labelled.dataset()
    found["last_rate"].values[0] = value
    found.to_netcdf(tmp_path / "results.nc", engine="scipy")
    with pytest.raises(SceneError, match=r"its last state is incomplete or damaged"):
        read_state(tmp_path / "results.nc")


OF_TOML = [text("x = 0x" + "f" * 9), text("a = " + "9" * 5000), text("a = " + "[" * 9999)]


@pytest.mark.parametrize("damage", [*DAMAGE, *OF_TOML])
def test_a_damaged_study_of_a_user_is_named(damage, tmp_path):
    file = tmp_path / "study.toml"
    file.write_text('scene = "engine"\n[parameters]\n"solve.steps" = [90, 180]\n')
    damage(file)
    with pytest.raises(SceneError) as caught:
        read_study(file)
    assert caught.value.cure and len(str(caught.value)) < 800

