"""What a run says of its own error, against the error that finer models show."""

import numpy as np
import pytest
from runs import solved

import kaneflex
from kaneflex import load, with_settings
from kaneflex.solve import one_way_corrections
from kaneflex.solve.run_result import seconds_of_steps
from kaneflex.solve.simulation import solve

FINE = ("solve.preset=stiffened", "solve.modes=all", "solve.integrator=radau")


@pytest.fixture(scope="module")
def engine():
    """The engine, and its sensors by 16 elements in 2880 steps."""
    scene = kaneflex.read_scene("engine")
    return scene, solved(scene, *FINE, "rod.elements=16", "solve.steps=2880")


def check_effectivities(found, fine, kind, least):
    """Of every sensor: between `least` and 2 of the error that a finer run shows, and of the kind of what is coarse."""
    estimates, reason = found.errors
    assert reason == "" and set(estimates) == set(found.model.scene.sensors)
    every = (len(fine.times) - 1) // (len(found.times) - 1)
    assert every * (len(found.times) - 1) == len(fine.times) - 1
    effectivities = []
    for name, estimate in estimates.items():
        expected = fine.series[name].values[::every]
        error, size = abs(found.series[name].values - expected).max(), abs(expected).max()
        if error > 1e-5 * size:  # more than what the finer one is off by
            effectivities.append(estimate.total / error)
            assert least < estimate.total / error < 2.0, name
            if estimate.total > 1e-3 * size:
                assert getattr(estimate, kind) > 0.5 * estimate.total, name
    assert len(effectivities) > 4 and 0.8 < np.median(effectivities) < 1.35


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


def test_a_module_without_the_terms_tells_nothing_of_them():
    """Else they would be worth nothing, as its kernels have none of them."""
    scene = kaneflex.read_scene("engine")
    for setting in ("solve.terms.geometric=false", "solve.preset=rigid"):
        estimates, reason = solve(load(with_settings(scene, [setting]), pruned=True)).errors
        assert not estimates and reason == "not estimated: the module has only the selected terms"
        assert solved(scene, setting).errors[0]["mid_transverse" if "terms" in setting else "crank_torque"].terms > 0


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
    assert not estimates and 'request it by solve.errors = "all"' in reason
    assert solved(scene, "solve.errors=all").errors[0]["mid_transverse"].elements > 0.0


def test_what_cannot_be_estimated_is_said():
    for name, settings, said in (
        ("engine-paper", [], "not estimated under preset paper"),
        ("elastic-double-pendulum", ["solve.preset=stiffened", "solve.steps=50"], "on free joints"),
        ("double-pendulum", ["solve.preset=rigid", "solve.duration=0.01 s"], "no body is elastic"),
    ):
        estimates, reason = solved(kaneflex.read_scene(name), *settings).errors
        assert not estimates and said in reason, name
