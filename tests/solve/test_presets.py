"""The named models: what each keeps, and that each solves what it says."""

import closed_forms as by_hand
import numpy as np
import pytest
from runs import alike, at_instant, model, peaks, run
from scipy.linalg import eigh, null_space
from scipy.sparse import issparse

from kaneflex import SceneError, read_scene, with_settings
from kaneflex.response.deformation import deform
from kaneflex.scene.options import resolve_options
from kaneflex.solve.quasistatic import rate_of
from kaneflex.solve.validity import validity_warnings

R, L, SPEED = 0.040, 0.137, 2 * np.pi * 100
ROD_RHO_A, PISTON = 0.153 / L, 0.214

# dynamics; then spin, gyroscopic, Euler, geometric, damping, T' and T'', foreshortening, reduction, integrator
PRESETS = {
    "rigid": ("rigid", 0, 0, 0, 0, 0, 0, 0, "none", "none"),
    "quasistatic": ("quasistatic", 1, 0, 1, 1, 0, 1, 1, "none", "none"),
    "paper": ("frozen", 1, 0, 1, 0, 0, 0, 0, "modal", "exact-modal"),
    "linear": ("dynamic", 1, 1, 1, 0, 1, 1, 0, "none", "spectral"),
    "stiffened": ("dynamic", 1, 1, 1, 1, 1, 1, 1, "none", "spectral"),
}


@pytest.mark.parametrize("preset", PRESETS)
def test_what_each_preset_keeps(preset):
    options = resolve_options(with_settings(read_scene("engine"), [f"solve.preset={preset}"]))
    groups = ("spin", "gyroscopic", "euler", "geometric", "damping", "convective", "foreshortening")
    found = (options.dynamics, *(int(getattr(options, g)) for g in groups), options.reduction, options.integrator)
    assert found == PRESETS[preset]
    paper = preset == "paper"
    assert (options.weld_pins, options.free_drives, options.elements) == (paper, paper, 1 if paper else None)
    if paper:
        assert (options.start, options.duration, options.mode_angle) == ("zero", 0.04, 0.0)


def test_rates_of_a_quasistatic_motion_are_of_fourth_order():
    """Those of a sine; at its ends of second order."""
    errors = []
    for steps in (20, 40):
        t = np.linspace(0.0, 1.0, steps + 1)
        away = abs(rate_of(np.sin(3.0 * t)[:, None], 1.0 / steps, periodic=False)[:, 0] - 3.0 * np.cos(3.0 * t))
        errors.append([away[2:-2].max(), away.max()])
    assert np.log2(np.divide(*errors)) == pytest.approx([4.0, 2.0], abs=0.2)


@pytest.mark.parametrize("group", ["spin", "gyroscopic", "euler", "geometric", "damping"])
def test_each_term_group_can_be_switched_off(group):
    """As a whole: what remains differs from everything by exactly that group."""
    whole, part = model("engine"), model("engine", f"solve.terms={{{group}=false}}")
    t = 0.0037
    rigid = whole.motion.at(t)
    w, e = rigid["rod.omega"][0], rigid["rod.epsilon"][0]

    def kept(found, name):
        return at_instant(found, found.kept[name], t)

    K, C = kept(whole, "K") - kept(part, "K"), kept(whole, "C") - kept(part, "C")
    equations = whole.equations
    euler = at_instant(whole, equations.K_d.only(lambda names: any(n.endswith(".epsilon") for n in names)), t)
    spin = whole.K_d(t) - euler
    zero = np.zeros_like(K)
    expected = {
        "spin": (spin, zero),
        "euler": (euler, zero),
        "geometric": (whole.K_g(t), zero),
        "gyroscopic": (zero, at_instant(whole, equations.C_d, t)),
        "damping": (at_instant(whole, equations.K_c, t), at_instant(whole, equations.C_s, t)),
    }[group]
    for found, wanted in zip((K, C), expected, strict=True):
        assert found == pytest.approx(wanted, abs=1e-12 * max(np.abs(kept(whole, "K")).max(), 1.0))
    assert np.abs(expected[0]).max() + np.abs(expected[1]).max() > 0
    assert abs(w) > 1 and abs(e) > 1


def test_rigid_has_no_coordinates_and_no_deformation():
    solution = run("engine", "solve.preset=rigid")
    assert solution.model.coordinates == ()
    elastic = run("engine").series
    for name in ("crank_torque", "crank_pin_force_x", "piston_side_force", "main_bearing_force_y"):
        assert (solution.series[name].values == elastic[f"{name}_rigid"].values).all(), name


def test_a_structure_that_stands_still_has_no_rigid_model():
    with pytest.raises(SceneError, match=r"solve\.preset = 'rigid': a fixed structure has no rigid motion"):
        model("pin-ended-cross", "solve.preset=rigid")


# ---- quasi-static -----------------------------------------------------------------------------------------------


def test_quasistatic_solves_its_equation_at_each_instant():
    solution = run("engine", "solve.preset=quasistatic")
    found = solution.model
    for k in (0, 300, 748, 1100):
        t = solution.times[k]
        z = np.linalg.solve(found.K_s(t) + found.K_d(t) + found.K_g(t), found.F(t))
        assert solution.trajectory.z[k] == pytest.approx(z, rel=1e-9, abs=1e-15)


def test_quasistatic_ignores_damping():
    """To the bit; and a fine mesh, whose damping matrix is large, gives what a coarse one gives."""
    damped, undamped = (run("engine", "solve.preset=quasistatic", *more) for more in ((), ("damping=none",)))
    assert (damped.trajectory.z == undamped.trajectory.z).all()
    coarse, fine = (
        peaks(run("engine", "solve.preset=quasistatic", f"rod.elements={n}"), "mid_transverse")[1].value
        for n in (4, 32)
    )
    assert fine == pytest.approx(coarse, rel=1e-4)


def test_velocities_of_the_quasistatic_answer_are_its_derivatives():
    fine, coarse = (run("engine", "solve.preset=quasistatic", f"solve.steps={n}").trajectory for n in (2880, 1440))
    h = fine.times[1]
    rate = (np.roll(fine.z[:-1], -1, 0) - np.roll(fine.z[:-1], 1, 0)) / (2 * h)
    assert fine.v[:-1] == pytest.approx(rate, abs=2e-3 * np.abs(rate).max())
    assert coarse.v[:-1] == pytest.approx(fine.v[:-1:2], abs=1e-2 * np.abs(fine.v).max())
    assert (fine.z[0] == pytest.approx(fine.z[-1], abs=1e-12)) and (fine.v[0] == fine.v[-1]).all()


def test_a_single_quasistatic_step():
    """Two instants, whose rates are the slope between them."""
    solution = run("engine", "solve.preset=quasistatic", "solve.steps=1", "solve.duration=1e-6 s", "solve.start=zero")
    z, v = solution.trajectory.z, solution.trajectory.v
    assert v[0] == pytest.approx((z[1] - z[0]) / 1e-6) and (v[0] == v[1]).all() and np.abs(v).max() > 0


def test_quasistatic_leaves_mechanism_modes_to_inertia_relief():
    """Both links elastic and the crank free to turn: K z = F - M R (R^T M R)^-1 R^T F and R^T M z = 0."""
    solution = run("engine-elastic-crank", "drives.main.rotation=free", "solve.preset=quasistatic", "rod.elements=1")
    found = solution.model
    for k in (200, 748):
        t = solution.times[k]
        M, K = found.M(t), found.K_s(t)
        scale = np.diag(1 / np.sqrt(np.diag(K)))
        R = scale @ null_space(scale @ K @ scale, rcond=1e-9)
        assert R.shape[1] == 1
        z = solution.trajectory.z[k]
        assert (R.T @ M @ z).item() == pytest.approx(0, abs=1e-6 * np.abs(R.T @ np.abs(M @ z)).item())
        relief = np.eye(len(z)) - M @ R @ np.linalg.solve(R.T @ M @ R, R.T)
        stiffness = K + found.K_d(t) + found.K_g(t)
        F = relief @ found.F(t)
        assert relief @ stiffness @ z == pytest.approx(F, abs=1e-9 * np.abs(F).max())


def test_stiffnesses_that_rounding_parts_are_named():
    huge = "lower.beam.section={rectangle=['7.990584395631813e+32 mm', '10 mm']}"
    with pytest.raises(SceneError, match=r"solve.preset = 'quasistatic': the stiffness matrix is numerically singular"):
        run("elastic-double-pendulum", huge, "solve.preset=quasistatic", "solve.duration=20 ms", "solve.steps=20")


def test_a_free_rod_bends_quasi_statically_against_its_own_inertia():
    """Force P in the middle, P/L along the rod against it: P L^3 / 48 EI - 5 P L^3 / 384 EI (Timoshenko 1955)."""
    solution = run("free-rod", "solve.preset=quasistatic", "solve.steps=100")
    E, I = 210e9, 7008e-12
    P = 1000 * np.exp(-(((solution.times - 1e-4) / 2e-5) ** 2))
    assert solution["bow"].values == pytest.approx(P * L**3 / (128 * E * I), rel=1e-6, abs=1e-18)


@pytest.mark.parametrize("elements", [100, 300])
def test_fine_meshes_are_not_taken_for_mechanisms(elements):
    """Their highest frequencies are so high that the lowest ones look like nothing beside them."""
    few, many = (
        run("engine", "solve.preset=quasistatic", "solve.steps=48", f"rod.elements={n}").series for n in (8, elements)
    )
    alike(many, few, 1e-3, ("tip_axial", "mid_transverse"))


@pytest.mark.parametrize(
    "settings", [("blade.elements=1024",), ("blade.elements=64", "blade.beam.I=9e-15 m^4")], ids=["fine", "slender"]
)
def test_what_is_held_at_one_end_is_not_taken_for_a_mechanism(settings):
    """A cantilever's lowest frequency beside its highest: 1e-8 on 1024 elements, 1e-9 at a slenderness of 1e5."""
    common = ("solve.preset=quasistatic", "solve.steps=12", "shaft.speed=0.001 rad/s")
    solution = run("rotating-cantilever", *common, *settings)
    E_I = 70e9 * (9e-15 if len(settings) == 2 else 67.5e-12)
    assert abs(solution.series["tip_transverse"].values).max() == pytest.approx(0.1 / (3 * E_I), rel=1e-4)


# ---- the paper's own model --------------------------------------------------------------------------------------


def welded_frame(phi: float, gas: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """M, K_s, K_d, F of the paper's frame, T^T k T without T', coordinates Q3, Q4, Q5, Q6, Q7, Q9."""
    motion = by_hand.slider_crank(R, L, phi, SPEED)
    m_1, EA_1, EI_1 = 0.952 / R, 2.1e11 * 0.952 / R / 7850, 2.1e11 * 7.660080868730307e-7
    EA_2, EI_2 = 2.1e11 * ROD_RHO_A / 7850, 2.1e11 * 7.008e-9
    M, K_s, K_d, F = np.zeros((9, 9)), np.zeros((9, 9)), np.zeros((9, 9)), np.zeros(9)
    pin = -R * SPEED**2 * np.array([np.cos(phi), np.sin(phi)])
    c, s = np.cos(motion["phi2"]), np.sin(motion["phi2"])
    for first, angle, w, e, a, data in (
        (0, phi, SPEED, 0.0, (0.0, 0.0), (m_1, EA_1, EI_1, R)),
        (3, motion["phi2"], motion["omega2"], motion["epsilon2"], (c * pin[0] + s * pin[1], -s * pin[0] + c * pin[1]),
         (ROD_RHO_A, EA_2, EI_2, L)),
    ):  # fmt: skip
        rhoA, EA, EI, length = data
        T = by_hand.rotation_to_local(np.cos(angle), np.sin(angle)).astype(float)
        rows = slice(first, first + 6)
        M[rows, rows] += T.T @ by_hand.mass(rhoA, length) @ T
        K_s[rows, rows] += T.T @ by_hand.stiffness(EA, EI, length) @ T
        K_d[rows, rows] += T.T @ by_hand.dynamic_stiffness(rhoA, length, w, e) @ T
        load = by_hand.load_acceleration(rhoA, length, *a)
        load = load + by_hand.load_centrifugal(rhoA, length, 0.0, w) + by_hand.load_euler(rhoA, length, 0.0, e)
        F[rows] += T.T @ load
    M[6, 6] += PISTON
    F[6] -= PISTON * motion["piston_acceleration"] + gas
    free = [2, 3, 4, 5, 6, 8]
    return M[np.ix_(free, free)], K_s[np.ix_(free, free)], K_d[np.ix_(free, free)], F[free]


@pytest.mark.parametrize("degrees", [0.0, 63.0, 190.0, 374.0])
def test_matrices_of_the_papers_frame(degrees):
    found, t = model("engine-paper"), np.radians(degrees) / SPEED
    gas = found.motion.at(t)["gas"][0]
    for name, expected in zip(("M", "K_s", "K_d", "F"), welded_frame(np.radians(degrees), gas), strict=True):
        computed = getattr(found, name)(t)
        assert computed == pytest.approx(expected, abs=1e-11 * np.abs(expected).max()), name


def test_motion_of_the_papers_frame():
    """Decoupled (143) at angle 0, from rest, undamped: convolution with sin(omega t)/omega, mode by mode."""
    solution = run("engine-paper")
    M, K_s, K_d, _ = welded_frame(0.0, 0.0)
    squares, shapes = eigh(K_s + K_d, M)
    omega = np.sqrt(squares)
    times, h = solution.times[:721], solution.times[1] / 4
    gas = solution.model.motion.at(h * np.arange(4 * len(times) - 3))["gas"]
    forces = np.array([shapes.T @ welded_frame(SPEED * h * k, g)[3] for k, g in enumerate(gas)])
    # Each step of the impulse response, force constant over it at its mean.
    mean = 0.5 * (forces[:-1] + forces[1:])
    turn = np.exp(1j * omega * h)
    state, expected = np.zeros(6, complex), [np.zeros(6)]
    for k in range(len(mean)):
        state = turn * state + mean[k] * (turn - 1) / (1j * omega)
        if (k + 1) % 4 == 0:
            expected.append(shapes @ (state.imag / omega))
    expected = np.array(expected)
    found = solution.coordinates[0].T[: len(expected)]
    assert found == pytest.approx(expected, abs=5e-4 * np.abs(expected).max())


def test_a_frozen_mode_without_stiffness_diverges_and_is_named():
    """The blade at eta = 8 loses its first mode to the spin: e^(35.28 t), the square root of -omega^2 of K_s + K_d."""
    solution = run("rotating-cantilever", "solve.preset=paper", "solve.duration=1 s", "solve.steps=2000")
    found = solution.model
    squares = eigh(found.K_s(0.0) + found.K_d(0.0), found.M(0.0), eigvals_only=True)
    tip = solution.series["tip_transverse"].values
    assert np.log(tip[2000] / tip[1000]) == pytest.approx(0.5 * np.sqrt(-squares[0]), rel=1e-6)
    (said,) = (text for text in validity_warnings(solution, [10.96]) if "frozen" in text)
    assert "grows as exp(35.28 t)" in said
    assert not any("frozen" in text for text in validity_warnings(run("engine-paper"), [1000.0]))


# ---- linear and stiffened ---------------------------------------------------------------------------------------


def test_foreshortening_is_in_the_outputs_of_stiffened_only():
    """-1/2 int v'^2 dx along the rod, by Simpson's rule on the slopes of the cubic elements."""
    linear, stiffened = run("engine", "solve.preset=linear"), run("engine", "solve.terms={geometric=false}")
    assert stiffened.trajectory.z == pytest.approx(linear.trajectory.z, abs=1e-12)
    deformation = deform(linear.model, linear.rigid, linear.coordinates, "rod")
    x = np.linspace(0, L, 401)
    slopes = np.array([deformation.at(place)[0][2] for place in x])
    weights = np.array([1, *([4, 2] * 199), 4, 1]) * (x[1] / 3)
    shortening = 0.5 * weights @ slopes**2
    difference = linear.series["tip_axial"].values - stiffened.series["tip_axial"].values
    assert difference == pytest.approx(shortening, rel=1e-6, abs=1e-14)
    assert shortening.max() > 1e-9


# ---- reduction and size -----------------------------------------------------------------------------------------


def test_craig_bampton_with_every_mode_changes_nothing():
    """To 1e-9 in the displacements at 2880 steps; forces hold accelerations of stiff modes, which differ more."""
    settings = ("rod.elements=4", "solve.steps=2880", "solve.integrator=radau")
    full = run("engine", *settings)
    reduced = run("engine", *settings, "solve.reduction=craig-bampton")
    assert len(reduced.model.coordinates) == len(full.model.coordinates) == 12
    assert any("mode_" in name for name in reduced.model.coordinates)
    alike(reduced, full, {"tip_axial": 1e-9, "mid_transverse": 1e-9, "mid_global_x": 1e-9, "crank_torque": 1e-7})


@pytest.mark.parametrize(("modes", "bound"), [(1, 2e-4), (3, 5e-5), (6, 5e-6)])
def test_craig_bampton_converges_with_its_modes(modes, bound):
    """Axial stretch and the chord's rotation are static shapes, and what is left out follows statically."""
    settings = ("rod.elements=8", "solve.integrator=radau")
    full, reduced = run("engine", *settings), run("engine", *settings, f"solve.modes={modes}")
    assert len(reduced.model.coordinates) == modes + 1
    for name in (
        "tip_axial", "mid_transverse", "rod_force_piston", "rod_mid_strain", "crank_pin_force_y", "crank_torque",
    ):
        expected = full.series[name].values
        assert np.abs(reduced.series[name].values - expected).max() < bound * np.abs(expected).max(), name


def test_more_modes_than_the_link_has_are_refused():
    with pytest.raises(SceneError, match=r"solve\.modes = 40.*rod has 11 fixed-interface modes"):
        model("engine", "solve.modes=40")


def test_sixty_four_elements_run_banded():
    """The band does not grow with the number of elements, and the answer is that of eight."""
    short = ("engine-transient", "solve.integrator=newmark", "solve.duration=0.0025 s", "solve.steps=900")
    few, many = (run(*short, f"rod.elements={n}") for n in (8, 64))
    assert len(many.model.coordinates) == 3 * 64
    assert many.model.system.half_bandwidth == few.model.system.half_bandwidth <= 6
    assert many.model.system.M.shape == (192 * 11, len(many.model.monomials))
    alike(many, few, 2e-3, ("tip_axial", "mid_transverse"))


def test_hundreds_of_elements_stay_sparse():
    """A quasi-static solve of 256 elements costs as many numbers as its band, not a square of them."""
    found = model("engine", "solve.preset=quasistatic", "rod.elements=256")
    assert len(found.coordinates) == 768
    matrices = [matrix for affine in found.equations.matrices().values() for matrix in affine.terms.values()]
    entries = sum(matrix.nnz if issparse(matrix) else matrix.size for matrix in matrices)
    assert entries < 768 * 250


def test_what_a_rigid_mechanism_has_no_use_for_is_said():
    """Nothing deforms, so nothing follows a motion; another preset, or an integrator, is not what is solved."""
    assert model("double-pendulum").warnings == ()
    assert model("double-pendulum", "solve.preset=coupled").warnings == ()  # it moves rigid bodies, too
    (said,) = model("double-pendulum", "solve.preset=stiffened").warnings
    assert said == "no body is elastic: preset stiffened solves the rigid mechanism, like preset rigid"
    still = model("engine", "solve.preset=rigid", "solve.integrator=newmark")
    assert still.warnings == ("preset rigid integrates nothing: solve.integrator = newmark has no effect",)
    assert still.options.integrator == "none"


def test_numbers_that_nothing_reads_are_said():
    """A shear coefficient where nothing shears, and the damping of an integrator that is not taken."""
    told = ("rod.kappa = 0.8 has no effect: theory euler-bernoulli has no shear deformation",)
    assert model("engine", "rod.kappa=0.8").warnings == told
    assert model("engine", "rod.kappa=0.8", "rod.theory=timoshenko", "rod.nu=0.3").warnings == ()
    modal = model("double-pendulum", "damping.modal.ratio=0.02")
    assert modal.warnings == ("no body is elastic: damping.modal has no modes to damp",)
    damped = "solve.rho_infinity = 0.5 has no effect: it belongs to generalised-alpha"
    for preset in ("stiffened", "coupled", "rigid"):
        assert model("engine", f"solve.preset={preset}", "solve.rho_infinity=0.5").warnings == (damped,)
    assert model("engine", "solve.integrator=generalised-alpha", "solve.rho_infinity=0.5").warnings == ()


@pytest.mark.parametrize(("scene", "settings", "said"), [
    ("engine", ["quasistatic", "solve.modes=2", "solve.reduction=none"],
     "solve.reduction = none keeps all modes: solve.modes = 2 has no effect"),
    ("engine", ["quasistatic", "solve.start=zero"],
     "preset quasistatic has no initial state: solve.start = zero has no effect"),
    ("engine", ["quasistatic", "solve.tolerance=1e-9"],
     "solve.tolerance = 1e-09 has no effect: only preset coupled and integrator spectral use it"),
    ("spatial-slider-crank-elastic", ["quasistatic", "solve.tolerance=1e-9"],
     "solve.tolerance = 1e-09 has no effect: only preset coupled and integrator spectral use it"),
    ("engine", ["linear", "solve.bounded=['speeds']"],
     "solve.bounded = speeds has no effect: only preset coupled uses it"),
    ("engine", ["paper"], "preset paper starts from rest: solve.start = periodic has no effect"),
    ("mathieu", ["rigid"], "no body is elastic: solve.reduction = modal has no effect"),
    ("double-pendulum", ["rigid", "solve.start=quasistatic", "solve.duration=1 ms"],
     "under preset rigid, free joints start as given in drives: solve.start = quasistatic has no effect"),
    ("spatial-slider-crank", ["coupled", "solve.forward.tolerance=1e-7"],
     "solve.forward has no effect: preset coupled integrates them with the links"),
], ids=lambda part: part[0] if isinstance(part, list) else "")  # fmt: skip
def test_settings_that_nothing_takes_up_are_said(scene, settings, said):
    preset, *others = settings
    assert said in model(scene, f"solve.preset={preset}", *others).warnings


def test_settings_that_are_taken_up_are_no_warnings():
    """Under quasistatic modes reduce, and the slow motion is both periodic and what a slow start asks for."""
    for settings in (("solve.modes=2",), ("solve.start=quasistatic",), ("solve.start=periodic",)):
        assert model("engine", "solve.preset=quasistatic", *settings).warnings == ()
    assert model("engine", "solve.tolerance=1e-7").warnings == ()  # of spectral


def test_all_modes_are_a_number_of_them_in_coupled_equations():
    """Which is said where all are asked for, and what is counted is what moves: a rod's five shapes."""
    coupled = ("engine", "solve.preset=coupled")
    asked = model(*coupled, "solve.modes=all")
    assert asked.warnings == ("preset coupled uses 3 modes of each link for solve.modes = all: give a number",)
    assert model(*coupled).warnings == model("engine", "solve.modes=all").warnings == ()
    assert asked.solved_for == 5 and model(*coupled, "solve.modes=2").solved_for == 4
    assert model("double-pendulum", "solve.preset=coupled").solved_for == 2
    top = model("spinning-top", "solve.preset=rigid")
    assert top.solved_for == top.degrees_of_freedom == 3
    assert model("four-bar-motor", "solve.preset=coupled").solved_for == 1 + 5  # its crank, too
