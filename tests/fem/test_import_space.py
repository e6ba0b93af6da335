"""Bodies in space from another program's finite elements: against its own modes, closed forms, a beam, the plane."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from imported_rod import AREA, ENDS, FILES, HEIGHT, I_Y, I_Z, NU, PAGE, RHO, WIDTH, E, L, arguments, printed_by
from machines import pendulum, slider_crank
from runs import alike, solved
from scipy.io import mmread
from scipy.sparse.linalg import eigsh

import kaneflex
from kaneflex.fem.imported.files import read_elements
from kaneflex.fem.imported.modal_arrays import imported_data
from kaneflex.multibody.model.held_shapes import held_shapes
from kaneflex.scene.modal_data import read_modal_data


@pytest.fixture(scope="module", autouse=True)
def printed(tmp_path_factory, peer):
    """What the page's command for a scene in space prints, in a folder with the files that its script writes."""
    peer("skfem")
    with printed_by(command(), tmp_path_factory.mktemp("finite-elements")) as output:
        yield output


def command(**changed):
    """The page's arguments, some of them changed."""
    return arguments(r"import rod-mass.mtx .*--space.*", **changed)


@pytest.fixture(scope="module")
def mesh():
    return read_elements(*FILES, ENDS, spatial=True)


def test_the_page_shows_what_is_printed(printed):
    (shown,) = re.findall(r"^    (137 mm .*\) kg m\^2)$", PAGE, re.MULTILINE)
    assert shown == printed.splitlines()[0]


def test_moments_of_the_bar():
    mass, centre, inertia = read_modal_data("rod-space.npz").rigid
    assert mass == pytest.approx(RHO * AREA * L, rel=1e-9)
    assert centre == pytest.approx((L / 2, 0.0, 0.0), rel=1e-9, abs=1e-12)
    sides = np.array([L, HEIGHT, WIDTH]) ** 2
    assert inertia[:3] == pytest.approx(mass / 12 * (sides.sum() - sides), rel=1e-9)
    assert inertia[3:] == pytest.approx((0.0, 0.0, 0.0), abs=1e-12 * inertia[2])


@pytest.mark.parametrize("rigid", [True, False])
def test_modes_of_the_free_mesh(mesh, rigid):
    """Shapes without momentum are nearly its free modes, which SciPy finds on all unknowns: 12 more of them than static
    ones meet five to 0.6 %: bending either way, torsion and stretch, never from below (Ritz 1909)."""
    K, M = (mmread(name).tocsc() for name in (FILES[1], FILES[0]))
    squares = np.sort(eigsh(K, 12, M, sigma=-1e6, v0=np.ones(K.shape[0]))[0])[6:]
    data = imported_data(mesh, 12, rigid)
    found = data.arrays["stiffness"] / np.einsum("aajj->j", data.arrays["mass_N_N"])
    away = np.sqrt(found[:5] / squares[:5]) - 1.0
    assert (away > -1e-9).all() and (away < 6e-3).all()


def test_a_cantilever_yields_as_timoshenkos():
    """Stretch, bending in both planes under forces and moments: ends that don't warp make it 1 % stiffer, and 4 % to
    torques (Saint-Venant's torsion of a rectangle, Roark's approximation, which is good to 0.3 %)."""
    data = read_modal_data("rod-space.npz")
    rows = held_shapes(data, (0.0, 0.0, 0.0)).rows[data.points.index("end")]
    found = rows @ (rows / data.arrays["stiffness"]).T
    G, kappa = E / (2 * (1 + NU)), 10 * (1 + NU) / (12 + 11 * NU)  # Cowper 1966
    a, b = HEIGHT / 2, WIDTH / 2
    J = a * b**3 * (16 / 3 - 3.36 * b / a * (1 - (b / a) ** 4 / 12))
    shear = L / (kappa * G * AREA)
    expected = [L / (E * AREA), L**3 / (3 * E * I_Z) + shear, L**3 / (3 * E * I_Y) + shear]
    expected += [L / (G * J), L / (E * I_Y), L / (E * I_Z)]
    away = np.diag(found) / expected - 1.0
    assert (abs(away[[0, 1, 2, 4, 5]]) < 1.2e-2).all() and -4e-2 < away[3] < 0.0
    assert found[1, 5] == pytest.approx(L**2 / (2 * E * I_Z), rel=1.2e-2)  # lifted, it turns about z
    assert found[2, 4] == pytest.approx(-(L**2) / (2 * E * I_Y), rel=1.2e-2)


@pytest.mark.parametrize("axis", [1, 2])
def test_bending_shortens_as_a_cantilever(axis):
    """Under a force at its end, d the deflection there: by 3/5 d^2 / L there, 3/16 d^2 / L in the mean of its mass.

    Both are the integral of half of v'^2, v = d (3 x^2 / L^2 - x^3 / L^3) / 2; 1.6 % of d are shear here.
    """
    data = read_modal_data("rod-space.npz")
    found = held_shapes(data, (0.0, 0.0, 0.0))
    k = data.points.index("end")
    q = 1e3 * found.rows[k, axis] / data.arrays["stiffness"]
    d = found.rows[k, axis] @ q
    for G, share in ((found.G[k], 3 / 5), (found.moments.G / data.arrays["mass"], 3 / 16)):
        x, *across = 0.5 * np.einsum("ajk,j,k->a", G, q, q)
        assert x == pytest.approx(-share * d**2 / L, rel=4e-2)
        assert abs(np.array(across)).max() < 1e-2 * abs(x)


def spun(of):
    """Series of a rod that is spun up about a skew axis and pushed."""
    return run(pendulum(
        of, 'speed = "300 rad/s", spin_up = "8 ms"', "rod", "pin", more={"pin": "axis = [0, 0.6, 0.8]"},
        loads='push = {force_on = "rod.end", direction = [0.1, 0.6, 0.8], law = "50000*t"}',
        sensors="""
y = {displacement = "rod.end", component = "y"}
z = {displacement = "rod.end", component = "z"}
bow = {displacement = "rod.mid", component = "y"}
force = {joint_force = "pin", component = "y"}
torque = {drive_torque = "pin"}""",
        solve={"preset": "coupled", "duration": "8 ms", "steps": 80},
    ))  # fmt: skip


BEAM = (
    'length = "137 mm", beam = {material = "steel", section = {rectangle = ["20 mm", "12 mm"]}, theory = "timoshenko"}'
)


def test_spun_up_about_a_skew_axis_beside_a_beam():
    """Displacements to 2 %, forces to 0.5 %: the ends of the mesh are stiffened, see the cantilever."""
    beam, found = (spun(of) for of in (BEAM, 'modal_data = "rod-space.npz"'))
    alike(found, beam, {"y": 2e-2, "z": 2e-2, "bow": 2e-2, "force": 5e-3, "torque": 5e-3})


def engine(file, deep):
    """Series of an engine whose rod has the modal data of a file."""
    return run(slider_crank(
        'length = "40 mm", mass = "0.952 kg"', f'modal_data = "{file}"', 'mass = "0.214 kg"',
        'speed = "6000 rpm", spin_up = "5 ms"', wrist="spherical" if deep else "revolute", deep=deep,
        more={} if deep else {"bore": 'branch = "+"'},
        sensors="""
bow = {displacement = "rod.mid", relative_to = "chord", component = "y"}
torque = {drive_torque = "main"}""",
        solve={"preset": "coupled", "duration": "5 ms", "steps": 100},
    ))  # fmt: skip


def test_an_engine_in_the_plane_and_lifted_into_space():
    """Bow to 2 % of its peak, torque to 0.1 %: shapes are static ones and modes of other conditions."""
    assert cli(*(word for word in command(**{"rod-space.npz": "rod.npz"}) if word != "--space")).exit_code == 0
    alike(engine("rod-space.npz", True), engine("rod.npz", False), {"bow": 2e-2, "torque": 1e-3})


def run(text):
    return solved(kaneflex.scene_of(text)).series


@pytest.mark.parametrize(("changed", "message"), [
    ({"end=small-eye.txt": "end=edge.txt"}, "the nodes of end lie on one line: its rotation is not determined"),
    ({"rod-stiffness.mtx": "rod-mass.mtx"}, "rod-mass.mtx resists a rigid motion along x by"),
    ({"rod-mass.mtx": "flat.mtx"}, "flat.mtx has two translations of each node"),
    ({"6": "50", "rod-nodes.txt": "rod-nodes.txt", "end=small-eye.txt": "end=none.txt"}, "none.txt cannot be read"),
])  # fmt: skip
def test_what_is_refused(changed, message):
    from scipy.io import mmwrite
    from scipy.sparse import eye_array

    numbers = np.loadtxt("rod-nodes.txt")
    edge = (numbers[:, 1] == L) & (numbers[:, 2] == numbers[:, 2].max())
    np.savetxt("edge.txt", numbers[edge, 0], fmt="%d")
    mmwrite("flat.mtx", eye_array(2 * len(numbers)))
    refused(cli(*command(**({"rod-space.npz": "other.npz"} | changed))), message)
    assert not Path("other.npz").exists()


def test_a_point_of_one_node_turns_as_the_sections_do():
    """Beside one that is the whole end of the bar: by the turn of a cantilever's end."""
    numbers = np.loadtxt("rod-nodes.txt")
    middle = abs(numbers[:, 1:] - [L, 0.0, 0.0]).max(axis=1).argmin()
    np.savetxt("middle.txt", numbers[[middle], 0], fmt="%d")
    alone = imported_data(read_elements(*FILES, ENDS | {"end": "middle.txt"}, spatial=True), 12)
    rows = held_shapes(alone, (0.0, 0.0, 0.0)).rows[alone.points.index("end")]
    found = rows @ (rows / alone.arrays["stiffness"]).T
    assert found[5, 1] == pytest.approx(L**2 / (2 * E * I_Z), rel=3e-2)


def on_feet(legs):
    """Files of the solid with so many beams on nodes of it, which meet in one beside it: names, feet, nodes' table."""
    from quadrature import uniform
    from scipy.io import mmwrite
    from scipy.sparse import csc_array, eye_array

    numbers = np.loadtxt("rod-nodes.txt")
    count, tip = len(numbers), np.array([L / 2, 18e-3, 0.0])
    wanted = ([L / 2, 10e-3, 6e-3], [L / 2, 10e-3, -6e-3], [0.0, 10e-3, 0.0])[:legs]
    feet = [int(np.linalg.norm(numbers[:, 1:] - place, axis=1).argmin()) for place in wanted]
    unknowns = eye_array(6 * (count + 1), format="csc")
    solid = unknowns[:, (6 * np.arange(count)[:, None] + np.arange(3)).ravel()]
    for k, name in enumerate(("mass", "stiffness")):
        whole = solid @ mmread(f"rod-{name}.mtx") @ solid.T
        for foot in feet:
            way = tip - numbers[foot, 1:]
            length, x = np.linalg.norm(way), way / np.linalg.norm(way)
            y = np.cross(x, [0.3, 0.5, 0.8])
            turn = np.kron(np.eye(4), np.stack([x, y / np.linalg.norm(y), np.cross(x, y / np.linalg.norm(y))]))
            element = uniform(1e-6, 1e-12, 1e1, 1e-3, 1e-3, 1e-3, length)[k]
            beam = unknowns[:, np.concatenate([6 * node + np.arange(6) for node in (foot, count)])]
            whole += beam @ csc_array(turn.T @ element @ turn) @ beam.T
        mmwrite(f"mixed-{name}.mtx", (whole + whole.T) / 2)
    np.savetxt("mixed-nodes.txt", np.vstack([numbers, [count + 1, *tip]]), fmt="%.12g")
    return ["mixed-mass.mtx", "mixed-stiffness.mtx", "mixed-nodes.txt"], feet, numbers


def test_solid_elements_beside_some_that_bend(mesh):
    """A soft tripod of three beams: nodes of the solid that bear none don't turn, and its data stay as they were."""
    files, feet, numbers = on_feet(3)
    count = len(numbers)
    link = read_elements(*files, ENDS, spatial=True)
    assert np.flatnonzero(link.turning).tolist() == [*sorted(feet), count]
    mixed, plain = (imported_data(each, 4) for each in (link, mesh))
    squares = [of.arrays["stiffness"] / np.einsum("aajj->j", of.arrays["mass_N_N"]) for of in (mixed, plain)]
    np.testing.assert_allclose(*(np.sort(each)[:5] for each in squares), rtol=1e-5)
    for name in ("mass", "mass_r", "mass_r_r"):
        largest = abs(plain.arrays[name]).max()
        np.testing.assert_allclose(mixed.arrays[name], plain.arrays[name], atol=1e-6 * largest)
    for of in (mixed, plain):  # how the middle of a cantilever turns and moves
        k = of.points.index("mid")
        rows = held_shapes(of, (0.0, 0.0, 0.0))
        end = rows.rows[of.points.index("end")]
        yields = rows.rows[k] @ (end / of.arrays["stiffness"]).T
        assert yields[1, 1] == pytest.approx(5 * L**3 / (48 * E * I_Z), rel=3e-2)
        assert yields[5, 1] == pytest.approx(3 * L**2 / (8 * E * I_Z), rel=2e-2)
    np.savetxt("lone.txt", [numbers[(numbers[:, 1] == L).argmax(), 0]], fmt="%d")
    lone = read_elements(*files, ENDS | {"end": "lone.txt"}, spatial=True)
    assert len(lone.held("end", "any")) == 3  # a node of the solid has no turn of its own


def test_a_beam_that_a_solid_does_not_hold_is_refused():
    """On one foot it turns about that: solid elements resist no turn of a node."""
    files, *_ = on_feet(1)
    arguments = command(**dict(zip(FILES, files, strict=True)), **{"rod-space.npz": "hinged.npz"})
    refused(cli(*arguments), "the stiffness matrix is singular with all points fixed")
    assert not Path("hinged.npz").exists()


def skew_rod(bending):
    """Files of a steel rod of four elements along a skew line, its bending stiffness E I_Y times ``bending``."""
    from quadrature import uniform
    from scipy.io import mmwrite
    from scipy.sparse import csc_array

    direction = np.array([0.48, -0.6, 0.64])
    across = np.cross(direction, [0.3, 0.5, 0.8])
    across /= np.linalg.norm(across)
    turn = np.kron(np.eye(10), np.stack([direction, across, np.cross(direction, across)]))
    for k, name in enumerate(("mass", "stiffness")):
        whole = np.zeros((30, 30))
        for node in range(4):
            part = slice(6 * node, 6 * node + 12)
            whole[part, part] += uniform(RHO * AREA, 1e-6, E * AREA, E * I_Z, bending * E * I_Y, E * I_Y, L / 4)[k]
        whole = turn.T @ whole @ turn
        mmwrite(f"skew-{name}.mtx", csc_array((whole + whole.T) / 2))
    places = np.array([1.0, -2.0, 0.5]) + np.outer(np.linspace(0.0, L, 5), direction)
    np.savetxt("skew-nodes.txt", np.column_stack([np.arange(1, 6), places]), fmt="%.12g")
    for name, node in (("first", 1), ("last", 5)):
        Path(f"{name}.txt").write_text(f"{node}\n")
    return "skew-mass.mtx", "skew-stiffness.mtx", "skew-nodes.txt"


def test_nodes_of_a_skew_beam_enclose_no_volume_that_gives_a_density():
    """Rounding errors gave it a volume, and 1.8e22 kg/m^3."""
    assert read_elements(*skew_rod(1.0), {"start": "first.txt", "end": "last.txt"}, spatial=True).doubts == []


def test_a_negative_stiffness_is_not_called_singular():
    points = "--point", "start=first.txt", "--point", "end=last.txt"
    message = "the stiffness matrix is not positive definite. Export the stiffness of the unloaded link"
    refused(cli("import", *skew_rod(-0.1), *points, "--space", "-o", "negative.npz"), message)
    assert not Path("negative.npz").exists()
