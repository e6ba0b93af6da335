"""Loads spread along a body: closed forms of beams, buckling, and the weight of everything written as such a load."""

import math

import numpy as np
import pytest
from machines import machine, pendulum
from runs import alike
from scipy.optimize import brentq

import kaneflex
from kaneflex import Scene, SceneError, scene_of, with_settings
from kaneflex.solve.simulation import solve

L, E, I, A, RHO = 1.2, 2.1e11, 2e-9, 1e-4, 7850.0
BEAM = f"length = {L}, beam = {{E = {E}, rho = {RHO}, A = {A}, I = {I}, elements = 4}}"


def written(text, *settings) -> Scene:
    return with_settings(scene_of(text), list(settings))


def solved(text, *settings):
    return solve(kaneflex.load(written(text, *settings)))


FRAME = machine(
    ground=dict(far=[L, 0]), bodies=dict(bar=f"pose = {{}}, {BEAM}, points = {{spot = [{0.3 * L}, 0]}}"),
    loads=dict(press='spread_on = "bar", direction = [0, -1], value = "40 N/m", profile = PROFILE'),
    sensors=dict(tip="displacement bar.end y", mid="displacement bar.mid y", root_moment="bending_moment bar.start",
                 mid_moment="bending_moment bar.mid", spot_moment="bending_moment bar.spot",
                 spot_shear="shear_force bar.spot", left="joint_force left y"),
    solve=dict(preset="quasistatic", duration=1.0, steps=4),
)
CLAMPED = 'joints.left = {weld = ["ground", "bar.start"]}'
HINGED = 'joints.left = {revolute = ["ground", "bar.start"]}\njoints.right = {revolute = ["ground.far", "bar.end"]}'


@pytest.mark.parametrize(
    ("profile", "tip", "root", "total"),
    [([1, 1], 1 / 8, 1 / 2, 1.0), ([1, 0], 1 / 30, 1 / 6, 0.5), ([0, 1], 11 / 120, 1 / 3, 0.5)],
)
def test_cantilever(profile, tip, root, total):
    """Deflections and moments of the textbooks (e.g. Young & Budynas 2002, table 8.1)."""
    found = solved((FRAME + CLAMPED).replace("PROFILE", str(profile))).series
    w = 40.0
    assert found["tip"].values == pytest.approx(-tip * w * L**4 / (E * I), rel=1e-9)
    assert found["root_moment"].values == pytest.approx(-root * w * L**2, rel=1e-9)
    assert found["left"].values == pytest.approx(total * w * L, rel=1e-9)
    x, (p, q) = 0.3 * L, profile  # between two nodes: moment and shear of what lies beyond
    beyond = np.poly1d([w * (q - p) / L, w * p])
    shear = beyond.integ()(L) - beyond.integ()(x)
    arm = (beyond * np.poly1d([1.0, -x])).integ()
    assert found["spot_moment"].values == pytest.approx(-(arm(L) - arm(x)), rel=1e-9)
    assert found["spot_shear"].values == pytest.approx(-shear, rel=1e-9)


def test_simply_supported():
    found = solved((FRAME + HINGED).replace("PROFILE", "[1, 1]")).series
    assert found["mid"].values == pytest.approx(-5 / 384 * 40 * L**4 / (E * I), rel=1e-9)
    assert found["mid_moment"].values == pytest.approx(40 * L**2 / 8, rel=1e-9)


def test_a_column_buckles_under_its_own_weight_at_greenhills_load():
    """q L^3 / E I = 7.8373 for a load along a column with a free top (Greenhill 1881)."""
    text = machine(
        bodies=dict(column=f"{BEAM}"), joints=dict(foot="revolute ground column.start"), drives=dict(foot="speed = 0"),
        loads=dict(weight='spread_on = "column", direction = [-1, 0], axes = "body", value = "1 N/m"'),
        solve="duration = 1.0",
    )

    def lowest(load: float) -> float:
        scene = written(text, f"weight.value={load * E * I / L**3!r}", "column.elements=8")
        return float(np.linalg.eigvalsh(kaneflex.linearise(kaneflex.load(scene)).K)[0])

    assert brentq(lowest, 7.5, 8.2, xtol=1e-6) == pytest.approx(7.8373, rel=1e-4)


def test_the_torque_that_carries_a_load_around():
    """Of a rigid crank: int q X cos(phi) dX in fixed axes, int q X dX in the body's."""
    text = pendulum(
        'length = "0.5 m", mass = "1 kg"', 'speed = "60 rpm", cycle = "360 deg"', "crank", "main",
        loads='wind = {spread_on = "crank", direction = [0, -1], axes = "AXES", law = "20 + main", profile = [2, 0.5]}',
        sensors=dict(torque="drive_torque main"), solve=dict(preset="rigid"),
    )
    for axes in ("global", "body"):
        solution = solved(text.replace("AXES", axes))
        phi = solution.drive_angles["main"]
        arm = (20 + phi) * 0.5**2 * (2 + 2 * 0.5) / 6
        expected = arm * np.cos(phi) if axes == "global" else arm
        assert solution.series["torque"].values == pytest.approx(expected, rel=1e-12, abs=1e-12), axes


# Two arms, the first one rigid, the second one elastic, carry a rigid hand on a hinge that is driven, too.
ARM = machine(
    bodies=dict(upper='length = "0.6 m", mass = "1.5 kg"', lower=BEAM, hand='length = "0.2 m", mass = "0.3 kg"'),
    joints=dict(shoulder="revolute ground upper.start", elbow="revolute upper.end lower.start",
                wrist="weld lower.end hand.start"),
    drives=dict(shoulder='law = "0.5 * sin(2 * t)"', elbow='law = "-1 + 0.3 * cos(3 * t)"'),
    damping=dict(rayleigh=dict(ratio=0.05, at=[5, 60])),
    sensors=dict(tip_x="displacement lower.end x", tip_y="displacement lower.end y", hand_y="displacement hand.end y",
                 root="bending_moment lower.start", inside="bending_moment lower.mid", tension="axial_force lower.mid",
                 wrist_force="joint_force wrist y", torque_1="drive_torque shoulder", torque_2="drive_torque elbow"),
    solve=dict(duration="0.4 s", steps=800),
)
WEIGHTS = """
loads.w_1 = {spread_on = "upper", direction = [0, -1], value = 24.525}
loads.w_2 = {spread_on = "lower", direction = [0, -1], law = "LOWER"}
loads.w_3 = {spread_on = "hand", direction = [0, -1], value = 14.715}
"""


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(
    ("preset", "tolerance"),
    [("rigid", 1e-12), ("quasistatic", 1e-9), ("linear", 1e-8), ("stiffened", 1e-8), ("coupled", 1e-6)],
)
def test_weight_is_such_a_load(preset, tolerance):
    """Every sensor of an arm reads the same with gravity as with its weight spread along rigid and elastic bodies."""
    by_gravity = ARM + "gravity = [0, -9.81]"
    by_loads = ARM + WEIGHTS.replace("LOWER", repr(RHO * A * 9.81))
    settings = [f"solve.preset={preset}"]
    one, other = (solved(text, *settings).series for text in (by_gravity, by_loads))
    for name, series in one.items():
        there = series.values
        assert abs(other[name].values - there).max() <= tolerance * max(1e-9, abs(there).max()), name


def test_reduced_links_carry_it_too():
    text = ARM + WEIGHTS.replace("LOWER", "200 * sin(8 * t)")
    full, few = (solved(text, "solve.steps=1600", *more).series for more in ([], ["solve.modes=2"]))
    # From half of the run on: its beginning shakes modes that are left out.
    alike(few, full, 2e-3, ("tip_y", "root", "inside", "wrist_force"), after=800)


@pytest.mark.parametrize(("load", "message"), [
    ('spread_on = "arm", direction = [0, 1], value = 1', "loads.q.spread_on = 'arm': no body of that name. "),
    ('spread_on = "hub", direction = [0, 1], value = 1',
     "loads.q.spread_on = 'hub': hub has no length for a distributed load. Give the body a length."),
    ('spread_on = "bar", value = 1',
     "loads.q.direction: the force has no direction. Give it, like direction = [1, 0], in space [1, 0, 0]."),
    ('spread_on = "bar", direction = [0, 1], value = "1 N"',
     "loads.q.value = '1 N': 'N' is not a unit of force per length. Write a force per length like '100 N/m', "
     "or a plain number in N/m."),
    ('spread_on = "bar", direction = [0, 1], value = 1, profile = [0, 0]',
     "loads.q.profile = [0, 0]: the load is zero at both ends. Give two numbers, at least one not zero."),
    ('force_on = "bar", direction = [0, 1], value = 1, profile = [1, 0]',
     "loads.q.profile = [1, 0]: belongs to a distributed load. Leave it out."),
    ('force_on = "bar", spread_on = "bar", direction = [0, 1], value = 1',
     "loads.q: force_on and spread_on exclude each other. Give exactly one of force_on, torque_at, spread_on."),
])  # fmt: skip
def test_what_is_refused(load, message):
    text = machine(
        bodies=dict(hub="mass = 1", bar=BEAM), joints=dict(a="revolute ground hub", b="weld hub bar.start"),
        drives=dict(a="speed = 1"), loads=dict(q=load), solve=dict(duration=math.tau),
    )
    with pytest.raises(SceneError) as error:
        written(text)
    assert message in str(error.value)
