"""Forward dynamics of free joints: how well its energy balances, and what sets that."""

import re

import numpy as np
import pytest
from machines import machine
from places import DOCS
from runs import derived_on_the_fly, model, starts_of

from kaneflex.multibody.time.run import integrate
from kaneflex.multibody.time.trajectory import by_themselves
from kaneflex.report.summary import summarise
from kaneflex.solve.coupled import method_of
from kaneflex.solve.loading import integrated
from kaneflex.solve.simulation import solve
from kaneflex.support.errors import SceneError

PAGE = (DOCS / "forward.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| (1e-\d+) \| (\d+) \| (\S+) \|$", PAGE, flags=re.MULTILINE)

CART = machine(
    gravity=[0, "-9.81 m/s^2"], ground=dict(post=["-0.3 m", "0.1 m"]),
    bodies=dict(slope='length = "1 m", mass = "3 kg", inertia = 0.4, centre = [0.4, 0.1], '
                      'points = {foot = ["0.1 m", "0.2 m"]}', cart='length = "0.2 m", mass = "1 kg"',
                bar='length = "0.6 m", mass = "0.8 kg", points = {hand = ["0.5 m", "0.1 m"]}'),
    joints=dict(hinge="revolute ground slope.start", rail="prismatic slope.foot cart.start, direction = [0.8, 0.6]",
                pin="revolute cart.end bar.start"),
    masses=dict(lump='at = "bar.hand", mass = "0.3 kg", inertia = "0.01 kg m^2"'),
    drives=dict(hinge='law = "0.3*sin(4*t)"', rail='law = "0.2 + 0.1*sin(3*t)"', pin='free = true, angle = "20 deg"'),
    loads=dict(motor='torque_at = "pin", law = "2 - 0.5*pin_speed"',
               wind='force_on = "bar.end", direction = [1, 2], axes = "body", law = "3*cos(5*t)"',
               push='force_on = "cart.end", direction = [1, 0], value = "4 N"',
               rain='spread_on = "bar", direction = [0.6, -0.8], value = "0.5 N/m", profile = [1, 2]'),
    springs=dict(rope='between = ["ground.post", "bar.end"], stiffness = "30 N/m", damping = "2 N s/m", '
                      'length = "0.2 m"',
                 coil='torsional_at = "pin", stiffness = "1 N m/rad", damping = "0.05 N m s/rad", angle = "30 deg"'),
    solve=dict(preset="rigid", duration="1 s", steps=100),
)


def courses(model):
    """Ends of the steps of the integration, and the coordinate of the first free joint there."""
    p, (joint, *_) = model.motion.parameters, model.module.FREE
    at = int(p[[path for path, _ in model.module.PARAMETERS].index(f"drives.{joint}.angle_table")])
    times = p[at + 2 : at + 3 + int(p[at])]
    return np.array([times, model.motion.at(times)[f"{joint}.angle"]])


def test_energy_of_the_double_pendulum_drifts_as_the_page_says():
    """Undriven and undamped: the tighter the tolerance, the better the energy is kept."""
    drifts = []
    for tolerance, steps, drift in ROWS:
        settings = ("solve.duration=2 s", "solve.steps=20", f"solve.forward.tolerance={tolerance}")
        found = integrated(model("double-pendulum", *settings))
        assert len(courses(found)[0]) - 1 == pytest.approx(int(steps), rel=0.1)
        assert float(drift) / 3 < found.energy.drift < 3 * float(drift)
        drifts.append(found.energy.drift)
    assert all(loose > factor * tight for loose, tight, factor in zip(drifts, drifts[1:], (100, 10), strict=False))


def test_energy_of_the_default_over_ten_chaotic_seconds():
    assert integrated(model("double-pendulum")).energy.drift < 1e-8


def test_energy_with_springs_dampers_loads_and_prescribed_drives(tmp_path):
    """Every kind of power at once: a swinging bar on a cart whose slope is turned."""
    energy = integrated(derived_on_the_fly(CART, tmp_path)).energy
    assert energy.drift < 1e-9
    for part in (energy.kinetic, energy.strain, energy.weight, energy.dissipated, energy.supplied):
        assert np.ptp(part) > 0.1
    assert (np.diff(energy.dissipated) >= 0).all()


def test_free_joints_of_an_elastic_model_have_the_courses_of_the_engine():
    """Coordinate, speed and acceleration at the ends of its steps are those of the crank that the motor drives."""
    start = model("four-bar-motor", "solve.preset=stiffened", "solve.duration=0.3 s")
    (system, state), times = start.motion.initial, start.step * np.arange(start.options.steps + 1)
    found, k = integrate(system, state, times, method_of(start), limited=True), starts_of(system)["crank"] + 2
    rows = np.concatenate([rows for rows, _ in found.curve.pieces])
    moved, there = by_themselves(system, rows), integrated(start).motion.at(rows[:, 0])
    for part, name in ((moved.q, "main.angle"), (moved.v, "crank.omega"), (moved.a, "crank.epsilon")):
        assert there[name] == pytest.approx(part[:, k], rel=1e-9, abs=1e-9 * abs(part[:, k]).max())


def test_summary_and_warning_of_a_loose_tolerance():
    loose = ("solve.duration=2 s", "solve.steps=20", "solve.forward.tolerance=0.1")
    found = summarise(solve(model("double-pendulum", *loose)))
    assert found.options["forward_tolerance"] == 0.1
    assert found.energy.drift > 1e-4 and found.energy.gap > 1e-3
    assert "lower solve.forward.tolerance from 0.1" in found.warnings[-1]
    tight = summarise(solve(model("double-pendulum", "solve.duration=2 s")))
    assert tight.energy.drift < 1e-9 and abs(tight.energy.stored) < 1e-7
    assert not any("energy" in warning for warning in tight.warnings)


def test_a_motion_that_can_not_go_on(tmp_path):
    """From some time on its forces are no longer numbers."""
    scene = CART.replace("2 - 0.5*pin_speed", "sqrt(0.5 - t + 0.001*pin)")
    with pytest.raises(SceneError, match=r"^drives\.pin: the motion can't continue after t = 0\.[45]"):
        integrated(derived_on_the_fly(scene, tmp_path))


@pytest.mark.parametrize(("scene", "settings", "why"), [
    ("engine", (), "no joint is free"),
    ("elastic-pendulum", (), "preset coupled integrates them with the links"),
    ("double-pendulum", ("solve.duration=2 s",), None),
])  # fmt: skip
def test_a_forward_table_without_use_is_said(scene, settings, why):
    warnings = model(scene, *settings, "solve.forward.tolerance=1e-8").warnings
    assert [text for text in warnings if "solve.forward" in text] == ([] if why is None else [
        f"solve.forward has no effect: {why}"
    ])  # fmt: skip


def test_a_motion_that_is_too_fast_for_its_duration_is_refused(monkeypatch):
    """A hundred thousand seconds of a double pendulum would take half an hour, in silence."""
    monkeypatch.setattr("kaneflex.multibody.time.run._MOST", 2000)
    with pytest.raises(SceneError, match=r"\d{4} evaluations reach only t = [\d.]+ s of 100000 s\. Shorten"):
        solve(model("double-pendulum", "solve.duration=1e5 s", "solve.steps=7"))
