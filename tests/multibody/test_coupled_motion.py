"""How a coupled trajectory is read: rates are derivatives of places, and sections carry what lies beyond them.

The motion is prescribed, so that no integrator has a part in it.
"""

from dataclasses import replace

import numpy as np
import pytest
from machines import machine
from runs import STENCIL, gaps, model, names_of, run, solved

from kaneflex import scene_of
from kaneflex.mechanism.wrenches import Wrench
from kaneflex.multibody.model.system import System
from kaneflex.multibody.time.floating_motion import FloatingMotion
from kaneflex.multibody.time.trajectory import by_themselves
from kaneflex.response import dalembert
from kaneflex.response.dalembert import Balance, balanced
from kaneflex.response.momentum import rate_of_momentum
from kaneflex.response.sensors import sensor_values
from kaneflex.scene.sensors import Sensor
from kaneflex.solve.coupled import result_of
from kaneflex.solve.error_stages import values_of


def path(system: System, *parts: np.ndarray) -> np.ndarray:
    """Record of coordinates of frames and shapes, and their rates, zero by default; without forces, all at t = 0."""
    record = np.zeros((len(parts[0]), len(system.engine.work.kept)))
    for columns, part in zip(system.record, parts, strict=False):
        record[:, columns] = part
    return record


def test_rates_are_the_derivatives_of_places():
    """Of every shape, and of points of the axis between nodes; all swings, each at its own frequency and phase."""
    given, h = model("slider-crank-150-coupled"), 2e-4
    times = 7e-3 + h * np.arange(-4, 5)
    n = len(names_of(given.coupled))
    rates, phases = 60 * np.linspace(1.0, 2.0, n), 2.4 * np.arange(n)
    angle = rates * times[:, None] + phases
    q, v, a = 0.05 * np.sin(angle), 0.05 * rates * np.cos(angle), -0.05 * rates**2 * np.sin(angle)
    moved, rows = path(given.coupled, q, v, a), np.zeros((len(times), len(given.coupled.engine.row(0.0))))
    rows[:, 0] = times
    solution = result_of(given, by_themselves(given.coupled, rows, moved), 0.0)
    motion, xs = solution.motion, (0.0, 0.11, 0.3)
    found = {"shapes": solution.coordinates} | {x: motion.moving.moving_place("rod", (x, 0.0)) for x in xs}
    found |= {f"{x} in its body": motion.displacement("rod", (x, 0.0)) for x in xs}
    for name, (place, rate, accel) in found.items():
        for lower, higher in ((place, rate), (rate, accel)):
            assert lower @ STENCIL / h == pytest.approx(higher[:, 4], rel=1e-7, abs=1e-9 * abs(higher).max()), name


def test_constraints_are_the_gaps_between_these_places():
    """Of every revolute joint, foreshortening included, in any state: the engine's sections against the places read."""
    given = model("slider-crank-150-coupled")
    system, joints = given.coupled, given.scene.joints
    q = 0.1 * np.random.default_rng(5).normal(size=(1, len(names_of(system))))
    found = gaps(system, 0.0, q[0])
    motion = FloatingMotion.of(system, given.motion.at(0.0), path(system, q))
    revolute = {joint: found.addresses for joint, found in joints.items() if found.kind == "revolute"}
    assert len(revolute) > 1
    for joint, addresses in revolute.items():
        places = (motion.moving_place(of.body, given.scene.point(of)) for of in addresses)
        first, second = (place[0][:, 0] for place in places)
        for k, axis in enumerate("xy"):
            assert found[f"{joint}.force_{axis}"] == pytest.approx(second[k] - first[k], abs=1e-12), (joint, axis)


def test_sections_of_a_tapered_link_with_rotary_inertia_carry_what_lies_beyond():
    """A straight link that turns about its start: N = -int rho A (a - g)_x over the part beyond, V and M likewise."""
    given, turn, omega, epsilon = model("elastic-pendulum"), 0.4, 3.0, 7.0
    link, poly = given.coupled.links["strip"], np.polynomial.Polynomial
    X, density, rotary = poly([0.0, 1.0]), poly([0.3, -0.2]), poly([0.02, 0.03])
    middles, lengths = (link.nodes[1:] + link.nodes[:-1]) / 2, np.diff(link.nodes)
    numbers = {"rho_A": density(middles), "rho_A_rise": -0.2 * lengths}
    numbers |= {"rho_I": rotary(middles), "rho_I_rise": 0.03 * lengths}
    own = replace(link, parameters=dict(link.parameters) | numbers)
    shapes = {"strip": replace(given.coupled.shapes["strip"], link=own)}
    engine = given.coupled.engine
    engine = replace(engine, layout=replace(engine.layout, shapes=shapes))
    system = replace(given.coupled, engine=engine, shapes=shapes)
    q, v, a = np.zeros((3, 1, len(names_of(system))))
    q[0, 2], v[0, 2], a[0, 2] = turn, omega, epsilon
    motion = FloatingMotion.of(system, given.motion.at(0.0), path(system, q, v, a))
    g_x, g_y = -9.81 * np.sin(turn), -9.81 * np.cos(turn)
    assert given.scene.gravity == (0, -9.81) and link.length == 1.0

    def beyond(x: float) -> list[float]:
        a_x, a_y = -(omega**2) * X - g_x, epsilon * X - g_y
        parts = (density * a_x, density * a_y, density * a_y * (X - x) + rotary * epsilon)
        return [-part.integ()(1.0) + part.integ()(x) for part in parts]

    N, V, M = beyond(0.0)
    hub = Wrench("hub", (0.0, 0.0), np.zeros((2, 1)), np.array([[-N], [-V]]), np.array([-M]))
    balance = Balance(motion, "strip", lambda: (hub,))
    for x in (0.0, 0.07, 0.5, 0.63, 1.0):
        assert balance.section(x)[:, 0] == pytest.approx(beyond(x), rel=1e-12, abs=1e-12), x


def test_shear_does_not_jump_beside_a_joint():
    """It is what the joint exerts there, the ringing in tension included, which sections far from joints leave out."""
    motion = run("elastic-pendulum", "solve.duration=0.1 s", "solve.steps=100").motion.moving
    sections = balanced(motion)["strip"]
    c, s = np.cos(motion.body("strip")[0][2]), np.sin(motion.body("strip")[0][2])
    force = [motion[f"hinge.force_{axis}"] for axis in "xy"]
    across = c * force[1] - s * force[0]
    beside, quiet = (found.section(1e-6)[1] for found in (sections, sections.quiet))
    assert abs(across + quiet).max() > 1e-4  # what rings has a share in it
    assert beside == pytest.approx(-across, abs=1e-5 * abs(across).max())


def test_balances_at_joints_are_evaluated_once_for_all_sections(monkeypatch):
    """Two balances at each station, and two at each end of the link: it has no joint between these."""
    sections = balanced(run("elastic-pendulum", "solve.duration=0.1 s", "solve.steps=100").motion.moving)["strip"]
    asked, section = [], Balance.section
    monkeypatch.setattr(Balance, "section", lambda self, x, after=False: asked.append(x) or section(self, x, after))
    for x in np.linspace(0.1, 0.9, 9):
        sections.section(x)
    assert len(asked) == 2 * 9 + 2 * 2


def test_a_rigid_body_that_links_carry_stays_rigid():
    """The follower's end keeps its distance from the pivot, however far the bent coupler lets it turn, and the pin."""
    solution = run("four-bar-motor", "solve.duration=0.3 s", "solve.steps=600")

    def place(at: str) -> np.ndarray:
        sensors = (Sensor.model_validate({"position": at, "component": axis}) for axis in "xy")
        return np.array([sensor_values(solution.motion, sensor) for sensor in sensors])

    end, pivot = place("follower.end"), np.array([[0.254], [0.0]])
    assert np.ptp(end, axis=1).max() > 0.1
    assert np.hypot(*(end - pivot)) == pytest.approx(0.2705, abs=1e-12)
    assert end == pytest.approx(place("coupler.end"), abs=1e-11)


def test_where_the_rigid_mechanism_stands_depends_on_nothing_that_was_asked_before():
    motion, times = model("engine-torque-elastic").motion, np.linspace(0.0, 0.1, 50)
    first = motion.at(times).values.copy()
    motion.at(np.linspace(0.07, 0.0, 9)).values  # noqa: B018
    assert np.array_equal(motion.at(times).values, first)


def test_a_force_in_body_axes_turns_with_its_section():
    """The end of a bent cantilever carries the force as the equations apply it: along the axes of the section there."""
    scene = {
        "schema": 1, "name": "follower", "ground": {"base": [0, 0]},
        "joints": {"root": {"weld": ["ground.base", "rod"]}},
        "bodies": {"rod": {"length": "1 m", "beam": {
            "elements": 4, "section": {"rectangle": ["20 mm", "4 mm"]}, "material": "aluminium",
        }}},
        "loads": {"tip": {"force_on": "rod.end", "direction": [0, 1], "axes": "body", "value": "6 N"}},
        "solve": {"preset": "coupled", "duration": "0.1 s", "steps": 20},
    }  # fmt: skip
    motion = solved(scene_of(scene)).motion
    theta = motion.moving.moving_place("rod", (1.0, 0.0))[0][2]
    N, V, _ = motion.section("rod", 1.0)
    assert abs(theta).max() > 0.02
    assert N == pytest.approx(-6.0 * np.sin(theta), abs=1e-9)
    assert V == pytest.approx(6.0 * np.cos(theta), abs=1e-9)


TURNING_BACK = machine(
    ground=dict(far=["150 mm", 0]),
    bodies=dict(a='length = "100 mm", mass = "0.1 kg"',
                b='length = "120 mm", beam = {material = "steel", section = {rectangle = ["10 mm", "10 mm"]}}',
                c='length = "110 mm", mass = "0.2 kg"'),
    joints=dict(main="revolute ground a.start", p="revolute a.end b.start", q="revolute b.end c.end",
                r="revolute ground.far c.start"),
    drives=dict(main='law = "1 + 0.3*sin(20*t)"'), sensors=dict(torque="drive_torque main"),
    solve=dict(preset="coupled", duration="314 ms", steps=100),
)


def test_far_instants_at_nearly_the_same_place_of_a_drive_are_reached():
    """The drive turns back between them: its rates there say nothing of the way."""
    solution = solved(scene_of(TURNING_BACK))
    alone = [solution.at(np.array([t])).series["torque_rigid"].values[0] for t in (0.000314, 0.15677, 0.313686)]
    together = solution.at(np.array([0.000314, 0.15677, 0.313686])).series["torque_rigid"].values
    assert together == pytest.approx(alone, rel=1e-9)


def test_sensors_of_a_link_share_its_sections(monkeypatch):
    """The momentum before the middle, the end and the start is integrated once, with and without axial vibration."""
    found, counted = solved("engine", "solve.preset=coupled", "solve.steps=60"), []
    monkeypatch.setattr(dalembert, "rate_of_momentum", lambda *of: counted.append(of[0]) or rate_of_momentum(*of))
    read = values_of(found.motion, ("rod_force_piston", "rod_mid_force", "rod_mid_strain"))
    assert len(counted) == 2 * 3
    for name, values in read.items():
        assert np.array_equal(values, found[name].values)
