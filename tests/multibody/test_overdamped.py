"""Light bodies against dampers and laws that damp them: the steps follow the slow motion, whatever the mass."""

import numpy as np
import pytest

from kaneflex import SceneError, load, scene_of, with_settings
from kaneflex.integrate import by_scipy
from kaneflex.solve.simulation import solve

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


@pytest.mark.parametrize(("integrator", "damping", "warned"), [("gauss", 1, 1), ("gauss", 1e-6, 0), ("radau", 1, 0)])
def test_gauss_against_a_damper_at_a_joint_warns(integrator, damping, warned):
    """It is A-stable, not L-stable: with 1e-5 kg m^2 rates ring by 2e-7 where Radau's are right to 3e-12."""
    settings = [f"solve.integrator={integrator}", f"s.damping={damping}", "z.inertia=1e-5", "z.mass=1"]
    found = solve(load(with_settings(scene_of(PLANE % CASES["spring at a joint"]), settings)))
    said = [text for text in found.warnings if "overdamped modes oscillate" in text]
    assert len(said) == warned
    assert all("fastest decay, which takes 1e-05 s" in text and "use 'radau'" in text for text in said)


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


RIGID = """
schema = 1
bodies.z = {mass = "1e-9 kg", inertia = [1e-9, 1e-9, 1e-9]}
joints.g = {prismatic = ["ground", "z"], direction = [1, 0, 0]}
drives.g = {free = true}
loads.f = {force_on = "z", direction = [1, 0, 0], law = "sin(t) - g - g_speed"}
sensors.z = {position = "g", component = "x"}
solve = {preset = "coupled", duration = "1 s", steps = 20, errors = "none"}
"""
FLAT = RIGID.replace(", 0, 0]", ", 0]").replace(", inertia = [1e-9, 1e-9, 1e-9]", "").replace("coupled", "rigid")


@pytest.mark.exhaustive
@pytest.mark.parametrize("mass", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("text", [RIGID, FLAT], ids=["space", "plane"])
def test_a_rigid_light_body_needs_no_choice_of_a_method(text, mass, monkeypatch):
    """Where a decay sets the steps of the explicit method, Radau's take its place; at 1e-3 kg they end before that."""
    paces = []
    monkeypatch.setattr(by_scipy.Pace, "__init__", lambda self, *given, old=by_scipy.Pace.__init__: (
        old(self, *given), paces.append(self)
    )[0])  # fmt: skip
    found = solve(load(with_settings(scene_of(text), [f"z.mass={mass!r} kg"])))
    assert abs(found.series["z"].values - closed_form(mass, found.times)[0]).max() < 1e-8
    assert sum(pace.evaluations for pace in paces) < 12_000


def test_a_rigid_motion_in_space_that_is_too_fast_ends_with_advice(monkeypatch):
    monkeypatch.setattr(by_scipy, "_WINDOW", 500)
    scene = scene_of(RIGID.replace("- g - g_speed", "- 1e12*g"))
    with pytest.raises(SceneError, match=r'drives.g: .* evaluations reach only t = .* of 1 s.*raise solve.tolerance'):
        solve(load(scene))
