"""Natural frequencies of the mechanism: the corrected one, the welded frame, what holds it, and how many there are."""

import numpy as np
import pytest
from machines import machine
from runs import derived_on_the_fly, model, peaks, run
from scipy.linalg import eigh
from scipy.sparse import csr_array

from kaneflex import SceneError, load, read_scene, scene_of, simulate, with_settings
from kaneflex.fem.modes import lowest_modes, rayleigh_coefficients
from kaneflex.multibody.model.building import reference_modes
from kaneflex.solve.loading import integrated
from kaneflex.solve.modes import mode_angle_spread
from kaneflex.solve.quasistatic import mechanism_modes
from kaneflex.solve.simulation import solve

SPEED = 2 * np.pi * 100
ONE_EACH = ("engine-elastic-crank", "crank.elements=1", "rod.elements=1")

# Computed independently from K_s and M alone; crank clamped at the shaft, revolute crank pin, one element a link.
CORRECTED = {
    0: [3368.784, 4527.772, 15332.844, 28523.179, 33473.183, 273769.431],
    90: [3343.486, 4351.550, 15417.891, 26848.769, 35096.431, 248421.593],
}
# The same sections in the paper's frame: welded crank pin, crank free to turn at the shaft.
WELDED = [(839, 1277), (4528, 5573), (6295, 7285), (33.5e3, 33.5e3), (90e3, 124e3), (274e3, 286e3)]


def frequencies(mass: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """In Hz, ascending; the stiffness may be unsymmetric, as K_d is."""
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness))
    assert np.abs(squares.imag).max() <= 1e-9 * np.abs(squares).max()
    return np.sqrt(np.sort(squares.real)) / (2 * np.pi)


@pytest.mark.parametrize("degrees", CORRECTED)
def test_reference_modes_are_those_of_the_angle_asked_for(degrees):
    engine = model(*ONE_EACH, f"solve.mode_angle={degrees} deg")
    omega, shapes = reference_modes(engine, "all")
    assert omega / (2 * np.pi) == pytest.approx(CORRECTED[degrees], rel=1e-5)
    M, K = engine.M(engine.reference_time), engine.K_s(engine.reference_time)
    assert shapes.T @ M @ shapes == pytest.approx(np.eye(6), abs=1e-9)
    assert shapes.T @ K @ shapes == pytest.approx(np.diag(omega**2), abs=1e-9 * omega[-1] ** 2)


LOCKED = ("four-bar", "main.speed=0", "solve.duration=1", "solve.start=zero")


def test_modes_of_a_locked_linkage_are_those_of_where_it_stands():
    """The third frequency of the four-bar falls by 45 % from 0 to 53 degrees; one that turns passes both."""
    at = "solve.mode_angle=53 deg"
    with pytest.raises(SceneError, match=r"= '53 deg': main stays at 0 deg\. .*, or set main\.angle = 53"):
        model(*LOCKED, at)
    both = model(*LOCKED, "main.angle=53 deg", at), model("four-bar", at)
    placed, turning = (reference_modes(found, 3)[0] for found in both)
    assert placed == pytest.approx(turning, rel=1e-9)
    elsewhere = model(*LOCKED, "main.angle=413 deg")
    assert elsewhere.reference_position == "main = 413 deg"
    assert reference_modes(elsewhere, 3)[0] == pytest.approx(placed, rel=1e-9)
    assert not np.allclose(reference_modes(model(*LOCKED), 3)[0], placed, rtol=0.2)


def test_modes_of_a_linkage_with_a_motor_are_those_of_where_it_comes_by():
    """From 90 degrees on it is at 30 after a third of a turn less; preset coupled knows its start alone."""
    motor = ("four-bar-motor", "solve.preset=stiffened")
    at = "solve.mode_angle=30 deg"
    found = [integrated(model(*motor, *more)) for more in ((at,), ("main.angle=30 deg", at))]
    assert found[0].reference_time > 0.0 == found[1].reference_time
    first, second = (reference_modes(each, 5)[0] for each in found)
    assert first == pytest.approx(second, rel=1e-6)
    with pytest.raises(SceneError, match="before the run only the start of main, 90 deg"):
        model("four-bar-motor", "solve.mode_angle=30 deg")


def test_damping_of_a_place_where_the_drive_never_stands_is_named():
    damping = ("damping.rayleigh=none", "damping.modal={ratio=0.02}", "main.angle=53 deg")
    (said,) = model(*LOCKED, *damping).warnings
    assert said == "main never reaches solve.mode_angle = 0 deg: modes are those of 53 deg"


@pytest.mark.parametrize("preset", ["coupled", "quasistatic"])
def test_nothing_is_said_of_a_place_whose_modes_the_run_does_not_use(preset):
    """A trolley at 2 m got a warning of solve.mode_angle = 0, which coupled and quasistatic runs never read."""
    damping = ("damping.rayleigh=none", "damping.modal={ratio=0.02}", "main.angle=53 deg")
    warnings = model(*LOCKED, *damping, f"solve.preset={preset}").warnings
    assert not [said for said in warnings if "mode_angle" in said]


def test_the_place_is_named_by_every_drive():
    said = model("two-link-arm", "solve.mode_angle=45 deg").reference_position
    assert said.startswith("shoulder = 45 deg, elbow = ")


def test_frequencies_of_the_released_and_of_the_welded_pin_interlace():
    """Sharing the two rotations at the pin is one constraint (Rayleigh's theorem)."""
    released = model(*ONE_EACH)
    names = list(released.coordinates)
    basis = np.delete(np.eye(6), names.index("rod.0.theta"), axis=1)
    basis[names.index("rod.0.theta"), names.index("crank.1.theta")] = 1.0
    M, K = released.M(0.0), released.K_s(0.0)
    free, welded = frequencies(M, K), frequencies(basis.T @ M @ basis, basis.T @ K @ basis)
    assert (free[:-1] <= welded * (1 + 1e-12)).all() and (welded <= free[1:] * (1 + 1e-12)).all()
    assert welded[0] > 1.05 * free[0]


def test_welded_frame_over_the_crank_angle():
    paper = model("engine-paper")
    assert paper.coordinates == ("crank.0.theta", "pin.x", "pin.y", "crank.1.theta", "piston.slide", "rod.1.theta")
    times = np.radians(np.arange(0, 361, 5)) / SPEED
    elastic = np.array([frequencies(paper.M(t), paper.K_s(t)) for t in times])
    lowest, highest = elastic.min(axis=0), elastic.max(axis=0)
    for found, (low, high) in zip(zip(lowest, highest, strict=True), WELDED, strict=True):
        assert found == pytest.approx((low, high), rel=4e-3)
    spinning = np.array([frequencies(paper.M(t), paper.K_s(t) + paper.K_d(t)) for t in times])
    moved = np.abs(spinning / elastic - 1).max()
    assert 0.005 < moved < 0.007


def test_frozen_peak_depends_on_the_angle_at_which_it_is_frozen():
    """Indicatively 0.18 to 1.90 mm: undamped resonances, whose height no digit of which should be trusted."""
    spread = mode_angle_spread(model("engine-paper"))["mid_transverse"]
    assert 1e3 * spread.smallest == pytest.approx(0.18, abs=0.005)
    assert 1e3 * spread.largest == pytest.approx(1.90, rel=0.15)
    at_zero = np.abs(run("engine-paper").series["mid_transverse"].values).max()
    assert spread.smallest <= at_zero <= spread.largest


def test_welded_frame_carries_torque_by_bending():
    """Quasi-static, 0.37 mm from the chord and 0.57 mm in global axes: the released pin gives 0.029 mm."""
    welded = run("engine-paper", "solve.preset=quasistatic")
    chord = peaks(welded, "mid_transverse")[1].value
    across = peaks(welded, "mid_global_y")[1].value
    assert 1e3 * chord == pytest.approx(0.37, abs=0.01)
    assert 1e3 * across == pytest.approx(0.575, abs=0.01)
    released = peaks(run("engine-elastic-crank", "solve.preset=quasistatic"), "mid_transverse")[1].value
    assert chord > 12 * released


def banded_problem(size: int):
    """K and M of a chain of different masses and springs, so that no two frequencies are equal."""
    rng = np.random.default_rng(size)
    springs = rng.uniform(1.0, 2.0, size + 1)
    K = np.diag(springs[:-1] + springs[1:]) - np.diag(springs[1:-1], 1) - np.diag(springs[1:-1], -1)
    return csr_array(K), csr_array(np.diag(rng.uniform(1.0, 2.0, size)))


@pytest.mark.parametrize("size", [6, 150, 151, 400])
def test_order_sign_and_scale_are_fixed(size):
    """The dense and the sparse solver give the same, in rising order, mass-normalised, largest entry positive."""
    K, M = banded_problem(size)
    omega, shapes = lowest_modes(K, M, 5)
    again, shapes_again = lowest_modes(K, M, 5)
    assert (omega == again).all() and (shapes == shapes_again).all()
    assert (np.diff(omega) > 0).all()
    assert shapes.T @ (M @ shapes) == pytest.approx(np.eye(5), abs=1e-9)
    largest = np.abs(shapes).argmax(axis=0)
    assert (shapes[largest, np.arange(5)] > 0).all()
    exact = np.sqrt(eigh(K.toarray(), M.toarray(), eigvals_only=True)[:5])
    assert omega == pytest.approx(exact, rel=1e-10)


def test_sign_does_not_hang_on_which_of_two_equal_entries_is_larger():
    """An antisymmetric mode's two largest entries are equal to rounding: the first of them decides."""
    for nudge in (-1e-13, 1e-13):
        K = csr_array(np.array([[2.0, -1.0], [-1.0, 2.0 + nudge]]))
        _, shapes = lowest_modes(K, csr_array(np.eye(2)), 2)
        assert (shapes[0] > 0).all()


def test_more_modes_than_coordinates_are_refused():
    K, M = banded_problem(6)
    with pytest.raises(ValueError, match="7 modes of 6"):
        lowest_modes(K, M, 7)


def test_rayleigh_damping_has_its_ratio_at_both_frequencies():
    """(alpha/omega + beta omega)/2, the ratio of a mode at omega."""
    alpha, beta = rayleigh_coefficients(0.02, 60.0, 400.0)
    omega = 2.0 * np.pi * np.array([60.0, 400.0])
    np.testing.assert_allclose((alpha / omega + beta * omega) / 2.0, 0.02, rtol=1e-14)


def test_modal_damping_depends_on_the_coordinates_away_from_its_angle():
    """Of the engine's full mesh and all its Craig-Bampton modes, T z of the reduced coordinates at an instant.

    M, K and Rayleigh's C are the same by both at all instants, modal damping's C at its own angle alone.
    """
    for damping, least in (("damping.modal={ratio=0.02}", 1e-4), ("damping.rayleigh.ratio=0.02", 0.0)):
        given = ("solve.preset=linear", *(["damping.rayleigh=none"] if least else []), damping)
        full, reduced = (model("engine", *given, f"solve.reduction={kind}", *modes)
                         for kind, modes in (("none", ()), ("craig-bampton", ("solve.modes=11",))))  # fmt: skip
        assert full.equations.size == reduced.equations.size
        for t, same in ((full.reference_time, True), (3e-3, False)):
            here = {name: float(values[0]) for name, values in scalars(full, t).items()}
            L, reduced_L = (of.frame.maps["rod"].value(here) for of in (full, reduced))
            T = np.linalg.solve(L.T @ L, L.T @ reduced.bases["rod"] @ reduced_L)
            apart = {}
            for name in ("M", "K_s", "C_s"):
                by_mesh, by_modes = (getattr(of.equations, name).value(here) for of in (full, reduced))
                apart[name] = abs(T.T @ by_mesh @ T - by_modes).max() / abs(by_modes).max()
            assert apart["M"] < 1e-12 and apart["K_s"] < 1e-12
            assert apart["C_s"] < 1e-12 if same or not least else least < apart["C_s"] < 1e-2


def scalars(of, t):
    """Scalars of a model's rigid motion at an instant."""
    rigid = of.motion.at(np.array([t]))
    return {name: rigid[name] for name in of.motion.column}


PLANE = machine(
    gravity=[0, -9.81],
    bodies=dict(bar='length = "1 m", '
                    'beam = {material = "steel", section = {rectangle = ["10 mm", "10 mm"]}, elements = 2}',
                block='mass = "1 kg"'),
    joints=dict(wall="weld ground bar.start", tip="weld bar.end block"), sensors=dict(y="position block y"),
    solve=dict(preset="coupled", duration="0.02 s", steps=20, errors="none"),
)
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


WELDED_LINK = """
schema = 1
bodies.base = {length = "1 m", pose = {at = [0, 0], angle = 0}, beam = {E = 2.1e11, rho = 7850, A = 1e-3, I = 1e-8}}
bodies.tip = {length = "1 m", pose = {at = [1, 0], angle = 0}, beam = {E = 2.1e11, rho = 7850, A = 1e-3, I = 1e-8}}
joints.wall = {weld = ["ground", "base.start"]}
joints.seam = {weld = ["base.end", "tip.start"]}
loads.push = {force_on = "tip.end", direction = [0, 1], value = "1e-3 N"}
sensors.end = {displacement = "tip.end", component = "y"}
sensors.wall_y = {joint_force = "wall", component = "y"}
solve = {preset = "quasistatic", duration = "1 s", steps = 4}
"""


def test_a_clamped_structure_is_not_free_flying_however_stiff_a_link_is(tmp_path):
    """Two welded beams: tip by F (b^3 / (3 E I_b) + (a^3 / 3 + a^2 b + a b^2) / (E I_a)), wall by equilibrium."""
    found = derived_on_the_fly(WELDED_LINK, tmp_path)
    for ratio, elements in ((1e6, 64), (1e9, 16)):
        settings = [f"bodies.tip.beam.I={1e-8 * ratio!r}", f"base.elements={elements}", f"tip.elements={elements}"]
        stiff = load(with_settings(found.scene, settings))
        assert mechanism_modes(stiff, 0.0) == 0
        with pytest.warns(match="the stiffness matrix is ill-conditioned"):
            series = simulate(stiff).series
        # as well as such a condition allows: rounding differs from processor to processor
        assert series["end"].values == pytest.approx(1e-3 * (7 / 3 + 1 / 3 / ratio) / 2.1e3, rel=0.1)
        assert abs(series["wall_y"].values) == pytest.approx(1e-3, rel=0.1)


@pytest.mark.parametrize(("scene", "settings", "free"), [
    ("free-frame", (), 3),
    ("engine-elastic-crank", ("drives.main.rotation=free",), 1),
    ("engine-elastic-crank", (), 0),
    ("pin-ended-cross", (), 0),
    ("four-bar", (), 0),
])  # fmt: skip
def test_motions_that_deform_nothing_are_counted_by_geometry(scene, settings, free):
    found = model(scene, *settings)
    assert mechanism_modes(found, 0.3 * found.options.duration) == free


def test_a_link_that_nothing_holds_is_reduced_with_its_rigid_motion():
    whole = solve(load(read_scene("free-rod")))
    sensors = ("bow", "end", "mid_moment")

    def apart(modes):
        found = solve(load(with_settings(read_scene("free-rod"), [f"solve.modes={modes}"])))
        pairs = ((found[name].values, whole[name].values) for name in sensors)
        return max(abs(one - other).max() / abs(other).max() for one, other in pairs)

    errors = [apart(modes) for modes in (2, 6, 24)]
    assert errors[0] < 0.2 and errors[1] < 0.1 * errors[0] and errors[2] < 1e-9


def test_numbers_without_a_sense_are_refused():
    """In wrong units, or with a digit too many: the message asks to check them."""
    with pytest.raises(SceneError, match=r"^bodies: the mass matrix is numerically singular.* Check their units"):
        lowest_modes(csr_array(np.eye(2)), csr_array(np.diag([1.0, -1e-30])), 1)
    huge = with_settings(read_scene("four-bar-misaligned"), ["solve.preset=coupled", "bodies.crank.length=3e30 m"])
    with pytest.raises(SceneError, match=r"^bodies: lengths or distances are too large .* Check their units"):
        load(huge)
