"""Scenes built in Exudyn, planar and in space: an independent nonlinear answer, and what can't be built there."""

import builtins
from importlib.metadata import EntryPoints
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import cli, refused
from machines import machine

from kaneflex import Comparison, SceneError, compare, read_scene, scene_of, with_settings
from kaneflex.solve.curves import Resolution
from kaneflex_peers.buildable import check_buildable, lumped
from kaneflex_peers.readings import PlanarRecorder


def compared(scene: str, *settings: str, elements: int, steps: int, presets=None) -> Comparison:
    changed = with_settings(read_scene(scene), list(settings))
    return compare(changed, presets, peer="exudyn", resolution=Resolution(elements, steps))


def shares(comparison: Comparison) -> dict[str, float]:
    """The largest difference of each sensor as a share of Exudyn's peak."""
    return {entry.sensor: entry.error for entry in comparison.differences}


@pytest.mark.exhaustive(group="plane", share=2)
def test_engine(peer):
    """-0.1464 and 0.0293 mm by both; what is left is the damping, which Exudyn has in proportion to K alone."""
    peer("exudyn")
    found = compared("engine", elements=4, steps=1440)
    assert found.against == "exudyn"
    tip, mid = (found.curves["exudyn"].values[name] for name in ("tip_axial", "mid_transverse"))
    assert tip.min() == pytest.approx(-0.1464e-3, abs=1e-7) and tip.max() == pytest.approx(0.0253e-3, abs=2e-7)
    assert mid.max() == pytest.approx(0.0293e-3, abs=1e-7)
    apart = shares(found)
    assert set(apart) == {*found.scene.sensors} - {"piston_side_force"} == set(found.curves["exudyn"].values)
    assert max(apart.values()) < 0.02
    assert all(apart[name] < 0.003 for name in ("tip_axial", "mid_transverse", "crank_pin_force_y", "crank_torque"))


@pytest.mark.exhaustive(group="plane", share=2)
def test_slider_crank_by_the_coupled_equations(peer):
    """At per cents of deflection coupled agrees to 0.3 %; stiffened is 6 % off. Its bending moment agrees to 2 %,
    though the rod rings undamped in tension.
    """
    peer("exudyn")
    settings = ("solve.duration=20 ms", "solve.steps=1500", "sensors.rod_force.axial_force=none")
    settings += ("sensors.rod_force.bending_moment=rod.mid",)
    found = compared("slider-crank-150", *settings, elements=12, steps=3000, presets=("stiffened", "coupled"))
    bend = {entry.model: entry.error for entry in found.differences if entry.sensor == "mid_transverse"}
    assert bend["coupled"] < 0.003 < 0.02 < bend["stiffened"]
    moment = {entry.model: entry.error for entry in found.differences if entry.sensor == "rod_force"}
    assert moment["coupled"] < 0.025 < 0.035 < moment["stiffened"]


@pytest.mark.exhaustive(group="plane", share=2)
def test_bending_of_a_pendulum_that_rings_in_tension(peer):
    """0.0613 N m at the middle of the strip in its first half second, by 16 elements and 4000 steps."""
    peer("exudyn")
    found = compared("elastic-pendulum", "solve.duration=0.5 s", "solve.steps=1000", elements=16, steps=4000)
    ours, theirs = (found.curves[name].values["mid_moment"] for name in ("coupled", "exudyn"))
    assert abs(ours).max() == pytest.approx(abs(theirs).max(), rel=1e-2)
    assert shares(found)["mid_moment"] < 0.03


@pytest.mark.exhaustive(group="plane", share=2)
def test_a_motor_starts_a_four_bar_with_an_elastic_coupler(peer):
    """Nonlinear in both: the motor's torque falls with the speed that it brings about."""
    peer("exudyn")
    apart = shares(compared("four-bar-motor", "solve.duration=0.3 s", "solve.steps=600", elements=8, steps=2400))
    assert apart["crank_speed"] < 1e-4 and apart["rocker_angle"] < 1e-5
    assert apart["coupler_mid"] < 3e-3 and apart["coupler_force"] < 0.01


@pytest.mark.exhaustive(group="plane", share=2)
def test_a_driven_elastic_link_is_held_by_a_hub(peer):
    """Spin-up, up to its largest deflection."""
    peer("exudyn")
    settings = ("solve.duration=8 s", "solve.steps=1600")
    apart = shares(compared("spin-up", *settings, elements=12, steps=1600))
    assert apart["tip_transverse"] < 0.005 and apart["hub_torque"] < 0.01 and apart["hub_angle"] < 1e-8


def test_lumped_masses_join_their_rigid_body():
    """Two equal masses at the ends of a bar: the centre stays, J grows by 2 m (l/2)^2."""
    settings = ["masses.a={at='crank.start', mass=1}", "masses.b={at='crank.end', mass=1, inertia=2e-3}"]
    scene = with_settings(read_scene("engine"), settings)
    mass, centre, inertia = lumped(scene, "crank")
    assert (mass, centre) == (pytest.approx(2.952), pytest.approx((0.02, 0.0)))
    assert inertia == pytest.approx(0.952 * 0.04**2 / 12 + 2 * 0.02**2 + 2e-3)


@pytest.mark.parametrize(("scene", "settings", "words"), [
    ("four-bar-motor", ("loads.motor.law=0.6 - main_speed**2",), ("loads.motor", "not linear in the speed")),
    ("four-bar-motor", ("loads.motor.law=0.6 - main_speed*t",), ("loads.motor", "of that joint alone")),
    ("four-bar-motor", ("loads.motor.law=0.6 - abs(main_speed)",), ("loads.motor", "not linear in the speed")),
    ("engine", ("bodies.rod.beam.theory=rayleigh",), ("bodies.rod.beam.theory", "rotary inertia")),
    ("engine", ("damping.rayleigh=none", "damping.modal={ratio=0.02}"), ("damping", "other than Rayleigh's")),
    ("engine", ("damping=none",), ("solve.start", "needs Rayleigh damping")),
    ("pin-ended-cross", (), ("a fixed structure",)),
])  # fmt: skip
def test_what_can_not_be_built_is_named(scene, settings, words):
    with pytest.raises(SceneError) as caught:
        check_buildable(with_settings(read_scene(scene), list(settings)))
    for word in words:
        assert word in str(caught.value)


def test_without_the_package_the_extra_is_named_and_nothing_runs(tmp_path, monkeypatch):
    original = builtins.__import__

    def without(name, *rest):
        if name == "exudyn":
            raise ModuleNotFoundError("No module named 'exudyn'", name="exudyn")
        return original(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    result = cli("compare", "engine", "--with", "exudyn", "-o", tmp_path / "out")
    refused(result, "exudyn is not installed", 'pip install "kaneflex[peer]"')
    refused(cli("compare", "engine", "--with", "adams", "-o", tmp_path / "out"), "--with = 'adams'", "Known: exudyn")
    monkeypatch.setattr("kaneflex.study.comparison.entry_points", lambda group: EntryPoints())
    refused(cli("compare", "engine", "--with", "exudyn", "-o", tmp_path / "out"), "pip install ./tests/peers")
    assert list(tmp_path.iterdir()) == []


def test_the_command_says_what_is_not_compared(peer, tmp_path):
    peer("exudyn")
    folder = tmp_path / "out"
    result = cli(
        "compare", "engine", "--with", "exudyn", "--peer-elements", 2, "--peer-steps", 360, "--steps", 180,
        "-o", folder,
    )  # fmt: skip
    assert result.exit_code == 0
    assert "exudyn: piston_side_force is not compared: the other program has no such sensor" in result.stderr
    assert "exudyn: 2 ANCF cable elements a link" in result.stderr
    assert np.all([(folder / name).stat().st_size > 0 for name in ("overlay.png", "curves.nc", "differences.csv")])


def test_an_axis_between_its_nodes_is_the_cubic_through_them():
    """Places and slopes of x = 1 - s + 2 s^2 - s^3, y = s^3 along it, from both at nodes that stand 0.5 m apart."""
    x, y = np.polynomial.Polynomial([1, -1, 2, -1]), np.polynomial.Polynomial([0, 0, 0, 1])
    at = lambda s: np.array([[f(s)] for f in (x, y, x.deriv(), y.deriv())])  # noqa: E731
    reader = SimpleNamespace(
        built=SimpleNamespace(nodes={"rod": [0, 1, 2]}), _size=lambda link: 0.5,
        _coordinates=lambda node, order: at(0.5 * node),
    )  # fmt: skip
    for s in (0.0, 0.2, 0.5, 0.85, 1.0):
        assert PlanarRecorder._along(reader, "rod", s) == pytest.approx(at(s), abs=1e-14), s


TURNING = machine(
    gravity=[0, 0, -9.81], ground=dict(hook=[0.3, 0.4, 0.9]),
    bodies=dict(post='length = "0.5 m", mass = "2 kg", centre = [0.2, 0.05, 0], '
                     'inertia = [0.02, 0.08, 0.09, 0.002, 0.001, -0.001], rotation = {x = [0, 0, 1]}',
                slide='length = "0.4 m", mass = "1 kg", centre = [0.2, 0, 0], inertia = [0.005, 0.02, 0.02]',
                paddle='length = "0.3 m", mass = "0.5 kg", inertia = [0.003, 0.006, 0.005]'),
    joints=dict(turn="revolute ground post.start, axis = [0, 0, 1]", guide="weld post.end slide.start",
                hinge="revolute slide.end paddle.start, axis = [0, 1, 1]"),
    drives=dict(turn='law = "3 * t + 0.5 * sin(4 * t)"',
                hinge='free = true, angle = "20 deg", initial_speed = "2 rad/s"'),
    loads=dict(wind='force_on = "paddle.end", axes = "body", direction = [0, 1, 0], '
                    'law = "1.5 + sin(6 * t) + 0.3 * hinge"',
               brake='torque_at = "hinge", law = "-0.05 * hinge_speed + 0.02 * turn"'),
    springs=dict(coil='torsional_at = "hinge", stiffness = 3, damping = 0.02, angle = "5 deg"',
                 rope='between = ["ground.hook", "paddle.end"], stiffness = 20, damping = 0.5, length = "0.2 m"'),
    sensors=dict(angle="position hinge angle", turning_rate="velocity hinge angle",
                 turning_accel="acceleration hinge angle", tip_x="position paddle.end x",
                 tip_v='velocity paddle.end z, axes = "body"',
                 tip_a='acceleration paddle.end y, reading = "accelerometer"', turning="velocity paddle angle_x",
                 spin="acceleration paddle angle_z", motor="drive_torque turn",
                 pin='joint_force hinge x, axes = "body"', base='joint_force turn z, body = "ground"',
                 base_moment="joint_force turn angle_x", tilting='joint_force guide angle_y, axes = "body"',
                 hinge_moment='joint_force hinge angle_z, body = "slide"', pull="spring_force rope",
                 twist="spring_torque coil"),
    solve=dict(preset="rigid", duration="0.5 s"),
)
SLIDING = machine(
    gravity=[0, 0, -9.81],
    bodies=dict(carriage='length = "0.4 m", mass = "2 kg", inertia = [0.02, 0.08, 0.09], rotation = {x = [0, 0, 1]}',
                bead='mass = "0.5 kg", inertia = [0.003, 0.004, 0.005]'),
    joints=dict(rail="prismatic ground carriage.start, direction = [1, 2, 2]",
                rod="cylindrical carriage.end bead, axis = [1, 0, 1]"),
    drives=dict(rail='law = "0.1 + 0.05 * sin(6 * t)"', rod="free = true"),
    loads=dict(push='force_on = "bead", direction = [1, 0, 0], law = "1 + 20 * rail - rail_speed"'),
    springs=dict(rope='between = ["carriage", "bead"], stiffness = 20, damping = 0.5, length = "0.2 m"'),
    sensors=dict(out="position rail x", along="position rod x", along_rate="velocity rod x", bead_x="position bead x",
                 bead_z="position bead z", push="drive_force rail", pin="joint_force rod y",
                 rail_moment='joint_force rail angle_z, body = "ground"', pull="spring_force rope"),
    solve=dict(preset="rigid", duration="0.5 s"),
)


def shares_in_space(scene, steps):
    """Difference of each sensor as a share of Exudyn's peak: the largest of places and velocities, the root of the
    mean square of accelerations and forces, which swing there from step to step at first and after Newton's skips."""
    found = compare(scene, peer="exudyn", resolution=Resolution(None, steps)).curves
    ours, theirs = found["rigid"], found["exudyn"]
    shares_in_space = {}
    for name, values in theirs.values.items():
        apart = abs(np.interp(theirs.times, ours.times, ours.values[name]) - values)[len(theirs.times) // 10 :]
        moves = scene.sensors[name].kind in ("position", "velocity")
        shares_in_space[name] = (apart.max() if moves else np.sqrt((apart**2).mean())) / abs(values).max()
    return shares_in_space


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "steps", "motion", "force"), [
    ("robot-arm", 2000, 1e-10, 2e-3), ("bricard", 8000, 1e-7, None), ("spatial-slider-crank", 8000, 3e-5, 2e-4),
    ("spinning-top", 8000, 2e-3, 5e-3),
])  # fmt: skip
def test_shipped_scenes(peer, name, steps, motion, force):
    """What is left is Exudyn's step error, which for the top falls to a sixteenth with a quarter of the step."""
    peer("exudyn")
    scene = read_scene(name)
    found = shares_in_space(scene, steps)
    assert set(found) == set(scene.sensors)
    for sensor, share in found.items():
        assert share < (motion if scene.sensors[sensor].kind in ("position", "velocity") else force), sensor


@pytest.mark.exhaustive(group="space", share=3)
def test_drives_loads_and_springs(peer):
    """A driven post carries a paddle on a hinge with full inertias: loads that turn with bodies and know its motion,
    springs of both kinds, all motions, accelerations, forces and moments."""
    peer("exudyn")
    scene = with_settings(scene_of(TURNING), ["solve.duration=0.1 s"])
    found = shares_in_space(scene, 200)
    assert set(found) == set(scene.sensors)
    assert all(found[name] < 2e-5 for name in ("angle", "turning_rate", "tip_x", "tip_v", "pull", "twist"))
    assert all(share < 3e-3 for share in found.values())


@pytest.mark.exhaustive(group="space", share=3)
def test_slides(peer):
    peer("exudyn")
    scene = scene_of(SLIDING)
    found = shares_in_space(scene, 1000)
    assert set(found) == set(scene.sensors)
    assert all(found[name] < 1e-5 for name in ("out", "along", "along_rate", "bead_x", "bead_z"))
    assert all(found[name] < 1e-5 for name in ("push", "pin", "rail_moment", "pull"))


@pytest.mark.exhaustive(group="space", share=3)
def test_moments_of_all_kinds_of_joints(peer):
    """A universal joint, here askew, holds one turn, a guide all of them; the shaft's crank turns freely about its x
    axis alone."""
    peer("exudyn")
    asked = {"cross": "xyz", "guide": "xyz", "shaft": "yz"}
    sensors = [f'sensors.{joint}_{axis} = {{joint_force = "{joint}", component = "angle_{axis}"}}'
               for joint, axes in asked.items() for axis in axes]  # fmt: skip
    askew = "joints.cross = {axes = [[0, 2, -1], [1, 0, 0]]}"
    text = "\n".join(['schema = 1\nlike = "spatial-slider-crank"', askew, *sensors])
    found = shares_in_space(scene_of(text), 4000)
    assert {f"{joint}_{axis}" for joint, axes in asked.items() for axis in axes} < set(found)
    assert all(share < 2e-3 for share in found.values())


CARRIED = machine(
    gravity=[0, 0, -9.81],
    bodies=dict(post='length = "0.4 m", mass = "2 kg", inertia = [0.02, 0.08, 0.09], rotation = {x = [0, 0, 1]}',
                bead='mass = "0.5 kg", inertia = [0.003, 0.004, 0.005]'),
    joints=dict(turn="revolute ground post.start, axis = [0, 1, 1]",
                rail="prismatic post.end bead, direction = [1, 2, 2]"),
    drives=dict(turn='free = true, initial_speed = "3 rad/s"', rail='law = "0.1 + 0.05 * sin(6 * t)"'),
    sensors=dict(out="position rail x", angle="position turn angle", bead_x="position bead x", push="drive_force rail",
                 pin="joint_force rail y", rail_moment="joint_force rail angle_z"),
    solve=dict(preset="rigid", duration="1 s"),
)


@pytest.mark.exhaustive(group="space", share=3)
def test_a_drive_along_a_guide_that_moves(peer, exhaustive):
    """What the drive exerts acts on the carrier where the bead is; the error falls with the step."""
    peer("exudyn")
    scene = scene_of(CARRIED)
    fine, coarse = shares_in_space(scene, 4000), shares_in_space(scene, 1000) if exhaustive else {}
    assert fine["out"] < 1e-9 and all(fine[name] < 2e-3 for name in scene.sensors)
    assert all(fine[name] < 2e-4 and 3 * fine[name] < coarse.get(name, 1.0) for name in ("angle", "bead_x"))


def elastic_shares(scene, elements, steps):
    """Largest difference of each sensor over one cycle as a share of Exudyn's peak."""
    found = compare(scene, peer="exudyn", resolution=Resolution(elements, steps))
    assert not found.curves["exudyn"].missing
    return {each.sensor: each.peak_difference / each.reference_peak for each in found.differences}


CANTILEVER = machine(
    gravity=[0, 0, -9.81],
    bodies=dict(arm='length = "0.4 m", rotation = {x = [1, 2, 2], y = [2, 1, -2]}, beam.E = "70 GPa", beam.nu = 0.33, '
                    'beam.rho = "2700 kg/m^3", beam.section = {rectangle = ["12 mm", "8 mm"]}, '
                    'beam.theory = "timoshenko", beam.elements = 4',
                fork='length = "0.2 m", mass = "0.3 kg", centre = [0.1, 0.02, 0], inertia = [1e-4, 1e-3, 1e-3], '
                     'rotation = {x = [2, 1, -2], y = [-2, 2, -1]}'),
    joints=dict(turn="revolute ground arm.start, axis = [0, 0, 1]", root="weld arm.end fork.start"),
    drives=dict(turn='speed = "60 rpm", cycle = "360 deg"'),
    loads=dict(push='force_on = "fork.end", direction = [0, 1, 1], value = "1 N"'),
    damping=dict(rayleigh=dict(ratio=0.2, at=["15 Hz", "40 Hz"])),
    sensors=dict(lag="displacement arm.end y", flap="displacement arm.end z", tip="displacement fork.end z",
                 twist="displacement arm.end angle_x", slope='displacement arm.mid angle_y, relative_to = "chord"',
                 torsion="torsional_moment arm.mid", shear="shear_force arm.mid z", pull="axial_force arm.start",
                 bent="bending_moment arm.start y", gauge='strain arm.mid, fibre = ["4 mm", "-5 mm"]',
                 place="position fork.end x", speed="velocity arm.end z", accel='acceleration arm.end x, axes = "body"',
                 moment='joint_force root angle_x, axes = "body"', motor="drive_torque turn"),
    solve=dict(preset="stiffened", start="periodic"),
)


@pytest.mark.exhaustive(group="beams", share=4)
def test_sections_rotations_and_rates_of_an_elastic_arm(peer, exhaustive):
    """A heavy fork across the tip of an arm that turns bends it both ways and twists it. The moments that
    displaced forces have, which one-way coupling leaves out, fall with the displacements of an arm eight times stiffer.
    """
    peer("exudyn")
    stiff = elastic_shares(scene_of(CANTILEVER.replace("70 GPa", "560 GPa")), 8, 180)
    assert len(stiff) == 15 and all(share < (0.04 if name == "slope" else 0.02) for name, share in stiff.items())
    if exhaustive:
        soft = elastic_shares(scene_of(CANTILEVER), 8, 180)
        assert all(4 * stiff[each] < soft[each] < 0.06 for each in ("motor", "moment", "shear", "place"))


@pytest.mark.exhaustive(group="beams", share=4)
def test_an_elastic_rod_in_space(peer, exhaustive):
    """It bends both ways by some 3e-4 of its length; what is left in the displacements falls with the square of
    Exudyn's elements' size, and is none of the forces'."""
    peer("exudyn")
    scene = with_settings(read_scene("spatial-slider-crank-elastic"), ["drives.shaft.speed=300 rpm"])
    fine = elastic_shares(scene, 12, 180)
    assert set(fine) == set(scene.sensors)
    assert fine["slider_x"] < 1e-7 and fine["rod_force"] < 4e-3
    assert fine["side_force"] < 1e-3 and fine["crank_torque"] < 1e-3
    coarse = elastic_shares(scene, 6, 180) if exhaustive else {}
    for sensor in ("mid_y", "mid_z", "rod_moment"):
        assert fine[sensor] < 0.02 and fine[sensor] < 0.3 * coarse.get(sensor, 1.0), sensor


@pytest.mark.exhaustive(group="beams", share=4)
def test_links_that_bend_more_are_further_apart(peer, exhaustive):
    """The follower of the four-bar bends by 1 % of its length at 300 rpm and by 0.1 % at 100 rpm, where what is left in
    displacements is the size of Exudyn's elements."""
    peer("exudyn")
    scene = read_scene("four-bar-misaligned")
    slow = elastic_shares(with_settings(scene, ["drives.main.speed=100 rpm"]), 8, 180)
    assert slow["out_of_plane"] < 5e-5 and slow["follower_moment"] < 0.01 and slow["crank_torque"] < 5e-3
    assert slow["coupler_mid"] < 0.03 and slow["follower_mid"] < 0.03
    if exhaustive:
        fast = elastic_shares(scene, 8, 180)
        assert fast["coupler_mid"] < 0.05 and fast["follower_mid"] < 0.05
        assert all(2 * slow[each] < fast[each] for each in ("out_of_plane", "follower_moment", "crank_torque"))


@pytest.mark.exhaustive(group="beams", share=4)
def test_a_four_bar_that_bends_back_on_its_motion_is_that_of_exact_rods(peer, exhaustive):
    """From rest to 1 % of its links' lengths, undamped: what is left under preset coupled is the size of Exudyn's
    elements, squared. Its coupler hangs on a universal joint, its follower on a pin that is none of its axes."""
    peer("exudyn")
    settings = ["solve.preset=coupled", "solve.modes=5", "damping=none", "sensors.follower_moment=none"]
    settings += ["solve.start=zero", "solve.duration=9 ms", "solve.steps=36"]
    scene = with_settings(read_scene("four-bar-misaligned"), settings)
    fine, coarse = elastic_shares(scene, 16, 80), elastic_shares(scene, 8, 40) if exhaustive else {}
    for sensor in ("coupler_mid", "follower_mid"):
        assert fine[sensor] < 4e-3 and 3 * fine[sensor] < coarse.get(sensor, 1.0), sensor
    assert fine["out_of_plane"] < 3e-3


@pytest.mark.parametrize(("given", "instead", "names"), [
    ('rayleigh = {ratio = 0.2, at = ["15 Hz", "40 Hz"]}', "modal = {ratio = 0.02}", ["damping", "solve.start"]),
    ('cycle = "360 deg"}', 'cycle = "360 deg", rotation = "free"}', ["drives.turn.rotation"]),
])  # fmt: skip
def test_what_has_no_counterpart_in_space(given, instead, names):
    scene = scene_of(CANTILEVER.replace(given, instead))
    with pytest.raises(SceneError) as refused:
        check_buildable(scene)
    assert [problem.key for problem in refused.value.problems] == names
