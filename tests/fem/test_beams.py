"""Beams with textbook answers, through the generated kernels: frequencies and statics.

Those of beams that rotate are in the gallery and, with flapping, in test_spatial_links.
"""

import json

import numpy as np
import pytest
from machines import cantilever
from places import DATA
from runs import derived_on_the_fly, model
from scipy.linalg import eigh

from kaneflex import Model, with_settings
from kaneflex.multibody.model.building import build_model, reference_modes
from kaneflex.scene.options import resolve_options
from kaneflex.solve.simulation import solve

FACTORS = json.loads((DATA / "beam_frequency_factors.json").read_text())
UNIFORM = FACTORS["uniform_beam"]

# Name -> (table, what the first and the last node are held in, rigid motions left).
ENDS = {
    "clamped-free": ("clamped_free", "v theta", "", 0),
    "pinned-pinned": ("pinned_pinned", "v", "v", 0),
    "clamped-pinned": ("clamped_pinned (=pinned_free elastic modes)", "v theta", "v", 0),
    "pinned-free": ("clamped_pinned (=pinned_free elastic modes)", "v", "", 1),
    "clamped-clamped": ("free_free (=clamped_clamped elastic modes)", "v theta", "v theta", 0),
    "free-free": ("free_free (=clamped_clamped elastic modes)", "", "", 2),
    "clamped-guided": ("clamped_guided (=free_guided elastic modes)", "v theta", "theta", 0),
    "free-guided": ("clamped_guided (=free_guided elastic modes)", "", "theta", 1),
    "pinned-guided": ("pinned_guided", "v", "theta", 0),
}


class Rod:
    """The reference engine's rod, cut into elements, with some of its coordinates deleted."""

    def __init__(self, elements: int, first: str, last: str, kind: str = "bending"):
        found = model("engine", f"rod.elements={elements}")
        self.link, self.body = found.links["rod"], found.scene.bodies["rod"]
        names = ("v", "theta") if kind == "bending" else ("u",)
        self.rows = [
            3 * node + "u v theta".split().index(name)
            for node in range(elements + 1)
            for name in names
            if name not in {0: first, elements: last}.get(node, "").split()
        ]

    def matrix(self, name: str, **scalars: float) -> np.ndarray:
        """M, K_s or K_g of the rows left, for scalars of the rod given by their last name."""
        affine = self.link.part.matrices[name]
        values = {s: scalars.get(s.rsplit(".")[-1], 0.0) for monomial in affine.terms for s in monomial}
        return affine.value(values)[np.ix_(self.rows, self.rows)]

    def last(self, name: str) -> int:
        """Where u, v or theta of the last node stands in the matrices."""
        return self.rows.index(3 * (len(self.link.nodes) - 1) + "u v theta".split().index(name))

    @property
    def unit(self) -> float:
        """sqrt(E I/(rho A))/L^2: frequencies are multiples of it."""
        return np.sqrt(self.body.E_I / self.body.rho_A) / self.link.length**2


def frequencies(stiffness: np.ndarray, mass: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(eigh(stiffness, mass, eigvals_only=True), 0.0))


def measured_order(errors: dict[int, np.ndarray]) -> np.ndarray:
    """Slope of log(error) over log(element length), from the coarsest to the finest mesh."""
    coarse, fine = min(errors), max(errors)
    return np.log(errors[coarse] / errors[fine]) / np.log(fine / coarse)


def expected_error(lam_sq: np.ndarray, elements: int) -> np.ndarray:
    """(lambda h)^4/1440 of a frequency: the leading error of cubic elements with a consistent mass."""
    return lam_sq**2 / elements**4 / 1440


def factors(table: list, modes: int) -> np.ndarray:
    return np.array([float(row["lam_sq"]) for row in table[:modes]])


@pytest.mark.parametrize("ends", ENDS)
def test_bending_factors(ends):
    """The error of the first three frequencies falls as h^4, from above, and is as large as theory says."""
    table, first, last, rigid = ENDS[ends]
    exact = factors(UNIFORM[table]["modes"], 3)
    errors = {}
    for elements in (8, 16):
        rod = Rod(elements, first, last)
        found = frequencies(rod.matrix("K_s"), rod.matrix("M")) / rod.unit
        assert (found[:rigid] < 1e-3).all()
        errors[elements] = found[rigid : rigid + 3] / exact - 1
    assert errors[16] == pytest.approx(expected_error(exact, 16), rel=0.04)
    assert measured_order(errors) == pytest.approx([4, 4, 4], abs=0.2)


@pytest.mark.parametrize("tension", [-0.9, -0.5, 0.5, 3.0])
def test_pinned_pinned_under_axial_force(tension):
    """omega_n^2 = (n pi/L)^4 E I/(rho A) (1 + P/(n^2 P_E)); the tension in Euler loads P_E, compression negative."""
    n = np.arange(1, 4)
    exact = (n * np.pi) ** 2 * np.sqrt(1 + tension / n**2)
    errors = {}
    for elements in (8, 16):
        rod = Rod(elements, "v", "v")
        P = tension * np.pi**2 * rod.body.E_I / rod.link.length**2
        K = rod.matrix("K_s") + rod.matrix("K_g", P_0=P)
        errors[elements] = frequencies(K, rod.matrix("M"))[:3] / rod.unit / exact - 1
    without = expected_error((n * np.pi) ** 2, 16)
    assert errors[16] == pytest.approx(without / (1 + tension / n**2), rel=0.02)
    assert measured_order(errors) == pytest.approx([4, 4, 4], abs=0.1)


# ---- whole scenes, derived on the fly ---------------------------------------------------------------------------

BAR = 'length = "1 m", beam = {material = "steel", A = "400 mm^2", I = "13333 mm^4"'
CLAMPED = cantilever(
    f"{BAR}, elements = 8}}, points = {{quarter = [\"250 mm\", 0]}}", "beam", "clamp",
    loads='tip = {force_on = "beam.end", direction = [0, 1], value = "100 N"}',
    sensors="""
tip = {displacement = "beam.end", component = "y"}
tip_angle = {displacement = "beam.end", component = "angle"}
quarter_moment = {bending_moment = "beam.quarter"}
shear = {shear_force = "beam.mid"}
clamp_force = {joint_force = "clamp", component = "y"}
clamp_moment = {joint_force = "clamp", component = "angle"}""",
    solve={"preset": "quasistatic", "duration": "0.1 s"},
)
@pytest.fixture(scope="module")
def clamped(tmp_path_factory) -> Model:
    return derived_on_the_fly(CLAMPED, tmp_path_factory.mktemp("clamped"))


def test_modes_of_a_clamped_beam_scene(clamped):
    body = clamped.scene.bodies["beam"]
    omega, _ = reference_modes(clamped, 3)
    found = omega * np.sqrt(body.rho_A / body.E_I) * body.length**2
    assert found == pytest.approx(factors(UNIFORM["clamped_free"]["modes"], 3), rel=7e-4)


def test_statics_of_a_clamped_beam_scene(clamped):
    """P l^3/(3 E I) and P l^2/(2 E I): cubic elements are exact."""
    body, P, l = clamped.scene.bodies["beam"], 100.0, 1.0
    expected = {
        "tip": P * l**3 / (3 * body.E_I),
        "tip_angle": P * l**2 / (2 * body.E_I),
        "quarter_moment": P * 0.75 * l,
        "clamp_force": -P,
        "clamp_force_rigid": -P,
        "clamp_moment": -P * l,
        "clamp_moment_rigid": -P * l,
    }
    series = solve(clamped).series
    for name, value in expected.items():
        assert series[name].values == pytest.approx(value, rel=1e-8), name
    assert np.abs(series["shear"].values) == pytest.approx(P, rel=1e-8)


def test_statics_of_a_reduced_beam_scene(clamped):
    """One mode of 27, and the load of the tip: the other modes follow statically, so the answer is still exact."""
    scene = with_settings(clamped.scene, ["solve.modes=1"])
    series = solve(build_model(scene, resolve_options(scene), clamped.motion)).series
    body, P, l = scene.bodies["beam"], 100.0, 1.0
    assert series["tip"].values == pytest.approx(P * l**3 / (3 * body.E_I), rel=1e-8)
    assert series["quarter_moment"].values == pytest.approx(P * 0.75 * l, rel=1e-6)
    assert series["clamp_moment"].values == pytest.approx(-P * l, rel=1e-6)


def test_a_clamped_beam_needs_neither_motion_nor_its_terms(clamped):
    """Nothing moves, so nothing of spin, gyroscopic, Euler and inertia loads is derived, nor a tension."""
    assert [name for name, *_ in clamped.module.TERMS] == ["mass", "stiffness"]
