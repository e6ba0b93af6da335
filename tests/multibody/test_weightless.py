"""Light bodies against dampers, and bodies without mass or inertia: what moves them, or the error names them."""

import numpy as np
import pytest
from lifting import lifted
from machines import FREE_CRANK, STRIP, WEIGHT, four_bar, machine, pendulum, scotch_yoke
from runs import solved
from scipy.integrate import solve_ivp

import kaneflex
from kaneflex import SceneError, load, scene_of, with_settings
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.time import run
from kaneflex.solve.simulation import solve

FOUR_BAR = four_bar(
    'length = "0.1 m", mass = "0.2 kg"', STRIP, 'length = "0.25 m"', "free = true, angle = 1.0", "P", names="ABCD",
    more={"C": 'branch = "+"'}, gravity=WEIGHT, ground={"P": ["0.28 m", 0]},
    sensors='psi = {position = "D", component = "angle"}',
    solve={"preset": "coupled", "duration": "0.02 s", "steps": 50},
)  # fmt: skip
PUCK = machine(
    bodies=dict(puck='mass = "1 kg", free = {velocity = [1, 0]}'), solve=dict(preset="coupled", duration="1 s"),
)


def bar(size):
    """A bar on a hinge, of any size and in its own time, the root of its length."""
    return pendulum(
        f"length = {size}, mass = {size**3}", "free = true, angle = 0", hinge="A", gravity=WEIGHT,
        sensors='phi = {position = "A", component = "angle"}',
        solve={"preset": "coupled", "duration": 0.3 * size**0.5, "steps": 10},
    )


def loaded(text):
    return kaneflex.load(scene_of(text))


@pytest.mark.parametrize("drive", ["{free = true, angle = 1.0}", '{law = "1 + 0.3 * sin(20 * t)"}'])
def test_a_massless_rocker_moves_as_one_of_next_to_no_mass(drive):
    text, found = FOUR_BAR.replace("{free = true, angle = 1.0}", drive), []
    for rocker in ('{length = "0.25 m"}', '{length = "0.25 m", mass = "1e-7 kg"}'):
        solution = solve(loaded(text.replace('{length = "0.25 m"}', rocker)))
        assert solution.outcome is Outcome.COMPLETED, solution.message
        found.append(solution.series["psi"].values)
        assert np.isfinite(solution.stresses["coupler"].mises).all()
    assert found[0] == pytest.approx(found[1], abs=1e-7)


def test_two_massless_cranks_move_as_ones_of_next_to_no_mass():
    bare = FOUR_BAR.replace(', mass = "0.2 kg"', "")
    light = FOUR_BAR.replace("0.2 kg", "1e-7 kg").replace('"0.25 m"}', '"0.25 m", mass = "1e-7 kg"}')
    first, second = (solve(loaded(text)) for text in (bare, light))
    assert first.outcome is Outcome.COMPLETED, first.message
    assert first.series["psi"].values == pytest.approx(second.series["psi"].values, abs=1e-6)


def test_a_massless_rocker_at_pins_with_friction_moves_as_one_of_next_to_no_mass():
    text, found = FOUR_BAR.replace('branch = "+"', 'branch = "+", friction = {mu = 0.2, radius = "5 mm"}'), []
    assert text != FOUR_BAR
    for rocker in ('{length = "0.25 m"}', '{length = "0.25 m", mass = "1e-7 kg"}'):
        solution = solve(loaded(text.replace('{length = "0.25 m"}', rocker)))
        assert solution.outcome is Outcome.COMPLETED, solution.message
        found.append(solution.series["psi"].values)
    assert found[0] == pytest.approx(found[1], abs=1e-7)


def test_a_massless_body_that_friction_alone_resists_is_named():
    text = pendulum("length = 1", "free = true, angle = 0", hinge="A", solve={"preset": "coupled", "duration": 1})
    rubs = text.replace('"bar.start"]', '"bar.start"], friction = {mu = 0.2, radius = "5 mm"}')
    with pytest.raises(SceneError, match=r"bodies\.\w+: the mass matrix is singular: .* carries no inertia"):
        loaded(rubs)


def test_a_free_body_without_inertia_is_named():
    with pytest.raises(SceneError, match=r"bodies\.puck\.free: .* singular: puck\.phi carries no inertia"):
        loaded(PUCK)
    light = PUCK.replace('"1 kg"', '"1 kg", inertia = "1e-9 kg m^2"')
    loaded(light.replace("velocity", "at = [1000, 1000], velocity"))


def test_a_bar_of_a_tenth_of_a_micrometre_is_no_massless_one():
    """Nor one of a kilometre: as one of a metre, in its own time, the root of its length."""
    found = [solve(loaded(bar(size))).series["phi"].values for size in (1e-7, 1.0, 1e3)]
    assert found[0] == pytest.approx(found[1], abs=1e-7) and found[2] == pytest.approx(found[1], abs=1e-7)


READ = 'x = {position = "yoke", component = "x"}\nN = {joint_force = "slot", component = "x"}'


def test_a_massless_block_in_a_guide_turns_with_it():
    """A Scotch yoke: the loop alone says how its block turns. m x'' pulls at the slot, r sin(phi) from the main pin."""
    driven = scotch_yoke('speed = "600 rpm", cycle = "360 deg"', {}, f'T = {{drive_torque = "main"}}\n{READ}')
    found = solve(loaded(driven)).series
    phi, force = np.ravel(found["phi"].values), 2.0 * 0.05 * (20 * np.pi) ** 2
    assert np.ravel(found["x"].values) == pytest.approx(0.05 * np.cos(phi), abs=1e-12)
    assert abs(np.ravel(found["N"].values)) == pytest.approx(force * abs(np.cos(phi)), abs=1e-9 * force)
    torque = 0.05 * force * np.sin(phi) * np.cos(phi)
    assert np.ravel(found["T"].values) == pytest.approx(torque, abs=1e-9 * 0.05 * force)


def test_a_massless_block_of_a_free_crank_resists_nothing():
    """(I + m r^2 sin^2(phi)) phi'' + m r^2 sin(phi) cos(phi) phi'^2 = 0."""
    found = solve(loaded(scotch_yoke(FREE_CRANK, {"duration": "0.5 s", "steps": 100}, READ)))
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


PLANE = """
schema = 1
ground.far = [10, 0]
bodies.z = {mass = "1e-9 kg", inertia = "1e-9 kg m^2"}
joints.g = {%s}
drives.g = {free = true}
loads.f = {%s}
%s
sensors.z = {position = "g", component = "%s"}
solve = {preset = "coupled", duration = "1 s", steps = 20, errors = "none"}
"""
SLIDE, TURN = 'prismatic = ["ground", "z"], direction = [1, 0]', 'revolute = ["ground", "z"]'
SPRING = "springs.s = {%s, stiffness = 1, damping = 1%s}"
CASES = {
    "law of a slide": (SLIDE, 'force_on = "z", direction = [1, 0], law = "sin(t) - g - g_speed"', "", "x"),
    "law of a turn": (TURN, 'torque_at = "g", law = "sin(t) - g - g_speed"', "", "angle"),
    "spring": (SLIDE, 'force_on = "z", direction = [1, 0], law = "sin(t)"',
               SPRING % ('between = ["ground.far", "z"]', ", length = 10"), "x"),
    "spring at a joint": (TURN, 'torque_at = "g", law = "sin(t)"', SPRING % ('torsional_at = "g"', ""), "angle"),
}  # fmt: skip
"""m z'' = sin t - z - z', the first one as ``shared/cases/overdamped_light_body.toml`` has it."""
SPACE = """
schema = 1
ground.far = [10, 0, 0]
bodies.rod = {length = "1 m", beam = {material = "steel", section = {rectangle = ["10 mm", "20 mm"]}, elements = 2}}
bodies.z = {mass = "1e-9 kg", inertia = ["1e-9 kg m^2", "1e-9 kg m^2", "1e-9 kg m^2"]}
joints.wall = {weld = ["ground", "rod.start"]}
joints.g = {%s = ["ground", "z"], %s = [1, 0, 0]}
drives.g = {free = true}
loads.f = {%s}
sensors.z = {position = "g", component = "%s"}
solve = {preset = "coupled", duration = "1 s", steps = 20, modes = 1, errors = "none"}
"""
MASSES = (1e-3, 1e-5, 1e-6, 1e-9)


def closed_form(mass, t):
    """z and z' from rest, by the two roots of m s^2 + s + 1, the small one without cancellation."""
    a, b = np.linalg.solve([[1.0 - mass, -1.0], [1.0, 1.0 - mass]], [1.0, 0.0])
    root = np.sqrt(1.0 - 4.0 * mass)
    slow, fast = -2.0 / (1.0 + root), -(1.0 + root) / (2.0 * mass)
    c, d = np.linalg.solve([[1.0, 1.0], [slow, fast]], [-b, -a])
    slow_part, fast_part = c * np.exp(slow * t), d * np.exp(fast * t)
    z = a * np.sin(t) + b * np.cos(t) + slow_part + fast_part
    return z, a * np.cos(t) - b * np.sin(t) + slow * slow_part + fast * fast_part


# Dampers at joints of the tree are in the factors without slopes: where gauss is asked for there, it stays, and warns.
@pytest.mark.parametrize(
    ("case", "integrator"), [*((case, "radau") for case in CASES), *((case, "gauss") for case in list(CASES)[:-1])]
)
def test_a_light_body_takes_the_steps_of_its_slow_motion(case, integrator):
    """Each step is one of the 20 stored instants, but for the start of the heavier ones."""
    scene, counts = scene_of(PLANE % CASES[case]), []
    for mass in MASSES:
        settings = [f"z.mass={mass!r} kg", f"z.inertia={mass!r} kg m^2", f"solve.integrator={integrator}"]
        found = solve(load(with_settings(scene, settings)))
        z, rate = closed_form(mass, found.times)
        q, v = found.trajectory.q, found.trajectory.v
        moved = abs(v).max(axis=0).argmax()
        assert abs(q[:, moved] - z).max() < 1e-10
        assert abs(v[:, moved] - rate).max() < 2e-9
        if mass == 1e-9:
            assert abs(v[:, moved] - np.sin(found.times) + q[:, moved])[1:].max() < 1e-9
        counts.append(found.trajectory.steps + found.trajectory.rejected)
    assert max(counts) < 40 and counts[-1] <= 21, counts


@pytest.mark.parametrize(
    ("integrator", "damping", "warned"), [("gauss", 1, 1), ("gauss", 0.05, 1), ("gauss", 1e-6, 0), ("radau", 1, 0)]
)
def test_gauss_against_a_damper_at_a_joint_warns(integrator, damping, warned):
    """It is A-stable, not L-stable: with 1e-5 kg m^2 rates ring by 2e-7 where Radau's are right to 3e-12."""
    settings = [f"solve.integrator={integrator}", f"s.damping={damping}", "z.inertia=1e-5", "z.mass=1"]
    found = solve(load(with_settings(scene_of(PLANE % CASES["spring at a joint"]), settings)))
    said = [text for text in found.warnings if "overdamped modes oscillate" in text]
    assert len(said) == warned
    takes = f"fastest decay, which takes {1e-5 / damping:.2g} s"
    assert all(takes in text and "use 'radau'" in text for text in said)


@pytest.mark.parametrize(
    ("joint", "along", "force", "component"),
    [("prismatic", "direction", 'force_on = "z", direction = [1, 0, 0], law = "sin(t) - g - g_speed"', "x"),
     ("revolute", "axis", 'torque_at = "g", law = "sin(t) - g - g_speed"', "angle")],
)  # fmt: skip
def test_a_light_body_in_space_takes_the_steps_of_its_slow_motion(joint, along, force, component):
    scene = scene_of(SPACE % (joint, along, force, component))
    for mass in (1e-3, 1e-9):
        inertia = f"[{mass!r}, {mass!r}, {mass!r}]"
        model = load(with_settings(scene, [f"z.mass={mass!r} kg", f"z.inertia={inertia}"]))
        found = solve(model)
        assert abs(found.series["z"].values - closed_form(mass, found.times)[0]).max() < 1e-10
        assert len(found.model.motion.curve.ends) < 40


RIGID = machine(
    bodies=dict(z='mass = "1e-9 kg", inertia = [1e-9, 1e-9, 1e-9]'),
    joints=dict(g="prismatic ground z, direction = [1, 0, 0]"), drives=dict(g="free = true"),
    loads=dict(f='force_on = "z", direction = [1, 0, 0], law = "sin(t) - g - g_speed"'), sensors=dict(z="position g x"),
    solve=dict(preset="coupled", duration="1 s", steps=20, errors="none"),
)
FLAT = RIGID.replace(", 0, 0]", ", 0]").replace(", inertia = [1e-9, 1e-9, 1e-9]", "").replace("coupled", "rigid")


@pytest.mark.exhaustive
@pytest.mark.parametrize("mass", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("text", [RIGID, FLAT], ids=["space", "plane"])
def test_a_rigid_light_body_needs_no_choice_of_a_method(text, mass, monkeypatch):
    """Where a decay sets the steps of the explicit method, Radau's take its place; at 1e-3 kg they end before that."""
    runs, go = [], run.Run.go
    monkeypatch.setattr(run.Run, "go", lambda self, *given: runs.append(self) or go(self, *given))
    found = solve(load(with_settings(scene_of(text), [f"z.mass={mass!r} kg"])))
    assert abs(found.series["z"].values - closed_form(mass, found.times)[0]).max() < 1e-8
    assert sum(each.evaluations for each in runs) < 12_000


def test_a_rigid_motion_in_space_that_is_too_fast_ends_with_advice(monkeypatch):
    monkeypatch.setattr(run, "_WINDOW", 500)
    scene = scene_of(RIGID.replace("- g - g_speed", "- 1e12*g"))
    with pytest.raises(SceneError, match=r'drives.g: .* evaluations reach only t = .* of 1 s.*raise solve.tolerance'):
        solve(load(scene))
