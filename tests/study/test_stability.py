"""Stability of the periodic equations: Mathieu's tongues, what has no multipliers, and what the command says of it."""

import csv
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from machines import machine
from matplotlib.figure import Figure
from places import DATA
from runs import model, run
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

from kaneflex import SceneError, load, read_scene, scene_of, with_settings
from kaneflex.cli.stability import orders_of, speed_range
from kaneflex.integrate.by_steps import cycle_map
from kaneflex.plots.stability import _over_speed
from kaneflex.solve.linear_warnings import lost_stiffness
from kaneflex.solve.validity import validity_warnings
from kaneflex.solve.variants import Variants
from kaneflex.study.stability.floquet import Multipliers, StepLimit, floquet_multipliers, recommended, step_limits
from kaneflex.study.stability.frozen import buckling, freeze
from kaneflex.study.stability.sweep import ORDERS, Sweep, check_sweep, sweep

MATHIEU = json.loads((DATA / "mathieu.json").read_text())["computed"]
"""Characteristic values (NIST DLMF 28.2), where y'' + (a - 2 q cos 2z) y = 0 changes from stable to unstable."""


@cache
def mathieu(a: float, *settings: str) -> Multipliers:
    """Multipliers over the coefficient's period pi of the scene whose first mode obeys Mathieu's equation, q = 1."""
    return floquet_multipliers(model("mathieu", "bar.elements=24", f"pull.value={a - 1.0!r}", *settings))


def is_boundary(a: float, sign: float, *settings: str) -> bool:
    """Within 1e-6 the sum of the two multipliers passes 2 (period pi) or -2 (period 2 pi), where both are 1 or -1."""
    below, above = (mathieu(a + by, *settings).values.sum().real - 2.0 * sign for by in (-1e-6, 1e-6))
    return below * above < 0.0


@pytest.mark.parametrize(("kind", "order"), [("a", 0), ("b", 1), ("a", 1), ("b", 2), ("a", 2), ("b", 3)])
def test_boundaries_of_mathieus_equation(kind, order):
    exact = float(MATHIEU["1"][kind][order if kind == "a" else order - 1])
    assert is_boundary(exact, 1.0 if order % 2 == 0 else -1.0)


def test_boundary_of_a_strong_pulsation():
    exact = float(MATHIEU["5"]["a"][1])
    assert is_boundary(exact, -1.0, "pulse.law=-10 * cos(clock)")


@pytest.mark.parametrize(("a", "unstable"), [(-0.5, True), (-0.3, False), (0.5, True), (1.8, True), (1.9, False)])
def test_tongues_of_mathieus_equation(a, unstable):
    """q = 1: below a_0 = -0.455, from b_1 = -0.110 to a_1 = 1.859, and between the two. Undamped: product one."""
    found = mathieu(a)
    assert found.unstable is unstable and found.converged
    assert np.prod(found.values) == pytest.approx(1.0, abs=1e-9)


def test_the_scene_as_it_is_shipped_grows_fourfold():
    assert floquet_multipliers(model("mathieu")).radius == pytest.approx(4.156, abs=1e-3)


def test_damping_shrinks_the_multipliers_by_what_it_takes():
    """With z' damped at the rate c, z = exp(-c t / 2) y, y'' + (a - c^2 / 4 - 2 q cos 2t) y = 0."""
    plain = mathieu(1.0)
    ratio, omega = 0.05, 1.0
    damped = mathieu(1.0 + (ratio * omega) ** 2, f"damping.modal.ratio={ratio}")
    assert damped.radius == pytest.approx(plain.radius * np.exp(-ratio * omega * np.pi), rel=1e-6)
    assert damped.growth_rate == pytest.approx(plain.growth_rate - ratio * omega, abs=1e-6)


def test_a_model_without_periodic_equations_is_refused():
    with pytest.raises(SceneError, match="has no elastic equations"):
        mathieu(1.0, "solve.preset=rigid")
    with pytest.raises(SceneError, match="the scene has none"):
        mathieu(1.0, "solve.duration=1 s")
    for law, first in (("-2 * cos(t)", -2), ("sin(t) * sin(2 * t)", "[^0]+")):  # the second is 0 at both ends
        with pytest.raises(SceneError, match=rf"bar\.link\.P_0 is {first}.* at an instant and .* a cycle later"):
            mathieu(1.0, f"pulse.law={law}")


# ---- speeds, buckling, steps -------------------------------------------------------------------------------------


def first_speed() -> float:
    """The blade's speed of eta = 3.516, its first frequency at a standstill [rad/s]: beam theory's 1.8751^2."""
    profile = read_scene("rotating-cantilever").bodies["blade"].profile.at(0.0)
    return 1.8751040687119611**2 * float(np.sqrt(profile.E_I_z / profile.rho_A))


def test_blade_without_axial_forces_is_unstable_above_its_critical_speed():
    """K_s - omega^2 M is lost at the first frequency of the blade at rest; with K_g nothing happens there.

    A sweep also looks at speeds between the asked ones, where a pulsation could excite a frequency.
    """
    critical = first_speed()
    speeds = np.array([0.5, 0.9, 1.2]) * critical
    trap = sweep(with_settings(read_scene("rotating-cantilever"), ["solve.preset=linear"]), speeds, 2)
    assert trap.bands == ((pytest.approx(critical, rel=2e-4), speeds[-1]),)
    asked = np.searchsorted(trap.speeds, speeds)
    assert list(trap.speeds[asked]) == list(speeds) and list(trap.radii[asked] > 1) == [False, False, True]
    assert trap.converged.all() and list(trap.radii > 1) == list(trap.speeds > critical)
    right = sweep(read_scene("rotating-cantilever"), speeds, 2)
    assert right.bands == () and (right.radii < 1).all()


def test_a_drive_that_moves_backwards_is_varied_backwards(monkeypatch):
    loaded, load = [], Variants.load
    monkeypatch.setattr(Variants, "load", lambda self, settings: loaded.append(settings) or load(self, settings))
    found = sweep(with_settings(read_scene("rotating-cantilever"), ["shaft.speed=-10"]), np.array([5.0, 10.0]), 2)
    assert list(found.speeds[[0, -1]]) == [5.0, 10.0]
    assert loaded[:2] == [["drives.shaft.speed=-5.0"], ["drives.shaft.speed=-10.0"]]


def test_frozen_frequencies_of_the_blade_rise_with_the_speed():
    """The lag frequencies of Wright, Smith, Thresher & Wang (1982) at eta = 8: the same at all angles."""
    loaded = model("rotating-cantilever", "push.value=1e-9 N")
    frozen = freeze(loaded, 2, 12)
    profile = loaded.scene.bodies["blade"].profile.at(0.0)
    table = json.loads((DATA / "rotating_cantilever.json").read_text())["table"]
    row = next(row for row in table if row["eta"] == "8")
    unit = np.sqrt(profile.E_I_z / profile.rho_A) / (2 * np.pi)
    exact = [unit * float(row[f"lag_mode{k}"]) for k in (1, 2)]
    assert frozen.frequencies == pytest.approx(np.tile(exact, (len(frozen.times), 1)), rel=2e-4)
    assert (frozen.growth < 0).all()


def test_a_pinned_beam_buckles_under_eulers_load():
    """E I (pi / l)^2 = 1 N: at clock = 0 it is pushed by 2 N, and nowhere more."""
    loaded = model("mathieu")
    found = buckling(loaded, np.linspace(0.0, np.pi, 37))
    assert found.factors[0] == found.margin == pytest.approx(0.5, rel=1e-5)
    assert found.factors[9] > 1e6 and np.isinf(found.factors[18])  # no push at a quarter, a pull at half


def test_nothing_buckles_in_a_blade_that_is_pulled():
    assert buckling(model("rotating-cantilever"), np.array([0.0])).margin == np.inf


def test_what_nothing_holds_has_no_buckling_load():
    assert buckling(model("free-frame"), np.array([0.0])) is None
    shaft = machine(
        bodies=dict(shaft='length = 0.4, beam = {material = "steel", section = {circle = 0.02}, elements = 1}'),
        joints=dict(main="revolute ground shaft.start, axis = [1, 0, 0]",
                    far="revolute ground.far shaft.end, axis = [1, 0, 0]"),
        ground=dict(far=[0.4, 0, 0]), drives=dict(main='speed = "600 rpm", cycle = "360 deg"'),
        solve=dict(preset="linear", steps=72),
    )  # fmt: skip
    assert buckling(load(scene_of(shaft)), np.array([0.0])) is None  # its axial force is statically indeterminate


def test_largest_stable_steps_of_the_four_bar():
    """One step fewer than the limit lets a disturbance grow that the equations damp."""
    loaded = model("four-bar", "crank.elements=2", "coupler.elements=2", "follower.elements=2")
    multipliers = floquet_multipliers(loaded)
    limits = {limit.integrator: limit for limit in step_limits(loaded, multipliers)}
    found = {name: limit.steps for name, limit in limits.items()}
    assert found == {"radau": 8, "newmark": 128, "generalised-alpha": 35, "gauss": 74} and not multipliers.unstable
    assert not limits.pop("radau").limited  # by any steps that were tried
    for name, limit in limits.items():
        assert limit.limited and limit.step == pytest.approx(multipliers.period / limit.steps)
        for steps, stable in ((limit.steps, True), (limit.steps - 1, False)):
            cycle = cycle_map(loaded.system, loaded.scalars, 0.0, multipliers.period, steps, name)
            assert (abs(np.linalg.eigvals(cycle.monodromy)).max() < 1.0 + 1e-4) is np.bool_(stable)


def test_the_recommended_step_resolves_the_lowest_mode_and_is_stable():
    coarse = StepLimit("newmark", 8, 1.0, False)
    fine = StepLimit("gauss", 100, 0.08, True)
    assert recommended((coarse, fine), 20.0) == StepLimit("gauss", 1600, 0.005, True)  # order 4, 10 steps of 0.05 s
    assert recommended((coarse, fine), 0.0) == StepLimit("newmark", 72, 8 / 72, False)  # gauss needs more than 72
    assert recommended((StepLimit("gauss", None, None, True),), 1.0) is None


def test_a_speed_that_no_drive_has_is_not_varied():
    with pytest.raises(SceneError, match="the first drive has no constant speed"):
        sweep(read_scene("spin-up"), np.array([1.0]), 1)


# ---- what a run says ---------------------------------------------------------------------------------------------


def test_a_run_beyond_a_buckling_load_says_so():
    """Pushed by 2 N at first, the beam buckles under 1 N; pushed by 0.9 N it says nothing."""
    (warning,) = validity_warnings(run("mathieu"), [])
    assert "exceed a buckling load at t = 0 s, with a load factor of 0.5" in warning
    assert validity_warnings(run("mathieu", "pulse.law=-0.9 * cos(clock)"), []) == []


@pytest.mark.parametrize(("speed", "warned"), [(3.5, False), (3.53, True)])
def test_a_run_in_the_trap_says_so(speed, warned):
    unit = first_speed() / 1.8751040687119611**2
    found = lost_stiffness(
        model("rotating-cantilever", "solve.preset=linear", f"shaft.speed={speed * unit!r}"), np.linspace(0.0, 0.1, 11)
    )
    assert ["because of the spin" in text for text in found] == [True] * warned


def test_runs_that_keep_their_stiffness_say_nothing():
    times = np.linspace(0.0, 0.1, 11)
    assert lost_stiffness(model("rotating-cantilever"), times) == []
    assert lost_stiffness(model("free-frame"), times) == []  # nothing holds it: nothing is lost
    assert lost_stiffness(model("double-pendulum"), times) == []  # rigid


def test_bands_of_a_pulsating_force_against_its_frequency():
    """y'' + (1 - 2 p cos w t) y = 0 is Mathieu's with a = 4 / w^2, q = p a: unstable from b_1(q) to a_1(q)."""
    share = 0.1
    scene = with_settings(read_scene("mathieu"), ["bar.elements=24", f"pulse.law={-2 * share!r} * cos(clock)"])
    found = sweep(scene, np.linspace(1.5, 2.5, 9), 1)
    exact = [
        brentq(lambda w, boundary=boundary: 4.0 / w**2 - boundary(1, 4.0 * share / w**2), 1.5, 2.5)
        for boundary in (mathieu_a, mathieu_b)
    ]
    assert exact == pytest.approx([2 * (1 - share) ** 0.5, 2 * (1 + share) ** 0.5], abs=2e-3)  # Bolotin 1964, at first
    assert found.bands == (pytest.approx(tuple(exact), abs=1e-3),)


STRUT_EDGES = 1227.004, 1261.005, 2278.773, 2745.769
"""Speeds [rpm] where the largest multiplier of the strut's first mode passes 1 (SciPy's DOP853, Brent's method): of
y'' + 2 zeta omega y' + omega^2 (1 - P(t) / P_1) y = 0, zeta = 0.01, P = 345 + 518 cos(speed t) N."""


def test_bands_of_the_strut_are_those_of_its_first_mode():
    """Bolotin 1964: around omega_1 and 2 omega_1, omega_1 = 23.45 Hz under a mean of 20 % of Euler's load: 20.97 Hz.

    Speeds are 150 rpm apart, as the 41 of the command from 0 to 6000 rpm; the band around omega_1 is 34 rpm wide.
    """
    rpm = np.pi / 30
    speeds = rpm * np.linspace(900, 3000, 15)
    assert not any(STRUT_EDGES[0] < speed / rpm < STRUT_EDGES[1] for speed in speeds)
    found = sweep(read_scene("pulsating-strut"), speeds, 1)
    assert [edge / rpm for band in found.bands for edge in band] == pytest.approx(STRUT_EDGES, rel=1e-3)
    assert set(speeds) < set(found.speeds) and len(found.speeds) <= 2 * len(speeds)
    assert 0.5 * 150 < found.widest_gap / rpm <= 150 * (1 + 1e-9)
    assert (np.diff(found.speeds) > 0).all() and found.radii.shape == found.speeds.shape


def test_frozen_frequencies_leave_the_damping_out_and_the_growth_does_not():
    """At a quarter of the cycle nothing pushes: omega = 1 rad/s, and the damped poles decay at 1/2 1/s."""
    frozen = freeze(model("mathieu", "damping.modal.ratio=0.5"), 1, 4)
    assert 2 * np.pi * frozen.frequencies[1, 0] == pytest.approx(1.0, rel=1e-4)
    assert frozen.growth[1] == pytest.approx(-0.5, rel=1e-4)


def columns(path: Path) -> dict[str, list[str]]:
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {key: [row[key] for row in rows] for key in rows[0]}


def test_trap_is_found_and_written(tmp_path):
    """The blade without K_g: unstable above 148.05 rpm, its first frequency at rest (eta = 3.516)."""
    folder = tmp_path / "trap"
    arguments = ("rotating-cantilever", "--preset", "linear", "--vary", "shaft.speed=100:200rpm", "--points", "5")
    result = cli("stability", *arguments, "-o", str(folder))
    assert result.exit_code == 0, result.output
    assert "from 100 rpm to 200 rpm, unstable from 148.05 rpm to 200 rpm" in result.output
    assert "grows 272.9-fold" in result.output and "K_g is left out" in result.output
    assert {path.name for path in folder.iterdir()} == {
        "stability.json", "cycle.csv", "speeds.csv", "stability.png"
    }
    data = json.loads((folder / "stability.json").read_text())
    assert data["unstable"] and data["spectral_radius"] == pytest.approx(272.9, rel=1e-4)
    assert data["unstable_bands"] == [[pytest.approx(148.05 * np.pi / 30, rel=1e-4), pytest.approx(200 * np.pi / 30)]]
    assert data["buckling_margin"] is None
    speeds = columns(folder / "speeds.csv")
    radii = np.array(speeds["spectral_radius"], dtype=float)
    assert list(radii > 1) == [speed > 148.05 * np.pi / 30 for speed in map(float, speeds["speed"])]
    assert len(columns(folder / "cycle.csv")["frequency_1"]) == 144


def test_mathieus_scene_says_what_is_wrong_with_it(tmp_path):
    result = cli("stability", "mathieu", "--no-plots", "-o", str(tmp_path / "found"))
    assert result.exit_code == 0, result.output
    assert "unstable: a disturbance grows 4.1561-fold in a period of 3.1416 s" in result.output
    assert "the motion itself is unstable; integrators that add no growth: radau" in result.output
    assert "At the scene's own speed; --vary clock.speed=LOW:HIGH computes a range" in result.output
    assert "beyond the buckling load: the load factor is 0.5 at clock = 0 deg" in result.output
    assert {path.name for path in (tmp_path / "found").iterdir()} == {"stability.json", "cycle.csv"}
    assert cli("stability", "mathieu", "--no-plots", "-o", str(tmp_path / "found")).exit_code == 2


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [("0:12000rpm", 0.0, 400 * np.pi), ("600 rpm : 1200 rpm", 20 * np.pi, 40 * np.pi), ("10:20", 10.0, 20.0)],
)
def test_a_range_of_speeds(text, low, high, capsys):
    """A plain number is in rad/s, and that is said."""
    assert speed_range(read_scene("engine"), "main", f"main.speed={text}") == pytest.approx((low, high))
    told = "--vary main.speed=10:20: a plain number is in rad/s, so 190.986 rpm\n"
    assert capsys.readouterr().err == (told if text == "10:20" else "")


@pytest.mark.parametrize(
    ("text", "reason"),
    [("100rpm", "not of the form PATH=LOW:HIGH"), ("200:100rpm", "not greater"), ("0:5 kg", "an angular speed"),
     ("-1:2", "not negative")],
)
def test_a_range_that_is_none(text, reason):
    with pytest.raises(SceneError, match=reason) as found:
        speed_range(read_scene("engine"), "main", f"main.speed={text}")
    assert found.value.key == "--vary"


@pytest.mark.parametrize("text", ["speed=100:200rpm", "crank.speed=1:2", "main.rotation=1:2"])
def test_only_the_first_drives_speed_varies(text):
    with pytest.raises(SceneError, match=r"over the speeds of the first drive. Write main.speed=LOW:HIGH"):
        speed_range(read_scene("engine"), "main", text)


def test_a_number_of_speeds_needs_their_range():
    refused(cli("stability", "mathieu", "--points", "9"), "--points = 9: requires --vary")


def test_orders_meet_frequencies():
    """A frequency of 10 Hz meets order k at 10 / k turns a second."""
    speeds, nothing = 2 * np.pi * np.linspace(1.0, 11.5, 50), np.zeros(50)
    level = np.full((50, 1), 10.0)
    orders = (1.0, 1.5, 3.0)
    swept = Sweep("main", speeds, nothing, nothing, nothing, level, level, level, (), orders, ("mode 1",), "link")
    found = {crossing.order: crossing.speed for crossing in swept.crossings()}
    assert found == {k: pytest.approx(2 * np.pi * 10.0 / k) for k in (1.0, 1.5, 3.0)}


@pytest.mark.parametrize("text", ["", "1,,2", "0,1", "-1", "one", "nan", "inf", "1_0", "\uff11"])
def test_orders_that_are_none_are_refused(text):
    with pytest.raises(SceneError, match="orders must be positive numbers"):
        orders_of(text)


def test_orders_are_those_that_are_asked_for():
    assert orders_of("2, 0.5,1,1") == (0.5, 1.0, 2.0)


def test_campbells_diagram_names_its_curves():
    """Modes above a point of theirs, orders beside where they end; what the panel doesn't show has no name."""
    speeds, nothing = 2 * np.pi * np.linspace(1.0, 12.0, 50), np.zeros(50)
    level = np.tile([10.0, 40.0, 500.0], (50, 1))
    campbell, radii = Figure().subplots(2, 1)
    modes = ("mode 1", "mode 2", "mode 3")
    swept = Sweep("main", speeds, nothing, nothing, nothing + 0.5, level, level, level, (), ORDERS, modes, "link")
    _over_speed(campbell, radii, swept, 1.0, False)
    named = {text.get_text(): text.xy for text in campbell.texts if not text.get_text().endswith("rpm")}
    assert {*named} == {"mode 1", "mode 2", *(f"order {k}" for k in "123456")}
    assert (named["mode 1"], named["mode 2"]) == ((speeds[-1], 10.0), (speeds[-1], 40.0))
    assert named["order 3"] == pytest.approx((speeds[-1], 36.0))
    crossed = [line for line in campbell.get_lines() if line.get_marker() == "o"]
    assert len(crossed) == len(swept.crossings()) > 0
    assert (campbell.get_ylabel(), radii.get_ylabel()) == ("frequency [Hz]", "multiplier [1]")
    campbell.figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in campbell.texts if text.xy[0] == speeds[-1]]
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])
    assert "axes that turn with the links" in campbell.get_title()


@pytest.mark.parametrize("name", ["double-pendulum", "pin-ended-cross"])
def test_without_a_constant_speed_there_is_none_to_vary(name):
    """Of free joints, and of a frame that nothing drives."""
    with pytest.raises(SceneError, match="--vary: the first drive has no constant speed"):
        check_sweep(read_scene(name).drives)
