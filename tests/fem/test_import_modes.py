"""Links from modes: files of MBDyn and universal files, beside the same link from its matrices."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import cli, refused
from foreign_rod import of_mbdyn, welded
from places import DOCS
from scipy.io import mmread
from scipy.sparse.linalg import eigsh

from kaneflex.fem.craig_bampton import reduced
from kaneflex.fem.foreign_files import read_foreign
from kaneflex.scene.modal_data import read_modal_data

PAGE = (DOCS / "finite-elements.md").read_text(encoding="utf-8")
ENDS = {"start": "big-eye.txt", "end": "small-eye.txt"}
POINTS = [word for name, file in ENDS.items() for word in ("--point", f"{name}={file}")]
HOW = ["--modes", "3", "--damping", "0.02", "--coupling", "averaged"]


@pytest.fixture(scope="module", autouse=True)
def bar(tmp_path_factory, peer):
    """The page's bar, in a folder with its matrices, files of its modes and what is imported of its matrices."""
    peer("skfem")
    pyuff = peer("pyuff")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("modes"))
        exec(re.search(r"^```python\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)[1], {})
        M, K, table = mmread("rod-mass.mtx").tocsc(), mmread("rod-stiffness.mtx").tocsc(), np.loadtxt("rod-nodes.txt")
        numbers, nodes = table[:, 0].astype(int), table[:, 1:]

        link = read_foreign("rod-mass.mtx", "rod-stiffness.mtx", "rod-nodes.txt", ENDS)
        kinds = (reduced(link, "axial", 2, False), reduced(link, "transverse", 3, False))
        shapes = np.hstack([own.shapes for own in kinds])  # in the files' own axes: X along the bar, from its start
        lumped = M.diagonal().reshape(-1, 3)[:, 0]
        lumped = lumped * (M.sum() / 3) / lumped.sum()  # Hinton, Rock & Zienkiewicz 1976
        of_mbdyn("rod.fem", numbers, nodes, shapes, shapes.T @ K @ shapes, lumped)
        of_mbdyn("massless.fem", numbers, nodes, shapes, shapes.T @ K @ shapes)

        squares, modes = eigsh(K, 46, M, sigma=-1e6, v0=np.ones(K.shape[0]))
        file = pyuff.UFF("rod.unv")
        one = np.ones(len(numbers), int)
        file.write_sets({"type": 2411, "node_nums": numbers, "def_cs": one, "disp_cs": one, "color": one,
                         **dict(zip("xyz", nodes.T, strict=True))}, "overwrite")  # fmt: skip
        for k, (square, mode) in enumerate(zip(squares, modes.T, strict=True)):
            u, v, w = mode.reshape(-1, 3).T
            file.write_sets(pyuff.prepare_55(
                id1="a", id2="a", id3="a", id4="a", id5="a", model_type=1, analysis_type=2, data_ch=2,
                spec_data_type=8, data_type=2, n_data_per_node=3, r1=u, r2=v, r3=w, node_nums=numbers, load_case=1,
                mode_n=k + 1, modal_m=1.0, freq=np.sqrt(max(square, 0.0)) / (2 * np.pi), modal_damp_vis=0.0,
                modal_damp_his=0.0,
            ), "add")  # fmt: skip
        result = cli("import", "rod-mass.mtx", "rod-stiffness.mtx", "rod-nodes.txt", *POINTS, *HOW, "-o", "rod.npz")
        assert result.exit_code == 0, result.output
        yield


def imported(*files, name):
    result = cli("import", *files, *POINTS, *HOW, "-o", name)
    assert result.exit_code == 0, result.output
    return read_modal_data(name)


def omega(data, name):
    """Circular frequencies of the shapes, which are orthogonal, of one kind [rad/s]."""
    count = data.counts[0]
    mass = [np.diag(data.arrays["mass_s_s"]), np.diag(data.arrays["mass_w_w"] + data.arrays["inertia_psi_psi"])]
    own = slice(None, count) if name == "s" else slice(count, None)
    return np.sqrt(data.arrays["stiffness"][own] / mass[name == "w"])


def test_shapes_of_a_modal_file_are_taken_over():
    """The mass matrix with the shapes that are imported of both matrices, and their stiffness: the same link."""
    found, expected = imported("rod-mass.mtx", "rod.fem", "rod.fem", name="shapes.npz"), read_modal_data("rod.npz")
    for name, array in expected.arrays.items():
        np.testing.assert_allclose(abs(found.arrays[name]), abs(array), rtol=1e-6, atol=1e-7 * abs(array).max())


def test_a_modal_file_alone():
    """All of it from one file, with its lumped mass, which costs what lumping does to 24 elements of second order."""
    found, expected = imported("rod.fem", "rod.fem", "rod.fem", name="lumped.npz"), read_modal_data("rod.npz")
    assert found.rigid[0] == pytest.approx(expected.rigid[0], rel=1e-6)
    assert found.rigid[1] == pytest.approx(expected.rigid[1], rel=1e-6)
    assert found.rigid[2] == pytest.approx(expected.rigid[2], rel=2e-3)
    for kind in "sw":
        np.testing.assert_allclose(omega(found, kind)[:2], omega(expected, kind)[:2], rtol=1e-2)


def test_free_modes_of_a_universal_file():
    """46 free modes of the mesh, 12 of them across or along: static shapes are what they make of them.

    They are stiffer than all of the mesh (Ritz 1909), the lowest one across by less than 1 %.
    """
    found, expected = imported("rod-mass.mtx", "rod.unv", "rod.unv", name="free.npz"), read_modal_data("rod.npz")
    assert found.rigid[::2] == pytest.approx(expected.rigid[::2], rel=1e-6)
    ratio = omega(found, "w")[:2] / omega(expected, "w")[:2]
    assert (ratio > 1.0 - 1e-9).all() and ratio[0] < 1.01


def test_modes_in_space():
    """46 free modes of the mesh are its shapes in space, too: the lowest one in either plane beside those of its
    matrices; with three modes more than the static ones neither have converged above these."""
    found = []
    for files in (("rod-mass.mtx", "rod.unv", "rod.unv"), ("rod-mass.mtx", "rod-stiffness.mtx", "rod-nodes.txt")):
        result = cli("import", *files, *POINTS, *HOW, "--space", "-o", "space.npz", "--force")
        assert result.exit_code == 0, result.output
        found.append(read_modal_data("space.npz"))
    free, whole = (data.arrays["stiffness"] / np.einsum("aajj->j", data.arrays["mass_N_N"]) for data in found)
    np.testing.assert_allclose(np.sqrt(free[:2]), np.sqrt(whole[:2]), rtol=2e-2)
    for one, other in zip(found[0].rigid, found[1].rigid, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-9)


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("space", "known"), [([], "transverse"), (["--space"], "any")])
def test_missing_flexibility_of_free_modes_is_warned_of(space, known):
    """A weld at the start: by the modes 15 % too stiff beside the whole mesh, by the estimate too soft by no more.

    Of shapes from a modal file, with static ones among them, nothing is said: they lack none.
    """
    result = cli("import", "rod-mass.mtx", "rod.unv", "rod.unv", *POINTS, *HOW, *space, "-o", "weld.npz", "--force")
    assert result.exit_code == 0, result.output
    told = re.search(r"Warning: .* lack about (\d+)% .* is (\S+) Hz by them and about (\S+) Hz .*\n", result.stderr)
    share, by_modes, estimated = map(float, told.groups())
    link = read_foreign("rod-mass.mtx", "rod-stiffness.mtx", "rod-nodes.txt", ENDS, spatial=bool(space))
    rows = link.held("start", "any") if space else np.array(link.means("start"))[1:]
    basis = link.basis(known, rigid=False)
    (right,) = welded(basis.T @ link.K @ basis, basis.T @ link.M @ basis, rows @ basis)
    assert 20.0 < share < 50.0 and 1.1 * right < by_modes < 1.2 * right and 0.85 * right < estimated < right
    result = cli("import", "rod-mass.mtx", "rod.fem", "rod.fem", *POINTS, *HOW, "-o", "weld.npz", "--force")
    assert result.exit_code == 0 and "Warning" not in result.stderr


@pytest.mark.parametrize("files, more, message", [
    (("massless.fem", "rod.fem", "rod.fem"), [], "massless.fem contains modes and no mass of its nodes"),
    (("rod.unv", "rod.unv", "rod.unv"), [], "rod.unv contains modes and no mass of its nodes"),
    (("rod-mass.mtx", "rod.fem", "rod-nodes.txt"), ["--coupling", "rigid"], "modes do not give rigid motion"),
    (("rod-mass.mtx", "rod.fem", "rod-nodes.txt"), ["--modes", "9"], "Ask for fewer, or give more modes"),
    (("rod-mass.mtx", "torn.fem", "rod-nodes.txt"), [], "torn.fem has no record group 10, modal stiffness"),
    (("rod-mass.mtx", "short.fem", "rod-nodes.txt"), [], "short.fem: its record groups don't fit 1225 nodes"),
    (("rod-mass.mtx", "rod.fem", "more.txt"), [], "rod-mass.mtx has the shape"),
    (("rod.fem", "rod.fem", "swapped.txt"), [], "rod.fem contains node 1225"),
    (("rod-mass.mtx", "empty.unv", "rod-nodes.txt"), [], "empty.unv"),
])  # fmt: skip
def test_what_is_refused(files, more, message):
    text = Path("rod.fem").read_text()
    Path("torn.fem").write_text(text[: text.index("** RECORD GROUP 10")])
    Path("short.fem").write_text(text.replace("NODAL Y COORDINATES\n", "NODAL Y COORDINATES\n1.0\n"))
    Path("more.txt").write_text(Path("rod-nodes.txt").read_text() + "4711 0.1 0.2 0.3\n")
    Path("swapped.txt").write_text(Path("rod-nodes.txt").read_text().replace("1225 ", "4711 "))
    Path("empty.unv").write_text("\n")
    refused(cli("import", *files, *POINTS, *HOW, *more, "-o", "other.npz"), message)
    assert not Path("other.npz").exists()
