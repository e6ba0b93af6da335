"""Links from finite elements of another program: against that program's own modes, closed forms and a beam."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from foreign_rod import AREA, ENDS, FILES, HEIGHT, I_Z, NU, PAGE, RHO, E, L, arguments, printed_by
from scipy.io import mmread, mmwrite
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

import kaneflex
from kaneflex.fem.craig_bampton import reduced
from kaneflex.fem.foreign import read_foreign
from kaneflex.scene.modal_data import read_modal_data


@pytest.fixture(scope="module", autouse=True)
def printed(tmp_path_factory, peer):
    """What the page's command prints, in a folder with the files that its script writes."""
    peer("skfem")
    with printed_by(command(), tmp_path_factory.mktemp("finite-elements")) as output:
        yield output


def command(**changed):
    """The page's arguments, some of them changed."""
    return arguments(r"import rod-mass.mtx rod-stiff(?!.*--space).*", **changed)


def test_the_page_shows_what_is_printed(printed):
    (shown,) = re.findall(r"^    (137 mm from .* from the start, .*)$", PAGE, re.MULTILINE)
    assert shown in printed.splitlines()


def test_moments_of_the_bar():
    data = read_modal_data("rod.npz")
    mass, centre, inertia = data.rigid
    assert mass == pytest.approx(RHO * AREA * L, rel=1e-9)
    assert centre == pytest.approx((L / 2, 0.0), rel=1e-9)
    assert inertia == pytest.approx(mass * (L**2 + HEIGHT**2) / 12, rel=1e-9)
    assert float(data.arrays["inertia"]) == pytest.approx(mass * HEIGHT**2 / 12, rel=1e-9)


def test_modes_of_the_free_mesh():
    """Many shapes of either kind with the rigid motions come near the whole mesh: its modes by SciPy on all unknowns.

    What differs: twelve modes with the points held instead of all. Averaged coupling holds nothing rigid.
    """
    link = read_foreign(*FILES, ENDS)
    K, M = (mmread(name).tocsc() for name in (FILES[1], FILES[0]))
    squares, modes = eigsh(K, 16, M, sigma=-1e6, v0=np.ones(K.shape[0]))
    for motion, rigid, wanted in (
        ("transverse", (link.field(0.0, 1.0), link.field(-link.nodes[:, 1], link.nodes[:, 0])), 3),
        ("axial", (link.field(1.0, 0.0),), 1),
    ):
        own = link.basis(motion, rigid=False)
        alike = np.linalg.norm(own.T @ modes, axis=0) > 0.99 * np.linalg.norm(modes, axis=0)
        expected = np.sqrt(np.sort(squares[alike & (squares > 1e6)]))[:wanted]
        whole = np.column_stack([reduced(link, motion, 12, rigid=False).shapes, *rigid])
        small = [whole.T @ A @ whole for A in (link.K, link.M)]
        found = np.sqrt(eigh(*small, eigvals_only=True)[len(rigid) : len(rigid) + wanted])
        assert len(expected) == wanted
        assert (found > (1.0 - 1e-9) * expected).all()  # a mean of the mesh is stiffer than the mesh (Ritz 1909)
        np.testing.assert_allclose(found, expected, rtol=2e-3)


@pytest.mark.parametrize("rigid", [True, False])
def test_bending_of_a_pinned_bar(rigid):
    """Timoshenko's frequencies on pins (1922), which leave out how the section warps: 1 %, with stiff ends 2.5 %."""
    found = reduced(read_foreign(*FILES, ENDS), "transverse", 3, rigid)
    omega = np.sqrt(found.stiffness / found.mass)
    k, G = np.arange(1, 4) * np.pi / L, E / (2 * (1 + NU))
    kappa = 10 * (1 + NU) / (12 + 11 * NU)  # Cowper 1966
    c2, s2, r2 = E / RHO, kappa * G / RHO, I_Z / AREA
    b = k**2 * (c2 + s2) + s2 / r2
    expected = np.sqrt((b - np.sqrt(b**2 - 4 * c2 * s2 * k**4)) / 2)
    np.testing.assert_allclose(omega, expected, rtol=2.5e-2 if rigid else 1e-2)


ENGINE = """
schema = 1
[bodies]
crank = {{length = "40 mm", mass = "0.952 kg"}}
rod = {rod}
piston = {{mass = "0.214 kg"}}
[joints]
main = {{revolute = ["ground", "crank.start"]}}
pin = {{revolute = ["crank.end", "rod.start"]}}
wrist = {{revolute = ["rod.end", "piston"]}}
bore = {{prismatic = ["ground", "piston"], direction = [1, 0], branch = "+"}}
[drives]
main = {{speed = "6000 rpm", cycle = "360 deg"}}
{damping}
[sensors]
bow = {{displacement = "rod.mid", relative_to = "chord", component = "y"}}
stretch = {{displacement = "rod.end", relative_to = "start", component = "x"}}
side_force = {{joint_force = "bore", component = "y"}}
torque = {{drive_torque = "main"}}
[solve]
preset = "coupled"
start = "periodic"
modes = {modes}
"""
BEAM = (
    '{length = "137 mm", beam = {material = "steel", section = {rectangle = ["20 mm", "12 mm"]}, '
    'theory = "timoshenko"}}'
)


def test_the_engine_with_it_and_with_a_beam():
    """The rod of finite elements beside one of Timoshenko elements: bow and stretch to 2 % of the peaks, forces 0.1 %.

    What differs: plane sections and a shear factor there; ends that are stiffened here, where the nodes of each move as
    one, and 2 % damping of each shape instead of each mode.
    """
    solutions = []
    for rod, damping, modes in ((BEAM, "[damping]\nmodal = {ratio = 0.02}", "3"), ('{modal_data = "rod.npz"}', "", "")):
        text = ENGINE.format(rod=rod, damping=damping, modes=modes)
        text = text if modes else text.replace("modes = \n", "")
        solutions.append(kaneflex.simulate(kaneflex.load(kaneflex.scene_of(text))))
    beam, imported = (solution.series for solution in solutions)
    for name, bound in (("bow", 2e-2), ("stretch", 2e-2), ("side_force", 1e-3), ("torque", 1e-3)):
        away = abs(imported[name].values - beam[name].values).max() / abs(beam[name].values).max()
        assert away < bound, (name, away)


@pytest.mark.parametrize(
    "changed, message",
    [
        ({"start=big-eye.txt": "start=all.txt"}, "start and end are in one place"),
        ({"start=big-eye.txt": "start=none.txt"}, "none.txt cannot be read: No such file"),
        ({"start=big-eye.txt": "start=strange.txt"}, "strange.txt: there is no node 4711"),
        ({"start=big-eye.txt": "begin=big-eye.txt"}, "no point start"),
        ({"start=big-eye.txt": "start=corner.txt"}, "start and end lean out of the plane of motion by"),
        ({"rod-mass.mtx": "short.mtx"}, "short.mtx has the shape (6, 6), with 1225 nodes"),
        ({"rod-mass.mtx": "rod-nodes.txt"}, "rod-nodes.txt has 4 columns"),
        ({"rod-mass.mtx": "torn.mtx"}, "torn.mtx is no Matrix Market file"),
        ({"rod-stiffness.mtx": "lopsided.mtx"}, "lopsided.mtx is not symmetric"),
        ({"rod-stiffness.mtx": "rod-mass.mtx"}, "rod-mass.mtx resists a motion of the whole link along its axis by"),
        ({"end=small-eye.txt": "end=upper.txt"}, "not its own mirror image in its axis"),
        ({"rod.npz": "rod.txt"}, "not the name of a file of arrays"),
    ],
)
def test_what_is_refused(changed, message):
    """By name and with a cure, and nothing is written."""
    numbers = np.loadtxt("rod-nodes.txt")
    np.savetxt("all.txt", np.loadtxt("small-eye.txt"))
    np.savetxt("strange.txt", [4711.0])
    np.savetxt("corner.txt", numbers[[0], 0])
    mmwrite("short.mtx", np.eye(6))
    Path("torn.mtx").write_text("%%MatrixMarket matrix coordinate real symmetric\n3 3 9\n1 1 1.0\n")
    K = mmread("rod-stiffness.mtx").tolil()
    K[0, 7] += 1e9
    mmwrite("lopsided.mtx", K.tocsr(), symmetry="general")
    np.savetxt("upper.txt", numbers[(numbers[:, 1] == L) & (numbers[:, 2] > 0.0), 0])
    arguments = command(**({"rod.npz": "other.npz"} | changed))
    refused(cli(*arguments), message)
    assert not Path("other.npz").exists() and not Path("rod.txt").exists()


def test_units_of_other_programs():
    """Millimetres, tonnes and newtons are the same link."""
    for name, factor in (("rod-mass.mtx", 1e-3), ("rod-stiffness.mtx", 1e-3)):
        mmwrite(f"mm-{name}", factor * mmread(name))
    table = np.loadtxt("rod-nodes.txt")
    table[:, 1:] *= 1e3
    np.savetxt("mm-rod-nodes.txt", table, fmt="%.12g")
    names = {name: f"mm-{name}" for name in FILES} | {"rod.npz": "mm.npz"}
    assert cli(*command(**names), "--units", "mm-t").exit_code == 0
    metric, other = (read_modal_data(name) for name in ("rod.npz", "mm.npz"))
    for name, array in metric.arrays.items():
        np.testing.assert_allclose(abs(other.arrays[name]), abs(array), rtol=1e-6, atol=1e-7 * abs(array).max())
