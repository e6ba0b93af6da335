"""Rotors in fixed axes: frequencies of forward and backward whirl and critical speeds, against closed forms."""

import json
import tomllib

import numpy as np
import pytest
from command_line import cli, unrendered
from machines import machine
from matplotlib.figure import Figure
from runs import model

from kaneflex import load, scene_of, stability, with_settings
from kaneflex.plots.stability import _over_speed
from kaneflex.response.whirl import turns, whirl
from kaneflex.study.stability.report import findings
from kaneflex.study.stability.sweep import sweep

E, DIAMETER, LENGTH = 210e9, 0.01, 0.5
EI = E * np.pi * DIAMETER**4 / 64
MASS, POLAR, TILTING = 2.0, 0.04, 0.02
RPM = np.pi / 30
_SHAFT = f"beam = {{E = {E}, nu = 0.3, rho = 1e-3, section = {{circle = {DIAMETER}}}, elements = 2}}"
ONE_DISC = machine(
    name="rotor", gravity=[0, 0, 0],
    bodies=dict(flange="mass = 1, inertia = [0.1, 0.1, 0.1]", shaft=f"length = {LENGTH}, {_SHAFT}",
                disc=f"mass = {MASS}, inertia = [{POLAR}, {TILTING}, {TILTING}]"),
    joints=dict(main="revolute ground flange.start, axis = [1, 0, 0]", clamp="weld flange.start shaft.start",
                hub="weld shaft.end disc.start"),
    drives=dict(main='speed = "60 rpm", cycle = "360 deg"'), solve=dict(preset="linear", start="periodic"),
)
JEFFCOTT = ONE_DISC.replace(f"shaft = {{length = {LENGTH}", f"left = {{length = {LENGTH / 2}")
JEFFCOTT = JEFFCOTT.replace(f"[{POLAR}, {TILTING}, {TILTING}]", "[2e-3, 1e-3, 1e-3]")
JEFFCOTT = JEFFCOTT.replace("shaft", "left") + f"""
ground.bearing = [{LENGTH}, 0, 0]
bodies.right.like = "left"
joints.other = {{weld = ["disc.start", "right.start"]}}
joints.bearing = {{cylindrical = ["ground.bearing", "right.end"], axis = [1, 0, 0]}}
"""
FLAT = ONE_DISC.replace(f"{{circle = {DIAMETER}}}", "{rectangle = [0.012, 0.008]}")


def stodola(speed):
    """Whirls [Hz], backward ones negative, of a disc at the end of a massless clamped shaft (Stodola 1924; Green 1948).

    With complex deflection and slope q e^(i w t): (K + w Omega G - w^2 M) q = 0.
    """
    K = EI * np.array([[12 / LENGTH**3, -6 / LENGTH**2], [-6 / LENGTH**2, 4 / LENGTH]])
    M, G = np.diag([MASS, TILTING]), np.diag([0.0, POLAR])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [np.linalg.solve(M, K), np.linalg.solve(M, speed * G)]])
    return np.sort(np.linalg.eigvals(A).real) / (2 * np.pi)


def critical_speed():
    """Speed [rad/s] of synchronous whirl: det(K + Omega^2 (G - M)) = 0, one root for a disc with POLAR > TILTING."""
    k11, k12, k22, i = 12 * EI / LENGTH**3, -6 * EI / LENGTH**2, 4 * EI / LENGTH, POLAR - TILTING
    # (k11 - m s)(k22 + i s) - k12^2 = 0 for s = Omega^2
    return max(np.roots([-MASS * i, k11 * i - MASS * k22, k11 * k22 - k12**2]).real) ** 0.5


JEFFCOTTS = (192 * EI / (MASS * LENGTH**3)) ** 0.5
"""Natural frequency [rad/s] of a disc amid a massless shaft clamped at both ends, which is its critical speed."""


def rotor(text, speed):
    return load(with_settings(scene_of(tomllib.loads(text)), [f"drives.main.speed={float(speed)!r}"]))


@pytest.mark.parametrize("rpm", [1, 60, 300, 600, 3000])
def test_a_disc_at_the_end_of_a_shaft_whirls_as_stodola_says(rpm):
    """Below and above the critical speed of 351.5 rpm, beyond which turning axes see the forward whirl go backwards."""
    found = whirl(rotor(ONE_DISC, rpm * RPM))
    signed = np.concatenate([-found.of(-1)[::-1], found.of(1)])
    own = signed[abs(signed) < 200.0]  # the rest is of the shaft, whose mass is next to nothing
    assert own == pytest.approx(stodola(rpm * RPM), rel=1e-5)
    torsion = np.sqrt(E / 2.6 * np.pi * DIAMETER**4 / 32 / LENGTH / POLAR) / (2 * np.pi)
    assert found.of(0)[0] == pytest.approx(torsion, rel=1e-5)


def test_a_sweep_finds_the_critical_speed_and_not_half_of_it():
    """In turning axes order 1 meets the forward whirl at half the critical speed; fixed axes have no crossing there."""
    speeds = JEFFCOTTS * np.linspace(0.4, 1.3, 4)
    found = sweep(scene_of(tomllib.loads(JEFFCOTT)), speeds, 4)
    assert found.axes == "fixed"
    assert {*found.modes[:2]} == {"forward whirl 1", "backward whirl 1"}
    assert [each.speed for each in found.critical] == pytest.approx([JEFFCOTTS], rel=1e-4)
    firsts = [each.speed for each in found.crossings() if each.order == 1.0 and each.mode in (1, 2)]
    assert firsts == pytest.approx([JEFFCOTTS] * 2, rel=1e-4)
    campbell, radii = Figure().subplots(2, 1)
    _over_speed(campbell, radii, found, 1.0 / RPM, False)
    assert f"{JEFFCOTTS / RPM:.4g} rpm" in [text.get_text() for text in campbell.texts]
    assert {"F1", "B1"} <= {text.get_text() for text in campbell.texts}
    assert "fixed axes" in campbell.get_title()


def test_the_command_prints_critical_speeds_in_rpm(tmp_path, monkeypatch):
    unrendered(monkeypatch)
    file = tmp_path / "rotor.toml"
    file.write_text(ONE_DISC)
    speeds = ("--vary", "main.speed=200:500rpm", "--points", "4", "--orders", "1")
    done = cli("stability", file, *speeds, "-o", tmp_path / "found")
    assert done.exit_code == 0, done.output
    rpm = critical_speed() / RPM
    assert f"  critical      {rpm:.4g} rpm (forward whirl 1)\n" in done.output
    met = f"1 meets backward whirl 1 at 295.7 rpm, forward whirl 1 at {rpm:.4g} rpm"
    assert f"  orders        {met} (frequencies in fixed axes)\n" in done.output
    forward, backward = (f"{abs(each):.5g}" for each in stodola(60 * RPM)[[2, 1]])
    assert f"in axes that turn with the links; whirl in fixed axes: forward {forward}, " in done.output
    assert f" and backward {backward}, " in done.output
    data = json.loads((tmp_path / "found" / "stability.json").read_text())
    assert data["critical_speeds"] == [pytest.approx(critical_speed(), rel=1e-4)]
    assert (data["axes"], data["modes"][:2]) == ("fixed", ["backward whirl 1", "forward whirl 1"])


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("text", [FLAT, "blade"])
def test_what_does_not_whirl_one_way_stays_in_turning_axes_and_says_so(text):
    """A flat shaft, and a blade across the axis: each has modes that fixed axes see at several frequencies."""
    if text == "blade":
        text = ONE_DISC.replace("axis = [1, 0, 0]", "axis = [0, 0, 1]")
    found = rotor(text, 100 * RPM)
    assert whirl(found) is None and turns(found)
    judged = stability(found.given, np.array([100.0, 200.0]) * RPM)
    said = findings(judged)
    assert judged.sweep.axes == "link" and "critical" not in said
    assert "in axes that turn with the links" in said["frozen"] and "in axes that turn with the links" in said["orders"]


def test_a_link_that_stands_still_has_fixed_axes():
    assert not turns(model("mathieu")) and whirl(model("mathieu")) is None
