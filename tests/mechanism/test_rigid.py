"""The rigid stage: closed forms by hand, and every body's own balance."""


import closed_forms as by_hand
import numpy as np
import pytest
from newton_euler import imbalance, motion_of
from runs import model

from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.scene import read_scene, with_settings

ANGLES = np.radians([0.0, 17.0, 90.0, 133.0, 180.0, 251.0, 270.0, 360.0, 374.0, 540.0, 719.0])
"""Crank angles, dead centres included."""


def motion_at_angles(name: str, seed: int) -> tuple[RigidMotion, dict[str, float]]:
    """A shipped module with random numbers in place of its scene's, at ANGLES; and those numbers."""
    rng = np.random.default_rng(seed)
    found = model(name).motion
    number = {
        "bodies.crank.length": rng.uniform(0.03, 0.06),
        "bodies.rod.length": rng.uniform(0.11, 0.2),
        "bodies.crank.centre_x": rng.uniform(-0.02, 0.03),
        "bodies.rod.centre_x": rng.uniform(0.03, 0.09),
        "bodies.crank.mass": rng.uniform(0.5, 2.0),
        "bodies.rod.mass": rng.uniform(0.1, 0.3),
        "bodies.piston.mass": rng.uniform(0.1, 0.4),
        "bodies.crank.inertia": rng.uniform(1e-4, 1e-3),
        "bodies.rod.inertia": rng.uniform(1e-4, 1e-3),
        "drives.main.speed": rng.uniform(100.0, 700.0),
    }
    p = found.parameters.copy()
    for k, (path, _) in enumerate(found.module.PARAMETERS):
        p[k] = number.get(path, p[k])
    number["gravity.x"] = dict(zip((path for path, _ in found.module.PARAMETERS), p, strict=False)).get("gravity.x", 0)
    return RigidKinematics(found.module, p).at(ANGLES / number["drives.main.speed"]), number


def close(found: np.ndarray, expected: np.ndarray, tolerance: float) -> bool:
    """To a share of the largest value over all angles: single values pass through zero."""
    return bool(np.isfinite(found).all() and np.abs(found - expected).max() <= tolerance * np.abs(expected).max())


# ---- closed forms by hand ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_motion_and_reactions_are_the_closed_forms(seed):
    rigid, n = motion_at_angles("engine", seed)
    r, l, speed = n["bodies.crank.length"], n["bodies.rod.length"], n["drives.main.speed"]
    motion = by_hand.slider_crank(r, l, ANGLES, speed)
    pairs = {
        "rod.omega": motion["omega2"],
        "rod.epsilon": motion["epsilon2"],
        "rod.s": np.sin(motion["phi2"]),
        "rod.c": np.cos(motion["phi2"]),
        "piston.x": motion["piston_position"],
        "piston.v_x": motion["piston_velocity"],
        "piston.a_x": motion["piston_acceleration"],
    }
    entries = ("mass", "centre_x", "inertia")
    crank, rod = ([n[f"bodies.{body}.{entry}"] for entry in entries] for body in ("crank", "rod"))
    forces = by_hand.slider_crank_forces(r, l, crank, rod, n["bodies.piston.mass"], ANGLES, speed, rigid["gas"])
    names = {"pin": "crank_pin_force", "main": "main_bearing_force"}
    pairs |= {f"{joint}.force_{axis}": forces[f"{name}_{axis}"] for joint, name in names.items() for axis in "xy"}
    pairs |= {"bore.normal": forces["piston_side_force"], "main.drive": forces["crank_torque"]}
    # The rod's tension where it begins, and its acceleration there in its own axes.
    c, s = pairs["rod.c"], pairs["rod.s"]
    a_x, a_y = -r * speed**2 * np.cos(ANGLES), -r * speed**2 * np.sin(ANGLES)
    pairs |= {
        "rod.link.P_0": -(c * forces["crank_pin_force_x"] + s * forces["crank_pin_force_y"]),
        "rod.link.a_x": c * a_x + s * a_y, "rod.link.a_y": -s * a_x + c * a_y,
    }
    for name, expected in pairs.items():
        assert close(rigid[name], expected, 1e-11), name


def test_gravity_in_the_axes_of_a_link_is_an_acceleration_upwards():
    """The loads of an elastic link are those of a - g, in its own axes; the tension holds its weight."""
    rigid, n = motion_at_angles("engine-rig", 0)
    r, l, speed, g = n["bodies.crank.length"], n["bodies.rod.length"], n["drives.main.speed"], n["gravity.x"]
    assert g == -9.81
    phi_2 = by_hand.slider_crank(r, l, ANGLES, speed)["phi2"]
    a_x, a_y = -r * speed**2 * np.cos(ANGLES) - g, -r * speed**2 * np.sin(ANGLES)
    c, s = np.cos(phi_2), np.sin(phi_2)
    for name, expected in (("a_x", c * a_x + s * a_y), ("a_y", -s * a_x + c * a_y)):
        assert close(rigid[f"rod.link.{name}"], expected, 1e-12)
        without = expected + g * (c if name == "a_x" else -s)
        assert not close(rigid[f"rod.link.{name}"], without, 1e-6)


# ---- every body's own balance -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def upright() -> RigidMotion:
    found = model("engine")
    return found.motion.at(np.radians(np.arange(0, 720, 2)) / found.scene.drives["main"].speed)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("settings", "negated", "same"), [
    (["joints.pin={revolute=['rod.start', 'crank.end']}", "joints.wrist={revolute=['piston', 'rod.end']}",
      "joints.bore={prismatic=['piston', 'ground'], direction=[1, 0], branch='+'}"],
     ("pin.force_x", "pin.force_y", "wrist.force_x", "wrist.force_y", "bore.normal"),
     ("rod.omega", "rod.epsilon", "piston.a_x", "main.force_y", "main.drive", "rod.link.P_0")),
    (["joints.bore.branch=-", "loads.gas.direction=[1, 0]", "main.angle=180 deg", "loads.gas.offset=180 deg"],
     ("piston.x", "piston.a_x", "rod.c", "rod.s", "pin.force_x", "pin.force_y", "main.force_y"),
     ("rod.omega", "rod.epsilon", "main.drive", "rod.link.P_0", "rod.link.a_x")),
], ids=["bodies in the other order", "other branch"])  # fmt: skip
def test_the_engine_written_otherwise_changes_signs_alone(upright, settings, negated, same):
    """A joint's force is that on the second body: it changes its sign, and nothing else does. Piston on the left, crank
    half a turn ahead, gas to the right: the engine turned by 180 degrees."""
    scene = with_settings(read_scene("engine"), settings)
    other = motion_of(scene)
    assert imbalance(scene, other) < 1e-10
    for names, sign in ((negated, -1.0), (same, 1.0)):
        for name in names:
            assert close(other[name], sign * upright[name], 1e-11), name
