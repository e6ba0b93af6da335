"""CSV tables and their spline blocks."""

import math

import numpy as np
import pytest
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PchipInterpolator

from kaneflex import SceneError, load, read_scene, scene_of, simulate, with_settings
from kaneflex.response.time_statistics import between_steps
from kaneflex.scene.options import resolve_options
from kaneflex.scene.plausible import implausible
from kaneflex.scene.tables import Table, evaluate_block, largest_of_block, overshoot_of_block, read_table
from kaneflex.support.errors import Fault
from kaneflex.support.interpolation import INTERPOLATIONS, cubics_through
from kaneflex.support.units import ANGLE, ANGULAR_SPEED, FORCE, LENGTH, PRESSURE, SPEED, TIME, TORQUE


@pytest.fixture
def knots():
    random = np.random.default_rng(4)
    return np.cumsum(random.uniform(0.1, 1.0, 30)), random.normal(size=30)


@pytest.mark.parametrize("rows", [3, 4, 5, 10, 30])
def test_splines_of_any_number_of_rows_agree_with_scipy(knots, rows):
    """Cyclic reduction halves the rows again and again, with one over or none."""
    x, y = (each[:rows] for each in knots)
    natural = CubicSpline(x, y, bc_type="natural").c[::-1].T
    np.testing.assert_allclose(cubics_through(x, y, "spline", periodic=False), natural, rtol=1e-13, atol=1e-12)
    y = np.append(y[:-1], y[0])
    around = CubicSpline(x, y, bc_type="periodic").c[::-1].T
    np.testing.assert_allclose(cubics_through(x, y, "spline", periodic=True), around, rtol=1e-12, atol=1e-11)


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
@pytest.mark.parametrize("rows", [2, 3, 30])
def test_every_interpolation_is_the_one_of_scipy(knots, rows, interpolation):
    x, y = (each[:rows] for each in knots)
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
    for turn in (0, 3, -3):
        at = inside + turn * period
        assert evaluate_block(block, at) == pytest.approx(expected(inside), abs=tolerance)


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
    """The numbers of docs/scene/units.md: every other row of the engine's gas force predicts those between."""
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


def read(path, column=None, unit=None, x=ANGLE, y=FORCE, assumed="N"):
    return read_table(path, column, unit, (x,), (y,), assumed)


def test_column_and_units_of_a_file(tmp_path):
    path = tmp_path / "f.csv"
    path.write_text("# measured\nphi, a, b\n0, 1, 2\n\n90, 3, 4\n180, 5, 6\n360, 7, 8\n")
    first = read(path)
    assert first.x == pytest.approx(np.radians([0, 90, 180, 360])) and first.y.tolist() == [1, 3, 5, 7]
    assert read(path, "b", "kN", TIME).y.tolist() == [2000, 4000, 6000, 8000]
    assert read(path, "b", "kN", TIME).x.tolist() == [0, 90, 180, 360]


@pytest.mark.parametrize(("heading", "x", "factor"), [
    ("Speed (RPM)", ANGULAR_SPEED, math.pi / 30), ("n [U/min]", ANGULAR_SPEED, math.pi / 30),
    ("n / rpm", ANGULAR_SPEED, math.pi / 30), ("n in 1/min", ANGULAR_SPEED, math.pi / 30),
    ("speed_rpm", ANGULAR_SPEED, math.pi / 30), ("omega [rad/s]", ANGULAR_SPEED, 1), ("v (km/h)", SPEED, 1 / 3.6),
    ("phi [°CA]", ANGLE, math.pi / 180), ("phi", ANGLE, math.pi / 180), ("theta_rad", ANGLE, 1), ("t", TIME, 1),
    ("t (ms)", TIME, 1e-3), ("time_s", TIME, 1), ("s", TIME, 1), ("Hub (mm)", LENGTH, 1e-3), ("lift_m", LENGTH, 1),
])  # fmt: skip
def test_the_first_column_has_the_unit_of_its_heading(tmp_path, heading, x, factor):
    (tmp_path / "f.csv").write_text(f"{heading},F\n0,1\n1,3\n2,5\n4,1\n")
    table = read(tmp_path / "f.csv", x=x)
    assert table.x == pytest.approx(factor * np.array([0, 1, 2, 4])) and table.x_dimension is x


@pytest.mark.parametrize(("heading", "unit", "y", "factor"), [
    ("F (kN)", None, FORCE, 1e3), ("F_gas_N", None, FORCE, 1), ("F", "kN", FORCE, 1e3), ("F [kN]", "kN", FORCE, 1e3),
    ("F", None, FORCE, 1), ("force (piston side)", "kN", FORCE, 1e3), ("M / Nm", None, TORQUE, 1),
    ("M (kNm)", None, TORQUE, 1e3), ("p [bar]", None, PRESSURE, 1e5), ("p_abs_bar", None, PRESSURE, 1e5),
    ("phase N", None, TORQUE, 1),
])  # fmt: skip
def test_the_second_column_has_the_given_unit_or_that_of_its_heading(tmp_path, heading, unit, y, factor):
    (tmp_path / "f.csv").write_text(f"t,{heading}\n0,1\n1,3\n2,5\n4,1\n")
    assumed = {FORCE: "N", TORQUE: "N m"}.get(y)
    assert read(tmp_path / "f.csv", None, unit, TIME, y, assumed).y == pytest.approx(factor * np.array([1, 3, 5, 1]))


@pytest.mark.parametrize(("headings", "unit", "x", "y", "reason"), [
    ("Speed (RPM),M", None, TIME, TORQUE, "column 'Speed (RPM)' is in 'rpm', not a unit of a time"),
    ("Speed RPM,M", None, TIME, TORQUE, "column 'Speed RPM' is in 'rpm', not a unit of a time"),
    ("phi (°),M", None, TIME, TORQUE, "column 'phi (°)' is in 'deg', not a unit of a time"),
    ("n (rpm),M", None, ANGLE, TORQUE, "column 'n (rpm)' is in 'rpm', not a unit of an angle"),
    ("speed,M", None, ANGULAR_SPEED, TORQUE, "heading 'speed' has no unit of an angular speed"),
    ("t,F (side)", None, TIME, FORCE, "column 'F (side)' is in 'side', not a unit of a force"),
    ("t,p [bar]", None, TIME, FORCE, "column 'p [bar]' is in 'bar', not a unit of a force"),
    ("t,p [bar]", "N", TIME, FORCE, "column 'p [bar]' is in 'bar', not a unit of a force"),
    ("t,F [kN]", "N", TIME, FORCE, "column 'F [kN]' is in kN"),
    ("t,p", None, TIME, PRESSURE, "heading 'p' has no unit of a pressure"),
])  # fmt: skip
def test_a_heading_with_another_quantity_is_refused(tmp_path, headings, unit, x, y, reason):
    (tmp_path / "f.csv").write_text(f"{headings}\n0,1\n1,3\n2,5\n4,1\n")
    with pytest.raises(Fault) as caught:
        read(tmp_path / "f.csv", None, unit, x, y, None if y is PRESSURE else "N" if y is FORCE else "N m")
    assert caught.value.reason.startswith("f.csv: ") and reason in caught.value.reason
    assert ("against = 'NAME_speed'" in caught.value.cure) == (caught.value.below == "table" and "is in" in reason)
    assert caught.value.below in ("table", "unit")


GOOD = ["x,F", "0,1", "90,3", "180,5", "360,1"]


@pytest.mark.parametrize(("lines", "reason"), [
    ([], "t.csv is empty"),
    (["# only a comment"], "t.csv is empty"),
    (GOOD[1:], "t.csv has no header line"),
    (GOOD[:2], "t.csv has 1 row of numbers"),
    (["x", "1", "2", "3", "4"], "t.csv has one column"),
    ([line.replace(",", ";") for line in GOOD], "t.csv has one column"),
    ([*GOOD[:2], "90,nan", *GOOD[3:]], "t.csv, line 3: 'nan' is not a finite number"),
    ([*GOOD[:2], "90,inf", *GOOD[3:]], "t.csv, line 3: 'inf' is not a finite number"),
    ([*GOOD[:2], "90,three", *GOOD[3:]], "t.csv, line 3: 'three' is not a finite number"),
    ([*GOOD[:2], "90", *GOOD[3:]], "t.csv, line 3: '' is not a finite number"),
    ([*GOOD[:2], "200,3", *GOOD[3:]], "t.csv, line 4: 180 is not above 200"),
    ([*GOOD[:2], "0,3", *GOOD[3:]], "t.csv, line 3: 0 is not above 0"),
    ([*GOOD[:2], "90,1_000", *GOOD[3:]], "t.csv, line 3: '1_000' is not a finite number"),
    ([*GOOD[:2], "90,\uff13", *GOOD[3:]], "t.csv, line 3: '\uff13' is not a finite number"),
    ([*GOOD[:2], "90,1e400", *GOOD[3:]], "t.csv, line 3: '1e400' is not a finite number"),
    ([*GOOD[:2], "180,3,5", *GOOD[3:]], "t.csv, line 3: 3 cells under 2 columns"),  # 3,5 is 3.5 in many countries
])  # fmt: skip
def test_bad_files(tmp_path, lines, reason):
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(Fault) as caught:
        read(path)
    assert caught.value.reason == reason and caught.value.below == "table"


def test_missing_file_column_and_unit(tmp_path):
    path = tmp_path / "t.csv"
    with pytest.raises(Fault, match="no such file"):
        read(path)
    path.write_text("\n".join(GOOD))
    with pytest.raises(Fault, match="does not have this column") as caught:
        read(path, "G")
    assert caught.value.below == "column"
    with pytest.raises(Fault, match="is not a unit of force") as caught:
        read(path, "F", "mm")
    assert caught.value.below == "unit"


def test_span_and_closing_of_a_period():
    table = Table(np.array([0.0, 1, 2, 4]), np.array([1.0, 8, -10, 1.5]))
    assert table.over_period(4.0, 0.06) is table
    with pytest.raises(Fault, match=r"differ by 0\.05 of the largest"):
        table.over_period(4.0, 0.04)
    with pytest.raises(Fault, match=r"covers 0\.5 of its period"):
        table.over_period(8.0, 0.06)
    with pytest.raises(Fault, match=r"covers 1\.33333 of its period"):
        table.over_period(3.0, 0.06)
    with pytest.raises(Fault, match=r"covers 0\.99999 of its period"):  # two rows nearly at one place have no slope
        table.over_period(4.00004, 0.06)


def test_a_cycle_without_its_last_row_is_closed_by_its_first(tmp_path):
    """720 rows of an indicator's diagram from 0 to 719 degrees, in bar on a bore."""
    phi = np.arange(720)
    p = 30 + 28 * np.cos(np.radians(phi)) + 5 * np.sin(np.radians(phi / 2))
    rows = "".join(f"{x},{y:.9f}\n" for x, y in zip(phi, p, strict=True))
    (tmp_path / "p.csv").write_text("Crank angle [deg],p [bar]\n" + rows)
    gas = f'table="{tmp_path}/p.csv", against="main", bore="72 mm", period="720 deg", interpolation="spline"'
    loads = f"loads={{p={{force_on='piston', direction=[-1, 0], {gas}}}}}"
    scene = with_settings(read_scene("engine"), ["loads.gas=none", loads])
    found = evaluate_block(scene.loads["p"].curve(), np.radians([719.5, 720 + 719.5, 360]))
    across = (30 + 28 * math.cos(math.radians(719.5)) + 5 * math.sin(math.radians(719.5 / 2))) * 1e5
    assert found[:2] == pytest.approx(across * math.pi / 4 * 0.072**2, rel=1e-6)
    assert found[2] == pytest.approx(58e5 * math.pi / 4 * 0.072**2, rel=1e-9)
    (warning,) = implausible(scene)
    assert warning == "loads.p: p.csv ends at 719 deg, before its period: its first row is repeated at 720 deg"
    whole = with_settings(scene, ["p.bore=none", f"p.area={math.pi / 4 * 0.072**2!r}"])
    assert evaluate_block(whole.loads["p"].curve(), 1.0) == evaluate_block(scene.loads["p"].curve(), 1.0)
    for change, reason in (
        (["p.against=main_speed"], r"loads\.p\.period.*a speed is not periodic"),
        (["p.area=1 cm^2"], r"loads\.p\.bore.*area and bore exclude each other"),
        (["p.unit=N"], r"loads\.p\.unit = 'N'.*is not a unit of pressure"),
        (["p.force_on=none", "p.direction=none", "p.torque_at=main"], r"loads\.p\.bore.*belongs to a point force"),
    ):
        with pytest.raises(SceneError, match=reason):
            with_settings(scene, change)


def test_a_drive_whose_table_ends_with_a_speed_is_named(tmp_path):
    """A straight line from 10 to 100 degrees between 0.1 and 0.6 s, in a run of a second: the speed jumped silently."""
    path = tmp_path / "move.csv"

    def warned(angles, *settings):
        path.write_text("t,phi\n" + "".join(f"{0.1 + 0.05 * k},{x}\n" for k, x in enumerate(angles)))
        text = MOTOR.format(inertia=1, axis="", component="angle", preset="rigid").splitlines()
        kept = [line for line in text if not line.startswith(("loads", "drives"))]
        scene = scene_of("\n".join([*kept, f"drives = {{shaft = {{table = '{path}'}}}}"]))
        return implausible(with_settings(scene, settings))

    line = 10.0 + 9.0 * np.arange(11)
    begins, ends = warned(line, "solve.duration=1 s")
    assert begins.startswith("drives.shaft: its table begins at 0.1 s with 3.142 rad/s, and the joint stands still")
    assert ends.startswith("drives.shaft: its table ends at 0.6 s with 3.142 rad/s")
    assert warned(line, "solve.duration=0.6 s") == (begins,)
    assert len(warned([10.0, 20.0], "solve.duration=1 s")) == 2
    turn = np.linspace(0, 2 * np.pi, 21)
    assert not warned(90.0 * (turn - np.sin(turn)), "solve.duration=2 s")


MOTOR = """
schema = 1
bodies = {{rotor = {{mass = "2 kg", inertia = {inertia}}}}}
joints = {{shaft = {{revolute = ["ground", "rotor"]{axis}}}}}
drives = {{shaft = {{free = true}}}}
loads = {{motor = {{torque_at = "shaft", table = "motor.csv", against = "shaft_speed", interpolation = "linear"}}}}
sensors = {{speed = {{velocity = "rotor", component = "{component}"}}}}
solve = {{preset = "{preset}", duration = "0.5 s", steps = 100}}
"""


@pytest.mark.parametrize("preset", ["rigid", "coupled"])
@pytest.mark.parametrize("spatial", [False, True])
def test_a_direct_current_motor_runs_up_as_its_closed_form_says(tmp_path, preset, spatial):
    """Its torque falls straight from 6 N m at rest to 0 at 3000 rpm: omega = omega_0 (1 - exp(-T_0 t/(J omega_0)))."""
    given = dict(inertia='[0.1, 0.1, "0.002 kg m^2"]', axis=", axis = [0, 0, 1]", component="angle_z")
    plane = dict(inertia='"0.002 kg m^2"', axis="", component="angle")
    (tmp_path / "motor.toml").write_text(MOTOR.format(preset=preset, **(given if spatial else plane)))
    (tmp_path / "motor.csv").write_text("Speed (RPM),Torque (Nm)\n0,6\n1000,4\n2500,1\n3000,0\n")
    solution = simulate(load(read_scene(tmp_path / "motor.toml")))
    no_load = 3000 * math.pi / 30
    speed = no_load * (1 - np.exp(-6 * solution.times / (0.002 * no_load)))
    assert solution.series["speed"].values == pytest.approx(speed, abs=1e-6 * no_load)


def test_a_force_over_the_place_of_a_guide_swings_it(tmp_path):
    """-200 N/m over the way in mm, by coupled and one-way motion: x = x_0 cos(sqrt(k / m) t)."""
    scene = """
schema = 1
bodies = {{block = {{mass = "2 kg"}}}}
joints = {{way = {{prismatic = ["ground", "block"], direction = [1, 0]}}}}
drives = {{way = {{free = true, position = "30 mm"}}}}
loads.back.force_on = "block"
loads.back.direction = [1, 0]
loads.back.table = "k.csv"
loads.back.against = "way"
loads.back.interpolation = "linear"
loads.back.offset = "{offset}"
sensors.x = {{position = "block", component = "x"}}
solve = {{preset = "{preset}", duration = "1 s", steps = 50}}
"""
    (tmp_path / "k.csv").write_text("way (mm),F (kN)\n-90,0.02\n0,0.002\n10,0\n110,-0.02\n")
    for preset in ("rigid", "coupled"):
        (tmp_path / "block.toml").write_text(scene.format(preset=preset, offset="-10 mm"))
        solution = simulate(load(read_scene(tmp_path / "block.toml")))
        exact = 0.03 * np.cos(10 * solution.times)
        assert solution.series["x"].values == pytest.approx(exact, abs=1e-6), preset
    (tmp_path / "block.toml").write_text(scene.format(preset="rigid", offset="10 deg"))
    with pytest.raises(SceneError, match=r"loads\.back\.offset = '10 deg': a guide slides; 'deg' is not a"):
        read_scene(tmp_path / "block.toml")


def test_a_torque_over_the_angle_of_a_lever_without_a_drive_needs_preset_coupled(tmp_path):
    """A table over its angle does what the law of the same line does."""
    (tmp_path / "k.csv").write_text("angle,M\n-720,720\n-1,1\n1,-1\n720,-720\n")
    settings = ["solve.preset=coupled", "solve.start=zero", "solve.duration=5 ms", "solve.steps=20"]
    ends = []
    table = f'table="{tmp_path}/k.csv", against="rocker", interpolation="linear"'
    for size in (table, f'law="-rocker*{180 / math.pi!r}"'):
        loads = f"loads={{brake={{torque_at='rocker', {size}}}}}"
        scene = with_settings(read_scene("four-bar"), [loads, *settings])
        ends.append([float(series.values[-1]) for series in simulate(load(scene)).series.values()])
    assert ends[0] == pytest.approx(ends[1], rel=1e-6, abs=1e-9)
    with pytest.raises(SceneError, match=r"loads\.brake\.against = 'rocker': .*rocker has none\. Use preset coupled"):
        resolve_options(with_settings(scene, ["brake.law=none", f"brake.table={tmp_path}/k.csv", "brake.against=rocker",
                                              "solve.preset=stiffened"]))  # fmt: skip


def test_rounds_of_a_table_that_no_run_can_follow_are_looked_at_in_part():
    """1e25 rpm, and a table that repeats every second turn: there were more rows than memory."""
    fast = ["main.speed=1e25 rpm", "solve.duration=20 ms", "solve.preset=rigid", "solve.start=zero", "solve.steps=20"]
    warnings = between_steps(load(with_settings(read_scene("engine"), fast)))
    assert any("main turns by" in text for text in warnings)
