"""Bodies without mass or inertia under preset coupled: what hangs on them moves them, or the error names them."""

import numpy as np
import pytest
from lifting import lifted
from machines import STRIP, WEIGHT, four_bar, pendulum
from runs import solved
from scipy.integrate import solve_ivp

import kaneflex
from kaneflex import SceneError, scene_of
from kaneflex.integrate.outcome import Outcome
from kaneflex.solve.simulation import solve

FOUR_BAR = four_bar(
    'length = "0.1 m", mass = "0.2 kg"', STRIP, 'length = "0.25 m"', "free = true, angle = 1.0", "P", names="ABCD",
    more={"C": 'branch = "+"'}, gravity=WEIGHT, ground={"P": ["0.28 m", 0]},
    sensors='psi = {position = "D", component = "angle"}',
    solve={"preset": "coupled", "duration": "0.02 s", "steps": 50},
)  # fmt: skip
PUCK = """
schema = 1
bodies.puck = {mass = "1 kg", free = {velocity = [1, 0]}}
solve = {preset = "coupled", duration = "1 s"}
"""


def bar(size):
    """A bar on a hinge, of any size and in its own time, the root of its length."""
    return pendulum(
        f"length = {size}, mass = {size**3}", "free = true, angle = 0", hinge="A", gravity=WEIGHT,
        sensors='phi = {position = "A", component = "angle"}',
        solve={"preset": "coupled", "duration": 0.3 * size**0.5, "steps": 10},
    )


def load(text):
    return kaneflex.load(scene_of(text))


@pytest.mark.parametrize("drive", ["{free = true, angle = 1.0}", '{law = "1 + 0.3 * sin(20 * t)"}'])
def test_a_massless_rocker_moves_as_one_of_next_to_no_mass(drive):
    text, found = FOUR_BAR.replace("{free = true, angle = 1.0}", drive), []
    for rocker in ('{length = "0.25 m"}', '{length = "0.25 m", mass = "1e-7 kg"}'):
        solution = solve(load(text.replace('{length = "0.25 m"}', rocker)))
        assert solution.outcome is Outcome.COMPLETED, solution.message
        found.append(solution.series["psi"].values)
        assert np.isfinite(solution.stresses["coupler"].mises).all()
    assert found[0] == pytest.approx(found[1], abs=1e-7)


def test_two_massless_cranks_are_named():
    text = FOUR_BAR.replace(', mass = "0.2 kg"', "")
    with pytest.raises(SceneError, match=r"bodies\.rocker\.mass = 0: rocker moves at D: .* Give it one"):
        load(text)


def test_a_free_body_without_inertia_is_named():
    with pytest.raises(SceneError, match=r"bodies\.puck\.inertia = 0: puck turns freely: .* Give it one"):
        load(PUCK)
    light = PUCK.replace('"1 kg"', '"1 kg", inertia = "1e-9 kg m^2"')
    load(light.replace("velocity", "at = [1000, 1000], velocity"))


def test_a_bar_of_a_tenth_of_a_micrometre_is_no_massless_one():
    """Nor one of a kilometre: as one of a metre, in its own time, the root of its length."""
    found = [solve(load(bar(size))).series["phi"].values for size in (1e-7, 1.0, 1e3)]
    assert found[0] == pytest.approx(found[1], abs=1e-7) and found[2] == pytest.approx(found[1], abs=1e-7)


YOKE = """
schema = 1
bodies.crank = {length = "50 mm", mass = "1 kg"}
bodies.block = {}
bodies.yoke = {mass = "2 kg"}
joints.main = {revolute = ["ground", "crank"]}
joints.rail = {prismatic = ["ground", "yoke"], direction = [1, 0]}
joints.slot = {prismatic = ["yoke", "block"], direction = [0, 1]}
joints.pin = {revolute = ["crank.end", "block"]}
drives.main = DRIVE
sensors.phi = {position = "main", component = "angle"}
sensors.x = {position = "yoke", component = "x"}
sensors.T = {drive_torque = "main"}
sensors.N = {joint_force = "slot", component = "x"}
solve = {preset = "coupled", tolerance = 1e-9}
"""


def test_a_massless_block_in_a_guide_turns_with_it():
    """A Scotch yoke: the loop alone says how its block turns. m x'' pulls at the slot, r sin(phi) from the main pin."""
    found = solve(load(YOKE.replace("DRIVE", '{speed = "600 rpm", cycle = "360 deg"}'))).series
    phi, force = np.ravel(found["phi"].values), 2.0 * 0.05 * (20 * np.pi) ** 2
    assert np.ravel(found["x"].values) == pytest.approx(0.05 * np.cos(phi), abs=1e-12)
    assert abs(np.ravel(found["N"].values)) == pytest.approx(force * abs(np.cos(phi)), abs=1e-9 * force)
    torque = 0.05 * force * np.sin(phi) * np.cos(phi)
    assert np.ravel(found["T"].values) == pytest.approx(torque, abs=1e-9 * 0.05 * force)


def test_a_massless_block_of_a_free_crank_resists_nothing():
    """(I + m r^2 sin^2(phi)) phi'' + m r^2 sin(phi) cos(phi) phi'^2 = 0."""
    text = YOKE.replace("DRIVE", '{free = true, angle = 0.4, initial_speed = "20 rad/s"}')
    text = text.replace('sensors.T = {drive_torque = "main"}\n', "")
    text = text.replace("tolerance = 1e-9", 'tolerance = 1e-9, duration = "0.5 s", steps = 100')
    found = solve(load(text))
    of_yoke = 2.0 * 0.05**2

    def rates(t, y):
        sine, cosine = np.sin(y[0]), np.cos(y[0])
        return [y[1], -of_yoke * sine * cosine * y[1] ** 2 / (0.05**2 / 3 + of_yoke * sine**2)]

    exact = solve_ivp(rates, (0.0, 0.5), [0.4, 20.0], "DOP853", np.asarray(found.times), rtol=1e-12, atol=1e-12)
    assert np.ravel(found.series["phi"].values) == pytest.approx(exact.y[0], abs=1e-7)


def test_a_massless_coupler_moves_in_space_as_in_the_plane():
    """Nothing but the loop gives its joint an inertia, on which the recursion over the tree divides."""
    text = FOUR_BAR.replace(', beam = {material = "steel", section = {rectangle = ["4 mm", "20 mm"]}}', "")
    text = text.replace('rocker = {length = "0.25 m"}', 'rocker = {length = "0.25 m", mass = "0.3 kg"}')
    text = text.replace('preset = "coupled"\nsolve.duration = "0.02 s"', 'preset = "rigid"\nsolve.duration = "0.5 s"')
    flat = scene_of(text.replace('psi = {position = "D"', 'phi = {position = "A"'))
    space = scene_of(lifted(flat) | {"solve": flat.raw["solve"]})
    one, other = (np.ravel(solved(scene).series["phi"].values) for scene in (flat, space))
    assert np.ptp(one) > 5.0 and abs((one - one[0]) - (other - other[0])).max() < 1e-6
