"""Finite elements whose nodes turn, in space: a bar of textbook beam elements, closed forms, and the beam itself."""

import numpy as np
import pytest
from command_line import cli, refused
from machines import pendulum
from quadrature import uniform
from runs import alike, solved
from scipy.io import mmread, mmwrite

import kaneflex
from kaneflex.fem.imported.files import read_elements
from kaneflex.fem.imported.modal_arrays import imported_data
from kaneflex.multibody.model.held_shapes import held_shapes
from kaneflex.scene.modal_data import read_modal_data

L, HEIGHT, WIDTH, E, NU, RHO, COUNT = 0.4, 20e-3, 12e-3, 210e9, 0.3, 7850.0, 16
A, I_Y, I_Z = HEIGHT * WIDTH, HEIGHT * WIDTH**3 / 12, WIDTH * HEIGHT**3 / 12
J = I_Y + I_Z  # of the twist, chosen: closed forms take any
G = E / (2 * (1 + NU))
IMPORT = ["import", "mass.mtx", "stiffness.mtx", "nodes.txt", "--point", "start=start.txt", "--point", "end=end.txt"]


def assembled(element):
    found = np.zeros((6 * (COUNT + 1),) * 2)
    for e in range(COUNT):
        found[6 * e : 6 * e + 12, 6 * e : 6 * e + 12] += element
    return found


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory):
    """With the files of the bar, along Y of their axes, its section's y along Z: consistent masses, twist inertia."""
    h = L / COUNT
    turn = np.eye(3)[[1, 2, 0]]  # axes of the bar in those of the files
    both = np.kron(np.eye(2 * (COUNT + 1)), turn)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("turning"))
        matrices = uniform(RHO * A, RHO * J, E * A, E * I_Y, E * I_Z, G * J, h)
        for name, element in zip(("mass", "stiffness"), matrices, strict=True):
            mmwrite(f"{name}.mtx", both.T @ assembled(element) @ both, symmetry="symmetric")
        places = np.linspace(0, L, COUNT + 1)[:, None] * turn[0]
        np.savetxt("nodes.txt", np.column_stack([np.arange(1, COUNT + 2), places]), fmt="%.12g")
        np.savetxt("start.txt", [1], fmt="%d")
        np.savetxt("end.txt", [COUNT + 1], fmt="%d")
        yield


@pytest.fixture(scope="module")
def data():
    more = ["--space", "--normal", "1", "0", "0", "--modes", "10", "--section", "third=0.1", "-o", "bar.npz"]
    assert cli(*IMPORT, *more).exit_code == 0
    return read_modal_data("bar.npz")


def test_moments(data):
    """Those of a rod with the rotary inertia of its twist, which Euler-Bernoulli's bending has none of."""
    m, centre, inertia = data.rigid
    assert m == pytest.approx(RHO * A * L, rel=1e-9)
    assert centre == pytest.approx((L / 2, 0.0, 0.0), rel=1e-9, abs=1e-12)
    assert inertia == pytest.approx((RHO * J * L, m * L**2 / 12, m * L**2 / 12, 0, 0, 0), rel=1e-9, abs=1e-12)


def test_frequencies_of_the_free_bar():
    """Bending either way (beta L = 4.7300, 7.8532), twist and stretch, by closed forms, to 0.3 %."""
    points = {"start": "start.txt", "end": "end.txt"}
    link = read_elements("mass.mtx", "stiffness.mtx", "nodes.txt", points, normal=(1, 0, 0), spatial=True)
    data = imported_data(link, 30)
    found = np.sqrt(data.arrays["stiffness"] / np.einsum("aajj->j", data.arrays["mass_N_N"]))
    bending = [(b / L) ** 2 * np.sqrt(E * I / (RHO * A)) for b in (4.730041, 7.853205) for I in (I_Y, I_Z)]
    expected = [*bending, np.pi / L * np.sqrt(G / RHO), np.pi / L * np.sqrt(E / RHO)]
    for omega in expected:
        assert abs(found / omega - 1.0).min() < 3e-3, omega


def test_a_cantilever_of_it(data):
    """Forces and moments at its end, by closed forms."""
    rows = held_shapes(data, (0.0, 0.0, 0.0)).rows[data.points.index("end")]
    found = rows @ (rows / data.arrays["stiffness"]).T
    expected = [L / (E * A), L**3 / (3 * E * I_Z), L**3 / (3 * E * I_Y), L / (G * J), L / (E * I_Y), L / (E * I_Z)]
    np.testing.assert_allclose(np.diag(found), expected, rtol=1e-6)
    assert found[1, 5] == pytest.approx(L**2 / (2 * E * I_Z), rel=1e-6)


SENSORS = """
y = {displacement = "rod.end", component = "y"}
z = {displacement = "rod.end", component = "z"}
bow = {displacement = "rod.mid", component = "y"}
turn = {displacement = "rod.mid", component = "angle_z"}
force = {joint_force = "pin", component = "y"}
torque = {drive_torque = "pin"}
moment = {bending_moment = "rod.mid", component = "z"}"""


def spun(of):
    return solved(kaneflex.scene_of(pendulum(
        of, 'speed = "60 rad/s", spin_up = "20 ms"', "rod", "pin", more={"pin": "axis = [0, 0.6, 0.8]"},
        loads='push = {force_on = "rod.end", direction = [0.1, 0.6, 0.8], law = "1e5*t**2"}', sensors=SENSORS,
        solve={"preset": "coupled", "duration": "20 ms", "steps": 40},
    ))).series  # fmt: skip


def test_spun_up_beside_the_beam(data):
    """To 1 % of the peaks: shapes differ, and what the beam knows of its axis when it bends."""
    section = f"A = {A}, I_y = {I_Y}, I_z = {I_Z}, J = {J}"
    beam = f'length = "{L} m", beam = {{E = {E}, nu = {NU}, rho = {RHO}, {section}, elements = 8}}'
    alike(spun('modal_data = "bar.npz"'), spun(beam), 1e-2)


def test_millimetres(data):
    """Ways in mm, masses in t, forces in N: moments in N mm."""
    way = np.tile([1e-3] * 3 + [1.0] * 3, COUNT + 1)
    for name in ("mass", "stiffness"):
        mmwrite(f"mm-{name}.mtx", np.asarray(mmread(f"{name}.mtx")) * np.outer(way, way) * 1e3, symmetry="symmetric")
    nodes = np.loadtxt("nodes.txt")
    np.savetxt("mm-nodes.txt", np.column_stack([nodes[:, 0], 1e3 * nodes[:, 1:]]), fmt="%.12g")
    more = ["--space", "--normal", "1", "0", "0", "--modes", "10", "--section", "third=100", "--units", "mm-t"]
    assert cli("import", *(f"mm-{word}" for word in IMPORT[1:4]), *IMPORT[4:], *more, "-o", "mm.npz").exit_code == 0
    found = read_modal_data("mm.npz")
    assert found.points == data.points
    for name in ("mass", "mass_r", "mass_r_r", "stiffness"):
        largest = abs(data.arrays[name]).max()
        np.testing.assert_allclose(found.arrays[name], data.arrays[name], rtol=1e-6, atol=1e-9 * largest)
    first, other = (np.sort(abs(of.sections.rows).max(axis=2), axis=None) for of in (found, data))
    np.testing.assert_allclose(first, other, rtol=1e-5, atol=1e-6 * other.max())


def test_masses_without_turns():
    """Lumped at the nodes of a line they resist no twist; with a moment of inertia they do."""
    lumped = np.full(COUNT + 1, RHO * A * L / COUNT)
    lumped[[0, -1]] /= 2
    mmwrite("lumped.mtx", np.diag(np.repeat(lumped, 3)))
    more = ["--space", "--normal", "1", "0", "0", "-o", "lumped.npz"]
    refused(cli("import", "lumped.mtx", *IMPORT[2:], *more), "the mass has no moment of inertia about the axis")
    mmwrite("lumped.mtx", np.diag(np.outer(lumped, [1, 1, 1, 0, J / A, 0]).ravel()))  # Y of the files is its axis
    assert cli("import", "lumped.mtx", *IMPORT[2:], *more).exit_code == 0
    found = read_modal_data("lumped.npz")
    assert found.rigid[0] == pytest.approx(RHO * A * L, rel=1e-9)
    assert found.rigid[2][0] == pytest.approx(RHO * J * L, rel=1e-9)
    rows = held_shapes(found, (0.0, 0.0, 0.0)).rows[found.points.index("end")]
    assert (rows[1] ** 2 / found.arrays["stiffness"]).sum() == pytest.approx(L**3 / (3 * E * I_Z), rel=1e-6)


def test_in_the_plane_they_are_refused():
    refused(cli(*IMPORT, "-o", "plane.npz"), "contains the rotation of node 1. Use --space, or mesh the link by solid")


def test_what_hangs_nowhere_is_refused():
    """A part that is held to nothing, and one on a hinge."""
    K = np.asarray(mmread("stiffness.mtx")).copy()
    K[6 * COUNT - 6 : 6 * COUNT] = K[:, 6 * COUNT - 6 : 6 * COUNT] = 0.0
    mmwrite("loose.mtx", K + np.diag(np.repeat([0.0, 1.0, 0.0], [6 * COUNT - 6, 6, 6])), symmetry="symmetric")
    arguments = (word.replace("stiffness", "loose") for word in IMPORT)
    refused(cli(*arguments, "--space", "-o", "loose.npz"), "loose.mtx resists")
