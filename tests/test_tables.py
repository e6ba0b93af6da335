"""CSV tables and their spline blocks."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from kaneflex.errors import Fault
from kaneflex.scene import read_scene
from kaneflex.tables import Table, evaluate_block, largest_of_block, read_table


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
