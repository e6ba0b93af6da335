"""What a run says of its own error, against the error that finer models show."""

import numpy as np
import pytest

import kaneflex
from kaneflex import load, simulate
from kaneflex.scene import with_settings

FINE = ("solve.preset=stiffened", "solve.modes=all", "solve.integrator=radau")


def solved(scene, *settings):
    return simulate(load(with_settings(scene, settings)))


@pytest.fixture(scope="module")
def engine():
    """The engine, and its sensors by 16 elements in 2880 steps."""
    scene = kaneflex.read_scene("engine")
    return scene, solved(scene, *FINE, "rod.elements=16", "solve.steps=2880")


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
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
    ],
    ids=lambda part: part if isinstance(part, str) else ",".join(part),
)
def test_a_plus_minus_is_the_error_that_a_finer_model_shows(engine, kind, settings):
    """Of every sensor: between 0.6 and 2 of it, and of the kind of what was made coarse."""
    scene, fine = engine
    found = solved(scene, *settings)
    estimates, reason = found.errors
    assert reason == "" and set(estimates) == set(scene.sensors)
    every = (len(fine.times) - 1) // (len(found.times) - 1)
    assert every * (len(found.times) - 1) == len(fine.times) - 1
    effectivities = []
    for name, estimate in estimates.items():
        expected = fine.series[name].values[::every]
        error, size = abs(found.series[name].values - expected).max(), abs(expected).max()
        if error > 1e-5 * size:  # more than what the finer one is off by
            effectivities.append(estimate.total / error)
            assert 0.6 < estimate.total / error < 2.0, name
            if estimate.total > 1e-3 * size:
                assert getattr(estimate, kind) > 0.5 * estimate.total, name
    assert len(effectivities) > 5 and 0.8 < np.median(effectivities) < 1.25


def test_a_module_without_the_terms_tells_nothing_of_them():
    """Else they would be worth nothing, as its kernels have none of them."""
    scene = kaneflex.read_scene("engine")
    for setting in ("solve.terms.geometric=false", "solve.preset=rigid"):
        estimates, reason = simulate(load(with_settings(scene, [setting]), pruned=True)).errors
        assert not estimates and reason == "not estimated: the module has no terms but those that were chosen"
        assert solved(scene, setting).errors[0]["mid_transverse" if "terms" in setting else "crank_torque"].terms > 0


def test_a_drive_that_does_not_come_back_has_no_estimate():
    """Statics know no start: what jumps from the end of a cycle to its beginning is no harmonic of anything."""
    drives = ["drives.main.speed=none", "drives.main.cycle=none", "drives.main.law='600 * t + 900 * t**2'",
              "drives.main.period=0.01 s", "solve.preset=quasistatic", "solve.start=zero"]  # fmt: skip
    estimates, reason = solved(kaneflex.read_scene("engine"), *drives).errors
    assert not estimates and reason == "not estimated: the motion or its loads don't repeat themselves"


def test_what_cannot_be_estimated_is_said(tmp_path):
    for name, settings, said in (
        ("engine-transient", [], "the motion is not a periodic one"),
        ("engine", ["solve.preset=coupled", "solve.steps=24"], "not estimated under preset coupled"),
        ("engine", ["solve.start=zero", "solve.steps=90"], "the motion is not a periodic one"),
        ("four-bar", ["solve.steps=90"], "corrections by time contract too slowly"),
        ("double-pendulum", ["solve.preset=rigid", "solve.duration=0.01 s"], "no body is elastic"),
    ):
        estimates, reason = solved(kaneflex.read_scene(name), *settings).errors
        assert not estimates and said in reason, name
