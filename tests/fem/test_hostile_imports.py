"""Finite elements that no program would write: importing them gives finite numbers or an error, in time."""

import numpy as np
import pytest
from import_fuzz import Mutants, examine, lattice
from scene_fuzz import broken
from scipy.io import mmwrite
from scipy.sparse import csc_array

from kaneflex.fem.imported.matrices import read_market
from kaneflex.scene.modal_data import ModalData
from kaneflex.support.errors import Fault


@pytest.fixture(scope="module")
def mutants(tmp_path_factory):
    return Mutants(tmp_path_factory.mktemp("imports"))


def test_every_format_is_imported_as_it_stands(mutants):
    """Or the mutants below would be refused for another reason than what is changed in them."""
    for form, files in mutants.formats.items():
        for spatial in (False, True):
            data = examine((form, tuple(str(mutants.folder / name) for name in files), spatial, False))
            assert isinstance(data, ModalData), (form, spatial, data)
            assert float(data.arrays["mass"]) == pytest.approx(0.002 * len(lattice()[0]), rel=1e-9)


def test_mutated_imports_are_read_or_refused(mutants):
    """500 with `make extremes`."""
    assert broken(mutants, [*range(60), 101, 122, 2003], limit=20.0, examine=examine) == []


@pytest.mark.parametrize("symmetry", ["general", "symmetric", "skew-symmetric"])
@pytest.mark.parametrize("kind", [float, int])
@pytest.mark.parametrize("full", [False, True])
def test_matrix_market_files_are_read_as_scipy_reads_them(full, kind, symmetry, tmp_path):
    A = np.random.default_rng(3).integers(-9, 10, (6, 6)).astype(kind)
    A = {"general": A, "symmetric": A + A.T, "skew-symmetric": A - A.T}[symmetry]
    A[0, 5] = A[5, 0] = 0
    file = tmp_path / "a.mtx"
    mmwrite(file, A if full else csc_array(A), comment="of a test\n", symmetry=symmetry)
    assert (read_market(str(file)).toarray() == A).all()


@pytest.mark.parametrize("body", [
    "3 3 2\n1 1 2E- 3\n2 2 1.0", "3 3 1\n0 1 1.0\n", "3 3 1\n1 4 1.0\n", "3 3 1\n1.5 1 1.0\n", "3 3 2\n1 1 1.0\n",
    "3 3 1\n1 1\n", "3 3 1\n1 1 1.0 2.0\n", "3 3 1\n1 1 1.0\n2 2 1.0\n", "3 3 1\n1 1 x", "3 3", "", "-3 3 1\n1 1 1.0\n",
])  # fmt: skip
def test_torn_matrix_market_files_are_refused(body, tmp_path):
    """SciPy reads beyond the end of the first one, and the process ends."""
    file = tmp_path / "a.mtx"
    file.write_text(f"%%MatrixMarket matrix coordinate real symmetric\n%\n{body}")
    with pytest.raises(Fault, match=r"a\.mtx is not a Matrix Market file: .*Export it again"):
        read_market(str(file))


@pytest.mark.parametrize("spatial", [False, True])
@pytest.mark.parametrize(("place", "value", "reason"), [
    ((60, 60), -0.01, "odd.mtx has a negative mass at node 21"),
    ((60, 60), -1e-5, "odd.mtx has a negative mass at node 21"), ((60, 63), 0.02, ""),
])  # fmt: skip
def test_a_mass_that_is_not_positive_definite_is_refused(mutants, place, value, reason, spatial):
    """Beside the diagonal it ended in a LinAlgError or an IndexError of the reduction."""
    M = lattice()[1].tolil()
    M[place] = M[place[::-1]] = value
    mmwrite(mutants.folder / "odd.mtx", csc_array(M))
    files = (str(mutants.folder / name) for name in ("odd.mtx", "stiffness.mtx", "nodes.txt"))
    found = examine(("market", tuple(files), spatial, False))
    assert isinstance(found, Fault) and found.reason.endswith(reason), found
