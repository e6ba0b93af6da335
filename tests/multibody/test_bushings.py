"""Bushings in space: frequencies, decay, deflections in closed form, momentum and energy, Exudyn beside, refusals."""

import math
import pickle
import re

import numpy as np
import pytest
from machines import changed, machine
from runs import solved

import kaneflex
from kaneflex import SceneError, compare, load
from kaneflex.integrate.system import Outcome
from kaneflex.solve.curves import Resolution
from kaneflex.study.sensitivity.parameters import find_parameters

STIFF, DAMPED = (1e5, 2e5, 3e5, 500.0, 700.0, 900.0), (80.0, 60.0, 40.0, 0.3, 0.4, 0.5)
MASS, INERTIA = 20.0, (0.5, 0.8, 1.1)

ENGINE = machine(
    gravity=[0, 0, 0], ground=dict(seat=[0.3, -0.2, 0.1]),
    bodies=dict(engine=f"mass = {MASS}, inertia = {list(INERTIA)}, rotation = {{axis = [1, 2, 0.5], angle = 0.7}}"),
    springs=dict(mount=f'bushing = ["ground.seat", "engine.start"], stiffness = {list(STIFF)}, '
                       f'damping = {list(DAMPED)}'),
    sensors=dict(x="position engine.start x", y="position engine.start y", z="position engine.start z",
                 force_x="spring_force mount x", turning_z="spring_torque mount z"),
    solve=dict(preset="rigid", duration="0.3 s", steps=600),
)


def scene_of(text, *changes):
    return kaneflex.scene_of(changed(text, *changes))


def swing(t, speed, inertia, stiffness, damping):
    """Coordinate and rate from rest at zero at a speed: m x'' + c x' + k x = 0."""
    decay = damping / (2.0 * inertia)
    omega = math.sqrt(stiffness / inertia - decay**2)
    x = speed / omega * np.exp(-decay * t) * np.sin(omega * t)
    return x, speed * np.exp(-decay * t) * np.cos(omega * t) - decay * x


def test_a_body_on_a_bushing_swings_in_six_ways():
    """Small oscillations: (k/m - (c/2m)^2)^(1/2) along and about every axis, those of the ground as the body stands
    turned, and its principal axes among them."""
    speeds, turning = (1e-3, 2e-3, -3e-3), (3e-5, -2e-5, 4e-5)
    sensors = "".join(f'sensors.turn_{axis} = {{velocity = "engine", component = "angle_{axis}"}}\n' for axis in "xyz")
    free = f"free = {{at = [0.3, -0.2, 0.1], velocity = {list(speeds)}, angular_velocity = {list(turning)}}}"
    solution = solved(scene_of(ENGINE, ("rotation = {axis = [1, 2, 0.5], angle = 0.7}", free), ("", sensors)))
    t, places = solution.times, (0.3, -0.2, 0.1)
    for k, axis in enumerate("xyz"):
        x, rate = swing(t, speeds[k], MASS, STIFF[k], DAMPED[k])
        assert solution[axis].values - places[k] == pytest.approx(x, abs=1e-4 * abs(x).max())
        angle, omega = swing(t, turning[k], INERTIA[k], STIFF[3 + k], DAMPED[3 + k])
        assert solution[f"turn_{axis}"].values == pytest.approx(omega, abs=1e-4 * abs(omega).max())
        if axis == "x":
            assert solution["force_x"].values == pytest.approx(
                STIFF[0] * x + DAMPED[0] * rate, abs=1e-4 * STIFF[0] * abs(x).max())  # fmt: skip
        if axis == "z":
            wanted = STIFF[5] * angle + DAMPED[5] * omega
            assert solution["turning_z"].values == pytest.approx(wanted, abs=1e-4 * abs(wanted).max())
    assert solution.energy.drift < 1e-6 and solution.energy.dissipated[-1] > 0


PAIR = machine(
    gravity=[0, 0, 0],
    bodies=dict(one="mass = 2, inertia = [0.02, 0.05, 0.04], "
                    "free = {at = [0, 0, 0], velocity = [0.1, 0, 0.2], angular_velocity = [3, -1, 2]}, "
                    "rotation = {axis = [1, 0, 1], angle = 0.4}, points = {side = [0.2, 0.1, 0]}",
                two="mass = 1, inertia = [0.02, 0.01, 0.025], centre = [0.1, 0, 0.05], "
                    "free = {at = [0.2, 0.15, -0.1], angular_velocity = [-4, 5, 1]}"),
    springs=dict(mount='bushing = ["one.side", "two.start"], stiffness = [300, 200, 400, 2, 3, 4]'),
    sensors=dict(x="position one.start x"), solve=dict(preset="rigid", duration="2 s", steps=200),
)


def test_two_bodies_in_flight_keep_energy_and_momentum():
    """Far turned, far apart and turning on: the moments belong to an energy, and what acts on both is opposite."""
    solution = solved(scene_of(PAIR))
    motion, mechanism = solution.motion.rigid, solution.model.motion.module.system.mechanism
    momentum, turning = np.zeros((2, 3, len(solution.times)))
    for name, body in mechanism.bodies.items():
        frame = motion.frame(name)
        J = np.diag(body.inertia[:3])
        p = body.mass * frame.velocity(body.centre)
        momentum = momentum + p
        turning = turning + np.cross(frame.place(body.centre), p, axis=0)
        turning = turning + frame.to_global(J @ frame.to_body(frame.omega))
    for kept in (momentum, turning):
        assert kept == pytest.approx(kept[:, :1] + 0.0 * kept, abs=1e-7)
    energy = solution.energy
    assert energy.drift < 1e-7 and np.ptp(energy.strain) > 1.0
    turned = np.einsum("jit,jkt->ikt", motion.frame("one").axes, motion.frame("two").axes)
    assert np.arccos(0.5 * (np.trace(turned) - 1.0)).max() > 1.5


ARM = machine(
    gravity=[0, 0, 0],
    bodies=dict(arm='length = "0.5 m", beam.section = {rectangle = ["10 mm", "10 mm"]}, beam.E = "210 GPa", '
                    'beam.nu = 0.3, beam.rho = "7800 kg/m^3", beam.elements = 4, free = {at = [0, 0, 0]}, '
                    'rotation = {x = [0, 1, 0]}'),
    springs=dict(seat='bushing = ["ground", "arm.start"], stiffness = [2e3, 3e3, 2e3, 100, 50, 80], '
                      'damping = [56, 70, 56, 3.6, 0.2, 3.6]'),
    loads=dict(push='force_on = "arm.end", direction = [0, 0, 1], law = "0.1 * (1 - exp(-400 * t**2))"'),
    damping=dict(modal=dict(ratio=0.3)),
    sensors=dict(tip="position arm.end z", root="position arm.start z", force="spring_force seat z",
                 moment="spring_torque seat x", bending="bending_moment arm.start z", shear="shear_force arm.start y"),
    solve=dict(preset="PRESET", duration="0.6 s", steps=60),
)


@pytest.mark.parametrize("preset", ["rigid", "coupled"])
def test_an_arm_on_a_bushing_comes_to_rest(preset):
    """F/k along, F a^2/k_r by the turn about global x, and F a^3/(3 E I) of an elastic arm."""
    F, a, EI = 0.1, 0.5, 210e9 * 0.01**4 / 12
    solution = solved(scene_of(ARM, ("PRESET", preset)))
    last = {name: series.values[-1] for name, series in solution.series.items()}
    sunk, turned, bent = F / 2e3, F * a**2 / 100, F * a**3 / (3 * EI)
    assert last["root"] == pytest.approx(sunk, rel=1e-4)
    assert last["tip"] == pytest.approx(sunk + turned + (bent if preset == "coupled" else 0.0), rel=1e-4)
    assert last["force"] == pytest.approx(F, rel=1e-4) and last["moment"] == pytest.approx(F * a, rel=1e-4)
    assert last["shear"] == pytest.approx(F, rel=1e-4) and last["bending"] == pytest.approx(F * a, rel=1e-4)
    assert solution.energy.drift < 1e-5


def test_a_bushing_beside_exudyn(peer):
    """Exudyn turns bushings by Tait-Bryan angles: moments differ by 2.5 % where these reach 0.5 deg, by a tenth of that
    at a tenth."""
    peer("exudyn")
    free = "free = {at = [0.3, -0.2, 0.1], velocity = [0.3, 0.2, -0.3], angular_velocity = [0.03, -0.02, 0.04]}"
    sensors = "".join(f'sensors.{what}_{axis} = {{spring_{what} = "mount", component = "{axis}"}}\n'
                      for what in ("force", "torque") for axis in "xyz")  # fmt: skip
    scene = scene_of(
        ENGINE.replace("force_x", "pull").replace("turning_z", "twist"),
        ("rotation =", free + ", rotation ="), ("", sensors), ("0.3 s", "0.1 s"),
    )  # fmt: skip
    found = compare(scene, peer="exudyn", resolution=Resolution(None, 4000)).curves
    ours, theirs = found["rigid"], found["exudyn"]
    assert set(theirs.values) == set(scene.sensors)
    for name, values in theirs.values.items():
        apart = abs(np.interp(theirs.times, ours.times, ours.values[name]) - values)
        bound = 4e-3 if name.startswith(("torque", "twist")) else 1e-6 if name in "xyz" else 4e-5
        assert apart[40:].max() < bound * abs(values).max(), name


FREE = "free = {at = [0.3, -0.2, 0.1]}, rotation ="


def test_a_stiffness_is_a_parameter_of_a_sensitivity():
    scene = scene_of(ENGINE, ("rotation =", FREE))
    names = ["springs.mount.stiffness.2", "springs.mount.stiffness.3", "springs.mount.damping.5"]
    assert [each.unit for each in find_parameters(scene, names)] == ["N/m", "N m/rad", "N m s/rad"]


SPUN = FREE.replace("]}", "], angular_velocity = [0, 0, 400]}")


@pytest.mark.parametrize(("old", "new", "words"), [
    ("rotation =", SPUN, r"bodies.engine.free: .*bushing mount is rotated by 17\d deg"),
    (f"stiffness = {list(STIFF)}", "stiffness = 5", r"stiffness = 5: a bushing has six"),
    ("stiffness = [100000.0,", "stiffness = [-3,", r"must not be negative"),
    ("stiffness = [1", "length = 1, stiffness = [1", r"springs.mount.length.*does not apply to bushing"),
    ("stiffness = [100000.0,", 'torsional_at = "a", stiffness = [100000.0,', r"bushing exclude each other"),
    ('"engine.start"]', '"engine.top"]', r"springs.mount.bushing = 'engine.top'.*no point"),
    ('component = "x"}\nsensors.turning', 'component = "angle_x"}\nsensors.turning', r"Give x, y or z"),
    ("bushing =", "stiff = 1, bushing =", r"stiff"),
])  # fmt: skip
def test_broken_bushings_are_named(old, new, words):
    changes = [(old, new)] if old == "rotation =" else [("rotation =", FREE), (old, new)]
    with pytest.raises(SceneError, match=words):
        solved(scene_of(ENGINE, *changes))


def test_one_way_presets_and_planar_scenes_have_none():
    with pytest.raises(SceneError, match=r"springs.seat.bushing.*Use preset coupled, or rigid"):
        load(scene_of(ARM, ("PRESET", "linear")))
    planar = machine(bodies=dict(bar="length = 1, mass = 1, free = {at = [0, 0]}"), solve=dict(duration=1),
                     springs=dict(s='bushing = ["ground", "bar.start"], stiffness = [1, 1, 1, 1, 1, 1]'))  # fmt: skip
    said = r"springs\.s\.bushing = \['ground', 'bar\.start'\]: only scenes in space have bushings"
    with pytest.raises(SceneError, match=said):
        load(scene_of(planar))


def test_a_drive_that_turns_a_bushing_too_far_is_refused():
    text = machine(
        bodies=dict(disc="mass = 1, inertia = [1, 1, 1]"),
        joints=dict(pin="revolute ground disc.start, axis = [0, 0, 1]"), drives=dict(pin='speed = "1 rad/s"'),
        springs=dict(mount='bushing = ["ground", "disc.start"], stiffness = [0, 0, 0, 1, 1, 1]'),
        sensors=dict(twist="spring_torque mount z", motor="drive_torque pin"),
        solve=dict(preset="rigid", duration="2 s", steps=20),
    )
    found = solved(scene_of(text))
    for name in ("twist", "motor"):
        assert found[name].values == pytest.approx(found.times, abs=1e-9)
    with pytest.raises(SceneError, match=r"springs.mount.bushing: bushing mount is rotated by 1\d\d deg"):
        load(scene_of(text, ("2 s", "4 s")))


def test_a_free_elastic_body_that_turns_its_bushing_too_far_stops_by_name():
    text = machine(
        gravity=[0, 0, 0], ground=dict(seat=[0, 0, 0]),
        bodies=dict(bar='length = "300 mm", beam = {material = "steel", section = {circle = "20 mm"}, elements = 4}, '
                        'free = {at = [0, 0, 0], angular_velocity = [0, 0, 30]}'),
        springs=dict(mount='bushing = ["ground.seat", "bar.start"], stiffness = [1e5, 1e5, 1e5, 1, 1, 1]'),
        sensors=dict(x="position bar.end x"), solve=dict(preset="coupled", duration="0.3 s", steps=300),
    )
    found = solved(scene_of(text))
    expected = r"the motion can't continue after t = 0\.11\d+ s: bushing mount .* Limit the"
    assert found.outcome is Outcome.STUCK and re.match(expected, found.message)
    x = found.series["x"].values
    assert 100 < len(x) < 130 and np.isfinite(x).all()
    with pytest.raises(SceneError, match=r"t = 0\.2: the run stopped at 0\.11\d+ s"):
        found.model.motion.at(0.2)
    there = pickle.loads(pickle.dumps(found))
    assert there.message == found.message and np.array_equal(there.series["x"].values, x)
