"""Links of few elements: the default number of modes is limited to those that there are."""

import pytest

from kaneflex import SceneError, load, scene_of, with_settings
from kaneflex.solve.simulation import solve

PLANE = """
schema = 1
gravity = [0, -9.81]
bodies.bar = {length = "1 m", beam = {material = "steel", section = {rectangle = ["10 mm", "10 mm"]}, elements = 2}}
bodies.block = {mass = "1 kg"}
joints.wall = {weld = ["ground", "bar.start"]}
joints.tip = {weld = ["bar.end", "block"]}
sensors.y = {position = "block", component = "y"}
solve = {preset = "coupled", duration = "0.02 s", steps = 20, errors = "none"}
"""
"""As ``shared/cases/default_modes.toml`` has it, for a shorter time."""
SAG = 9.81 * (1.0 / 3 + 7850 * 1e-4 / 8) / (210e9 * 1e-8 / 12)
"""Of the tip by the weights of block and bar [m], by Euler and Bernoulli."""


@pytest.mark.parametrize(
    ("elements", "shapes", "modes"),
    [(1, "craig-bampton", 0), (2, "craig-bampton", 2), (4, "craig-bampton", 3), (2, "polynomial", 2)],
)
def test_the_default_takes_the_modes_that_a_link_has(elements, shapes, modes):
    scene = with_settings(scene_of(PLANE), [f"bar.elements={elements}", f"bar.shapes={shapes}"])
    model = load(scene)
    assert model.coupled.shapes["bar"].transverse.shape[1] - 2 == modes  # less the static shapes of the tip
    notes = [text for text in model.warnings if text.startswith(f"bar has only {modes} of the default's 3 modes")]
    assert len(notes) == (modes < 3)
    still = solve(load(with_settings(scene, ["solve.start=quasistatic"])))
    assert abs(still.series["y"].values).max() == pytest.approx(SAG, rel=2e-3)


def test_modes_that_are_asked_for_must_be_there():
    with pytest.raises(SceneError, match="up to 2 fixed-interface modes of bar"):
        load(with_settings(scene_of(PLANE), ["solve.modes=3"]))


def test_one_element_has_nothing_left_to_reduce():
    """A reduction that keeps all coordinates of a link, which has no share of its own between its ends."""
    settings = ["bar.elements=1", "solve.preset=stiffened", "solve.start=quasistatic"]
    scene = with_settings(scene_of(PLANE), settings)
    whole, reduced = (
        solve(load(with_settings(scene, [f"solve.reduction={kind}"]))).series["y"].values
        for kind in ("none", "craig-bampton")
    )
    assert reduced == pytest.approx(whole, rel=1e-12)
