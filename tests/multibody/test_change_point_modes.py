"""Change points: rigid loops pass them on the branch of their velocities; modes and standing there are refused."""

import numpy as np
import pytest
from command_line import cli, refused, unrendered
from lifting import lifted
from machines import STRIP, WEIGHT, four_bar
from scipy.integrate import solve_ivp
from scipy_motion import scipy_motion

from kaneflex import SceneError, load, scene_of, simulate
from kaneflex.integrate.system import Outcome
from kaneflex.multibody.time import lost_branch

PARALLELOGRAM = four_bar(
    'length = "0.1 m", mass = "0.2 kg"', STRIP, 'length = "0.1 m", mass = "0.2 kg"',
    'free = true, angle = 1.0, initial_speed = "20 rad/s"', "P", names="ABCD", more={"C": 'branch = "+"'},
    gravity=WEIGHT, ground={"P": ["0.3 m", 0]}, sensors='phi = {position = "A", component = "angle"}',
    solve={"preset": "coupled", "duration": "0.4 s", "steps": 160},
)  # fmt: skip


def test_a_run_through_a_change_point_is_written(tmp_path, monkeypatch):
    unrendered(monkeypatch)
    file, out = tmp_path / "scene.toml", tmp_path / "out"
    file.write_text(PARALLELOGRAM)
    result = cli("run", file, "-o", out, "--frames", 2, "--set", "solve.errors=none")
    assert result.exit_code == 0, result.stderr
    said = "no modes at solve.mode_angle = 0 deg, a dead centre or change point, where A does not determine"
    assert said in " ".join((result.stdout + result.stderr).split())
    assert (out / "summary.json").exists()


def test_modes_of_a_change_point_are_refused_with_the_cure(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(PARALLELOGRAM)
    refused(cli("modes", file), "solve.mode_angle = '0 deg'", "Choose another position")


def test_a_prescribed_run_through_a_change_point_is_refused():
    """Without notice the mechanism went on as an antiparallelogram, where it has another speed."""
    free, driven = 'free = true, angle = 1.0, initial_speed = "20 rad/s"', 'speed = "20 rad/s", angle = 1.0'
    with pytest.raises(SceneError, match=r"joints = '.+': a loop does not close, or the position is singular"):
        load(scene_of(PARALLELOGRAM.replace(free, driven)))


def ladder(count: int, tolerance: float, integrator: str = "radau") -> dict:
    """IFToMM's benchmark A02: count + 1 vertical cranks of 1 m, joined by couplers of 1 m; tip speed 1 m/s."""
    bar, couplers = {"length": 1.0, "mass": "1 kg"}, range(count)
    joints = {f"A{k}": {"revolute": [f"ground.P{k}", f"crank{k}.start"]} for k in range(count + 1)}
    for k in couplers:
        joints[f"B{k}"] = {"revolute": [f"crank{k}.end", f"coupler{k}.start"]}
        joints[f"C{k}"] = {"revolute": [f"coupler{k}.end", f"crank{k + 1}.end"], "branch": "+"}
    return {
        "schema": 1, "gravity": [0, "-9.81 m/s^2"], "ground": {f"P{k}": [float(k), 0] for k in range(count + 1)},
        "bodies": {f"crank{k}": bar for k in range(count + 1)} | {f"coupler{k}": bar for k in couplers},
        "joints": joints, "drives": {"A0": {"free": True, "angle": "90 deg", "initial_speed": "-1 rad/s"}},
        "sensors": {f"phi{k}": {"position": f"A{k}", "component": "angle"} for k in range(count + 1)},
        "solve": {
            "preset": "coupled", "duration": "10 s", "steps": 1000, "errors": "none", "tolerance": tolerance,
            "integrator": integrator,
        },
    }  # fmt: skip


def one_degree_of_freedom(count: int, times: np.ndarray, speed: float = -1.0) -> np.ndarray:
    """Angle of all cranks: couplers translate, so that (n + 1)/3 + n = inertia [kg m^2], (n + 1)/2 + n kg at 1 m."""
    inertia, moment = (count + 1) / 3 + count, ((count + 1) / 2 + count) * 9.81
    found = solve_ivp(
        lambda t, y: [y[1], -moment * np.cos(y[0]) / inertia], (0.0, times[-1]), [np.pi / 2, speed], "DOP853", times,
        rtol=3e-14, atol=1e-14,
    )  # fmt: skip
    return found.y[0]


@pytest.mark.parametrize(
    ("count", "tolerance", "integrator"),
    [(1, 1e-12, "radau"), (3, 1e-9, "radau"), (3, 1e-9, "gauss"), (8, 1e-6, "radau"), (8, 1e-10, "radau")],
)
def test_loops_that_become_singular_together_go_on_as_they_move(count, tolerance, integrator):
    """The cranks pass the horizontal 27 times; the other branch there is metres off."""
    solution = simulate(load(scene_of(ladder(count, tolerance, integrator))))
    assert solution.outcome is Outcome.COMPLETED
    exact = one_degree_of_freedom(count, np.asarray(solution.times))
    for k in range(count + 1):
        off = np.ravel(solution.series[f"phi{k}"].values) - exact
        # rounding grows at every horizontal: to 3e-10 at the end where C's compiler fuses products and sums
        assert abs(off).max() < 100 * tolerance + 1e-9


def beside(raw: dict, other: dict, metres: float) -> dict:
    """Two mechanisms in one scene, the names of the other one's parts with an x behind."""

    def named(address: str) -> str:
        body, point = address.split(".")
        return f"{body}.{point}x" if body == "ground" else f"{body}x.{point}"

    joints = {name: {key: [named(side) for side in value] if key == "revolute" else value
                     for key, value in joint.items()} for name, joint in other["joints"].items()}  # fmt: skip
    more = {
        "ground": {name: [x + metres, y] for name, (x, y) in other["ground"].items()},
        "bodies": other["bodies"], "joints": joints, "drives": other["drives"],
        "sensors": {name: sensor | {"position": f"{sensor['position']}x"} for name, sensor in other["sensors"].items()},
    }  # fmt: skip
    return raw | {key: raw[key] | {f"{name}x": value for name, value in part.items()} for key, part in more.items()}


@pytest.mark.parametrize(("other", "speed", "tolerance"), [(1, -1.0, 1e-9), (2, -3.0, 1e-10), (2, -3.0, 3e-10)])
def test_linkages_that_pass_change_points_beside_each_other_go_on_as_they_move(other, speed, tolerance):
    """Each is moved by a coordinate of its own. The first two were 39 rad off, without a word; the others ended."""
    raw = ladder(other, tolerance)
    raw["drives"]["A0"]["initial_speed"] = f"{speed} rad/s"
    solution = simulate(load(scene_of(beside(ladder(1, tolerance), raw, 5.0))))
    assert solution.outcome is Outcome.COMPLETED
    times = np.asarray(solution.times)
    for name, count, first in [("phi0", 1, -1.0), ("phi1", 1, -1.0), (f"phi{other}x", other, speed)]:
        off = np.ravel(solution.series[name].values) - one_degree_of_freedom(count, times, first)
        assert abs(off).max() < 100 * tolerance


def test_a_run_that_leaves_its_branch_ends_there():
    """SciPy's steps know no branches: beyond the 16th change point the motion would be metres off."""
    solution = scipy_motion(load(scene_of(ladder(3, 1e-6, "gauss"))))
    assert solution.outcome is Outcome.SINGULAR
    assert "the energy balance jumps at t = 6.56" in solution.message and "integrator = radau" in solution.message
    times = np.asarray(solution.times)
    assert 6.5 < times[-1] < 6.57
    off = np.ravel(solution.series["phi3"].values) - one_degree_of_freedom(3, times)
    assert abs(off).max() < 1e-4


def test_a_loss_of_energy_at_a_change_point_is_not_blamed_on_the_tolerance(monkeypatch):
    monkeypatch.setattr(lost_branch, "departure", lambda system, path, integrator: None)
    solution = scipy_motion(load(scene_of(ladder(3, 1e-6, "gauss"))))
    assert solution.outcome is Outcome.COMPLETED
    (said,) = [text for text in solution.warnings if "energy balance" in text]
    assert "jumps at t = 6.5" in said and "singular position" in said and "tolerance does not help" in said


BARS = {"crank": 1.0, "coupler": 3.0, "rocker": 2.5, "ground": 4.5}


def unequal(drive, preset, bars=BARS, **solve):
    """A four-bar linkage of these lengths."""
    *bodies, far = (bars[name] for name in ("crank", "coupler", "rocker", "ground"))
    return four_bar(
        *(f'length = {length}, mass = "1 kg"' for length in bodies), drive, "P", names="ABCD",
        more={"C": 'branch = "+"'}, gravity=WEIGHT, ground={"P": [far, 0]},
        sensors="""
phi = {position = "A", component = "angle"}
psi = {position = "D", component = "angle"}""",
        solve={"preset": preset, "duration": "3 s", "steps": 300, "errors": "none", **solve},
    )  # fmt: skip


def test_a_linkage_that_stands_at_its_change_point_is_named():
    drive = 'speed = "0 rpm", angle = "180 deg"'
    with pytest.raises(SceneError, match=r"singular position.*A = 180 deg.*coupler and rocker lie on one line"):
        load(scene_of(unequal(drive, "rigid")))


def test_a_run_that_starts_at_a_change_point_is_named():
    """At 180 deg the bars lie on one line; at 0 deg two pins coincide, and what is placed on them locks the crank: the
    run completed, and began at rest."""
    raw = ladder(1, 1e-8)
    raw["drives"]["A0"] |= {"angle": "180 deg", "initial_speed": "-5 rad/s"}
    solution = simulate(load(scene_of(raw)))
    assert solution.outcome is Outcome.SINGULAR and len(solution.times) == 1
    assert "singular position" in solution.message
    raw["drives"]["A0"]["angle"] = "0 deg"
    with pytest.raises(SceneError, match=r"drives.A0.initial_speed = -5.*singular position.*Start near"):
        simulate(load(scene_of(raw)))


def test_a_free_joint_that_stops_at_a_singular_position_is_told_so():
    """The run passes the position, where the kernels keep the branch."""
    raw = ladder(1, 1e-8)
    raw["solve"] = {"preset": "rigid", "duration": "3 s", "steps": 300, "errors": "none"}
    with pytest.raises(SceneError, match=r"joints.* singular position before t = 0\.71.*Use preset coupled"):
        simulate(load(scene_of(raw)))


def test_a_change_point_of_unequal_bars_keeps_the_energy():
    """At 180 deg; where the motion is interpolated nothing but the energy knows that it is the right one."""
    drive = 'free = true, angle = "90 deg", initial_speed = "4 rad/s"'
    solution = simulate(load(scene_of(unequal(drive, "coupled", tolerance=1e-11))))
    assert solution.outcome is Outcome.COMPLETED
    assert np.ptp(solution.series["phi"].values) > 3 * 2 * np.pi  # it turns, and passes more than three times
    assert solution.energy.drift < 1e-9


@pytest.mark.parametrize("preset", ["rigid", "coupled"])
@pytest.mark.parametrize("scale", [1e-9, 1e9])
def test_a_linkage_of_any_size_closes(scale, preset):
    bars = {name: scale * length for name, length in BARS.items()} | {"ground": 4.0 * scale}
    solution = simulate(load(scene_of(unequal('speed = "20 rpm"', preset, bars))))
    psi = np.ravel(solution.series["psi"].values)
    phi = np.ravel(solution.series["phi"].values)
    off = np.hypot(4.0 + 2.5 * np.cos(psi) - np.cos(phi), 2.5 * np.sin(psi) - np.sin(phi)) - 3.0
    assert abs(off).max() < 1e-9


def in_space(flat: dict | str, sensors: dict, **settings: float | str) -> dict:
    """The same turned into space, all joints at zero where it starts."""
    flat = scene_of(flat)
    deep = lifted(flat, zero_at_start=True)
    for name, drive in flat.drives.items():
        deep["drives"][name] = {"free": True, "initial_speed": drive.initial_speed}
    deep["sensors"] = {name: {"position": joint, "component": "angle"} for name, joint in sensors.items()}
    asked = {key: flat.raw["solve"][key] for key in ("preset", "duration", "steps", "errors")}
    return deep | {"solve": asked | settings}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(
    ("count", "tolerance", "integrator"),
    [(1, 1e-10, "radau"), (3, 1e-9, "gauss"), (3, 1e-12, "radau"), (8, 1e-6, "radau"), (8, 1e-10, "radau")],
)
def test_loops_in_space_go_on_as_they_move(count, tolerance, integrator):
    """As in the plane. Rounding leaves some 3e-10 rad after 27 change points."""
    sensors = {f"phi{k}": f"A{k}" for k in range(count + 1)}
    given = in_space(ladder(count, tolerance), sensors, tolerance=tolerance, integrator=integrator)
    solution = simulate(load(scene_of(given)))
    exact = one_degree_of_freedom(count, np.asarray(solution.times))
    for name in sensors:
        off = np.ravel(solution.series[name].values) - exact + np.pi / 2
        assert abs(off).max() < max(100 * tolerance, 1e-9)


def test_a_change_point_of_unequal_bars_in_space_goes_on_as_in_the_plane():
    drive = 'free = true, angle = "90 deg", initial_speed = "4 rad/s"'
    flat = unequal(drive, "coupled", tolerance=1e-11)
    plane = simulate(load(scene_of(flat)))
    space = simulate(load(scene_of(in_space(flat, {"phi": "A", "psi": "D"}, tolerance=1e-11))))
    for name in ("phi", "psi"):
        one, other = (np.ravel(solution.series[name].values) for solution in (plane, space))
        assert abs((one - one[0]) - (other - other[0])).max() < 3e-8
