"""Scenes built in Exudyn: an independent nonlinear answer to the same mechanism, and what can't be built there."""

import builtins
from importlib.metadata import EntryPoints
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import cli, refused

from kaneflex import Comparison, SceneError, compare, read_scene, with_settings
from kaneflex.solve.curves import Resolution
from kaneflex_peers.buildable import check_buildable, lumped
from kaneflex_peers.readings import PlanarRecorder


def compared(scene: str, *settings: str, elements: int, steps: int, presets=None) -> Comparison:
    changed = with_settings(read_scene(scene), list(settings))
    return compare(changed, presets, peer="exudyn", resolution=Resolution(elements, steps))


def shares(comparison: Comparison) -> dict[str, float]:
    """The largest difference of each sensor as a share of Exudyn's peak."""
    return {entry.sensor: entry.peak_share for entry in comparison.differences}


def test_engine(peer):
    """-0.1464 and 0.0293 mm by both; what is left is the damping, which Exudyn has in proportion to K alone."""
    peer("exudyn")
    found = compared("engine", elements=4, steps=1440)
    assert found.against == "exudyn"
    tip, mid = (found.curves["exudyn"].values[name] for name in ("tip_axial", "mid_transverse"))
    assert tip.min() == pytest.approx(-0.1464e-3, abs=1e-7) and tip.max() == pytest.approx(0.0253e-3, abs=2e-7)
    assert mid.max() == pytest.approx(0.0293e-3, abs=1e-7)
    apart = shares(found)
    assert set(apart) == {*found.scene.sensors} - {"piston_side_force"} == set(found.curves["exudyn"].values)
    assert max(apart.values()) < 0.02
    assert all(apart[name] < 0.003 for name in ("tip_axial", "mid_transverse", "crank_pin_force_y", "crank_torque"))


def test_slider_crank_by_the_coupled_equations(peer):
    """At per cents of deflection coupled agrees to 0.3 %; stiffened is 6 % off. Its bending moment agrees to 2 %,
    though the rod rings undamped in tension.
    """
    peer("exudyn")
    settings = ("solve.duration=20 ms", "solve.steps=1500", "sensors.rod_force.axial_force=none")
    settings += ("sensors.rod_force.bending_moment=rod.mid",)
    found = compared("slider-crank-150", *settings, elements=12, steps=3000, presets=("stiffened", "coupled"))
    bend = {entry.model: entry.peak_share for entry in found.differences if entry.sensor == "mid_transverse"}
    assert bend["coupled"] < 0.003 < 0.02 < bend["stiffened"]
    moment = {entry.model: entry.peak_share for entry in found.differences if entry.sensor == "rod_force"}
    assert moment["coupled"] < 0.025 < 0.035 < moment["stiffened"]


def test_bending_of_a_pendulum_that_rings_in_tension(peer):
    """0.0613 N m at the middle of the strip in its first half second, by 16 elements and 4000 steps."""
    peer("exudyn")
    found = compared("elastic-pendulum", "solve.duration=0.5 s", "solve.steps=1000", elements=16, steps=4000)
    ours, theirs = (found.curves[name].values["mid_moment"] for name in ("coupled", "exudyn"))
    assert abs(ours).max() == pytest.approx(abs(theirs).max(), rel=1e-2)
    assert shares(found)["mid_moment"] < 0.03


def test_a_motor_starts_a_four_bar_with_an_elastic_coupler(peer):
    """Nonlinear in both: the motor's torque falls with the speed that it brings about."""
    peer("exudyn")
    apart = shares(compared("four-bar-motor", "solve.duration=0.3 s", "solve.steps=600", elements=8, steps=2400))
    assert apart["crank_speed"] < 1e-4 and apart["rocker_angle"] < 1e-5
    assert apart["coupler_mid"] < 3e-3 and apart["coupler_force"] < 0.01


def test_a_driven_elastic_link_is_held_by_a_hub(peer):
    """Spin-up, up to its largest deflection."""
    peer("exudyn")
    settings = ("solve.duration=8 s", "solve.steps=1600")
    apart = shares(compared("spin-up", *settings, elements=12, steps=1600))
    assert apart["tip_transverse"] < 0.005 and apart["hub_torque"] < 0.01 and apart["hub_angle"] < 1e-8


def test_lumped_masses_join_their_rigid_body():
    """Two equal masses at the ends of a bar: the centre stays, J grows by 2 m (l/2)^2."""
    settings = ["masses.a={at='crank.start', mass=1}", "masses.b={at='crank.end', mass=1, inertia=2e-3}"]
    scene = with_settings(read_scene("engine"), settings)
    mass, centre, inertia = lumped(scene, "crank")
    assert (mass, centre) == (pytest.approx(2.952), pytest.approx((0.02, 0.0)))
    assert inertia == pytest.approx(0.952 * 0.04**2 / 12 + 2 * 0.02**2 + 2e-3)


@pytest.mark.parametrize(("scene", "settings", "words"), [
    ("four-bar-motor", ("loads.motor.law=0.6 - main_speed**2",), ("loads.motor", "not linear in the speed")),
    ("four-bar-motor", ("loads.motor.law=0.6 - main_speed*t",), ("loads.motor", "of that joint alone")),
    ("four-bar-motor", ("loads.motor.law=0.6 - abs(main_speed)",), ("loads.motor", "not linear in the speed")),
    ("engine", ("bodies.rod.beam.theory=rayleigh",), ("bodies.rod.beam.theory", "rotary inertia")),
    ("engine", ("damping.rayleigh=none", "damping.modal={ratio=0.02}"), ("damping", "other than Rayleigh's")),
    ("engine", ("damping=none",), ("solve.start", "needs Rayleigh damping")),
    ("pin-ended-cross", (), ("a fixed structure",)),
])  # fmt: skip
def test_what_can_not_be_built_is_named(scene, settings, words):
    with pytest.raises(SceneError) as caught:
        check_buildable(with_settings(read_scene(scene), list(settings)))
    for word in words:
        assert word in str(caught.value)


def test_without_the_package_the_extra_is_named_and_nothing_runs(tmp_path, monkeypatch):
    original = builtins.__import__

    def without(name, *rest):
        if name == "exudyn":
            raise ModuleNotFoundError("No module named 'exudyn'", name="exudyn")
        return original(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    result = cli("compare", "engine", "--with", "exudyn", "-o", tmp_path / "out")
    refused(result, "exudyn is not installed", 'pip install "kaneflex[peer]"')
    refused(cli("compare", "engine", "--with", "adams", "-o", tmp_path / "out"), "--with = 'adams'", "Known: exudyn")
    monkeypatch.setattr("kaneflex.study.comparison.entry_points", lambda group: EntryPoints())
    refused(cli("compare", "engine", "--with", "exudyn", "-o", tmp_path / "out"), "pip install ./tests/peers")
    assert list(tmp_path.iterdir()) == []


def test_the_command_says_what_is_not_compared(peer, tmp_path):
    peer("exudyn")
    folder = tmp_path / "out"
    result = cli(
        "compare", "engine", "--with", "exudyn", "--peer-elements", 2, "--peer-steps", 1440, "--steps", 720,
        "-o", folder,
    )  # fmt: skip
    assert result.exit_code == 0
    assert "exudyn: piston_side_force is not compared: the other program has no such sensor" in result.stderr
    assert "exudyn: 2 ANCF cable elements a link" in result.stderr
    assert np.all([(folder / name).stat().st_size > 0 for name in ("overlay.png", "curves.nc", "differences.csv")])


def test_an_axis_between_its_nodes_is_the_cubic_through_them():
    """Places and slopes of x = 1 - s + 2 s^2 - s^3, y = s^3 along it, from both at nodes that stand 0.5 m apart."""
    x, y = np.polynomial.Polynomial([1, -1, 2, -1]), np.polynomial.Polynomial([0, 0, 0, 1])
    at = lambda s: np.array([[f(s)] for f in (x, y, x.deriv(), y.deriv())])  # noqa: E731
    reader = SimpleNamespace(
        built=SimpleNamespace(nodes={"rod": [0, 1, 2]}), _size=lambda link: 0.5,
        _coordinates=lambda node, order: at(0.5 * node),
    )  # fmt: skip
    for s in (0.0, 0.2, 0.5, 0.85, 1.0):
        assert PlanarRecorder._along(reader, "rod", s) == pytest.approx(at(s), abs=1e-14), s
