"""CSV tables and their spline blocks."""

import math

import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PchipInterpolator

from kaneflex.scene import read_scene, with_settings
from kaneflex.scene.tables import Table, evaluate_block, largest_of_block, overshoot_of_block, read_table
from kaneflex.support.errors import Fault, SceneError
from kaneflex.support.interpolation import INTERPOLATIONS


@pytest.fixture
def knots():
    random = np.random.default_rng(4)
    return np.cumsum(random.uniform(0.1, 1.0, 30)), random.normal(size=30)


def test_natural_spline_agrees_with_scipy_and_keeps_its_end_values(knots):
    x, y = knots
    block = Table(x, y).coefficients()
    inside = np.linspace(x[0], x[-1], 501)
    expected = CubicSpline(x, y, bc_type="natural")(inside)
    assert evaluate_block(block, inside) == pytest.approx(expected, abs=1e-13)
    assert evaluate_block(block, [x[0] - 7.3, x[-1] + 7.3]) == pytest.approx([y[0], y[-1]], abs=1e-15)


def test_periodic_spline_agrees_with_scipy_in_every_period(knots):
    x, y = knots
    y[-1] = y[0]
    period = x[-1] - x[0]
    block = Table(x, y).coefficients(period)
    everywhere = np.linspace(-3, 4, 501) * period
    expected = CubicSpline(x, y, bc_type="periodic")(everywhere)
    assert evaluate_block(block, everywhere) == pytest.approx(expected, abs=1e-12)


def through(interpolation, x, y):
    """scipy's own of that name."""
    match interpolation:
        case "linear":
            return lambda at: np.interp(at, x, y)
        case "pchip":
            return PchipInterpolator(x, y)
        case "akima":
            return Akima1DInterpolator(x, y)
    return CubicSpline(x, y, bc_type="natural")


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_every_interpolation_is_the_one_of_scipy(knots, interpolation):
    x, y = knots
    block = Table(x, y).coefficients(None, interpolation)
    inside = np.linspace(x[0], x[-1], 501)
    assert evaluate_block(block, inside) == pytest.approx(through(interpolation, x, y)(inside), abs=1e-13)
    assert evaluate_block(block, [x[0] - 7.3, x[-1] + 7.3]) == pytest.approx([y[0], y[-1]], abs=1e-15)


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("count", [4, 30])
def test_a_table_that_repeats_has_no_ends(knots, interpolation, count):
    """As scipy's through five rounds of it; with few rows a round is shorter than what a slope depends on."""
    x, y = (values[:count] for values in knots)
    y[-1] = y[0]
    period = x[-1] - x[0]
    rounds = [x[:-1] + k * period for k in range(-6, 7)]
    expected = through(interpolation, np.concatenate(rounds), np.tile(y[:-1], 13))
    inside = np.linspace(x[0], x[-1], 501)
    tolerance = 1e-5 if interpolation == "spline" else 1e-12  # what is left of a spline's ends after six rounds
    block = Table(x, y).coefficients(period, interpolation)
    assert evaluate_block(block, inside) == pytest.approx(expected(inside), abs=tolerance)


FLANK = (np.radians([0.0, 130, 170, 180, 190, 230, 360]), np.array([0.0, 0, 0, 12e3, 0, 0, 0]))


@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
@pytest.mark.parametrize("period", [None, 2 * math.pi])
def test_how_far_a_curve_goes_beyond_the_rows_beside_it(interpolation, period):
    """A force of 12 kN at 180 degrees, none from 170 down and 190 up: a spline invents 11 kN of the other sign."""
    x, y = FLANK
    block = Table(x, y).coefficients(period, interpolation)
    at = np.linspace(0.0, 2 * math.pi, 200_001)
    values = evaluate_block(block, at)
    k = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    rows = np.sort([y[k], y[k + 1]], axis=0)
    beyond = np.maximum(values - rows[1], rows[0] - values).max()
    found = overshoot_of_block(block)
    assert found.size == pytest.approx(max(beyond, 0.0), rel=1e-6, abs=1e-9)
    assert evaluate_block(block, found.x) == pytest.approx(found.value, abs=1e-9)
    assert found.size == 0.0 if interpolation in ("linear", "pchip") else True
    assert found.size > 10e3 if interpolation == "spline" else True


@pytest.fixture
def flank(tmp_path):
    path = tmp_path / "flank.csv"
    path.write_text("deg,F\n" + "".join(f"{2 * math.degrees(x):.6f},{y}\n" for x, y in zip(*FLANK, strict=True)))
    load = f"{{g={{force_on='piston', direction=[-1,0], against='main', table='{path}'}}}}"
    return ["loads.gas=none", "solve.start=zero", f"loads={load}"]


def test_the_default_of_a_load_invents_no_force(flank):
    scene = with_settings(read_scene("engine"), flank)
    values = evaluate_block(scene.loads["g"].curve(), np.radians(2 * np.array([60.0, 154.0, 169.9, 191.0])))
    assert values == pytest.approx(0.0, abs=1e-9)
    splined = with_settings(scene, ["g.interpolation=spline"])
    assert evaluate_block(splined.loads["g"].curve(), np.radians(2 * 154.0)) < -10e3


def test_a_drive_takes_no_interpolation_with_jumps_of_its_speed(tmp_path):
    (tmp_path / "s.csv").write_text("t,deg\n0,0\n1,1\n2,3\n3,9\n")
    drive = f"drives.elbow={{law='none', period='none', table='{tmp_path}/s.csv', interpolation='%s'}}"
    settings = ["shoulder.period=none", "solve.start=zero", "solve.duration=1 s"]
    arm = with_settings(read_scene("two-link-arm"), settings)
    assert with_settings(arm, [drive % "akima"]).drives["elbow"].interpolation == "akima"
    with pytest.raises(SceneError, match=r"drives\.elbow\.interpolation = 'linear': must be 'pchip', 'akima'"):
        with_settings(arm, [drive % "linear"])


def test_what_the_defaults_cost_on_a_smooth_curve():
    """The numbers of docs/scene.md: every other row of the engine's gas force predicts those between."""
    table = read_scene("engine").loads["gas"].read_table()
    y = table.y.copy()
    y[0] = y[-1] = (y[0] + y[-1]) / 2
    every_other = Table(table.x[::2], y[::2])
    worst = {
        name: abs(evaluate_block(every_other.coefficients(4 * math.pi, name), table.x) - y).max() / y.max()
        for name in INTERPOLATIONS
    }
    expected = {"linear": 0.20e-2, "pchip": 0.12e-2, "akima": 0.025e-2, "spline": 0.0016e-2}
    assert worst == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("turn", [1.0, -1.0])
@pytest.mark.parametrize("periodic", [True, False])
def test_the_largest_value_of_a_spline_is_found_between_its_knots(knots, periodic, turn):
    x, y = knots
    y[-1] = y[0]
    block = Table(x, turn * y).coefficients(x[-1] - x[0] if periodic else None)
    largest = abs(evaluate_block(block, np.linspace(x[0], x[-1], 400_001))).max()
    assert largest > 1.01 * abs(y).max()
    assert largest_of_block(block) == pytest.approx(largest, rel=1e-8)


def test_the_largest_value_of_a_straight_line_and_of_zeros_is_at_a_knot():
    x = np.arange(5.0)
    assert largest_of_block(Table(x, -2.0 * x).coefficients()) == 8.0
    assert largest_of_block(Table(x, 0.0 * x).coefficients(4.0)) == 0.0


def test_periodic_spline_is_fourth_order():
    errors = []
    for n in (20, 40, 80):
        x = np.linspace(0, 2 * math.pi, n + 1)
        block = Table(x, np.exp(np.sin(x))).coefficients(2 * math.pi)
        fine = np.linspace(0, 2 * math.pi, 1001)
        errors.append(np.abs(evaluate_block(block, fine) - np.exp(np.sin(fine))).max())
    assert np.log2(errors[0] / errors[1]) > 3.7 and np.log2(errors[1] / errors[2]) > 3.8


def test_block_layout():
    x = np.array([0.0, 1.0, 3.0, 4.0])
    block = Table(x, np.array([2.0, 5.0, 1.0, 2.0])).coefficients(4.0)
    assert block[:2].tolist() == [3, 4] and block[2:6].tolist() == x.tolist() and len(block) == 2 + 4 + 3 * 4
    assert block[6::4].tolist() == pytest.approx([2, 5, 1])


def test_periodic_table_closes_at_the_mean_of_its_ends():
    x = np.linspace(0, 1, 6)
    block = Table(x, np.array([1.0, 4.0, 2.0, 5.0, 3.0, 1.02])).coefficients(1.0)
    assert evaluate_block(block, [0.0, 1.0, 2.0]) == pytest.approx([1.01] * 3, abs=1e-14)


def test_gas_curve_of_the_reference_engine():
    gas = read_scene("engine").loads["gas"]
    block = gas.read_table().coefficients(gas.period)
    # Peak of the assumed engine: 92.3 bar less 1.013 bar of the crankcase on 4071.5 mm^2, at 373.5 degrees.
    angles = np.radians(np.linspace(0, 720, 14401))
    force = evaluate_block(block, angles)
    assert force.max() == pytest.approx((92.3e5 - 1.013e5) * 4071.5e-6, rel=1e-3)
    assert np.degrees(angles[force.argmax()]) == pytest.approx(373.5, abs=0.2)


def test_column_and_units_of_a_file(tmp_path):
    path = tmp_path / "f.csv"
    path.write_text("# measured\ndeg, a, b\n0, 1, 2\n\n90, 3, 4\n180, 5, 6\n360, 7, 8\n")
    first = read_table(path, None, "N", "deg")
    assert first.x == pytest.approx(np.radians([0, 90, 180, 360])) and first.y.tolist() == [1, 3, 5, 7]
    assert read_table(path, "b", "kN", "s").y.tolist() == [2000, 4000, 6000, 8000]
    assert read_table(path, "b", "kN", "s").x.tolist() == [0, 90, 180, 360]


GOOD = ["x,F", "0,1", "90,3", "180,5", "360,1"]


@pytest.mark.parametrize(("lines", "reason"), [
    ([], "t.csv is empty"),
    (["# only a comment"], "t.csv is empty"),
    (GOOD[1:], "t.csv has no header line"),
    (GOOD[:4], "t.csv has 3 rows of numbers"),
    (["x", "1", "2", "3", "4"], "t.csv has one column"),
    ([line.replace(",", ";") for line in GOOD], "t.csv has one column"),
    ([*GOOD[:2], "90,nan", *GOOD[3:]], "t.csv, line 3: 'nan' is not a finite number"),
    ([*GOOD[:2], "90,inf", *GOOD[3:]], "t.csv, line 3: 'inf' is not a finite number"),
    ([*GOOD[:2], "90,three", *GOOD[3:]], "t.csv, line 3: 'three' is not a finite number"),
    ([*GOOD[:2], "90", *GOOD[3:]], "t.csv, line 3: '' is not a finite number"),
    ([*GOOD[:2], "200,3", *GOOD[3:]], "t.csv, line 4: 180 does not rise above 200"),
    ([*GOOD[:2], "0,3", *GOOD[3:]], "t.csv, line 3: 0 does not rise above 0"),
    ([*GOOD[:2], "180,3,5", *GOOD[3:]], "t.csv, line 3: 3 cells under 2 columns"),  # 3,5 is 3.5 in many countries
])  # fmt: skip
def test_bad_files(tmp_path, lines, reason):
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(Fault) as caught:
        read_table(path, None, "N", "deg")
    assert caught.value.reason == reason and caught.value.below == "table"


def test_missing_file_column_and_unit(tmp_path):
    path = tmp_path / "t.csv"
    with pytest.raises(Fault, match="no such file"):
        read_table(path, None, "N", "deg")
    path.write_text("\n".join(GOOD))
    with pytest.raises(Fault, match="no such column") as caught:
        read_table(path, "G", "N", "deg")
    assert caught.value.below == "column"
    with pytest.raises(Fault, match="is not a unit of force") as caught:
        read_table(path, "F", "mm", "deg")
    assert caught.value.below == "unit"


def test_span_and_closing_of_a_period():
    table = Table(np.array([0.0, 1, 2, 4]), np.array([1.0, 8, -10, 1.5]))
    table.check_period(4.0, 0.06)
    with pytest.raises(Fault, match=r"differ by 0\.05 of the largest"):
        table.check_period(4.0, 0.04)
    with pytest.raises(Fault, match=r"covers 0\.8 of its period"):
        table.check_period(5.0, 0.06)
