"""The gallery: scenes whose numbers are known from elsewhere. docs/gallery.md lists them."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from places import DATA, DOCS
from runs import model, run, shipped
from scipy.linalg import eigh

from kaneflex import Model, load, modes, read_scene, shipped_scenes
from kaneflex.multibody.model.building import build_model, reference_modes
from kaneflex.solve.modes import mesh_hint


def reference(name: str) -> dict:
    return json.loads((DATA / f"{name}.json").read_text())


def deviation(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return np.abs(np.asarray(found) / np.asarray(exact) - 1)


# ---- four-bar with three elastic links ---------------------------------------------------------------------------


def four_bar_deviation(*settings: str) -> np.ndarray:
    """Worst deviation of the three lowest frequencies of the locked four-bar over the crank's angles."""
    worst = np.zeros(3)
    loaded = model("four-bar", *settings)
    for angle, *exact in reference("four_bar_frequencies")["exact_locked_crank_table_SI_rounded"]["rows"]:
        options = loaded.options._replace(mode_angle=np.radians(angle))
        found = reference_modes(build_model(loaded.scene, options, loaded.motion), 3)[0]
        worst = np.maximum(worst, deviation(found, exact[:3]))
    return worst


def four_bar_elements(count: int) -> list[str]:
    return [f"{link}.elements={count}" for link in ("crank", "coupler", "follower")]


def test_four_bar_frequencies_fall_with_the_fourth_power():
    """8 elements a link: 1e-4 (Kitis & Lindenberg 1990, made exact); order four from 2 to 16, nearly so at first."""
    worst = {count: four_bar_deviation(*four_bar_elements(count)) for count in (2, 4, 8, 16)}
    assert (worst[8] < 1e-4).all()
    for count, slack in ((2, 0.4), (4, 0.1), (8, 0.1)):
        assert np.log2(worst[count] / worst[2 * count]) == pytest.approx([4, 4, 4], abs=slack)


def test_four_bar_frequencies_of_reduced_links():
    assert (four_bar_deviation(*four_bar_elements(8), "solve.modes=4") < 1e-3).all()


# ---- spin-up and slider-crank: what K_g is for -------------------------------------------------------------------


@pytest.fixture(scope="module")
def spin_up() -> dict[str, np.ndarray]:
    solution = run("spin-up")
    return {"t": solution.times} | {name: series.values for name, series in solution.series.items()}


def test_spin_up_is_the_linear_stiffened_reference(spin_up):
    """Kane, Ryan & Banerjee (1987) in the data of Wu & Haug (1988), against an independent model of the same order."""
    exact = reference("spin_up")["cases"]["WuHaug"]["linear_stiffened"]
    u1, u2, t = spin_up["tip_axial"], spin_up["tip_transverse"], spin_up["t"]
    late = t > 15.0
    assert exact["u2_min"] == pytest.approx(-0.53471, rel=1e-5)
    assert u2.min() == pytest.approx(exact["u2_min"], rel=1e-3)
    assert t[u2.argmin()] == pytest.approx(exact["t_of_u2_min"], abs=0.02)
    assert u1.min() == pytest.approx(exact["u1_min"], rel=2e-3)
    assert np.abs(u2[late]).max() == pytest.approx(exact["u2_residual_amplitude_after_T"], rel=2e-2)
    assert u1[late].mean() == pytest.approx(exact["u1_late_mean"], rel=5e-3)
    assert abs(u2[late].mean() - exact["u2_mean_after_T"]) < 1e-2 * exact["u2_residual_amplitude_after_T"]


def slider_crank(preset: str) -> np.ndarray:
    return run("slider-crank-150", f"solve.preset={preset}").series["mid_transverse"].values / 0.3


def test_slider_crank_without_axial_forces_is_the_linear_reference():
    exact = reference("slider_crank_150")["computed_own"]["linear_4sine_3axial"]["w_max"]
    assert slider_crank("linear").max() == pytest.approx(exact, rel=5e-3)


def test_slider_crank_with_axial_forces_meets_the_geometrically_exact_peak():
    """K_g from the rigid reactions closes the 22 %; what it misses later in the cycle stays as small as it is known."""
    exact = reference("slider_crank_150")["computed_own"]["GE_EulerBernoulli"]
    w = slider_crank("stiffened")
    assert w.max() == pytest.approx(exact["w_max"], rel=5e-3)
    assert slider_crank("linear").max() / exact["w_max"] == pytest.approx(1.22, abs=0.01)
    assert w.min() / exact["w_min"] - 1 == pytest.approx(0.024, abs=0.005)
    assert abs(w[-1] / exact["w_at_end"] - 1) == pytest.approx(0.28, abs=0.02)


# ---- rotating cantilever -----------------------------------------------------------------------------------------


def bending_matrices(loaded: Model) -> dict[str, np.ndarray]:
    """Matrices of the blade's v and theta. At constant speed no stiffness couples them with u, which is left out."""
    rows = [k for k, name in enumerate(loaded.coordinates) if not name.endswith(".u")]
    others = [k for k, name in enumerate(loaded.coordinates) if name.endswith(".u")]
    found = {name: getattr(loaded, name)(0.0) for name in ("M", "K_s", "K_g", "K_d")}
    for matrix in found.values():
        assert np.abs(matrix[np.ix_(rows, others)]).max() <= 1e-12 * np.abs(matrix).max()
    return {name: matrix[np.ix_(rows, rows)] for name, matrix in found.items()}


def blade(elements: int, eta: float) -> tuple[dict[str, np.ndarray], float]:
    """Matrices at the speed eta sqrt(E I / (rho A l^4)), and that unit of speed [rad/s]."""
    body = read_scene("rotating-cantilever").bodies["blade"]
    unit = float(np.sqrt(body.profile.at(0.0).E_I_z / body.profile.at(0.0).rho_A) / body.length**2)
    loaded = model("rotating-cantilever", f"blade.elements={elements}", f"shaft.speed={eta * unit!r}")
    return bending_matrices(loaded), unit


def lag_frequencies(elements: int, eta: float) -> np.ndarray:
    m, unit = blade(elements, eta)
    return np.sqrt(eigh(m["K_s"] + m["K_g"] + m["K_d"], m["M"], eigvals_only=True)[:3]) / unit


@pytest.mark.parametrize("row", reference("rotating_cantilever")["table"], ids=lambda row: f"eta={row['eta']}")
def test_rotating_cantilever_frequencies(row):
    """Lag modes of the classical table (Wright, Smith, Thresher & Wang 1982), from the scene's own matrices."""
    exact = [float(row[f"lag_mode{k}"]) for k in (1, 2, 3)]
    off = deviation(lag_frequencies(24, max(float(row["eta"]), 1e-9)), exact)
    assert (off[:2] < 1e-5).all() and off[2] < 1e-4


def test_rotating_cantilever_pulls_on_its_shaft():
    """E A u'' + rho A omega^2 (x + u) = 0: the root carries E A (1 / cos k l - 1), k^2 = rho omega^2 / E."""
    solution = run("rotating-cantilever", "push.value=1e-9 N")
    body, speed = solution.model.scene.bodies["blade"], solution.model.scene.drives["shaft"].speed
    k = speed * np.sqrt(body.profile.at(0.0).rho_A / body.profile.at(0.0).E_A)
    pull = body.profile.at(0.0).E_A * (1 / np.cos(k * body.length) - 1)
    assert pull != pytest.approx(body.profile.at(0.0).rho_A * speed**2 * body.length**2 / 2, rel=1e-5)
    assert solution.series["root_force"].values == pytest.approx(pull, rel=1e-6)
    stretch = np.tan(k * body.length) / k - body.length
    assert solution.series["tip_axial"].values == pytest.approx(stretch, rel=1e-6)


# ---- plane frames ------------------------------------------------------------------------------------------------

ARM = 'beam = {E = "200 GPa", rho = "8000 kg/m^3", A = "0.015625 m^2", I = "2.0345052083333332e-5 m^4", elements = 10}'


def double_cross(folder: Path) -> Path:
    """NAFEMS FV2: eight arms of 5 m at 45 degrees, their outer ends pinned."""
    angles = [45 * k for k in range(8)]
    ends = ", ".join(f"end_{a} = [{5 * np.cos(np.radians(a))}, {5 * np.sin(np.radians(a))}]" for a in angles)
    lines = ["schema = 1", f"ground = {{{ends}}}", f'[bodies.arm_0]\nlength = "5 m"\npose = {{}}\n{ARM}', "[bodies]"]
    lines += [f'arm_{a} = {{like = "arm_0", pose = {{angle = "{a} deg"}}}}' for a in angles[1:]]
    lines += ["[joints]"]
    lines += [f'hub_{a} = {{weld = ["arm_0.start", "arm_{a}.start"], relative_angle = "{a} deg"}}' for a in angles[1:]]
    lines += [f'pin_{a} = {{revolute = ["ground.end_{a}", "arm_{a}.end"]}}' for a in angles]
    lines += ["[solve]", 'preset = "linear"', 'duration = "1 s"']
    path = folder / "double-cross.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


FRAMES = {
    # name: (table, key of its exact values, rigid modes before them)
    "pin-ended-cross": ("FV1_pin_ended_cross", "exact_EB_Hz", 0),
    "double-cross": ("FV2_pin_ended_double_cross", "exact_EB_Hz", 0),
    "free-frame": ("FV3_free_square_frame", "exact_EB_Hz_elastic_modes_4_on", 3),
}


@pytest.mark.parametrize("name", FRAMES)
def test_frame_frequencies(name, tmp_path):
    """NAFEMS FV1, FV2, FV3 in their plane, axial compressibility included; ten elements a member."""
    table, key, rigid = FRAMES[name]
    exact = np.array(reference("nafems_frames")[table][key])
    scene = read_scene(double_cross(tmp_path) if name == "double-cross" else name)
    found = reference_modes(load(scene), rigid + len(exact))[0] / (2 * np.pi)
    assert (found[:rigid] < 1e-3 * exact[0]).all()
    off = deviation(found[rigid:], exact)
    assert (off[:4] < 1e-4).all()
    assert (off[4:] < 1e-3).all()


def test_free_rod_bends_as_a_free_uniform_beam():
    """cos(b) cosh(b) = 1 (Blevins 1979, table 8-1). The paper's Fig. 17 has 6425 Hz for a rod of unknown section."""
    rod = model("free-rod").scene.bodies["rod"]
    rate = np.sqrt(2.1e11 * 7008e-12 / (rod.mass * rod.length**3)) / (2 * np.pi)
    exact = np.array([4.73004074, 7.85320462]) ** 2 * rate
    found = reference_modes(model("free-rod"), 5)[0] / (2 * np.pi)
    assert found[3:] == pytest.approx(exact, rel=1e-3)
    assert found[3] == pytest.approx(6887, abs=1)
    assert mesh_hint(modes(read_scene("free-rod"))) == ""  # rigid modes are rounding, with any mesh


def test_block_is_shaken_as_a_mass_on_its_mounts():
    """M x'' + c x' + k x = -P'', P the first moments of the moving masses in the block's axes, harmonic by harmonic."""
    r, l, omega, count = 0.040, 0.137, 200 * np.pi, 360
    crank, rod, piston = 0.952, 0.153, 0.214
    theta = 2 * np.pi * np.arange(count) / count
    wrist = r * np.cos(theta) + np.sqrt(l**2 - (r * np.sin(theta)) ** 2)
    along = crank * r * np.cos(theta) / 2 + rod * (r * np.cos(theta) + wrist) / 2 + piston * wrist
    across = (crank + rod) * r * np.sin(theta) / 2
    rates, moving = omega * np.arange(count // 2 + 1), crank + rod + piston
    stiff = run("engine-block", "rod.E=2.1e15")
    elastic = run("engine-block")
    for name, moment, M, k, c, weight in (
        ("AccBloc_V", along, 62 + moving, 244.8e3, 779.0, 9.81), ("AccBloc_T", across, 60 + moving, 236.9e3, 754.0, 0.0)
    ):  # fmt: skip
        place = rates**2 * np.fft.rfft(moment) / (k - M * rates**2 + 1j * c * rates)
        exact = np.tile(np.fft.irfft(-(rates**2) * place, count), 2) + weight  # an accelerometer at rest reads -g
        largest = abs(exact).max()
        assert stiff.series[name].values[:-1] == pytest.approx(exact, abs=4e-6 * largest)
        assert elastic.series[name].values[:-1] == pytest.approx(exact, abs=0.02 * largest)


def test_free_frame_drifts_as_the_blow_tells_it():
    """Nothing holds the frame: its mass centre moves at impulse / mass, whatever rings; and not at all across."""
    solution = run("free-frame")
    impulse, mass = 10000 * 0.015 * np.sqrt(np.pi), 4 * solution.model.scene.bodies["bottom"].mass
    z, v, _ = solution.coordinates
    late = solution.times > 0.2
    momentum = translations(solution.model).T @ solution.model.M(0.0) @ v
    assert momentum[0, late] == pytest.approx(impulse, rel=1e-4)
    assert np.abs(momentum[1]).max() < 1e-6 * impulse
    centre = translations(solution.model).T @ solution.model.M(0.0) @ z / mass
    assert centre[0, -1] == pytest.approx(impulse / mass * (solution.times[-1] - 0.05), rel=1e-4)


def translations(loaded: Model) -> np.ndarray:
    """Coordinates of the two unit translations, (n, 2): what the strain energy does not see, by the corners' values."""
    values, shapes = eigh(loaded.K_s(0.0))
    assert (np.abs(values[:3]) < 1e-9 * values[-1]).all() and values[3] > 1e-9 * values[-1]
    corners = [k for k, name in enumerate(loaded.coordinates) if name.endswith((".x", ".y"))]
    wanted = np.array([[name.endswith(".x"), name.endswith(".y")] for name in np.array(loaded.coordinates)[corners]])
    parts, *_ = np.linalg.lstsq(shapes[corners, :3], wanted.astype(float))
    return shapes[:, :3] @ parts


# ---- the page ----------------------------------------------------------------------------------------------------


def test_the_page_has_an_entry_for_each_scene():
    page = DOCS / "gallery.md"
    text = page.read_text(encoding="utf-8")
    assert sorted(re.findall(r"^## (\S+)$", text, flags=re.MULTILINE)) == sorted(shipped_scenes())
    rows = re.findall(
        r"^\| \[!\[(\S+)\]\(pictures/thumbs/\1\.png\)<br>\1\]\(#\1\)<br>`(\w+)` \| [^|]+ \| [^|]+ \|$", text,
        flags=re.MULTILINE,
    )  # fmt: skip
    assert sorted(rows) == [(name, scene.solve.preset) for name, scene in shipped().items()]


def test_the_page_has_a_picture_of_every_scene():
    """Made by `python docs/figures.py gallery`, of `kaneflex run NAME --plots mechanism`."""
    page = DOCS / "gallery.md"
    pictures = re.findall(r"^!\[(\S+)\]\(pictures/(\S+)\.png\)$", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(pictures) == sorted((name, name) for name in shipped_scenes())
    for name in shipped_scenes():
        for file, largest in ((f"{name}.png", 60_000), (f"thumbs/{name}.png", 12_000)):
            content = (page.parent / "pictures" / file).read_bytes()
            assert content.startswith(b"\x89PNG") and len(content) < largest, file
