"""Preset coupled in space: large deflections, what free motions keep, planar runs lifted into space, loops."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import tomlkit
from cosserat_rod import tip_of_rod
from lifting import lifted
from machines import machine, pendulum
from places import DATA
from runs import alike, solved

import kaneflex
from kaneflex import SceneError, scene_of, shipped_scenes, with_settings
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.spatial_motion import Counts
from kaneflex.report.checked import description
from kaneflex.scene.shapes import torsion_constant

LENGTH, HEIGHT, WIDTH, FORCE, E, NU = 0.508, 0.0123777, 0.0032024, 8.896, 71.7e9, 0.31
A, I_Y, I_Z = HEIGHT * WIDTH, HEIGHT * WIDTH**3 / 12.0, WIDTH * HEIGHT**3 / 12.0
TORSION = torsion_constant(HEIGHT, WIDTH)
STIFFER = 1.034
"""J of the elements in the table that DATA has, by Saint-Venant's: one number with which the rod's equations give both
deflections at all of its angles."""
SQUARE = 'length = "1 m", beam = {material = "aluminium", section = {rectangle = ["10 mm", "10 mm"]}, elements = 4}'


def driven(dimension: int) -> str:
    """A rod that is turned and pushed, in the plane or in space."""
    return pendulum(
        SQUARE, 'speed = "8 rad/s", spin_up = "0.2 s"', "rod", "pin", deep=dimension == 3,
        gravity=[0, -9.81, 0][:dimension],
        loads=dict(push=f'force_on = "rod.end", direction = {[0, 1, 0][:dimension]}, value = "0.5 N"'),
        damping=dict(rayleigh=dict(ratio=0.01, at=["20 Hz", "80 Hz"])),
        sensors=dict(tip='displacement rod.end y, axes = "body"', short='displacement rod.end x, axes = "body"',
                     height="position rod.end y", force="joint_force pin y", torque="drive_torque pin"),
        solve=dict(preset="coupled", duration="0.25 s", steps=50),
    )  # fmt: skip


def free_strip(dimension: int, damping: str = "") -> str:
    """A strip that swings, in the plane or in space."""
    return pendulum(
        'length = "1 m", beam = {material = "steel", section = {rectangle = ["1.5 mm", "10 mm"]}}',
        'free = true, angle = "-30 deg"', "strip", deep=dimension == 3, gravity=[0, -9.81, 0][:dimension],
        sensors=dict(angle="position hinge angle", bend="displacement strip.end y", height="position strip.end y",
                     force="joint_force hinge y"),
        solve=dict(preset="coupled", modes=6, duration="0.1 s", steps=40),
    ) + damping  # fmt: skip


def _princeton(beta: float, preset: str = "coupled", count: int = 8, J: float = TORSION) -> str:
    """The Princeton beam (Dowell & Traybar 1975), its force at the tip keeps its direction."""
    names = [f"blade_{k}" for k in range(count)]
    beam = f"E = {E}, nu = {NU}, rho = 2700, elements = {1 if count > 1 else 8}"
    beam += f", A = {A}, I_y = {I_Y}, I_z = {I_Z}, J = {J}"
    welds = {f"weld_{b}": f"weld {a}.end {b}.start" for a, b in pairwise(names)}
    y, z = math.cos(math.radians(beta)), math.sin(math.radians(beta))
    return machine(
        gravity=[0, 0, 0], bodies=dict.fromkeys(names, f"length = {LENGTH / count}, beam = {{{beam}}}"),
        joints={"root": "weld ground blade_0.start"} | welds,
        loads=dict(tip=f'force_on = "{names[-1]}.end", direction = [0, {y}, {z}], value = {FORCE}'),
        sensors={axis: f"displacement {names[-1]}.end {axis}" for axis in "yz"},
        solve=dict(preset=preset, start="quasistatic", duration="1 ms", steps=2),
    )


def _rod(beta: float, J: float) -> np.ndarray:
    """y and z of the tip by the rod's equations."""
    G, y, z = E / (2.0 * (1.0 + NU)), math.cos(math.radians(beta)), math.sin(math.radians(beta))
    stretching, turning = (E * A, 5.0 / 6.0 * G * A, 5.0 / 6.0 * G * A), (G * J, E * I_Y, E * I_Z)
    return tip_of_rod(LENGTH, stretching, turning, (0.0, FORCE * y, FORCE * z))[1:]


def _table() -> dict[int, tuple[float, float]]:
    """Angle of the force to the strong plane [deg] -> y, z of the tip [m]."""
    stored = json.loads((DATA / "princeton_beam.json").read_text())
    values = stored["values_by_force_N"][str(FORCE)]
    return dict(zip(stored["beta_deg"], zip(values["y"], values["z"], strict=True), strict=True))


def _solution(text):
    return solved(scene_of(text))


def _bent_cantilever(count: int) -> str:
    """Cantilever of unit square section along 45 degrees of a circle of radius 100, as straight pieces welded together,
    with a dead load of 600 across its plane (Bathe & Bolourchi 1979, sec. 4.3); I = 1/12, J = 1/6."""
    angles = [0.25 * math.pi * k / count for k in range(count + 1)]
    points = [(100.0 * math.sin(angle), 100.0 * (math.cos(angle) - 1.0)) for angle in angles]
    lines = ["schema = 1", "gravity = [0, 0, 0]"]
    for k, ((x_1, y_1), (x_2, y_2)) in enumerate(pairwise(points)):
        x, y = x_2 - x_1, y_2 - y_1
        lines.append(
            f"bodies.b{k} = {{length = {math.hypot(x, y)!r}, rotation = {{x = [{x!r}, {y!r}, 0]}}, beam = {{E = 1e7,"
            f" G = 5e6, rho = 1, A = 1, I_y = {1 / 12!r}, I_z = {1 / 12!r}, J = {1 / 6!r}, elements = 2}}}}"
        )
    ends = ["ground", *(f"b{k}.end" for k in range(count))]
    lines += [f'joints.w{k} = {{weld = ["{end}", "b{k}.start"]}}' for k, end in enumerate(ends[:-1])]
    lines += [f'sensors.{axis} = {{position = "{ends[-1]}", component = "{axis}"}}' for axis in "xyz"]
    lines.append(f'loads.tip = {{force_on = "{ends[-1]}", direction = [0, 0, 1], value = 600}}')
    solve = 'solve = {preset = "coupled", start = "quasistatic", modes = 6, duration = "1 ms", steps = 2}'
    return "\n".join([*lines, solve])


@pytest.mark.parametrize(("count", "bound"), [(8, 6e-3), (16, 2e-3)])
def test_a_bent_cantilever_turns_through_60_degrees(count, bound):
    """The reference is the limit of many geometrically exact elements; pieces of straight beams tend to it."""
    found = solved(scene_of(tomlkit.parse(_bent_cantilever(count)).unwrap()))
    tip = np.array([found[axis][0] for axis in "xyz"])
    reference = np.array([47.15, -15.68, 53.48])
    assert np.linalg.norm(tip - reference) < bound * np.linalg.norm(reference)


def test_the_princeton_beams_table_is_a_rod_that_is_stiffer_in_torsion():
    """With Saint-Venant's J the rod's y is up to 0.83 % above the table's, and so no model with it comes closer."""
    for beta, expected in _table().items():
        assert _rod(beta, STIFFER * TORSION) == pytest.approx(expected, rel=1e-4, abs=1e-6)
    assert _rod(75, TORSION)[0] / _table()[75][0] - 1.0 == pytest.approx(0.0083, abs=5e-5)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("beta", "stiffer"), [(30, STIFFER), (75, STIFFER), (75, 1.0)])
def test_the_princeton_beam_as_eight_bodies(beta, stiffer):
    """Each deflection as the table has it, with its J; and as the rod, with Saint-Venant's."""
    expected = _table()[beta] if stiffer > 1.0 else _rod(beta, TORSION)
    found = _solution(_princeton(beta, J=stiffer * TORSION))
    moved = np.array([found.series[axis].values for axis in "yz"])
    assert moved[:, 0] == pytest.approx(expected, rel=0.003)
    assert np.allclose(moved[:, -1], moved[:, 0], rtol=1e-6)  # at rest it stays
    assert not found.warnings


def test_one_way_presets_warn_of_the_princeton_beam():
    found = _solution(_princeton(75, "quasistatic", 1))
    assert any("assumes small displacements" in warning for warning in found.warnings)


def test_a_free_elastic_rod_keeps_energy_and_momenta():
    free = ", free = {at = [0, 0, 0], velocity = [0.3, 0, -0.2], angular_velocity = [3, 20, 15]}"
    tail = 'sensors.tip = {position = "rod.end", component = "y"}\n'
    tail += 'solve = {preset = "coupled", duration = "0.05 s"}'
    found = _solution(machine(gravity=[0, 0, 0], bodies=dict(rod=f"{SQUARE}{free}")) + tail)
    energy, curve = found.energy, found.model.motion.curve
    assert abs(energy.stored - energy.stored[0]).max() < 1e-6 * energy.stored[0]
    assert energy.strain.max() > 1e-5  # the rod does deform
    system, momenta = found.model.module.system, []
    for t in (0.0, 0.0213, 0.05):
        state = curve(t)
        of_speeds = system.engine.mass() @ state.u
        node = system.layout.node_of["rod"]
        r, R = system.work.r[node].copy(), system.work.R[node].copy()
        momenta.append([*of_speeds[:3], *(R @ of_speeds[3:6] + np.cross(r, of_speeds[:3]))])
    momenta = np.array(momenta)
    assert abs(momenta - momenta[0]).max() < 1e-7 * abs(momenta[0]).max()


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_rigid_mechanism_beside_free_joints_has_the_rates_of_its_positions(dimension):
    """Accelerations too: they are not those that the loads would give the rigid mechanism."""
    speed, acceleration = {2: ("omega", "epsilon"), 3: ("omega_z", "epsilon_z")}[dimension]
    found = _solution(free_strip(dimension))
    step, (body,) = 1e-6 * found.times[-1], found.model.scene.bodies
    motion = found.model.motion if dimension == 2 else found.model.motion.rigid
    near = motion.at(found.times[len(found.times) // 2] + step * np.array([-1.0, 0.0, 1.0]))
    slope = (near[f"{body}.{speed}"][2] - near[f"{body}.{speed}"][0]) / (2.0 * step)
    assert near[f"{body}.{acceleration}"][1] == pytest.approx(slope, rel=1e-4)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(
    ("damping", "close"),
    [("", ()), ('damping.rayleigh = {ratio = "5 %", at = ["4 Hz", "20 Hz"]}', ("force",))],
)
def test_a_link_that_turns_freely_is_the_planar_one(damping, close):
    """Its axes follow its mean turn, whatever the number of its shapes, and damping acts against these.

    Undamped, the force at the hinge has the vibration along the strip, that of 0.2 um here: less than a step's error.
    The bend is measured from the rotation of the section there.
    """
    flat, deep = (_solution(free_strip(dimension, damping)) for dimension in (2, 3))
    alike(deep, flat, dict.fromkeys(("angle", "bend", "height"), 2e-5) | dict.fromkeys(close, 0.01))


@pytest.mark.parametrize("damping", ['rayleigh = {ratio = 0.05, at = ["20 Hz", "300 Hz"]}', "modal = {ratio = 0.05}"])
def test_damping_in_a_loop_is_the_planar_one(damping):
    """Against the rod's chord, on whichever of its ends it hangs; against its tangent there, 1 and 3 % are missing.

    Sensors in the rod's axes have those of the rigid motion, not those that its shapes are measured in.
    """
    text = shipped_scenes()["slider-crank-150"].read_text().partition("[solve]")[0]
    text = "\n".join(line for line in text.splitlines() if "axial_force" not in line)
    tail = f'\n\n[damping]\n{damping}\n\n[solve]\npreset = "coupled"\nduration = "10 ms"\nsteps = 100\n'
    tail += '\n[sensors.along]\nvelocity = "rod.mid"\n\n[sensors.across]\nvelocity = "rod.mid"\ncomponent = "y"\n'
    flat = _solution(text + tail)
    given = lifted(flat.model.scene) | {"solve": flat.model.scene.raw["solve"]}
    deep = _solution(given)
    alike(deep, flat, {"mid_transverse": 1e-3, "along": 5e-4, "across": 5e-4})


def test_a_loop_with_an_elastic_rod_is_near_the_one_way_model():
    """The slider-crank's connecting rod bends by 0.4 mm, so that it acts back on the motion by little."""
    text = shipped_scenes()["spatial-slider-crank-elastic"].read_text().partition("[solve]")[0]
    left = ("_moment =", "_force =", "damping", "rayleigh")
    text = "\n".join(line for line in text.splitlines() if not any(word in line for word in left))
    tail = '\n\n[solve]\npreset = "{}"\nstart = "zero"\nduration = "30 ms"\nsteps = 300\n'
    coupled, one_way = (_solution(text + tail.format(preset)) for preset in ("coupled", "stiffened"))
    energy = coupled.energy
    assert energy.drift < 1e-6
    alike(coupled, one_way, 0.05, ("mid_y", "mid_z"))


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("axes", ["global", "body"])
def test_section_forces_under_a_load_along_a_rod_are_the_planar_ones(axes):
    """Lifted into space and turned by any rotation; the tension has the ringing that Radau's method damps there."""
    more = f"""
loads.wind = {{spread_on = "rod", direction = [0.3, 1], axes = "{axes}", value = "0.8 N/m", profile = [1, -0.4]}}
sensors.tension = {{axial_force = "rod.mid"}}
sensors.shear = {{shear_force = "rod.mid"}}
sensors.moment = {{bending_moment = "rod.mid"}}
sensors.gauge = {{strain = "rod.mid", fibre = "2 mm"}}
sensors.root_tension = {{axial_force = "rod.start"}}
sensors.root_moment = {{bending_moment = "rod.start"}}
"""
    flat = _solution(driven(2) + more)
    given = lifted(flat.model.scene) | {"solve": flat.model.scene.raw["solve"]}
    deep = _solution(given)
    alike(deep, flat, {name: 2e-3 if "tension" in name else 1e-5 for name in given["sensors"]})


def _ringing(start: str, duration: float, steps: int = 40) -> str:
    """The blade in one piece, without a force at its tip; shapes 2 and 5 are its first in the strong and weak plane."""
    text = _princeton(30, count=1).replace("value = 8.896", "value = 0")
    text = text.replace('start = "quasistatic"', f"start = {start}, modes = 2")
    return text.replace('duration = "1 ms", steps = 2', f"duration = {duration!r}, steps = {steps}")


@pytest.mark.parametrize(("plane", "shape", "height"), [("y", 2, 12.3777e-3), ("z", 5, 3.2024e-3)])
def test_a_cantilever_rings_from_the_shape_that_it_is_given(plane, shape, height):
    """Two periods of the first mode, whose frequency is that of Euler and Bernoulli's clamped-free beam."""
    omega = 1.8751040687**2 * math.sqrt(71.7e9 * height**2 / 12.0 / 2700.0) / 0.508**2
    start = f'{{displacements = {{"blade_0.shape_{shape}" = "10 um"}}}}'
    found = _solution(_ringing(start, 4.0 * math.pi / omega))
    assert abs(found.series[plane].values - 1e-5 * np.cos(omega * found.times)).max() < 1e-3 * 1e-5


@pytest.mark.parametrize(("start", "message"), [
    ('{displacements = {"blade_0.shape_9" = 0.01}}', r"no such coordinate.*blade_0\.shape_8"),
    ('{velocities = {"blade_0.shape_8" = "1 m/s"}}', r"velocities\.blade_0\.shape_8 = '1 m/s'"),  # it is twist
])  # fmt: skip
def test_states_that_there_are_not_are_refused_by_name(start, message):
    with pytest.raises(SceneError, match=message):
        _solution(_ringing(start, 1e-3, 2))


def test_a_rate_that_the_joints_leave_no_shape_is_refused():
    """Between two pins that don't give way a rod can't stretch: the first of its shapes does."""
    text = machine(
        gravity=[0, 0, 0], ground=dict(far=[1, 0, 0]), bodies=dict(rod=SQUARE), drives=dict(pin="free = true"),
        joints=dict(pin="revolute ground rod.start, axis = [0, 0, 1]", held="spherical ground.far rod.end"),
        solve={"preset": "coupled", "modes": 2, "duration": "1 ms", "steps": 2,
               "start": {"velocities": {'"rod.shape_0"': "0.1 m/s"}}},
    )  # fmt: skip
    with pytest.raises(SceneError, match=r"velocities\.rod\.shape_0 = '0\.1 m/s': joints and drives make it 0 m/s"):
        _solution(text)


def _pendulum(more: str, section: str = '{circle = "4 mm"}') -> str:
    text = free_strip(3)
    text = text.replace("modes = 6", "modes = 3")
    return text.replace('{rectangle = ["1.5 mm", "10 mm"]}', section).replace('length = "1 m"', f'{more}length = "1 m"')


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(
    ("askew", "close"), [("x = [1, 0, 0], y = [0, 0.8, 0.6]", 4e-4), ("x = [1, 0, 0.005], y = [0, -1, 0]", 4e-5)]
)
def test_a_round_link_turns_freely_whatever_axes_its_section_is_given(askew, close):
    """About one across it that is none of its own, where the shapes are others, too; and 0.3 degrees from across it."""
    straight, turned = (_solution(_pendulum(of)) for of in ("", f"rotation = {{{askew}}}, "))
    alike(turned, straight, close, ("angle", "height"))
    motion, times = turned.model.motion, turned.times[::8]
    angle = motion.at(times)["hinge.angle"]
    assert motion.rigid.at(times)["hinge.angle"] == pytest.approx(angle, abs=1e-9)


def test_turns_of_a_joint_in_the_tree_take_no_further_evaluations(monkeypatch):
    """The mechanism is evaluated at the requested instants alone, and all joints that close loops count at once."""
    solution, unfold, evaluated = _solution(_pendulum("")), System.unfold, []
    angle = pytest.approx(solution["angle"].values, abs=1e-12)
    monkeypatch.setattr(
        System, "unfold", lambda *args, **more: (evaluated.extend(args[1][:, 0]), unfold(*args, **more))[1]
    )
    motion = replace(solution.model.motion)
    assert motion.at(solution.times)["hinge.angle"] == angle
    assert evaluated == solution.times.tolist()


def test_turns_of_several_angles_are_counted_at_once():
    """Of one that turns back and of one that turns fast, at instants in any order of requests."""
    requests = []

    def at(times):
        requests.append(times)
        angles = np.array([9.0 * np.sin(3.0 * times), 1.0 - 200.0 * times]).T
        return np.arctan2(np.sin(angles), np.cos(angles)), np.array([27.0 * np.cos(3.0 * times), 0 * times - 200.0]).T

    counts = Counts(at, 0.1)
    for times in (np.zeros(1), np.linspace(0.0, 3.0, 7), np.array([0.3, 0.31, 2.9, 4.0])):
        expected = np.array([9.0 * np.sin(3.0 * times), 1.0 - 200.0 * times]).T
        assert counts.over(times, *at(times)) == pytest.approx(expected, abs=1e-12)
    assert len(requests) == 6  # the start, what was asked for, and once between


def test_stiff_vibrations_set_no_steps():
    """The rod vibrates along its axis at 4.3 and 15 kHz, unseen: a turn in 0.1 s takes few steps to a coarse tolerance,
    and with finer ones every sensor comes to the same."""
    text = shipped_scenes()["spatial-slider-crank-elastic"].read_text().partition("[solve]")[0]
    tail = '\n[solve]\npreset = "coupled"\nstart = "quasistatic"\nsteps = 90\ntolerance = {}\n'
    coarse, fine, finest = (_solution(text + tail.format(each)) for each in ("1e-5", "1e-8", "1e-10"))
    steps = [len(each.model.motion.curve.ends) for each in (coarse, fine, finest)]
    assert steps[0] < 2 * 90 and steps[0] < steps[1] < steps[2] < 1500
    for found, allowed in ((coarse, 3e-2), (fine, 1e-3)):
        alike(found, finest, allowed)
    assert finest.energy.drift < 1e-8


@pytest.mark.parametrize("name", ["spatial-slider-crank-elastic", "four-bar"])
def test_an_integrator_of_other_presets_is_refused(name):
    text = shipped_scenes()[name].read_text().partition("[solve]")[0]
    with pytest.raises(SceneError, match=r"integrator = 'newmark': this integrator is for .*Use radau or gauss"):
        _solution(text + '\n[solve]\npreset = "coupled"\nintegrator = "newmark"\n')


def test_gauss_keeps_the_energy_in_space():
    text = shipped_scenes()["spatial-slider-crank-elastic"].read_text().partition("[solve]")[0]
    found = {}
    for name, tolerance in (("gauss", "1e-7"), ("radau", "1e-7"), ("radau", "1e-10")):
        solve = f'preset = "coupled"\nintegrator = "{name}"\nsteps = 90\ntolerance = {tolerance}\nstart = "quasistatic"'
        found[name, tolerance] = _solution(f"{text}\n[solve]\n{solve}\n")
    gauss, radau, exact = found.values()
    assert gauss.energy.drift < 0.1 * radau.energy.drift
    alike(gauss, exact, 1e-5)


@pytest.mark.parametrize("axes", [
    [[0, 1, 0], [0, 0, 1]], [[0, 1, 1], [0, -1, 1]], [[-0.03, 1, 0], [0, 0, 1]]
], ids=["own", "between", "askew"])  # fmt: skip
def test_a_universal_joint_damps_alike_however_its_axes_stand(axes):
    """It lets the link turn about all axes across, however its cross is turned about the link, or a little askew: it
    holds neither plane of bending, and of a rod with pinned ends the mass damps what Rayleigh says."""
    raw = {
        "schema": 1,
        "bodies": {
            "link": {"length": 0.3, "beam": {"material": "steel", "section": {"circle": "6 mm"}}},
            "disc": {"mass": 1.0, "inertia": [0.01, 0.01, 0.01]},
        },
        "ground": {"far": [0.3, 0.0, 0.0]},
        "joints": {
            "cross": {"universal": ["ground", "link.start"], "axes": axes}, "ball": {"spherical": ["link.end", "disc"]},
            "guide": {"prismatic": ["ground.far", "disc"], "direction": [1, 0, 0]},
        },
        "damping": {"rayleigh": {"ratio": 0.02, "at": ["100 Hz", "300 Hz"]}},
        "sensors": {"place": {"position": "disc"}},
        "solve": {"preset": "coupled", "duration": 1e-3, "steps": 2},
    }
    model = kaneflex.load(scene_of(raw))
    lowest = sorted((x for x in np.linalg.eigvals(kaneflex.linearise(model, t=0.0).A) if x.imag > 1.0), key=abs)[:2]
    omega, low, high = abs(lowest[0]), 200 * math.pi, 600 * math.pi
    wanted = 0.02 * (low * high / omega + omega) / (low + high)
    assert [-x.real / abs(x) for x in lowest] == pytest.approx([wanted] * 2, rel=0.01)


SPANS = """
schema = 1
name = "spans"
gravity = [0, -9.81, 0]
bodies.bar = {length = 0.6, BAR, elements = 4}}
joints.pin = {revolute = ["ground", "bar.NEAR"], axis = [0, 0, 1]}
drives.pin = {free = true, initial_speed = 1.0}
loads.middle = {force_on = "bar.mid", direction = [0, 1, 0], value = 1.0}
loads.tip = {force_on = "bar.FAR", direction = [0, 1, 0], value = 0.5}
sensors.pull = {joint_force = "pin", component = "x", body = "bar"}
solve = {preset = "coupled", modes = 1, tolerance = 1e-9, duration = "0.5 ms", steps = 5}
"""


def test_either_end_of_a_body_may_be_its_start():
    """Two spans as long as each other stretch in modes of one frequency, of which any mixture is one, too."""
    beam = 'beam = {material = "aluminium", section = {rectangle = [0.02, 0.012]}'
    turned = f"rotation = {{x = [-1, 0, 0], y = [0, 1, 0]}}, {beam}"
    one, other = (
        solved(scene_of(text))["pull"].values
        for bar, near, far in ((beam, "start", "end"), (turned, "end", "start"))
        for text in (SPANS.replace("BAR", bar).replace("NEAR", near).replace("FAR", far),)
    )
    assert other == pytest.approx(one, abs=1e-6 * np.ptp(one))


def _bent_arm(size: float) -> str:
    """An arm with a leg across it, which twists it, at any size of lengths: density and times stay as they are."""
    beam = f"{{E = {2e9 * size**2!r}, nu = 0.3, rho = 2000, section = {{circle = {0.01 * size!r}}}, elements = 2}}"
    return f"""
schema = 1
gravity = [0, 0, {-9.81 * size!r}]
bodies.arm = {{length = {0.4 * size!r}, beam = {beam}}}
bodies.leg = {{length = {0.3 * size!r}, rotation = {{x = [0, 1, 0]}}, beam = {beam}}}
joints.root = {{revolute = ["ground", "arm.start"], axis = [0, 0, 1]}}
joints.corner = {{weld = ["arm.end", "leg.start"]}}
drives.root = {{law = "0.5*sin(3*t)"}}
sensors.tip = {{displacement = "leg.end", component = "z", axes = "global"}}
sensors.twist = {{torsional_moment = "arm.mid"}}
solve = {{preset = "coupled", modes = 1, duration = 0.2, steps = 40}}
"""


def test_twist_is_measured_in_radians_whatever_the_size():
    """As a share of the size its inertia vanished in arms of 0.1 mm, and in large ones its error grew."""
    here, small, large = (_solution(_bent_arm(size)) for size in (1.0, 1e-5, 1e3))
    for size, other in ((1e-5, small), (1e3, large)):
        for name, unit in (("tip", size), ("twist", size**5)):
            expected = here[name].values
            assert abs(other[name].values / unit - expected).max() < 1e-7 * abs(expected).max(), (size, name)


@pytest.mark.parametrize("modes", [3, 4])
def test_modes_that_the_elements_do_not_have_are_warned_of(modes):
    settings = ["solve.preset=coupled", "bodies.rod.beam.elements=2", f"solve.modes={modes}"]
    model = kaneflex.load(kaneflex.with_settings(kaneflex.read_scene("spatial-slider-crank-elastic"), settings))
    said = [warning for warning in model.warnings if "bending modes" in warning]
    if modes == 3:
        assert said == []
    else:
        (warning,) = said
        assert warning.startswith("rod has only 3 bending modes per plane, fewer than solve.modes = ")
        assert str(modes) in warning and model.motion.module.system.layout.shapes["rod"].count == 11


def test_the_stretch_of_a_rotating_rod_needs_no_modes_beyond_those_of_the_inertia():
    """By E u'' = -rho omega^2 (x + u), u(0) = u'(L) = 0; a vibration mode in their place is wrong by 1.4 %."""
    found = _solution(pendulum(
        "length = 1, beam = {E = 210e9, rho = 7850, nu = 0.3, section = {circle = 0.02}, elements = 4}",
        'speed = "50 rad/s", cycle = "360 deg"', "rod", "hub", deep=True, gravity=[0, 0, 0],
        sensors="""
mid = {displacement = "rod.mid", component = "x"}
tip = {displacement = "rod.end", component = "x"}""",
        solve={"preset": "coupled", "modes": 3, "start": "quasistatic", "duration": "1 ms", "steps": 2},
    ))
    k = 50.0 * math.sqrt(7850 / 210e9)
    for name, x in (("mid", 0.5), ("tip", 1.0)):
        expected = math.sin(k * x) / (k * math.cos(k)) - x
        assert abs(found[name].values - expected).max() < 2e-6 * expected, name


@pytest.mark.parametrize("deep", [False, True], ids=["plane", "space"])
def test_a_tolerance_bounds_speeds_and_reactions_in_the_plane_and_in_space(deep):
    """Shares of their largest, against a run at a far smaller tolerance; at the start the shapes are at rest, and the
    accelerations of all angles are rounding, to which steps must not be fitted."""
    settings = {"preset": "coupled", "modes": 1, "duration": 0.002, "steps": 4, "errors": "none"}
    flat = kaneflex.read_scene("slider-crank-150-coupled")
    changed = [f"solve.{key}={value}" for key, value in settings.items()]
    scene = scene_of(lifted(flat) | {"solve": settings}) if deep else with_settings(flat, changed)

    def found(tolerance, *bounded):
        run = solved(scene, f"solve.tolerance={tolerance}", f"solve.bounded={list(bounded)}".replace("'", '"'))
        return run.motion.state[1], run.series["crank_torque"].values

    exact, errors = found(1e-10), {}
    for bounded in ((), ("speeds",), ("speeds", "reactions")):
        values = zip(found(1e-3, *bounded), exact, strict=True)
        errors[bounded] = [abs(one - other).max() / abs(other).max() for one, other in values]
    assert min(errors[()]) > 1e-3
    assert errors["speeds",][0] < 1e-3 and max(errors["speeds", "reactions"]) < 1e-3
    told = description(kaneflex.load(with_settings(scene, ['solve.bounded=["speeds"]'])))["options"]["integrator"]
    assert deep or "of the longest body's length, for speeds of their largest value" in told
