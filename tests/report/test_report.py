"""report.html: the page of a run, as it is written and as a browser shows it."""

import json
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from conftest import absent
from hostile_names import NAME
from scene_fuzz import written_toml

from kaneflex import load, scene_of, simulate
from kaneflex.cli import main
from kaneflex.report.page import _as_json, _numbers, page
from kaneflex.report.summary import summarise
from kaneflex.report.tables import _rounded, ending


def run(folder, *arguments: str) -> str:
    done = CliRunner().invoke(main, ["run", *arguments, "-o", str(folder)])
    assert done.exit_code in (0, 3), done.output
    return (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "engine"
    return folder, run(folder, "engine", "--no-plots", "--set", "solve.steps=5000")


def data_of(text: str) -> dict:
    return json.loads(re.search(r'id="data">(.*?)</script>', text, flags=re.DOTALL)[1])


def test_a_page_holds_the_run_and_asks_no_network(engine):
    folder, text = engine
    data = data_of(text)
    summary = json.loads((folder / "summary.json").read_text())
    assert set(data["sensors"]) == set(summary["sensors"])
    side, found = data["sensors"]["piston_side_force"], summary["sensors"]
    assert side["unit"] == "kN"
    assert max(side["values"]) == pytest.approx(1e-3 * found["piston_side_force"]["max"], rel=1e-5)
    assert max(side["rigid"]) == pytest.approx(1e-3 * found["piston_side_force_rigid"]["max"], rel=1e-5)
    assert [axis["label"] for axis in data["axes"]] == ["time [s]", "main [deg]"]
    assert data["axis"] == 1, "the table has the drive's angles, too"
    assert 1500 <= len(side["values"]) < 1700 and len(text) < 2**20
    assert text.index('id="sensors"') < text.index('id="curve"') < text.index("<h2>Model</h2>")
    assert '#side { position: sticky' in text, "the curve stays beside the table"
    assert "{{" not in text and not re.search(r"(src|href)=[\"']?https?:", text)


def test_curves_are_arrays_of_six_digits_with_gaps():
    values = np.array([0.0, -1.5, 1.0 / 3.0, 1e300, -2.5e-7, np.nan, np.inf, -np.inf])
    read = json.loads(_as_json({"a \\ b": _numbers(values), "none": None, "empty": _numbers(values[:0])}))
    assert read == {"a \\ b": [0, -1.5, 0.333333, 1e300, -2.5e-7, None, None, None], "none": None, "empty": []}


@pytest.mark.parametrize(("sensors", "picture", "kept", "too_large"), [
    (3, 0, ["mechanism", "animation"], ""),
    (3, 300_000, ["mechanism"], "animation.gif"),
    (300, 300_000, [], "mechanism.png, animation.gif"),
])  # fmt: skip
def test_a_page_has_a_megabyte_at_most(sensors, picture, kept, too_large, tmp_path):
    """Neither many sensors, each with a peak of its own, nor large pictures make it larger."""
    own = {f"s{k}": {"displacement": "rod.mid", "component": "y"} for k in range(sensors)}
    solution = simulate(load(scene_of({"schema": 1, "like": "engine", "name": "many", "sensors": own})))
    times = np.linspace(0.0, 0.02, len(solution.times))
    for k, name in enumerate(own):  # 300 curves whose extremes are 600 instants
        values = np.sin(2e3 * times + k) - 7.0 * (np.arange(len(times)) == 2 * k)
        solution.series[name] = solution.series[name]._replace(values=values)
    files = [tmp_path / name for name in ("sensors.png", "mechanism.png", "animation.gif")]
    for file in files:
        file.write_bytes(bytes(picture))
    text = page(solution, summarise(solution), files)
    assert len(text.encode()) <= 1_000_000
    assert own.keys() <= data_of(text)["sensors"].keys()
    assert re.findall(r"<figcaption>(\w+)</figcaption>", text) == kept
    assert "mechanism" not in kept or text.index("<figcaption>mechanism<") < text.index("<h2>Sensors</h2>")
    assert (f"Too large for this page: {too_large}." if too_large else "</table>") in text


def test_texts_of_a_scene_stay_texts(tmp_path):
    (tmp_path / "odd.toml").write_text(written_toml({"like": "engine", "name": NAME, "description": NAME}), "utf-8")
    text = run(tmp_path / "odd", str(tmp_path / "odd.toml"), "--no-plots")
    assert "<script>alert" not in text and "&lt;/script&gt;" in text and "\x1b" not in text
    assert data_of(text)["axes"] and text.count("<script") == 2
    assert json.loads((tmp_path / "odd" / "summary.json").read_text("utf-8"))["scene"] == NAME


def test_warnings_stand_first_and_a_run_that_stopped_says_so(tmp_path):
    text = run(tmp_path / "stopped", "engine-transient", "--no-plots", "--set", "rod.E=1e7")
    assert text.index("Stopped early: ") < text.index('class="warning"') < text.index("<h2>Sensors</h2>")
    assert data_of(text)["sensors"]
    nothing = run(tmp_path / "nothing", "engine", "--no-plots", "--set", "rod.E=1e7")
    assert "Stopped early: " in nothing and data_of(nothing)["sensors"] == {}


def test_a_whole_cycle_that_disturbances_leave_did_not_stop_early():
    ended = SimpleNamespace(outcome="unstable", message="any disturbance grows", duration_s=0.3, steps=3, step_s=0.1)
    assert ending(ended) == "Any disturbance grows"
    ended.duration_s = 0.2
    assert ending(ended) == "Stopped early: any disturbance grows"


def test_a_browser_shows_the_curve_of_the_sensor_that_is_clicked(engine, peer):
    if not shutil.which("chromium"):
        absent("chromium", "apt-get install chromium")
    peer("playwright")
    from playwright import sync_api

    with sync_api.sync_playwright() as browsers:
        browser = browsers.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        shown = browser.new_page(viewport={"width": 1200, "height": 900})
        failures: list[str] = []
        shown.on("pageerror", lambda error: failures.append(str(error)))
        shown.on("request", lambda asked: failures.append(asked.url) if not asked.url.startswith("file:") else None)
        shown.goto((engine[0] / "report.html").as_uri())
        before = shown.inner_html("#curve")
        assert shown.input_value("#axis") == "1" and "main [deg]" in before
        shown.click("tr[data-name=piston_side_force]")
        assert "rigid mechanism" in shown.inner_text("#meaning")
        assert "piston_side_force [kN]" in shown.inner_html("#curve") and shown.inner_html("#curve") != before
        assert shown.locator("#curve path").count() == 2
        shown.select_option("#axis", label="main [deg]")
        shown.locator("#curve").hover()
        reading = r"main \[deg\] 3\d\d\.?\d*: piston_side_force -?[\d.e-]+ kN \(rigid"
        assert re.match(reading, shown.inner_text("#reading"))
        shown.click("tr[data-name=crank_torque]", modifiers=["Control"])
        assert shown.locator("#curve path").count() == 4 and shown.locator("#meaning div").count() == 2
        assert shown.locator("tr[aria-selected=true]").count() == 2
        shown.keyboard.press("Home")
        assert shown.evaluate("document.activeElement.rowIndex") == 1 and shown.locator("#meaning div").count() == 1
        shown.keyboard.press("ArrowDown")
        assert shown.locator("tr[aria-selected=true]").get_attribute("tabindex") == "0"
        assert shown.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
        shown.keyboard.press("Control+ArrowDown")
        shown.keyboard.press("Space")
        assert shown.locator("#meaning div").count() == 2
        shown.focus("#curve")
        shown.keyboard.press("End")
        assert shown.inner_text("#reading").startswith("main [deg] 720: ")
        shown.locator("tr").last.scroll_into_view_if_needed()
        assert shown.locator("#curve").bounding_box()["y"] >= 0.0, "always visible"
        drawn = "[...document.querySelectorAll('#curve path')].map(each => each.getAttribute('d')).join()"
        whole = shown.evaluate(drawn)
        box = shown.locator("#curve").bounding_box()
        shown.mouse.move(box["x"] + 300, box["y"] + 100)
        shown.mouse.down()
        shown.mouse.move(box["x"] + 500, box["y"] + 100)
        shown.mouse.up()
        assert shown.evaluate(drawn) != whole
        shown.click("#whole")
        assert shown.evaluate(drawn) == whole
        assert failures == []
        browser.close()


def test_of_components_only_what_is_rounding_is_shown_as_zero():
    assert _rounded(np.array([2.0, -0.05, 3e-9, 1e-9])) == "2, -0.05, 3e-09, 0"
