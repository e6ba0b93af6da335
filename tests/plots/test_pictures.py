"""Pictures that a mechanism engineer expects: what is drawn on them, by numbers known from elsewhere."""

import re
from functools import cache

import numpy as np
import pytest
from machines import machine
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon
from places import DOCS
from runs import run, solved

from kaneflex import figures, read_scene, scene_of, show
from kaneflex.mechanism.joints import axes_of
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.multibody.model.building import reference_modes
from kaneflex.plots import loads, motion, paths, sensors, spectra
from kaneflex.plots.outlines import VIEW
from kaneflex.plots.sensors import grouped
from kaneflex.plots.style import readable, styled
from kaneflex.plots.view import view

STICKS = "drag: sticks"
SWINGING = """
schema = 1
like = "four-bar"
drives.main = {speed = "none", cycle = "none", law = "1.5 + 0.3 * sin(2 * pi * t)", period = "1 s"}
solve = {preset = "rigid", start = "periodic", steps = 144}
"""


@cache
def drawn(kind, name: str, *settings: str):
    """Picture of a run by a module, or by one of its functions."""
    with styled():
        (figure,) = getattr(kind, "figures", kind)(run(name, *settings)).values()
    return figure


def curves(axes) -> dict[str, np.ndarray]:
    """Those with a name, (2, n)."""
    lines = axes.get_lines()
    return {line.get_label(): np.array(line.get_data()) for line in lines if not line.get_label().startswith("_")}


def test_paths_and_hodographs_are_those_of_the_closed_form():
    """Middle of a centred slider-crank's rod: half-way between pin and wrist, whose height is r sin(theta)."""
    rigid = ("engine", "solve.preset=rigid", "solve.steps=144")
    path, hodograph = drawn(paths, *rigid).axes
    theta, r, l, omega = np.radians(view(run(*rigid)).x), 40.0, 137.0, 200 * np.pi
    root = np.sqrt(l**2 - (r * np.sin(theta)) ** 2)
    x, y = r * np.cos(theta) + root / 2, r * np.sin(theta) / 2
    v_x = -r * np.sin(theta) * (1 + r * np.cos(theta) / (2 * root))
    v_y = r * np.cos(theta) / 2
    assert curves(path)["rod.mid"] == pytest.approx(np.array([x, y]), abs=1e-9)
    assert curves(hodograph)["rod.mid"] == pytest.approx(1e-3 * omega * np.array([v_x, v_y]), abs=1e-9)
    assert {*curves(path)} == {*curves(hodograph)} == {"rod.end, piston.start", "rod.mid"}
    assert [text.get_text() for text in hodograph.get_legend().get_texts()] == [*curves(path)]
    assert "a dot each 30 deg" in path.get_title(loc="left")
    dots = next(line for line in path.get_lines() if line.get_marker() == "o" and line.get_markersize() == 3)
    assert len(dots.get_xdata()) == 24


def test_points_beside_the_bodies_are_in_the_pictures():
    """A thread lever's eye stands far beside its link, a counterweight behind the crank's pivot."""
    tables = {
        "schema": 1, "like": "four-bar", "solve": {"preset": "rigid", "start": "zero", "steps": 72},
        "bodies": {"coupler": {"points": {"eye": ["0.9 m", "0.5 m"]}}, "crank": {"points": {"back": ["-0.6 m", 0]}}},
        "masses": {"weight": {"at": "crank.back", "mass": "2 kg"}},
        "sensors": {"eye": {"position": "coupler.eye", "component": "x"}},
    }  # fmt: skip
    scene = scene_of(tables)
    with styled():
        path = paths.figures(solved(scene))["paths"].axes[0]
    seen = curves(path)["coupler.eye"]
    drawing = show(scene).axes[0]
    placed = {name: pose.place(at) for name, at in (("crank", (-0.6, 0.0)), ("coupler", (0.9, 0.5)))
              for pose in [axes_of(place(mechanism_of(scene), {}).poses)[name]]}  # fmt: skip
    for axes, points in ((path, seen.T), (drawing, [1e3 * np.array(each) for each in placed.values()])):
        assert all(axes.viewLim.contains(*point) for point in points)
    lines = [line.get_xydata() for line in drawing.get_lines()]
    for point in placed.values():
        reached = [line for line in lines if len(line) > 1 and (abs(line - 1e3 * np.array(point)) < 1e-6).all(1).any()]
        assert reached, "nothing is drawn from the body to its point"


INCLINED = machine(
    bodies=dict(arm='length = "0.5 m", mass = "1 kg", inertia = [1e-3, 0.02, 0.02]'),
    joints=dict(hub="revolute ground arm.start, axis = [0, 3, 4]"),
    drives=dict(hub='speed = "20 rad/s", cycle = "360 deg"'),
    sensors=dict(tip="position arm.end x", pivot="velocity arm.start z"), solve=dict(preset="rigid", steps=72),
)


def test_hodographs_in_space_are_those_of_a_point_on_a_circle():
    """v = omega x r about the axis (0, 0.6, 0.8), r turned from (0.5, 0, 0)."""
    with styled():
        (figure,) = paths.figures(solved(scene_of(INCLINED))).values()
    along_z, along_y, along_x, angled = figure.axes[1::2]
    phi = np.radians(np.linspace(0.0, 360.0, 73))
    v = 10.0 * np.array([-np.sin(phi), 0.8 * np.cos(phi), -0.6 * np.cos(phi)])
    assert {*curves(along_z)} == {"arm.end", "arm.start"}
    for axes, parts in ((along_z, [0, 1]), (along_y, [0, 2]), (along_x, [1, 2])):
        assert curves(axes)["arm.end"] == pytest.approx(v[parts], abs=1e-8)
    assert curves(angled)["arm.end"] == pytest.approx(VIEW @ v, abs=1e-8)
    assert (along_y.get_xlabel(), along_y.get_ylabel()) == ("v_x [m/s]", "v_z [m/s]")
    assert {"x", "y", "z", "10 m/s"} <= {text.get_text() for text in angled.texts}
    assert along_z.get_xlim()[0] <= -10.0 and along_z.get_xlim()[1] >= 10.0


# A motor that runs up a fan, and beside it a slide that a damper on a moving guide slows down.
MOTOR = machine(
    bodies=dict(fan='mass = "3 kg", inertia = "0.05 kg m^2"', slide='mass = "1 kg"'),
    joints=dict(shaft="revolute ground fan", bore="prismatic fan slide, direction = [0.6, 0.8]"),
    drives=dict(shaft="free = true", bore='free = true, initial_speed = "2 m/s"'),
    loads=dict(motor='torque_at = "shaft", law = "20 * (1 - shaft_speed / 150)"',
               damper='force_on = "slide", axes = "body", direction = [0.6, 0.8], law = "-3 * bore_speed"'),
    solve=dict(duration="0.3 s", steps=60),
)


@pytest.mark.parametrize("preset", ["rigid", "coupled"])
def test_motors_and_dampers_are_drawn_over_time_and_over_their_speeds(preset):
    with styled():
        solution = solved(scene_of(MOTOR), f"solve.preset={preset}")
        found = loads.figures(solution)
    force, torque = sorted(found["loads"].axes, key=lambda axes: axes.get_title(loc="left"))
    assert (force.get_ylabel(), torque.get_ylabel()) == ("force [N]", "torque [N m]")
    motor, damper = found["characteristics"].axes
    assert motor.get_xlabel() == "speed of shaft, starting at the ring [rpm]"
    rpm, nm = curves(motor)["motor"]
    assert rpm[0] == pytest.approx(0.0, abs=1e-9) and np.ptp(rpm) > 100.0
    assert nm == pytest.approx(20.0 * (1.0 - rpm * np.pi / 30.0 / 150.0), rel=1e-9)
    assert torque.get_lines()[0].get_ydata() == pytest.approx(nm)
    speed, newton = curves(damper)["damper"]
    assert speed[0] == pytest.approx(2.0, rel=1e-9) and newton == pytest.approx(-3.0 * speed, rel=1e-9, abs=1e-9)


def test_the_text_of_a_late_peak_is_not_cut_off():
    load = "loads.push={force_on='upper.end', direction=[0, 1], law='t'}"
    (panel,) = drawn(loads.figures, "double-pendulum", "solve.duration=0.1 s", "solve.steps=20", load).axes
    (text,) = panel.texts
    assert text.get_ha() == "right" and text.get_position()[0] < 0.0


def test_loads_that_do_not_vary_have_no_picture():
    constant = MOTOR.replace('law = "20 * (1 - shaft_speed / 150)"', "value = 20")
    constant = constant.replace('law = "-3 * bore_speed"', "value = -3")
    assert loads.figures(solved(scene_of(constant), "solve.preset=rigid")) == {}


def test_orders_are_those_of_the_series():
    """A centred piston's place is r cos(theta) + l sqrt(1 - q^2 sin(theta)^2), q = r/l: orders 1, 2, 4 .. by the
    binomial series; a cycle of two turns has half orders, too, which are zero here."""
    rigid = ("engine", "solve.preset=rigid", "solve.steps=144")
    r, l, q = 40.0, 137.0, 40.0 / 137.0
    (place,) = (axes for axes in drawn(spectra.orders, *rigid).axes if axes.get_title(loc="left") == "Position")
    order, amplitude = curves(place)["piston_position"]
    of = dict(zip(np.round(order, 6).tolist(), amplitude, strict=True))
    assert place.get_ylabel() == "position [mm]" and order[0] == pytest.approx(0.5)
    assert of[1.0] == pytest.approx(r, rel=1e-9) and max(of[0.5], of[1.5], of[3.0]) < 1e-9
    assert of[2.0] == pytest.approx(l * (q**2 / 4 + q**4 / 16 + 15 * q**6 / 512 + 35 * q**8 / 2048), rel=1e-5)
    assert of[4.0] == pytest.approx(l * (q**4 / 64 + 3 * q**6 / 256 + 35 * q**8 / 4096), rel=1e-3)
    lowest = drawn(spectra.orders, *rigid).axes
    assert [axes.get_xlabel() for axes in lowest if axes.get_xlabel()] == ["order of main [1 = 100 Hz]"] * 2


def test_orders_stand_beside_the_natural_frequencies():
    figure, model = drawn(spectra.orders, "four-bar", "solve.steps=144"), run("four-bar", "solve.steps=144").model
    natural = [line.get_xdata()[0] for line in figure.axes[0].get_lines() if line.get_linestyle() == "--"]
    assert 5.0 * np.array(natural) == pytest.approx(reference_modes(model, 6)[0][: len(natural)] / (2 * np.pi))
    assert len(natural) >= 3


def test_what_does_not_repeat_has_no_orders():
    assert "orders" not in spectra.figures(run("engine-transient", "solve.duration=0.01 s", "solve.steps=360"))
    turning = ("four-bar", "solve.steps=144", "sensors.rocker_angle.position=main")
    every = {*spectra.harmonics(run("four-bar", "solve.steps=144"))}
    assert every - {*spectra.harmonics(run(*turning))} == {"rocker_angle"}


def test_the_energy_that_is_drawn_is_the_motors_work():
    """Of a motor of 0.6 (1 - omega / 31.416) N m, whose speed a sensor reads; two rigid bars and a flywheel turn."""
    motor = ("four-bar-motor", "solve.duration=0.2 s", "solve.steps=2000")
    stored, balance = drawn(loads.energy, *motor).axes
    solution = run(*motor)
    omega = solution.series["crank_speed"].values
    power = 0.6 * (1.0 - omega / 31.41592653589793) * omega
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(solution.times))])
    found = curves(balance)
    factor = {"J": 1.0, "mJ": 1e3}[balance.get_ylabel()[8:-1]]
    assert found["supplied"][1] == pytest.approx(factor * work, abs=1e-4 * factor * work.max())
    there = found["stored, increase"][1] + found["dissipated"][1]
    assert there == pytest.approx(found["supplied"][1], rel=1e-6, abs=1e-9)
    assert {*curves(stored)} == {"kinetic", "strain, springs"}
    assert not loads.energy(run("four-bar", "solve.steps=144"))


def test_free_joints_turn_their_bodies_without_a_torque():
    panels = drawn(motion, "double-pendulum", "solve.duration=0.1 s", "solve.steps=20").axes
    assert [axes.get_ylabel().split(" [")[0] for axes in panels] == ["angle", "ang. velocity", "ang. acceleration"]
    assert [*curves(panels[0])] == [*read_scene("double-pendulum").bodies]


def test_a_drive_that_swings_is_drawn_over_time(tmp_path):
    """Over its angle, curves would fold back on themselves."""
    (tmp_path / "swinging.toml").write_text(SWINGING)
    shown = view(run(tmp_path / "swinging.toml"))
    assert shown.x_label == "time [s]" and (np.diff(shown.x) > 0).all()
    assert view(run("four-bar", "solve.preset=rigid")).x_label == "angle of main [deg]"
    (torque,) = (
        axes for axes in drawn(spectra.orders, tmp_path / "swinging.toml").axes if "torque" in axes.get_ylabel()
    )
    assert curves(torque)["crank_torque"][0, :3] == pytest.approx([1.0, 2.0, 3.0])  # Hz
    panels = drawn(motion, tmp_path / "swinging.toml").axes
    (course,) = (axes for axes in panels if axes.get_title(loc="left") == "Angle of main")
    (angle,) = course.get_lines()
    assert angle.get_ydata() == pytest.approx(np.degrees(1.5 + 0.3 * np.sin(2 * np.pi * shown.times)))
    backwards = view(run("four-bar", "solve.preset=rigid", "main.speed=-300 rpm"))
    assert backwards.x_label == "angle of main [deg]" and (np.diff(backwards.x) < 0).all()


@pytest.mark.parametrize(("unit", "largest", "expected"), [
    ("m", 12.0, "12 m"), ("m", 9.0, "9000 mm"), ("N m", 2e5, "200 kN m"), ("N", 3e6, "3 MN"), ("N m", 4e6, "4 MN m"),
    ("N/m", 700.0, "0.7 kN/m"), ("J", 2.5e-3, "2.5 mJ"), ("J", 40e3, "40 kJ"), ("rad", 1e-3, "1 mrad"),
])  # fmt: skip
def test_units_are_those_on_drawings_and_nameplates(unit, largest, expected):
    factor, label = readable(unit, np.array([largest]))
    assert f"{factor * largest:.4g} {label}" == expected


def test_the_page_names_every_picture():
    text = (DOCS / "results.md").read_text(encoding="utf-8")
    named = re.findall(r"`([\w.]+)`", "".join(re.findall(r"^\| (`.*?) \|", text.split("## Pictures")[1], re.MULTILINE)))
    drawn = {*figures(run("four-bar", "solve.steps=144")), *figures(run("engine", "solve.steps=144"))}
    general = {re.sub(r"_(rod|crank|coupler|follower)$", "_NAME", name) for name in drawn}
    assert general <= {*named} and len(general) > 7


def test_sensors_of_other_magnitudes_have_axes_of_their_own():
    scene = read_scene("engine")
    forces = ["crank_pin_force_x", "piston_side_force", "main_bearing_force_x"]
    reach = {"crank_pin_force_x": 4e4, "piston_side_force": 50.0, "main_bearing_force_x": 5e3}
    assert grouped(scene, forces, reach) == {
        "Joint force (1)": ["crank_pin_force_x", "main_bearing_force_x"], "Joint force (2)": ["piston_side_force"]
    }  # fmt: skip
    constant = grouped(scene, forces, reach | {"piston_side_force": 0.0})
    assert constant == grouped(scene, forces) == {"Joint force": forces}


def test_a_curve_of_friction_is_wide_where_it_sticks():
    """On the belt of stick-slip: as long as the part moves with it, at 0.1 m/s."""
    solution = run("stick-slip")
    (line,) = [each for axes in drawn(sensors, "stick-slip").axes for each in axes.lines if each.get_label() == STICKS]
    there = np.isfinite(line.get_ydata())
    speed = solution.series["speed"].values
    assert len(there) == len(speed) and abs(speed[there] - 0.1).max() < 1e-9
    assert there.sum() > 0.3 * len(speed) and abs(speed[~there] - 0.1).max() > 0.2


def test_a_pivot_stands_on_its_hatched_base():
    """The base is as low as the triangle, and wider."""
    axes = show(read_scene("four-bar")).axes[0]
    strokes = [each for drawn in axes.collections if isinstance(drawn, LineCollection) for each in drawn.get_segments()]
    triangles = [patch.get_xy() for patch in axes.patches if isinstance(patch, Polygon) and len(patch.get_xy()) == 4]
    assert len(triangles) == 2
    for _, left, right, _ in triangles:
        assert any(np.ptp(base[:, 1]) < 1e-9 and base[0, 1] == pytest.approx(left[1])
                   and base[:, 0].min() < left[0] < right[0] < base[:, 0].max() for base in strokes)  # fmt: skip
