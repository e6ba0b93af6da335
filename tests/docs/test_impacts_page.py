"""docs/impacts.md: its studies and commands run as they stand, its Python prints what it says, and its numbers."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import xarray
from command_line import cli, unrendered
from pages import blocks, check_printed, commands, page
from runs import run

from kaneflex.study.study import Poincare

TEXT = page("impacts.md")


def row(start: str) -> list[float]:
    """Numbers of a line of a table."""
    (found,) = re.findall(rf"^\| {re.escape(start)} \|(.*)\|$", TEXT, flags=re.MULTILINE)
    return [float(part) for part in found.split("|")[1:]]  # after the unit


@pytest.fixture(scope="module", autouse=True)
def outputs(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("page"))
        unrendered(patch, drawn=False)
        for text in blocks(TEXT, "toml"):
            Path(text.split()[1]).write_text(text)
        yield [cli(*arguments) for arguments in commands(TEXT)]


def test_the_commands_draw_what_the_page_says(outputs):
    assert [result.exit_code for result in outputs] == [0, 0]
    drawn = {path.name for path in Path("shaken-sweep").glob("*.png")}
    assert drawn == {"sweep.png", "bifurcation.png", "poincare.png"}
    assert [path.name for path in Path("room-sweep").glob("*.png")] == ["sweep.png"]
    Path("shaken-sweep/poincare.png").unlink()
    assert "Drawn: shaken-sweep/poincare.png" in cli("sweep", "shaken.toml").stdout  # nothing is solved
    assert "Drawn" not in cli("sweep", "shaken.toml", "--no-plots").stdout


def test_the_python_prints_what_its_comments_say(capsys):
    check_printed(TEXT, capsys, r"^# (.*)$")


def test_a_section_holds_the_ends_of_periods():
    with xarray.open_dataset("shaken-sweep/sweep.nc", engine="scipy") as found:
        speed = found["drives.main.speed"].values * math.pi / 30
        assert found.sizes["instant"] == 20
        assert found.time.values == pytest.approx(np.arange(101, 121) * 2 * math.pi / speed[:, None], rel=1e-12)


def test_a_bouncing_ball_has_the_phase_and_the_doubling_of_theory():
    """Luo & Han 1996: of a ball that comes down once a period cos(phase) = pi (1 - e)/(1 + e)/Gamma."""
    with xarray.open_dataset("shaken-sweep/sweep.nc", engine="scipy") as found:
        turns, heights = found["drives.main.speed"].values * math.pi / 30, found.height_series.values
    e, g, r = 0.5, 9.81, 1e-3
    for omega, height in zip(turns[:2], heights[:2], strict=True):
        period, loss = 2 * math.pi / omega, math.pi * (1 - e) / (1 + e)
        phase = math.acos(loss * g / (r * omega**2))  # of the impact; the ball flies on with g T/2 from there
        flown = period - phase / omega
        assert height[-1] == pytest.approx(r * math.sin(phase) + g * flown * (period - flown) / 2, rel=0.02)
    doubles = math.hypot(math.pi * (1 - e) / (1 + e), 2 * (1 + e**2) / (1 + e) ** 2)
    assert doubles == pytest.approx(1.5268, abs=1e-4)
    assert r * turns[1] ** 2 / g < doubles < r * turns[2] ** 2 / g
    assert math.sqrt(doubles * g / r) * 30 / math.pi == pytest.approx(1168.7, abs=0.1)
    assert np.ptp(heights[1]) < 1e-6 < 5e-4 < abs(heights[2, -1] - heights[2, -2])
    assert heights[2, -1] == pytest.approx(heights[2, -3], abs=1e-5)


def test_elasticity_lowers_the_peaks():
    with xarray.open_dataset("room-sweep/sweep.nc", engine="scipy") as found:
        peaks = found.pin_force.sel(statistic="max").values.reshape(6, 2).T / 1e3
    assert peaks[1] == pytest.approx(row("largest force, rigid rod"), rel=2e-3)
    assert peaks[0] == pytest.approx(row("largest force, elastic rod"), rel=0.15)  # later ones are chaotic
    assert peaks[0] / peaks[1] == pytest.approx(row("ratio"), abs=0.08) and (peaks[0] / peaks[1] < 0.65).all()
    first = run("slider-crank-clearance", "rod.E=2.1e15 Pa", "solve.duration=1 ms", "solve.steps=50").impacts[0]
    assert 1e3 * peaks[1, 2] == pytest.approx(first.peak, rel=1e-2)  # the rigid rod's hardest knock is its first


def test_a_tight_joint_is_the_limit_of_a_clearance():
    end = ("solve.duration=0.8 s", "solve.steps=1600", "solve.tolerance=1e-10")
    tight = run("engine-rig", "solve.preset=coupled", "solve.start=zero", *end)
    late, dead_centre, found = tight.times > 0.65, 30 / 42.36, []
    for gap in (5e-5, 5e-6, 5e-7):
        settings = (f"bore.clearance.gap={gap}", "bore.clearance.contact.stiffness=1e12", *end)
        loose = run("engine-rig-clearance", "bore.clearance.friction=none", *settings)
        sensors = ("piston_position", "crank_torque")
        place, torque = ((loose.series[name].values - tight.series[name].values)[late] for name in sensors)
        knocks = [impact for impact in loose.impacts if impact.begin > 0.65]
        peaks = [max(getattr(impact, key) for impact in knocks) for key in ("approach", "peak")]
        across = min(impact.begin for impact in knocks) - dead_centre
        differences = 1e6 * abs(place).max(), 1e3 * np.sqrt((torque**2).mean())
        found.append([*differences, 1e3 * across, 1e3 * peaks[0], peaks[1]])
    lines = [
        "position of the piston along the bore, largest difference", "torque of the crank, rms of the difference",
        "time to cross the gap", "largest speed of approach", "largest force of an impact",
    ]  # fmt: skip
    written = np.array([row(line) for line in lines])
    assert np.transpose(found) == pytest.approx(written[:, :3], rel=0.02)
    rates = np.log10(np.divide(found[:-1], found[1:]))
    assert rates == pytest.approx(np.tile(written[:, 3], (2, 1)), abs=0.05)
    assert rates[:, [0, 2, 3, 4]] == pytest.approx(np.tile([1, 1 / 3, 2 / 3, 4 / 5], (2, 1)), abs=0.015)


def test_the_table_has_every_key():
    for name in Poincare.model_fields:
        assert re.search(rf"^\| `{name}` \|", TEXT, flags=re.MULTILINE), name
