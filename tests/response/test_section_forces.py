"""Section forces and elastic-consistent reactions: in balance in every preset, and against independent models."""

from dataclasses import replace

import numpy as np
import pytest
from lifting import lifted
from machines import cantilever, changed, machine
from rigid_bars import hanging_chain
from runs import solved

import kaneflex
from kaneflex import read_scene, scene_of
from kaneflex.mechanism.affine import as_array
from kaneflex.response.reactions import least_squares
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.sensors import Sensor

MASS_AT_THE_TIP = cantilever(
    'length = "300 mm", beam = {material = "steel", section = {rectangle = ["8 mm", "12 mm"]}, elements = 6}', "arm",
    "wall", gravity=[0, -9.81], masses='tip = {at = "arm.end", mass = "0.3 kg", inertia = "1e-4 kg m^2"}',
    loads='push = {force_on = "arm.end", direction = [0, 1], law = "20"}',
    sensors="""
root_moment = {bending_moment = "arm.start"}
root_shear = {shear_force = "arm.start"}
tip_moment = {bending_moment = "arm.end"}
tip_shear = {shear_force = "arm.end"}
tip_feels = {acceleration = "arm.end", component = "y", axes = "global", reading = "accelerometer"}
tip_turns = {acceleration = "arm.end", component = "angle"}
wall_moment = {joint_force = "wall", component = "angle"}
wall_force = {joint_force = "wall", component = "y"}""",
    solve={"preset": "coupled", "start": "zero", "duration": "20 ms", "steps": 400},
)


def test_lumped_masses_push_with_the_acceleration_of_the_deflected_axis():
    """The root carries what the wall exerts; 9.9 N m by the one-way equations, too, of which 4.8 N m are static.

    The tip carries what the mass feels there: force m (a - g), moment J epsilon.
    """
    scene = scene_of(MASS_AT_THE_TIP)
    found = {name: series.values for name, series in solved(scene).series.items()}
    assert found["root_moment"] == pytest.approx(-found["wall_moment"], abs=1e-9)
    assert found["root_shear"] == pytest.approx(-found["wall_force"], abs=1e-9)
    assert found["tip_shear"] == pytest.approx(20 - 0.3 * found["tip_feels"], abs=1e-9)
    assert found["tip_moment"] == pytest.approx(-1e-4 * found["tip_turns"], abs=1e-9)
    one_way = solved(scene, "solve.preset=stiffened", "solve.integrator=generalised-alpha").series["root_moment"].values
    assert found["root_moment"].max() == pytest.approx(one_way.max(), rel=3e-3)


def strip_moment(modes):
    """Times and bending moment at the middle of the pendulum in its first 0.3 s."""
    settings = (f"solve.modes={modes}", "solve.duration=0.3 s", "solve.steps=1200")
    solution = solved(read_scene("elastic-pendulum"), *settings)
    return solution.times[::4], solution.series["mid_moment"].values[::4]


def test_bending_of_a_strip_that_rings_in_tension_is_that_of_a_chain_of_rigid_bars():
    """Twenty bars with springs E I / h at their pins, which can't ring: 0.0618 N m at the largest, as forty say.

    What is left has the frequencies of the bending modes that the shapes don't hold.
    """
    E_I, rho_A = 2.1e11 * 10e-3 * 1.5e-3**3 / 12, 7850.0 * 15e-6
    times, three = strip_moment(3)
    seven = strip_moment(7)[1]
    _, moments = hanging_chain(20, 1.0, rho_A, E_I, -np.pi / 6, 9.81, times)
    expected = moments[9]
    peak = abs(expected).max()
    assert peak == pytest.approx(0.0618, rel=2e-3)
    for found in (three, seven):
        assert abs(found).max() == pytest.approx(peak, rel=5e-3)
        assert abs(found - expected).max() < 0.025 * peak
        assert np.sqrt(np.mean((found - expected) ** 2)) < 0.008 * peak


def test_bending_in_space_leaves_out_what_rings_as_in_the_plane():
    """The same strip turned in space; with the accelerations of its axial vibration it would be 2 % more."""
    flat = read_scene("elastic-pendulum")
    settings = ("solve.modes=3", "solve.duration=0.3 s", "solve.steps=300")
    plane, space = (solved(scene, *settings) for scene in (flat, scene_of(lifted(flat) | {"solve": flat.raw["solve"]})))
    (name,) = (name for name in space.series if name.endswith("mid_moment"))
    moments = plane.series["mid_moment"].values
    assert space.series[name].values == pytest.approx(moments, abs=2e-6 * abs(moments).max())


CASES = [
    *((name, preset) for name in ("engine-elastic-crank", "quick-return", "two-link-arm")
      for preset in ("rigid", "quasistatic", "linear", "stiffened")),
    *((name, "stiffened") for name in ("engine-3", "four-bar", "rotating-cantilever", "six-bar")),
    *((name, "coupled") for name in ("elastic-double-pendulum", "four-bar-motor", "slider-crank-150")),
]  # fmt: skip
"""Scenes with joints that stand alone at the end of an elastic link; in space see ``test_spatial_elastic``."""


def at_joints(scene):
    """(joint, link, point, sign) of every joint at the end of an elastic link where nothing else acts."""
    busy = [load.force_on for load in scene.forces.values()] + [mass.at for mass in scene.masses.values()]
    busy += [end for spring in scene.springs.values() for end in spring.ends]
    turned = [load.torque_at for load in scene.torques.values()] + [s.torsional_at for s in scene.springs.values()]
    busy += [address for joint in turned if joint is not None for address in scene.joints[joint].addresses]
    for name, joint in scene.joints.items():
        for address, sign in zip(joint.addresses, (-1.0, 1.0), strict=True):
            alone = sum(address in other.addresses for other in scene.joints.values()) == 1
            elastic = address.body in scene.bodies and scene.bodies[address.body].elastic
            if elastic and alone and address.point in ("start", "end") and address not in busy:
                yield name, address, sign


GUIDE = machine(
    ground=dict(pivot=["100 mm", "40 mm"]),
    bodies=dict(arm='length = "400 mm", beam = {material = "steel", A = "100 mm^2", I = "2000 mm^4", elements = 2}',
                block='mass = "0.3 kg", inertia = "1e-4 kg m^2"', rod='length = "250 mm", mass = "1 kg"'),
    joints=dict(main="revolute ground arm.start", wrist="revolute rod.end block",
                foot="revolute ground.pivot rod.start",
                slot='prismatic arm.start block, direction = [1, 0], branch = "+"'),
    drives=dict(main='speed = "20 rad/s", cycle = "360 deg"'),
    sensors=dict(free_end="bending_moment arm.end", torque="drive_torque main"), solve='preset = "rigid"',
)


def test_a_beam_with_a_guide_is_pushed_where_the_slider_is():
    """Nothing acts at its free end."""
    series = solved(scene_of(GUIDE)).series
    assert np.abs(series["torque"].values).max() > 5
    assert np.abs(series["free_end"].values).max() < 1e-12


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "preset"), CASES)
def test_section_forces_at_a_joint_are_the_joints_reaction(name, preset):
    """In every preset, forces and moments alike."""
    scene = read_scene(name)
    joints = list(at_joints(scene))
    assert joints
    settings = () if preset == "coupled" else ("solve.modes=all",)
    solution = solved(scene, f"solve.preset={preset}", "solve.start=zero", "solve.steps=12", *settings)
    if preset in ("linear", "stiffened"):
        solution = accelerated_by_its_equations(solution)
    for joint, address, sign in joints:
        link, towards = address.body, (1.0 if address.point == "end" else -1.0)
        found = [values(solution, **{kind: address}) for kind in ("axial_force", "shear_force", "bending_moment")]
        force = [values(solution, joint_force=joint, component=k) for k in ("x", "y")]
        moment = values(solution, joint_force=joint, component="angle")
        if scene.joints[joint].kind == "revolute" and joint in scene.drives:
            moment = values(solution, drive_torque=joint)
        c, s = axes_of(solution, link)
        exerted = [c * force[0] + s * force[1], c * force[1] - s * force[0], moment]
        forces = max(abs(part).max() for part in (*found[:2], *force)) or 1.0
        for here, there, scale in zip(found, exerted, (1.0, 1.0, scene.bodies[link].length), strict=True):
            assert here == pytest.approx(towards * sign * there, abs=1e-6 * forces * scale), (joint, str(address))


def values(solution, **sensor):
    return sensor_values(solution.motion, Sensor.model_validate(sensor))


def axes_of(solution, link):
    """cos and sin of the axes in which a link's section forces are given."""
    if solution.model.coupled is None:
        return solution.rigid[f"{link}.c"], solution.rigid[f"{link}.s"]
    phi = solution.motion.moving.body(link)[0][2]
    return np.cos(phi), np.sin(phi)


def accelerated_by_its_equations(solution):
    """The same states with z'' of M z'' = F - C z' - K z at each instant, instead of the integrator's own."""
    kept, rigid, (z, v, _) = solution.model.kept, solution.rigid, solution.coordinates
    push = rigid.column_of(kept["F"]) - rigid.apply(kept["C"], v) - rigid.apply(kept["K"], z)
    M = sum(rigid.monomial(monomial)[:, None, None] * as_array(part) for monomial, part in kept["M"].terms.items())
    a = np.linalg.solve(M, push.T[..., None])[..., 0]
    return replace(solution, trajectory=replace(solution.trajectory, a=a))


LEVER = machine(
    gravity=[0, 0],
    bodies=dict(lever='length = "1 m", beam = {material = "steel", section = {rectangle = ["20 mm", "20 mm"]}}'),
    joints=dict(pivot="revolute ground lever.mid"), drives=dict(pivot='law = "0 * t"'),
    loads=dict(push='force_on = "lever.end", direction = [0.6, 0.8], value = 20'),
    sensors=dict(force_x="joint_force pivot x", force_y="joint_force pivot y", torque="drive_torque pivot",
                 moment="joint_force pivot angle", N="axial_force lever.mid", V="shear_force lever.mid",
                 M="bending_moment lever.mid", N_behind='axial_force lever.mid, cut = "after"',
                 V_behind='shear_force lever.mid, cut = "after"', M_behind='bending_moment lever.mid, cut = "after"',
                 bent='strain lever.mid, fibre = "10 mm", cut = "after"'),
    solve=dict(start="quasistatic", duration="1 s", steps=4),
)
IN_SPACE = {
    "gravity = [0, 0]": "gravity = [0, 0, 0]", "[0.6, 0.8]": "[0.6, 0.8, 0]",
    '["ground", "lever.mid"]}': '["ground", "lever.mid"], axis = [0, 0, 1]}',
    "shear_force = \"lever.mid\"": "shear_force = \"lever.mid\", component = \"y\"",
    "bending_moment = \"lever.mid\"": "bending_moment = \"lever.mid\", component = \"z\"",
    'fibre = "10 mm"': 'fibre = ["10 mm", 0]',
    'component = "angle"': 'component = "angle_z"',
}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("in_space", [False, True], ids=["plane", "space"])
@pytest.mark.parametrize("preset", ["rigid", "quasistatic", "stiffened", "coupled"])
def test_section_forces_jump_where_something_acts(preset, in_space):
    """Nothing pulls at the half before the pivot, all at the half behind it; the mean of both is nowhere."""
    text = LEVER
    for plane, space in IN_SPACE.items() if in_space else ():
        text = text.replace(plane, space)
    solution = solved(scene_of(text), f"solve.preset={preset}")
    found = {name: series.values for name, series in solution.series.items()}
    np.testing.assert_allclose(found["moment"], found["torque"], rtol=0, atol=1e-9)
    for name in ("N", "V", "M"):
        np.testing.assert_allclose(found[name], 0.0, atol=2e-7)
    for name, reaction in (("N", "force_x"), ("V", "force_y"), ("M", "torque")):
        np.testing.assert_allclose(found[f"{name}_behind"], -found[reaction], rtol=0, atol=2e-5)
    assert found["N_behind"] == pytest.approx(12.0, rel=1e-3) and found["M_behind"] == pytest.approx(8.0, rel=5e-3)
    strain = found["N_behind"] / (210e9 * 4e-4) - 0.01 * found["M_behind"] / (210e9 * 0.02**4 / 12)
    assert found["bent"] == pytest.approx(strain, rel=2e-2)
    said = [each for each in solution.model.warnings if "cut" in each]
    told = 'is measured just before lever.mid, where a force acts: give cut = "before" or "after"'
    assert said == [f"{name} {told}" for name in "NVM"]


def test_a_force_beside_the_axis_of_a_rigid_beam_bends_it_by_its_arm():
    """Of F = (12, 16) N at (250, 100) mm from the pivot: 0.25 * 16 - 0.1 * 12 = 2.8 N m there, none at the free end."""
    section = '{rectangle = ["20 mm", "20 mm"]}}'
    text = LEVER.replace(section, f'{section}, points = {{side = ["750 mm", "100 mm"]}}').replace(
        'force_on = "lever.end"', 'force_on = "lever.side"'
    ).replace("solve = {", 'sensors.tip = {bending_moment = "lever.end"}\nsolve = {preset = "rigid", ')
    found = {name: series.values for name, series in solved(scene_of(text)).series.items()}
    np.testing.assert_allclose(found["tip"], 0.0, atol=1e-12)
    np.testing.assert_allclose(found["M_behind"], 2.8, rtol=1e-12)


@pytest.mark.parametrize(("sensor", "place", "words"), [
    ('{shear_force = "lever.end", cut = "after"}', "sensors.odd.cut", "the end has a section on one side only"),
    ('{displacement = "lever.mid", cut = "after"}', "sensors.odd.cut", "does not apply to displacement"),
], ids=["end", "displacement"])  # fmt: skip
def test_a_cut_that_means_nothing_is_refused(sensor, place, words):
    with pytest.raises(kaneflex.SceneError, match=words) as raised:
        scene_of(f"{LEVER}sensors.odd = {sensor}")
    assert place in str(raised.value)


def test_unknowns_that_stand_alone_change_no_least_squares():
    random, instants = np.random.default_rng(3), 5
    rows = [
        {0: 1.0, 1: random.normal(size=instants)},  # 0 is constant here, and nowhere else
        {1: 2.0, 2: -1.0},
        {1: random.normal(size=instants), 2: 0.5, 3: random.normal(size=instants)},  # 3 is alone, but varies
        {2: 1.0},
        {4: -2.0, 2: random.normal(size=instants)},
        {},
    ]
    right = random.normal(size=(len(rows), instants))
    found = least_squares(rows, right)
    for t in range(instants):
        matrix = np.zeros((len(rows), 5))
        for row, coefficients in enumerate(rows):
            for unknown, value in coefficients.items():
                matrix[row, unknown] = np.broadcast_to(value, instants)[t]
        expected = np.linalg.lstsq(matrix, right[:, t], rcond=None)[0]
        assert [found[k][t] for k in range(5)] == pytest.approx(expected, rel=1e-12)


BEAM = 'beam = {material = "steel", A = "100 mm^2", I = "2000 mm^4", elements = '
SWINGING = changed(
    GUIDE, (f'"400 mm", {BEAM}2}}', '"200 mm", mass = "1 kg"'), ('"250 mm", mass = "1 kg"', f'"250 mm", {BEAM}1}}'),
    ('sensors.free_end = {bending_moment = "arm.end"}\n', ""), ("rigid", "quasistatic"),
) + """
sensors.bearing = {joint_force = "main", component = "x"}
sensors.slot = {joint_force = "slot", component = "y"}
sensors.slot_x = {joint_force = "slot", component = "x"}
sensors.foot = {joint_force = "foot", component = "y"}
"""


def test_a_guide_on_a_moving_body_is_pushed_where_the_slider_is():
    """A block that slides along a driven arm: its push has a lever about the arm's bearing."""
    solution = solved(scene_of(SWINGING))
    for name in ("torque", "bearing", "slot", "foot"):
        rigid = solution.series[f"{name}_rigid"].values
        # At 20 rad/s the rod is as good as rigid.
        assert solution.series[name].values == pytest.approx(rigid, abs=1e-4 * np.abs(rigid).max()), name
    assert np.abs(solution.series["torque_rigid"].values).max() > 1
    along = solution.rigid["arm.c"] * solution.series["slot_x"].values
    along += solution.rigid["arm.s"] * solution.series["slot"].values
    assert np.abs(along).max() < 1e-12 * np.abs(solution.series["slot"].values).max()  # nothing along the guide
