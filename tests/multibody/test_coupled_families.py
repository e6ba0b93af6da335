"""Families of shapes under preset coupled: closed-form frequencies, agreement with Craig-Bampton modes, refusals."""

import numpy as np
import pytest
from runs import counts_of, moments

import kaneflex
from kaneflex import SceneError, read_scene, with_settings
from kaneflex.multibody.model.shape_bases import clamped_free
from kaneflex.solve.simulation import solve


def load(name, *settings):
    return kaneflex.load(with_settings(read_scene(name), ["solve.preset=coupled", *settings]))


def squares(model, link):
    """Stiffness over mass of each transverse shape, the squares of a fixed link's frequencies where it is free."""
    number, (axial, _) = moments(model, link), counts_of(model.coupled)[link]
    return number["stiffness"][axial:] / np.diag(number["mass_w_w"])


def test_a_hinged_beam_by_sines():
    """omega^2 = (k pi / L)^4 E I / (rho A), to the elements' cubic interpolation of the sines."""
    model = load("slider-crank-150", "bodies.rod.beam.shapes=sine", "bodies.rod.beam.elements=16")
    rod = model.scene.bodies["rod"]
    exact = (np.arange(1, 4) * np.pi / rod.length) ** 4 * rod.E_I / rod.rho_A
    assert squares(model, "rod") == pytest.approx(exact, rel=2e-4)


@pytest.mark.parametrize(
    ("shapes", "tolerances"), [("clamped-free", (2e-4, 2e-4, 2e-4)), ("polynomial", (1e-3, 0.02, 3.0))]
)
def test_a_clamped_beam(shapes, tolerances):
    """(1.8751, 4.6941, 7.8548)^4 E I / (rho A L^4) (Blevins 1979); X^2, X^3, X^4 come to the lowest from above."""
    model = load("spin-up", f"bodies.beam.beam.shapes={shapes}", "bodies.beam.beam.elements=20")
    beam = model.scene.bodies["beam"]
    exact = (np.array([1.875104, 4.694091, 7.854757]) / beam.length) ** 4 * beam.E_I / beam.rho_A
    error = squares(model, "beam") / exact - 1
    assert (error > -1e-6).all() and (error < tolerances).all()


def test_high_clamped_free_functions_keep_their_ends():
    """phi(0) = phi'(0) = 0 and |phi(1)| = 2 also where cosh and sinh would cancel."""
    for k in (0, 5, 11, 20):
        values, slopes = clamped_free(k, np.array([0.0, 1.0]))
        assert values[0] == pytest.approx(0.0, abs=1e-11) and slopes[0] == pytest.approx(0.0, abs=1e-9)
        assert abs(values[1]) == pytest.approx(2.0, rel=1e-9)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("name", "link", "shapes", "sensor", "tolerance"), [
    ("spin-up", "beam", "clamped-free", "tip_transverse", 1e-3),
    ("spin-up", "beam", "polynomial", "tip_transverse", 3e-3),
    ("slider-crank-150", "rod", "sine", "mid_transverse", 2e-3),
    ("slider-crank-150", "rod", "polynomial", "mid_transverse", 1e-2),
])  # fmt: skip
def test_families_agree_with_craig_bampton_modes(name, link, shapes, sensor, tolerance):
    elements = f"bodies.{link}.beam.elements=8"
    there = solve(load(name, elements)).series[sensor].values
    here = solve(load(name, elements, f"bodies.{link}.beam.shapes={shapes}")).series[sensor].values
    gap = abs(there - here).max()
    assert 1e-9 * abs(there).max() < gap < tolerance * abs(there).max()


@pytest.mark.parametrize(("settings", "message"), [
    (["bodies.beam.beam.shapes=sine"],
     "bodies.beam.beam.shapes = 'sine': sines vanish at both ends of the link, and one of them is not pinned. "
     "Use craig-bampton or polynomial."),
    (["bodies.beam.beam.shapes=polynomial", "bodies.beam.beam.elements=2", "solve.modes=3"],
     "bodies.beam.beam.shapes = 'polynomial': 3 of them need at least 3 elements, the link has 2. Give "
     "bodies.beam.beam.elements, or use fewer modes."),
    (["bodies.beam.beam.shapes=clamped-free", "bodies.beam.beam.theory=timoshenko",
      "bodies.beam.beam.kappa=0.85", "bodies.beam.beam.nu=0.3"],
     "bodies.beam.beam.shapes = 'clamped-free': these functions have no shear, unlike a Timoshenko beam. Use "
     "craig-bampton, or another theory."),
])  # fmt: skip
def test_what_a_family_cannot_stand_for(settings, message):
    with pytest.raises(SceneError) as error:
        load("spin-up", *settings)
    assert str(error.value) == message


def test_a_link_that_turns_at_its_start_is_not_clamped():
    with pytest.raises(SceneError, match="these shapes are clamped at one end, but this link is pinned"):
        load("slider-crank-150", "bodies.rod.beam.shapes=clamped-free")
