"""What runs say of their own error, one-way ones and those of preset coupled, against what finer models show."""

import itertools
import json
import time

import numpy as np
import pytest
from click.testing import CliRunner
from machines import ABSORBER
from runs import solved

import kaneflex
from kaneflex import load, with_settings
from kaneflex.cli import main
from kaneflex.multibody.model import assembly
from kaneflex.multibody.model.initial_state import choose
from kaneflex.multibody.time import shooting
from kaneflex.response.coupled_motion import CoupledMotion
from kaneflex.solve import coupled, coupled_corrections, error_estimates, one_way_corrections
from kaneflex.solve.error_stages import Read
from kaneflex.solve.initial import state_after
from kaneflex.solve.run_result import nominal_seconds, seconds_of_steps
from kaneflex.solve.simulation import solve

FINE = ("solve.preset=stiffened", "solve.modes=all", "solve.integrator=radau")


@pytest.fixture(scope="module")
def engine():
    """The engine, and its sensors by 16 elements in 2880 steps."""
    scene = kaneflex.read_scene("engine")
    return scene, solved(scene, *FINE, "rod.elements=16", "solve.steps=2880")


def effectivities(found, fine, least=1e-5):
    """By sensor whose error is more than a share of its peak: the estimate over the error that a finer run shows."""
    estimates, reason = found.errors
    assert reason == "" and set(estimates) == set(found.model.scene.sensors)
    every, ratios = (len(fine.times) - 1) // (len(found.times) - 1), {}
    assert every * (len(found.times) - 1) == len(fine.times) - 1
    for name, estimate in estimates.items():
        expected = fine.series[name].values[::every]
        error = abs(found.series[name].values - expected).max()
        if error > least * abs(expected).max():
            ratios[name] = estimate.total / error
    return ratios


def check_effectivities(found, fine, kind, least):
    """Of every sensor: between `least` and 2 of the error that a finer run shows, and of the kind of what is coarse."""
    ratios = effectivities(found, fine)
    for name, ratio in ratios.items():
        assert least < ratio < 2.0, name
        estimate = found.errors[0][name]
        if kind and estimate.total > 1e-3 * abs(fine.series[name].values).max():
            assert getattr(estimate, kind) > 0.5 * estimate.total, name
    assert len(ratios) > 4 and 0.8 < np.median([*ratios.values()]) < 1.35


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("kind", "settings"), [
    ("terms", ["solve.preset=rigid"]),
    ("terms", ["solve.preset=quasistatic"]),
    ("terms", ["solve.preset=linear"]),
    ("terms", ["solve.terms.damping=false"]),
    ("modes", ["solve.modes=1"]),
    ("elements", ["rod.elements=1"]),
    ("elements", ["rod.elements=2", "solve.tolerance=1e-8"]),
    ("time", ["solve.integrator=newmark", "solve.steps=360"]),
    ("time", ["solve.integrator=radau", "solve.steps=180"]),
    ("time", ["solve.tolerance=0.01"]),
], ids=lambda part: part if isinstance(part, str) else ",".join(part))  # fmt: skip
def test_a_plus_minus_is_the_error_that_a_finer_model_shows(engine, kind, settings):
    scene, fine = engine
    check_effectivities(solved(scene, *settings), fine, kind, 0.6)


START = "solve.start=quasistatic"


@pytest.fixture(scope="module")
def beginning():
    """The engine's first turn from a slow start, by 16 elements in 2880 steps."""
    scene = kaneflex.read_scene("engine")
    return scene, solved(scene, *FINE, START, "rod.elements=16", "solve.steps=2880")


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("kind", "settings"), [
    ("terms", ["solve.preset=rigid"]),
    ("terms", ["solve.preset=linear"]),
    ("modes", ["solve.modes=1"]),
    ("elements", ["rod.elements=2"]),
    ("time", ["solve.integrator=newmark", "solve.steps=180"]),
    ("time", ["solve.integrator=generalised-alpha", "solve.steps=180"]),
    ("time", ["solve.integrator=radau", "solve.steps=90"]),
], ids=lambda part: part if isinstance(part, str) else ",".join(part))  # fmt: skip
def test_a_transient_has_a_plus_minus_by_steps(beginning, kind, settings):
    scene, fine = beginning
    check_effectivities(solved(scene, START, *settings), fine, kind, 0.6)


def test_what_starts_from_a_given_shape_is_corrected_from_there():
    """A richer model that began elsewhere would be another motion. (Of the finer mesh the user has given nothing.)"""
    scene = kaneflex.read_scene("spin-up")
    state = with_settings(scene, ["solve.duration=3 s", "solve.steps=1200"])
    last = solve(load(state)).state()
    assert abs(last["displacements"]["beam.4.v"]) > 0.01
    begun = state.seen(solve=state.solve.model_copy(update={"start": kaneflex.scene.start.Start(**last)}))
    estimates, reason = solve(load(begun)).errors
    assert reason == "" and 0.0 < estimates["tip_transverse"].total < 1e-3 * abs(last["displacements"]["beam.4.v"])


@pytest.mark.parametrize("settings", [[], ["solve.integrator=newmark"]], ids=["radau", "newmark"])
def test_cycles_whose_harmonics_converge_too_slowly_are_corrected_by_steps(settings):
    scene = kaneflex.read_scene("four-bar")
    coarse = ["crank.elements=1", "coupler.elements=1", "follower.elements=1", "solve.steps=180"]
    finer = ["crank.elements=4", "coupler.elements=4", "follower.elements=4", "solve.steps=360"]
    found, fine = solved(scene, *coarse, *settings), solved(scene, *FINE, *finer)
    if not settings:
        assert found.trajectory.solver.startswith("radau")
    check_effectivities(found, fine, "elements", 0.6)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("kind", "settings"),
    [("elements", ["rod.elements=2"]), ("terms", ["solve.preset=linear", "shaft.speed=1500 rpm"]),
     ("modes", ["solve.modes=1"])],
    ids=lambda part: part if isinstance(part, str) else ",".join(part),
)  # fmt: skip
def test_transients_in_space_are_corrected_by_steps(kind, settings):
    scene = with_settings(
        kaneflex.read_scene("spatial-slider-crank-elastic"),
        ["solve.start=quasistatic", "solve.duration=0.03 s", "solve.steps=300", *settings],
    )
    fine = solved(scene, *FINE, "rod.elements=8", "solve.steps=600")
    check_effectivities(solved(scene), fine, kind, 0.6)


def test_a_part_of_a_run_has_the_errors_of_its_instants(beginning):
    scene, _ = beginning
    whole = solved(scene, START, "solve.preset=linear")
    half = whole.at(np.linspace(0.0, 0.5 * whole.times[-1], 37))
    for name, own in half.errors[0].items():
        assert 0.0 < own.total <= 1.01 * whole.errors[0][name].total


def test_terms_that_are_left_out_are_a_source_of_error():
    scene = kaneflex.read_scene("engine")
    for setting, sensor in (("solve.terms.geometric=false", "mid_transverse"), ("solve.preset=rigid", "crank_torque")):
        assert solved(scene, setting).errors[0][sensor].terms > 0


@pytest.mark.parametrize("name", ["engine", "spatial-slider-crank-elastic"])
def test_equations_are_assembled_anew_for_other_elements_alone(monkeypatch, name):
    """They have all groups of terms, and the run with fewer terms has the motion of their scalars."""
    found, build, built = solved(kaneflex.read_scene(name), "solve.preset=linear"), one_way_corrections.build_model, []
    monkeypatch.setattr(one_way_corrections, "build_model", lambda *given: built.append(given) or build(*given))
    estimates, reason = found.errors
    assert reason == "" and any(each.terms > 0.0 for each in estimates.values()) and len(built) == 1


def test_statics_of_a_drive_that_does_not_come_back_are_corrected_from_a_slow_start():
    """Not on harmonics: what jumps from the end of a cycle to its beginning is none. They know no other start."""
    drives = ["drives.main.speed=none", "drives.main.cycle=none", "drives.main.law='600 * t + 900 * t**2'",
              "drives.main.period=0.01 s"]  # fmt: skip
    scene = with_settings(kaneflex.read_scene("engine"), drives)
    statics = solved(scene, "solve.preset=quasistatic", "solve.start=zero", "solve.steps=720")
    check_effectivities(statics, solved(scene, *FINE, START, "rod.elements=16", "solve.steps=1440"), "terms", 0.6)
    estimates, reason = solved(scene, "solve.preset=rigid", "solve.start=periodic").errors
    assert not estimates and reason == "not estimated: the motion or its loads are not periodic"


def test_reductions_have_no_use_where_nothing_deforms():
    """The estimate is then of all of the deformation, whatever modes the scene would take."""
    modal = solved(kaneflex.read_scene("mathieu"), "solve.preset=rigid", "solve.steps=100")
    assert modal.errors[1] == "" and modal.errors[0]["mid_transverse"].terms == 0.0
    for reduction in ("modal", "craig-bampton"):
        settings = ("solve.preset=rigid", f"solve.reduction={reduction}", "solve.modes=1", "solve.steps=100")
        estimates, reason = solved(kaneflex.read_scene("engine"), *settings).errors
        assert reason == "" and estimates["mid_transverse"].terms > 0.0 == estimates["mid_transverse"].modes


def test_richer_models_that_take_long_are_not_solved_without_being_asked(monkeypatch):
    """Modal damping fills the frame's matrices: by 240 coordinates its steps took an hour."""
    frame = load(with_settings(kaneflex.read_scene("free-frame"), ["damping.modal.ratio=882"]))
    assert seconds_of_steps(frame, frame.options.steps) > one_way_corrections.LONGEST
    monkeypatch.setattr(one_way_corrections, "LONGEST", 0.0)
    scene = with_settings(kaneflex.read_scene("engine-transient"), ["solve.duration=5 ms", "solve.steps=100"])
    estimates, reason = solved(scene).errors
    assert not estimates and 'request it by solve.errors = "total"' in reason
    assert solved(scene, "solve.errors=total").errors[0]["mid_transverse"].elements > 0.0


def test_what_cannot_be_estimated_is_said():
    for name, settings, said in (
        ("engine-paper", [], "not estimated under preset paper"),
        ("elastic-double-pendulum", ["solve.preset=stiffened", "solve.steps=50"], "on free joints"),
        ("robot-arm", ["solve.steps=50"], "no body is elastic, and drives prescribe the motion"),
    ):
        estimates, reason = solved(kaneflex.read_scene(name), *settings).errors
        assert not estimates and said in reason, name


COUPLED = ("solve.preset=coupled",)
MANY_MODES = (*COUPLED, "solve.modes=8", "solve.tolerance=1e-10")


@pytest.fixture(scope="module")
def cycle():
    """The cycle's cycle under preset coupled by 16 elements with 8 modes."""
    scene = kaneflex.read_scene("engine")
    return scene, solved(scene, *MANY_MODES, "rod.elements=16", "solve.steps=1440")


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("kind", "settings"), [
    ("modes", ["solve.modes=1"]),
    ("elements", ["rod.elements=2", "solve.modes=4"]),
    ("time", ["solve.tolerance=1e-5", "solve.steps=180"]),
], ids=lambda part: part if isinstance(part, str) else ",".join(part))  # fmt: skip
def test_a_coupled_cycle_has_a_plus_minus(cycle, kind, settings):
    scene, fine = cycle
    found = solved(scene, *COUPLED, *settings, "solve.errors=all")
    check_effectivities(found, fine, kind, 0.8)
    assert all(each.terms == 0.0 and each.coupling is None for each in found.errors[0].values())
    by_default = solved(scene, *COUPLED, *settings)
    check_effectivities(by_default, fine, None, 0.8)
    assert all(each.time is each.modes is each.terms is each.elements is None for each in by_default.errors[0].values())


def test_one_richer_run_gives_the_error_of_a_coupled_run(monkeypatch):
    """All parts at once, at a tight tolerance by longer steps than the run's; each by itself is asked for."""
    scene, runs = with_settings(kaneflex.read_scene("engine"), [*COUPLED, "solve.steps=72"]), []
    run = coupled_corrections.simulate_coupled
    monkeypatch.setattr(coupled_corrections, "simulate_coupled", lambda *given: runs.append(given) or run(*given))
    for setting, steps in (("solve.tolerance=1e-8", [36]), ("solve.tolerance=1e-6", [144]), ("solve.steps=75", [150]),
                           ("solve.errors=all", [144] * 3)):  # fmt: skip
        found = solved(scene, setting)
        runs.clear()
        assert found.errors[0] and [given[0].options.steps for given in runs] == steps


def test_a_link_of_few_elements_does_not_limit_the_modes_of_others():
    """The crank's two elements have the three modes of the run and no more, the rod's have: its error was 0."""
    found = solved(kaneflex.read_scene("engine-elastic-crank"), *COUPLED, "solve.steps=180", "solve.errors=all")
    peak = abs(found["mid_transverse"].values).max()
    assert found.errors[0]["mid_transverse"].modes > 1e-4 * peak


def test_the_work_of_a_run_in_space_grows_linearly_with_its_speeds():
    """A run of 0.2 s was taken for one of 14 s, which is too long for an estimate by default."""
    found = solved(kaneflex.read_scene("robot-arm-elastic"), *COUPLED)
    assert found.errors[1] == "" and set(found.errors[0]) == set(found.model.scene.sensors)


def test_a_cycle_knows_how_far_it_is_from_repeating(monkeypatch):
    """Of tight steps what is left of the search for its start is all that there is."""
    settings = [*COUPLED, "solve.tolerance=1e-11", "solve.steps=720", "solve.errors=all"]
    scene = with_settings(kaneflex.read_scene("engine"), settings)
    found = solved(scene)
    monkeypatch.setattr(coupled, "HARMONICS", 1e-9)
    fine = solved(scene, "solve.tolerance=1e-13")
    for name in ("tip_axial", "mid_transverse"):
        error = abs(found.series[name].values - fine.series[name].values).max()
        assert 0.6 < found.errors[0][name].time / error < 1.4


@pytest.mark.parametrize("tolerance", ["1e-5", "1e-8"])
def test_a_cycle_of_a_free_joint_has_a_plus_minus(monkeypatch, tolerance):
    scene = with_settings(kaneflex.scene_of(ABSORBER), ["solve.steps=60"])
    found = solved(scene, f"solve.tolerance={tolerance}")
    assert found.errors[0]
    monkeypatch.setattr(shooting, "REPEATS", 1e-9)
    ratios = effectivities(found, solved(scene, "solve.tolerance=1e-12"), least=1e-10)
    assert len(ratios) == 2 and all(0.8 < ratio < 1.35 for ratio in ratios.values()), ratios


def test_a_soft_pendulum_of_four_elements_knows_how_far_its_bending_moment_is_off():
    """By some % of its peak in a second; its hinge's force rings with another phase each time."""
    scene = with_settings(kaneflex.read_scene("elastic-pendulum"), ["solve.duration=1 s", "solve.steps=100"])
    fine = solved(scene, *MANY_MODES, "bodies.strip.beam.elements=16")
    for found in (solved(scene, *COUPLED), solved(scene, *COUPLED, "solve.errors=all")):
        ratios = effectivities(found, fine)
        assert {"mid_moment", "tip_bend", "hinge_force_x"} <= set(ratios)
        assert all(0.8 < ratio < 2.0 for ratio in ratios.values()), ratios
    moment = found.errors[0]["mid_moment"]
    assert 0.02 < moment.total / abs(found.series["mid_moment"].values).max() < 0.2
    assert moment.elements > 0.5 * moment.total > 100.0 * moment.time


def test_a_coupled_transient_in_space_has_a_plus_minus():
    settings = ["solve.start=quasistatic", "solve.duration=0.01 s", "solve.steps=50"]
    scene = with_settings(kaneflex.read_scene("spatial-slider-crank-elastic"), [*settings, "solve.errors=all"])
    found = solved(scene, *COUPLED, "solve.modes=1")
    ratios = effectivities(found, solved(scene, *COUPLED, "solve.modes=6", "rod.elements=8"))
    assert ratios.keys() == {"mid_y", "mid_z", "rod_moment"}, ratios
    assert all(0.9 < ratio < 1.3 for ratio in ratios.values()), ratios
    mid = found.errors[0]["mid_y"]
    assert mid.modes > 0.5 * mid.total > mid.time


def test_steps_that_the_tolerance_chooses_are_told_by_a_tighter_one():
    """Not by steps half as long: between stored instants there are many."""
    settings = [*COUPLED, "solve.duration=0.4 s", "solve.steps=10", "solve.errors=all"]
    scene = with_settings(kaneflex.read_scene("elastic-double-pendulum"), settings)
    found, fine = solved(scene, "solve.tolerance=1e-5"), solved(scene, "solve.tolerance=1e-11")
    for name, estimate in found.errors[0].items():
        error = abs(found.series[name].values - fine.series[name].values).max()
        assert 0.8 < estimate.time / error < 1.25, name


@pytest.mark.parametrize(
    ("name", "settings"),
    [("stick-slip", ["solve.steps=100"]),
     ("double-pendulum", ["solve.preset=rigid", "solve.duration=1 s", "solve.steps=10"]),
     ("spinning-top", ["solve.preset=rigid", "solve.duration=0.2 s", "solve.steps=50"]),
     ("spinning-top", [*COUPLED, "solve.steps=50", "solve.duration=0.2 s", "solve.errors=all"])],
)  # fmt: skip
def test_rigid_bodies_are_off_by_the_steps_alone(name, settings):
    scene = with_settings(kaneflex.read_scene(name), settings)
    rigid = scene.solve.preset == "rigid"
    entry, loose = ("solve.forward.tolerance", 1e-6) if rigid else ("solve.tolerance", 1e-4)
    found, fine = (solved(scene, f"{entry}={number}") for number in (loose, 1e-11))
    ratios = effectivities(found, fine, least=1e-9)
    assert ratios and all(0.8 < ratio < 2.0 for ratio in ratios.values()), ratios
    asked = solved(scene, f"{entry}={loose}", "solve.errors=all").errors[0]
    assert asked and all(each.time > 0.0 == each.modes == each.elements for each in asked.values())


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(
    ("name", "settings"),
    [("four-bar", ["solve.steps=90"]), ("slider-crank-150", ["solve.duration=20 ms", "solve.steps=750"])],
)
def test_a_one_way_run_knows_what_the_coupling_is_worth_where_it_is_asked_for(name, settings):
    """Some 30 % of the four-bar's forces; of the slider-crank it makes another motion."""
    scene = with_settings(kaneflex.read_scene(name), settings)
    found = solved(scene, "solve.errors=all")
    elements = {each: 2 * body.beam.elements for each, body in scene.bodies.items() if body.elastic}
    finer = [f"bodies.{each}.beam.elements={count}" for each, count in elements.items()]
    ratios = effectivities(found, solved(scene, *MANY_MODES, *finer), least=1e-4)
    assert len(ratios) > 2 and all(0.8 < ratio < 1.3 for ratio in ratios.values()), ratios
    assert any(each.coupling > 0.8 * each.total for each in found.errors[0].values())
    assert all(each.coupling is None for each in solved(scene).errors[0].values())


def test_what_elements_leave_out_is_no_part_of_the_coupling():
    """One element is off by a fifth of the bending, the coupling by a thousandth: it is taken by the same mesh."""
    found = solved(kaneflex.read_scene("engine"), "rod.elements=1", "solve.errors=all", "solve.steps=360")
    size, bent = abs(found.series["mid_transverse"].values).max(), found.errors[0]["mid_transverse"]
    assert bent.elements > 0.1 * size > 10.0 * bent.coupling > 0.0


def test_free_joints_have_a_plus_minus_where_the_coupling_is_asked_for():
    scene = with_settings(kaneflex.read_scene("elastic-double-pendulum"), ["solve.duration=0.15 s", "solve.steps=300"])
    found = solved(scene, "solve.preset=linear", "solve.errors=all")
    fine = solved(scene, *MANY_MODES, "upper.elements=12", "lower.elements=12")
    ratios = effectivities(found, fine, least=1e-4)
    assert len(ratios) > 4 and all(0.8 < ratio < 1.3 for ratio in ratios.values()), ratios
    estimates, reason = solved(scene, "solve.preset=quasistatic", "solve.errors=all").errors
    assert not estimates and "pivot is free and has no equilibrium" in reason


def test_a_coupling_that_is_not_known_is_said():
    scene = with_settings(kaneflex.read_scene("engine"), ["solve.errors=all", "solve.steps=180"])
    given = kaneflex.scene.start.Start(displacements={"rod.1.v": 1e-6})
    begun = scene.seen(solve=scene.solve.model_copy(update={"start": given}))
    estimates, reason = solved(begun).errors
    assert estimates and all(each.coupling is None for each in estimates.values())
    assert reason.startswith("the error of the one-way coupling is not estimated: the initial state")


def test_runs_that_go_on_and_given_shapes_are_continued_by_richer_models():
    """From the state that the run begins in, in other shapes: what they begin with beside it would count at once."""
    scene = with_settings(kaneflex.read_scene("spin-up-torque"), ["solve.duration=0.5 s", "solve.steps=200"])
    first = solved(scene)
    second = solve(load(scene), after=first)
    given = kaneflex.scene.start.Start(**first.state())
    third = solved(scene.seen(solve=scene.solve.model_copy(update={"start": given})))
    for run in (second, third):
        estimates, reason = run.errors
        tip = estimates["tip_transverse"]
        assert reason == "" and 0.0 < tip.total < 0.01 * abs(run.series["tip_transverse"].values).max()


def test_nothing_is_derived_for_a_richer_model(monkeypatch):
    found = solved(kaneflex.read_scene("four-bar-motor"), "solve.duration=0.05 s", "solve.steps=100")
    monkeypatch.setattr(assembly, "find_laws_module", lambda *_: pytest.fail("a module is looked for"))
    estimates, reason = found.errors
    assert reason == "" and estimates["coupler_mid"].total > 0.0


def test_a_run_that_takes_long_is_not_run_again_without_being_asked(monkeypatch):
    monkeypatch.setattr(error_estimates, "LONGEST", 0.0)
    scene = with_settings(kaneflex.read_scene("spin-up-torque"), ["solve.duration=0.1 s", "solve.steps=50"])
    estimates, reason = solved(scene).errors
    assert not estimates and 'request it by solve.errors = "total"' in reason
    assert solved(scene, "solve.errors=total").errors[0]
    for preset in ("coupled", "stiffened"):
        chosen = solved(scene, "solve.errors=none", f"solve.preset={preset}").errors
        assert chosen == ({}, "not estimated: solve.errors is none")


def test_a_long_run_is_run_again_where_that_takes_no_longer():
    """By steps of twice the length; by half as long ones, if their number is odd, it takes three times as long."""
    scene = kaneflex.read_scene("elastic-pendulum")
    found = solved(scene)
    assert nominal_seconds(found) > error_estimates.LONGEST and found.errors[0] and not found.errors[1]
    assert "a richer one about" in solved(scene, "solve.steps=4001").errors[1]


def test_no_clock_decides_what_is_estimated_or_where_pieces_end(monkeypatch):
    """Each look at a clock that runs fast is an hour later; the scales of `bounded` are taken where a piece ends."""
    settings = ("solve.duration=0.05 s", "solve.steps=100", 'solve.bounded=["speeds"]', "solve.tolerance=1e-5")
    hours = itertools.count(step=3600.0)
    runs = [solved(kaneflex.read_scene("four-bar-motor"), *settings)]
    monkeypatch.setattr(time, "perf_counter", lambda: next(hours))
    runs.append(solved(kaneflex.read_scene("four-bar-motor"), *settings))
    quick, slow = (found.trajectory for found in runs)
    assert quick.steps == slow.steps and np.array_equal(quick.q, slow.q)
    for name, found in (estimates := runs[0].errors[0]).items():
        assert runs[1].errors[0][name] == found
    assert estimates


def test_richer_models_in_space_begin_at_a_given_state():
    """Where the run begins, but for what a richer basis adds, as also after another run."""
    space = with_settings(kaneflex.read_scene("spatial-slider-crank-elastic"), ["solve.duration=1 ms", "solve.steps=4"])
    space = with_settings(space, [*COUPLED, "solve.start=zero", "solve.modes=1", "solve.errors=all"])
    before = solved(space)
    shapes = {name: size for name, size in before.state()["displacements"].items() if ".shape_" in name}
    given = space.solve.model_copy(update={"start": kaneflex.scene.start.Start(displacements=shapes)})
    for begun in (solved(space.seen(solve=given)), solve(load(space), after=before)):
        errors, reason = begun.errors
        assert reason == "" and set(errors) == set(begun.series)
        read = Read.of(begun, periodic=False)
        start, own = read.model.in_space.curve.start, read.model.in_space.module.system
        for _, scene, options in coupled_corrections._richer(read.model):
            richer = coupled_corrections.neighbour(read.model, scene, options=options)
            system = richer.in_space.module.system
            embedded = coupled_corrections._embedded(read, richer)
            found, _ = state_after(system, embedded, lambda given, of=system: choose(of, given.q))
            places = system.work.sections[:, :3].copy()
            own.project(start.t, start.q, start.u, start.choice)
            bent = abs(start.q[own.engine.modal[0]]).max()
            assert found.t == begun.times[0] and abs(places - own.work.sections[:, :3]).max() < 1e-3 * bent


def test_a_run_says_what_it_took_and_shows_it_everywhere(tmp_path, caplog):
    arguments = ["run", "engine", "--preset", "coupled", "--steps", "72", "--no-plots", "-v"]
    result = CliRunner().invoke(main, [*arguments, "-o", str(tmp_path / "coupled")])
    assert result.exit_code == 0 and "  +-" in result.stdout
    assert any(line.startswith("estimating the errors: ") and line.endswith(" s") for line in caplog.messages)
    summary = json.loads((tmp_path / "coupled/summary.json").read_text())
    off = summary["sensors"]["mid_transverse"]["plus_minus"]
    assert summary["errors"] == "" and off["total"] > 0.0 and off["modes"] is off["coupling"] is None
    asked = ["run", "engine", "--set", "solve.errors=all", "--steps", "72", "--no-plots"]
    assert CliRunner().invoke(main, [*asked, "-o", str(tmp_path / "one-way")]).exit_code == 0
    summary = json.loads((tmp_path / "one-way/summary.json").read_text())
    assert summary["sensors"]["mid_transverse"]["plus_minus"]["coupling"] > 0.0
    assert summary["options"]["errors"] == "all"


def test_elements_that_a_force_divides_are_halved_too():
    """A cantilever whose flexural rigidity falls linearly, loaded in the middle, against the integral of its moment."""
    found = kaneflex.simulate(load(kaneflex.scene_of("""
schema = 1
bodies.bar = {length = 1, pose = {}, beam = {E = 2e11, rho = 7800, A = 1e-4, I = 2e-9, I_end = 5e-10, elements = 1}}
joints.clamp = {weld = ["ground", "bar.start"]}
loads.push = {force_on = "bar.mid", direction = [0, 1], value = 10}
sensors.tip = {displacement = "bar.end", component = "y"}
solve = {preset = "quasistatic", duration = 1, steps = 2}
""")))
    x = (np.arange(20000) + 0.5) / 40000
    exact = np.mean(10 * (0.5 - x) * (1 - x) / (400 - 300 * x)) * 0.5
    off = abs(found.series["tip"].values[0] - exact)
    assert off / 3 < found.errors[0]["tip"].total < 3 * off


def test_a_richer_run_with_contacts_is_compared_at_all_instants_without_a_copy(monkeypatch):
    """The copy took 0.13 s of the 2 s of an estimate for engine-rig-clearance."""
    found = solved(kaneflex.read_scene("bouncing-bar"), "solve.duration=0.1 s", "solve.steps=400")
    monkeypatch.setattr(CoupledMotion, "taken", None)
    estimates, reason = found.errors
    assert reason == "" and estimates["tip"].statistics > 0.0
