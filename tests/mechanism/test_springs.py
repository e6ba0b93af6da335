"""Springs and dampers: forces, torques and motions in closed form."""

import numpy as np
import pytest
from machines import machine, slider_crank
from matplotlib.text import Text
from runs import solved

from kaneflex import SceneError, scene_of
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.plots.scheme import scheme
from kaneflex.report.presentation import parts, printed

BAR = machine(
    bodies=dict(bar='length = "0.5 m", mass = "2 kg"'), ground=dict(post=["0.2 m", "0.6 m"]),
    joints=dict(pivot="revolute ground bar.start"),
)
DRIVEN = BAR + 'drives.pivot = {speed = "100 rpm", cycle = "360 deg"}\n'
RIGID = 'solve.preset = "rigid"\nsolve.steps = 360\n'


def solve(text):
    return solved(scene_of(text))


def pull(theta, omega, at=(0.2, 0.6), length=0.5, k=2000.0, free=0.1, c=5.0):
    """Tension of the spring from a post to the end of a turning bar, and its arm about the bar's pivot."""
    x, y = length * np.cos(theta), length * np.sin(theta)
    d_x, d_y = x - at[0], y - at[1]
    now = np.hypot(d_x, d_y)
    tension = k * (now - free) + c * (d_x * -y + d_y * x) * omega / now
    return tension, (y * d_x - x * d_y) / now


def test_a_crank_drives_against_a_spring_to_the_ground():
    solution = solve(
        DRIVEN
        + """
springs.valve = {between = ["ground.post", "bar.end"], stiffness = "2 kN/m", length = "100 mm", damping = "5 N s/m"}
sensors.torque = {drive_torque = "pivot"}
sensors.tension = {spring_force = "valve"}
sensors.side = {joint_force = "pivot"}
"""
        + RIGID
    )
    theta, omega = solution.rigid["pivot.angle"], 100 * np.pi / 30
    tension, arm = pull(theta, omega)
    series = {name: one.values for name, one in solution.series.items()}
    np.testing.assert_allclose(series["tension"], tension, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(series["torque"], -tension * arm, atol=1e-9)
    d = np.array([0.5 * np.cos(theta) - 0.2, 0.5 * np.sin(theta) - 0.6])
    inertia = -2.0 * 0.25 * omega**2 * np.cos(theta)
    np.testing.assert_allclose(series["side"], inertia + tension * d[0] / np.hypot(*d), atol=1e-9)


def test_a_spring_may_name_its_points_in_either_order():
    scene = DRIVEN + 'springs.valve = {between = [%s], stiffness = 2000, length = 0.1, damping = 5}\n' + RIGID
    torques = [
        solve(scene % pair).rigid["pivot.drive"]
        for pair in ('"ground.post", "bar.end"', '"bar.end", "ground.post"')
    ]
    assert np.abs(torques[0]).max() > 10
    np.testing.assert_allclose(*torques, atol=1e-9)


def test_a_spring_without_free_length_pulls_through_the_point_where_its_ends_meet():
    """k d, and with it the torque of the force k r on an arm of its own direction: none."""
    scene = DRIVEN.replace('["0.2 m", "0.6 m"]', '["0.5 m", 0]')
    spring = 'springs.band = {between = ["ground.post", "bar.end"], stiffness = 300%s}\n'
    solution = solve(scene + spring % "" + RIGID)
    theta = solution.rigid["pivot.angle"]
    np.testing.assert_allclose(solution.rigid["pivot.drive"], 300 * 0.25 * np.sin(theta), atol=1e-10)
    with pytest.raises(SceneError) as error:
        solve(scene + spring % ", length = 0.1" + RIGID)
    assert str(error.value) == (
        "springs.band.between = 'ground.post and bar.end': its points coincide at t = 0 s, so forces by length "
        "or damping have no direction. Move one of the points, or give only stiffness."
    )


def test_a_drive_may_pass_where_a_free_joint_starts():
    """The pusher at 0.08 m passes 0.05 m, where the block starts, only after its spring has moved the block on."""
    solution = solve("""
schema = 1
bodies = {pusher = {mass = 1}, block = {mass = 0.1}}
joints.push = {prismatic = ["ground", "pusher"], direction = [1, 0]}
joints.slide = {prismatic = ["ground", "block"], direction = [1, 0]}
drives.push = {law = "0.08 * step(t, 0, 0, 0.2, 1)"}
drives.slide = {free = true, position = 0.05}
springs.coil = {between = ["pusher", "block"], stiffness = 1e5, length = 0.05}
sensors.pull = {spring_force = "coil"}
solve = {preset = "coupled", duration = 0.2, steps = 20}
""")
    rigid = solution.rigid
    assert rigid["pusher.x"][-1] == pytest.approx(0.08) and (rigid["block.x"] - rigid["pusher.x"] > 0.049).all()


def test_a_torsional_spring_at_a_drive_counts_whole_turns():
    spring = 'springs.hinge = {torsional_at = "pivot", stiffness = 12, angle = "20 deg", damping = 0.1}\n'
    solution = solve(DRIVEN.replace("360", "1080") + spring + 'sensors.m = {spring_torque = "hinge"}\n' + RIGID)
    theta = solution.rigid["pivot.angle"]
    expected = 12 * (theta - np.radians(20)) + 0.1 * 100 * np.pi / 30
    assert theta[-1] == pytest.approx(6 * np.pi)
    np.testing.assert_allclose(solution.rigid["pivot.drive"], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(solution.series["m"].values, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("preset", ["rigid", "coupled"])
def test_a_torsional_spring_at_a_joint_without_a_drive_counts_turns_under_coupled_only(preset):
    """A crank turns three times at the end of its coupler: links of 0.1, 0.3 and 0.25 m on a base of 0.35 m."""
    solution = solve(f"""
schema = 1
ground = {{post = [0.35, 0]}}
bodies.crank = {{length = 0.1, mass = 1}}
bodies.coupler = {{length = 0.3, mass = 1}}
bodies.rocker = {{length = 0.25, mass = 1}}
joints.main = {{revolute = ["ground", "crank"]}}
joints.pin = {{revolute = ["crank.end", "coupler"]}}
joints.post = {{revolute = ["ground.post", "rocker"]}}
joints.last = {{revolute = ["coupler.end", "rocker.end"]}}
drives.main = {{speed = 10}}
springs.coil = {{torsional_at = "pin", stiffness = 0.5, angle = 1}}
sensors.torque = {{spring_torque = "coil"}}
solve = {{preset = "{preset}", duration = 2, steps = 200}}
""")
    crank = np.exp(10j * solution.times)
    across = 0.35 - 0.1 * crank  # from the crank's end to the post
    beside = np.arccos((abs(across) ** 2 + 0.3**2 - 0.25**2) / (2 * abs(across) * 0.3))
    angle = np.unwrap(np.angle(across) + beside - 10 * solution.times) - 1
    expected = angle if preset == "coupled" else np.angle(np.exp(1j * angle))
    np.testing.assert_allclose(solution.series["torque"].values, 0.5 * expected, atol=1e-9)


def test_a_free_bar_on_a_spring_keeps_its_energy():
    solution = solve(
        BAR
        + """
drives.pivot = {free = true, angle = "-40 deg"}
springs.valve = {between = ["ground.post", "bar.end"], stiffness = 2000, length = 0.1}
solve = {preset = "rigid", duration = "2 s", steps = 400}
"""
    )
    rigid = solution.rigid
    energy = 0.5 * (2.0 * 0.25 / 3) * rigid["bar.omega"] ** 2 + 0.5 * 2000 * (rigid["valve.length"] - 0.1) ** 2
    assert np.ptp(rigid["valve.length"]) > 0.1
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)


SLIDER = """
schema = 1
like = "engine"
springs.spring = {%s}
solve.preset = "rigid"
"""


def test_a_spring_on_a_slider_of_a_linkage_turns_the_crank_by_virtual_work():
    """Torque x omega = power into the spring, beside the torque without it."""
    spring = 'between = ["ground", "piston"], stiffness = "20 kN/m", length = "150 mm", damping = "40 N s/m"'
    rigid, bare = solve(SLIDER % spring).rigid, solve('schema = 1\nlike = "engine"\nsolve.preset = "rigid"\n').rigid
    added = (rigid["main.drive"] - bare["main.drive"]) * rigid["crank.omega"]
    tension = 20e3 * (rigid["piston.x"] - 0.15) + 40 * rigid["piston.v_x"]
    np.testing.assert_allclose(added, tension * rigid["piston.v_x"], atol=1e-6 * np.abs(added).max())


def test_a_torsional_spring_at_a_pin_without_a_drive_works_between_its_bodies():
    text = slider_crank(
        'length = "40 mm", mass = "1 kg"', 'length = "137 mm", mass = "0.15 kg"', 'mass = "0.2 kg"',
        'speed = "600 rpm", cycle = "360 deg"', more={"bore": 'branch = "+"'},
    )  # fmt: skip
    spring = 'springs.hinge = {torsional_at = "pin", stiffness = 50, angle = "30 deg", damping = 0.02}\n'
    rigid, bare = solve(text + spring + RIGID).rigid, solve(text + RIGID).rigid
    relative = rigid["rod.omega"] - rigid["crank.omega"]
    angle = np.arctan2(rigid["rod.s"], rigid["rod.c"]) - np.arctan2(rigid["crank.s"], rigid["crank.c"])
    stretch = (angle - np.radians(30) + np.pi) % (2 * np.pi) - np.pi
    power = (50 * stretch + 0.02 * relative) * relative
    added = (rigid["main.drive"] - bare["main.drive"]) * rigid["crank.omega"]
    np.testing.assert_allclose(added, power, atol=1e-6 * np.abs(power).max())


@pytest.mark.parametrize("preset", ["stiffened", "linear", "quasistatic"])
def test_a_spring_on_the_driven_crank_of_an_elastic_engine_moves_its_torque_alone(preset):
    text = 'schema = 1\nlike = "engine"\nground.post = ["20 mm", "90 mm"]\n'
    spring = """
springs.valve = {between = ["ground.post", "crank.end"], stiffness = "20 kN/m", length = "10 mm", damping = "1 N s/m"}
springs.recoil = {torsional_at = "main", stiffness = 3, angle = "20 deg", damping = 0.001}
"""
    end = f'solve.preset = "{preset}"\nsolve.steps = 720\n'
    held, bare = solve(text + spring + end), solve(text + end)
    theta, omega = held.rigid["main.angle"], held.rigid["crank.omega"]
    tension, arm = pull(theta, omega, at=(0.02, 0.09), length=0.04, k=20e3, free=0.01, c=1.0)
    added = -tension * arm + 3 * (theta - np.radians(20)) + 0.001 * omega
    assert np.abs(added).max() > 10
    d = np.array([0.04 * np.cos(theta) - 0.02, 0.04 * np.sin(theta) - 0.09])
    pulled = dict(zip(("main_bearing_force_x", "main_bearing_force_y"), tension * d / np.hypot(*d), strict=True))
    changes = pulled | {"crank_torque": added}
    for name, series in bare.series.items():
        expected = series.values + changes.get(name.removesuffix("_rigid"), 0.0)
        scale = np.abs(expected).max()
        np.testing.assert_allclose(held.series[name].values, expected, atol=1e-8 * scale, err_msg=name)


def test_springs_are_drawn_and_listed():
    text = DRIVEN + """
springs.valve = {between = ["ground.post", "bar.end"], stiffness = 2000, length = 0.1, damping = 5}
springs.hinge = {torsional_at = "pivot", stiffness = 12}
sensors.pull = {spring_force = "valve"}
sensors.twist = {spring_torque = "hinge"}
"""
    scene = scene_of(text + RIGID)
    assert "2000 N/m, 5 N s/m, ground.post to bar.end, free length 100 mm" in printed(scene, parts(scene))
    assert "12 N m/rad, 0 N m s/rad, at pivot" in printed(scene, parts(scene))
    figure = scheme(scene, place(mechanism_of(scene)))
    said = "\n".join(text.get_text() for text in figure.findobj(Text))
    for name in ("valve", "hinge", "1  spring valve: pull", "2  spring hinge: twist"):
        assert name in said.split("\n"), name


@pytest.mark.parametrize("apart, more, meets", [
    ("0 mm", 'length = "20 mm"', True), ("1 mm", 'length = "20 mm"', False), ("0 mm", "damping = 3", False),
])  # fmt: skip
def test_points_of_a_spring_must_not_meet_in_a_run_either(apart, more, meets):
    """Two blocks on a spring that pass each other, on one line or beside each other: on one line its force jumps, but
    not that of a damper."""
    scene = scene_of(machine(
        ground=dict(far=["0 m", apart]), bodies=dict(block='mass = "1 kg"', other='mass = "1 kg"'),
        joints=dict(slide="prismatic ground block, direction = [1, 0]",
                    track="prismatic ground.far other, direction = [1, 0]"),
        drives=dict(slide='free = true, position = "50 mm", initial_speed = "-1 m/s"', track="free = true"),
        springs=dict(band='between = ["block", "other"], stiffness = "2000 N/m", ' + more),
        solve=dict(preset="coupled", duration="0.2 s", steps=100),
    ))  # fmt: skip
    if not meets:
        assert solved(scene).outcome.name == "COMPLETED"
        return
    with pytest.raises(SceneError, match=r"springs\.band\.between.*its points coincide at t = 0\.\d+ s"):
        solved(scene)
