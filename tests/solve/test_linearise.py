"""The state space against the model's own matrices, modes with damping, and runs that it must reproduce."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import cli, refused
from machines import cantilever
from runs import model, run
from scipy.io import loadmat
from scipy.linalg import expm

import kaneflex
from kaneflex import OutputError, SceneError, linearise, load, scene_of
from kaneflex.fem.modes import damping_ratios, rayleigh_coefficients
from kaneflex.multibody.model.building import reference_modes
from kaneflex.plots import bode
from kaneflex.plots.style import styled
from kaneflex.report.tables import poles_table
from kaneflex.solve.simulation import solve

CANTILEVER = cantilever(
    'length = "500 mm", beam = {material = "steel", A = "400 mm^2", I = "13333 mm^4", elements = 3}', root="wall",
    loads='tip_force = {force_on = "bar.end", direction = [0, -1], value = "100 N"}',
    sensors="""
tip = {displacement = "bar.end", component = "y"}
bow = {displacement = "bar.mid", relative_to = "chord", component = "y"}
turn = {displacement = "bar.end", component = "angle"}
speed = {velocity = "bar.end", component = "y"}
reading = {acceleration = "bar.end", component = "y"}
moment = {bending_moment = "bar.start"}
shear = {shear_force = "bar.mid"}
strain = {strain = "bar.start", fibre = "10 mm"}
wall_force = {joint_force = "wall", component = "y"}
wall_moment = {joint_force = "wall", component = "angle"}""",
    solve={"preset": "linear", "duration": "20 ms", "steps": 4000},
)
MODAL, RAYLEIGH = "modal = {ratio = [0.01, 0.03]}", 'rayleigh = {ratio = 0.02, at = ["60 Hz", "400 Hz"]}'


@cache
def cantilever(damping: str) -> kaneflex.Model:
    return load(scene_of(f"{CANTILEVER}damping.{damping}"))


def poles(omega: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """Eigenvalues of a'' + 2 zeta omega a' + omega^2 a = 0 with positive imaginary part."""
    return -zeta * omega + 1j * omega * np.sqrt(1.0 - zeta**2)


@pytest.mark.parametrize("damping", [MODAL, RAYLEIGH])
def test_poles_are_the_modes_with_their_damping(damping):
    found = cantilever(damping)
    omega, _ = reference_modes(found, "all")
    if damping == MODAL:
        zeta = np.where(np.arange(len(omega)) == 0, 0.01, 0.03)
    else:
        alpha, beta = rayleigh_coefficients(0.02, 60.0, 400.0)
        zeta = alpha / (2.0 * omega) + beta * omega / 2.0
    assert (zeta < 1.0).all()
    system = linearise(found)
    assert system.poles == pytest.approx(poles(omega, zeta), rel=1e-9)
    shown = [line.split()[-1] for line in poles_table(system).splitlines()]
    assert shown[1:] == [f"{ratio:.3%}" for ratio in zeta[: len(shown) - 1]] and len(shown) > 3


def test_a_pole_at_zero_has_no_damping_ratio():
    shown = poles_table(SimpleNamespace(poles=np.array([0.0, -1.0 + 0.0j]))).splitlines()[1:]
    assert [line.split() for line in shown] == [["1", "0.000"], ["2", "0.159", "100.000%"]]


def test_adams_damps_by_frequency():
    """1 % below 100 Hz, 10 % below 1 kHz, critical above: this bar has modes at 81 Hz, 512 Hz and from 1.4 kHz on."""
    found = cantilever('modal = {ratio = "adams"}')
    omega, shapes = reference_modes(found, "all")
    assert np.count_nonzero(omega < 2 * np.pi * 100) == np.count_nonzero(omega[1:] < 2 * np.pi * 1000) == 1
    zeta = np.array([0.01, 0.1] + [1.0] * (len(omega) - 2))
    assert shapes.T @ found.C(0.0) @ shapes == pytest.approx(np.diag(2 * zeta * omega), abs=1e-8 * omega[-1])
    assert damping_ratios("adams", 2 * np.pi * np.array([999.9, 0.0, 99.9, 1000.1, 100.1])).tolist() == [
        0.1, 0.01, 0.01, 1.0, 0.1,
    ]  # fmt: skip


def test_a_step_of_the_load_gives_the_response_that_a_run_gives():
    """x' = A x + B u from rest has x = (e^(A t) - 1) A^-1 B u."""
    found = cantilever(MODAL)
    system, solution = linearise(found), solve(found)
    force = 100.0
    steady = np.linalg.solve(system.A, system.B[:, 0] * force)
    for k in (1, 400, 1500, 4000):
        x = (expm(system.A * solution.times[k]) - np.eye(len(system.A))) @ steady
        y = system.C @ x + system.D[:, 0] * force
        for name, value in zip(system.outputs, y, strict=True):
            series = solution.series[name].values
            assert value == pytest.approx(series[k], abs=1e-4 * np.abs(series).max()), (name, k)


def test_section_forces_under_coupled_follow_the_inputs():
    """A statically determinate bar: shear is the tip force, the moment grows with the distance from the tip. The part
    without axial vibration left the inputs out, so that a unit force had a shear of 1.47 between joints."""
    settings = ["solve.preset=coupled", "strain.strain=bar.mid", "sensors.middle={bending_moment='bar.mid'}"]
    found = load(kaneflex.with_settings(scene_of(CANTILEVER), settings))
    system = linearise(found, sensors=["shear", "strain", "middle"])
    static = (system.D - system.C @ np.linalg.solve(system.A, system.B))[:, 0]
    assert static == pytest.approx([-1.0, 0.01 * 0.25 / (210e9 * 13333e-12), -0.25], rel=1e-4)


def test_a_bode_plot_shows_the_static_answer_and_the_resonance():
    """F L^3 / (3 E I) at rest; at the first natural frequency the phase of a single mode, -90 degrees, and 1/(2 zeta)
    of its static share, 12/1.8751^4 of that (e.g. Meirovitch, Fundamentals of Vibrations)."""
    system = linearise(cantilever(MODAL), sensors=["tip", "speed"])
    static = -(0.5**3) / (3.0 * 210e9 * 13333e-12)
    assert system.frequency_response(np.zeros(1))[0, 0, 0] == pytest.approx(static, rel=1e-9)
    with styled():
        panels = bode.figure(system).axes
    hertz, size = panels[0].get_lines()[0].get_data()
    phase = panels[1].get_lines()[0].get_ydata()
    omega = abs(system.poles[0])
    peak = int(size.argmax())
    assert 2 * np.pi * hertz[peak] == pytest.approx(omega, rel=2e-3)
    assert size[peak] == pytest.approx(abs(static) * 12.0 / 1.8751**4 / 0.02, rel=1e-2)
    assert np.interp(omega / (2 * np.pi), hertz, phase) % 180.0 == pytest.approx(90.0, abs=3.0)
    speed = panels[2].get_lines()[0].get_ydata()
    assert speed == pytest.approx(2 * np.pi * hertz * size, rel=1e-9)
    legend = panels[1].get_legend().get_texts()[0].get_text()
    assert legend == "tip_force [m by N]" and panels[-1].get_xlabel() == "frequency [Hz]"


def test_a_bode_plot_needs_inputs_and_a_picture(tmp_path):
    system = linearise(cantilever(MODAL))
    with pytest.raises(SceneError, match="the state space has no input"):
        bode.figure(replace(system, inputs=(), input_units=(), B=system.B[:, :0], D=system.D[:, :0]))
    refused(cli("linearise", "engine", "-o", tmp_path / "a.npz", "--bode", tmp_path / "a.gif"), "not a kind of picture")
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("degrees", [0.0, 90.0, 250.0])
def test_matrices_are_those_of_the_model_at_that_instant(degrees):
    engine = model("engine", f"solve.mode_angle={degrees} deg")
    system, t = linearise(engine), engine.reference_time
    n = len(system.M)
    assert t == pytest.approx(degrees / 36000.0)
    assert system.t == t
    assert system.drives == {"main": pytest.approx(np.radians(degrees))}
    assert system.M == pytest.approx(engine.M(t))
    assert system.C_damping == pytest.approx(engine.C(t))
    parts = engine.K_s(t) + engine.K_d(t) + engine.K_c(t) + engine.K_g(t)
    assert system.K == pytest.approx(parts, rel=1e-9)
    assert (system.A[:n, :n] == 0).all() and (system.A[:n, n:] == np.eye(n)).all()
    assert system.M @ system.A[n:] == pytest.approx(-np.hstack([system.K, system.C_damping]), rel=1e-6, abs=1.0)
    assert (system.B[:n] == 0).all()


def test_terms_that_are_switched_off_stay_out():
    off = linearise(model("engine", "solve.mode_angle=90 deg", "solve.terms.geometric=false"))
    on = linearise(model("engine", "solve.mode_angle=90 deg"))
    engine = model("engine", "solve.mode_angle=90 deg")
    assert on.K - off.K == pytest.approx(engine.K_g(engine.reference_time), rel=1e-6, abs=1.0)
    assert (on.M == off.M).all() and (on.C_damping == off.C_damping).all()


ENGINE = ("solve.preset=linear", "solve.steps=720")
SHORT = ("solve.start=zero", "solve.duration=1 ms")


@pytest.mark.parametrize("reduced", [(), ("solve.modes=2",)], ids=["full", "craig-bampton"])
def test_outputs_on_the_moving_engine_follow_the_state(reduced):
    """Two runs under the same loads differ by C (x_1 - x_2) at every instant, every sensor alike."""
    starts = ("zero", "quasistatic")
    first, second = (run("engine-transient", *ENGINE, *reduced, f"solve.start={start}") for start in starts)
    for k in (3, 200, 611):
        system = linearise(first.model, float(first.times[k]))
        x = [np.concatenate([part[:, k] for part in solution.coordinates[:2]]) for solution in (first, second)]
        for name, difference in zip(system.outputs, system.C @ (x[0] - x[1]), strict=True):
            values = [solution.series[name].values for solution in (first, second)]
            scale = np.abs(values[0] - values[1]).max()
            assert difference == pytest.approx(values[0][k] - values[1][k], abs=1e-6 * scale + 1e-12), (name, k)


def start_of(scene: str, *settings: str) -> dict[str, float]:
    """What the sensors read at the first instant, undeformed and at rest in the links' frames."""
    solution = run(scene, *ENGINE, *settings, *SHORT)
    return {name: float(series.values[0]) for name, series in solution.series.items()}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("reduced", [(), ("solve.modes=2",)], ids=["full", "craig-bampton"])
@pytest.mark.parametrize("scene", ["engine", "engine-elastic-crank"])
def test_a_load_enters_as_in_two_runs_that_differ_by_it(scene, reduced):
    without = ("loads.gas.table=none", "loads.gas.column=none", "loads.gas.unit=none", "loads.gas.against=none",
               "loads.gas.period=none", "loads.gas.interpolation=none")  # fmt: skip
    constant = [(*without, *reduced, f"loads.gas.value={size} N") for size in (0, 2000)]
    system = linearise(model(scene, *ENGINE, *constant[0]), 0.0)
    readings = [start_of(scene, *settings) for settings in constant]
    column = system.D[:, system.inputs.index("gas")]
    for name, slope in zip(system.outputs, column, strict=True):
        difference = readings[1][name] - readings[0][name]
        assert 2000.0 * slope == pytest.approx(difference, rel=1e-6, abs=1e-7 * (1.0 + abs(readings[0][name]))), name
    forces = [model(scene, *ENGINE, *settings).F(0.0) for settings in constant]
    n = len(system.M)
    assert 2000.0 * system.M @ system.B[n:, system.inputs.index("gas")] == pytest.approx(
        forces[1] - forces[0], abs=1e-6
    )


@pytest.mark.exhaustive
@pytest.mark.parametrize("scene", ["engine", "engine-elastic-crank", "four-bar"])
def test_the_drives_acceleration_enters_as_in_two_runs_that_differ_by_it(scene):
    constant = ("drives.main.speed=none", "drives.main.cycle=none")
    courses = [(*constant, f"drives.main.law=1 + 30*t + {alpha / 2}*t**2") for alpha in (0, 5000)]
    system = linearise(model(scene, *ENGINE, *courses[0], *SHORT), 0.0)
    readings = [start_of(scene, *course) for course in courses]
    assert system.drives["main"] == pytest.approx(1.0)
    for name, slope in zip(system.outputs, system.D[:, system.inputs.index("main.acceleration")], strict=True):
        difference = readings[1][name] - readings[0][name]
        assert 5000.0 * slope == pytest.approx(difference, rel=1e-6, abs=1e-6 * (1e-3 + abs(difference))), name


def test_all_modes_give_the_transfer_functions_of_the_full_model():
    full, modal = (
        linearise(model("engine", *ENGINE, "solve.mode_angle=60 deg", *extra))
        for extra in ((), ("solve.reduction=modal",))
    )
    assert modal.states[0] == "mode_1" and modal.states[len(modal.M)] == "mode_1'"
    s = 2j * np.pi * 2500.0

    def transfer(system):
        return system.C @ np.linalg.solve(s * np.eye(len(system.A)) - system.A, system.B) + system.D

    assert transfer(modal) == pytest.approx(transfer(full), rel=1e-6, abs=1e-12)


def test_a_free_joint_has_no_acceleration_to_prescribe():
    found = linearise(model("engine-torque", "solve.preset=linear", "solve.duration=2 ms", "solve.steps=100"))
    assert "motor" in found.inputs and "main.acceleration" not in found.inputs
    assert found.input_units[found.inputs.index("motor")] == "N m"


# ---- files, command line, what is refused ------------------------------------------------------------------------


def test_files_hold_everything_by_name(tmp_path):
    system = kaneflex.linearise(model("engine", *ENGINE))
    system.save(tmp_path / "engine.npz")
    system.save(tmp_path / "engine.mat")
    with np.load(tmp_path / "engine.npz", allow_pickle=False) as found:
        numpy = dict(found)
    matlab = loadmat(tmp_path / "engine.mat", simplify_cells=True)
    for name in ("M", "C_damping", "K", "A", "B", "C", "D"):
        assert (numpy[name] == getattr(system, name)).all()
        assert (matlab[name] == getattr(system, name)).all()
    for name in ("states", "inputs", "outputs", "input_units", "output_units"):
        assert tuple(numpy[name]) == tuple(matlab[name]) == getattr(system, name)
    assert numpy["drives"] == matlab["drives"] == "main" and numpy["drive_angles"] == matlab["drive_angles"] == 0.0
    assert len(system.states) == len(system.A) and len(system.outputs) == len(system.C)
    again = tmp_path / "again.mat"
    system.save(again)
    assert again.read_bytes() == (tmp_path / "engine.mat").read_bytes()
    assert not re.search(rb"20\d\d|posix|Platform", again.read_bytes()[:116])


def test_the_modelica_model_is_read_back_by_another_program(peer, tmp_path):
    """Pymoca's parser finds the same matrices, inputs and outputs with their units."""
    peer("pymoca")
    from pymoca import ast, parser

    scene = kaneflex.scene_of(CANTILEVER.replace("tip = {disp", "tip_force = {disp"))
    system = linearise(load(scene))
    system.save(tmp_path / "2nd bar's.mo")
    found = parser.parse((tmp_path / "2nd bar's.mo").read_text(encoding="utf-8")).classes["model_2nd_bar_s"]

    def number(entry):
        if isinstance(entry, ast.Expression):  # - 1.0
            assert str(entry.operator) == "-" and len(entry.operands) == 1
            return -number(entry.operands[0])
        return float(entry.value)

    for key in "ABCD":
        (given,) = found.symbols[key].class_modification.arguments[0].value.modifications
        matrix = np.array([[number(entry) for entry in row.values] for row in given.values])
        assert (matrix == getattr(system, key)).all()
    kinds = {name: symbol.prefixes for name, symbol in found.symbols.items() if name.startswith("'")}
    names = ["tip_force", *system.outputs]
    assert "tip_force" in system.outputs
    names[1 + system.outputs.index("tip_force")] = "tip_force sensor"
    assert [*kinds] == [f"'{name}'" for name in names] and [*kinds.values()].count(["input"]) == 1
    assert len(found.equations) == 1 + len(system.outputs)
    text = (tmp_path / "2nd bar's.mo").read_text(encoding="utf-8")
    assert '\'wall_moment\'(unit = "N.m")' in text and '\'reading\'(unit = "m/s2")' in text
    assert "der(x) = A * x + B * u;" in text and "= C * x + D * u;" in text


def test_what_can_not_be_linearised_is_refused():
    for preset in ("rigid", "quasistatic"):
        with pytest.raises(SceneError, match=f"a {preset} model has no states"):
            linearise(model("engine", f"solve.preset={preset}"))
    with pytest.raises(SceneError, match="nearest known one is 'tip_axial'"):
        linearise(model("engine"), sensors=["tip_axal"])
    paper = model("engine-paper")
    with pytest.raises(SceneError, match="can't be computed from frozen matrices"):
        linearise(paper, sensors=["crank_torque"])
    assert "crank_torque" not in linearise(paper).outputs
    with pytest.raises(OutputError, match=r"\.npz, \.mat or \.mo"):
        linearise(paper).save("engine.csv")


def test_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shown = cli("linearise", "engine", "--at", "main=90deg", "--sensors", "tip_axial", "-o", "engine.npz")
    assert shown.exit_code == 0, shown.output
    assert "24 states, 2 inputs, 1 output" in shown.stdout
    with np.load("engine.npz") as found:
        assert found["t"] == pytest.approx(0.0025) and list(found["outputs"]) == ["tip_axial"]
    refused(cli("linearise", "engine", "-o", "engine.npz"), "the file exists", "--force")
    refused(cli("linearise", "engine", "-o", "engine.txt"), "engine.txt", ".npz, .mat or .mo")
    refused(cli("linearise", "engine", "--at", "pin=0", "-o", "other.npz"), "--at = 'pin=0'")
    refused(cli("linearise", "two-link-arm", "--at", "shoulder=90deg", "-o", "other.npz"), "shoulder never")
    paper = cli("linearise", "engine-paper", "-o", "paper.mat")
    assert paper.exit_code == 0 and "left out" in paper.stderr and "crank_torque" in paper.stderr
    assert sorted(path.name for path in Path().iterdir()) == ["engine.npz", "paper.mat"]
