"""Matrices of finite elements as other programs write them: each format holds the same ones.

Nastran's files are written by pyYeti, and read by it. Those of Abaqus and CalculiX are written here as the manual of
Abaqus (*MATRIX INPUT) and CalculiX's source (matrixstorage.c) lay them down: every term once, on or above the diagonal.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.io import mmwrite
from scipy.sparse import coo_array, csc_array, triu

from kaneflex.fem.imported.matrices import read_matrix
from kaneflex.support.errors import Fault

pytestmark = pytest.mark.usefixtures("empty_folder")
NUMBERS = np.array([40, 7, 112, 3, 25])
AXES = 3


@pytest.fixture(scope="module")
def stiffness():
    """A sparse, symmetric matrix of three translations of the nodes."""
    random = np.random.default_rng(3)
    half = random.standard_normal((len(NUMBERS) * AXES,) * 2) * (random.random((len(NUMBERS) * AXES,) * 2) < 0.4)
    return csc_array(half + half.T + 20.0 * np.eye(len(half)))


def labels(numbers=NUMBERS, axes=AXES):
    return np.repeat(numbers, axes), np.tile(np.arange(1, axes + 1), len(numbers))


def market(K):
    mmwrite("k.mtx", K)
    return "k.mtx"


def abaqus(K, both=False):
    node, axis = labels()
    part = coo_array(K if both else triu(K))
    lines = zip(node[part.row], axis[part.row], node[part.col], axis[part.col], part.data, strict=True)
    Path("job_STIF1.mtx").write_text("".join(f"{n},{i}, {m},{j}, {value:.17e}\n" for n, i, m, j, value in lines))
    return "job_STIF1.mtx"


def coordinate(K, both=True):
    """FORMAT=COORDINATE: rows count the motions of one node after the other, these in the order of their numbers."""
    order = (AXES * np.argsort(NUMBERS)[:, None] + np.arange(AXES)).ravel()
    part = coo_array(csc_array(K)[order][:, order])
    part = part if both else coo_array(triu(part))
    lines = zip(part.row + 1, part.col + 1, part.data, strict=True)
    Path("job_STIF2.mtx").write_text("".join(f"{row:8d} {column:8d} {value: .15E}\n" for row, column, value in lines))
    return "job_STIF2.mtx"


def calculix(K):
    order = np.random.default_rng(0).permutation(K.shape[0])  # of its equations, which is its own business
    node, axis = (part[order] for part in labels())
    part = coo_array(triu(csc_array(K[order][:, order])))
    lines = zip(part.row + 1, part.col + 1, part.data, strict=True)
    Path("job.sti").write_text("".join(f"{row} {column} {value:20.17e}\n" for row, column, value in lines))
    Path("job.dof").write_text("".join(f"{n}.{i}\n" for n, i in zip(node, axis, strict=True)))
    return "job.sti"


def all_six(K):
    """With rotations that nothing resists, and the grid points in the order of their numbers."""
    order = np.argsort(NUMBERS)
    place = (6 * np.argsort(order)[:, None] + np.arange(AXES)).ravel()
    whole = np.zeros((6 * len(NUMBERS),) * 2)
    whole[np.ix_(place, place)] = K.toarray()
    return whole


def output4(K, digits=17, sparse="bigmat"):
    from pyyeti.nastran import op4

    whole = all_six(K)
    op4.write("job.op4", {"mgg": np.eye(len(whole)), "kgg": whole}, binary=False, digits=digits, sparse=sparse)
    return "job.op4"


def punched(K):
    import pandas as pd
    from pyyeti import nastran

    index = pd.MultiIndex.from_arrays(labels(), names=["id", "dof"])
    nastran.wtdmig("job.pch", {"kaax": pd.DataFrame(K.toarray(), index=index, columns=index)})
    return "job.pch"


@pytest.mark.parametrize(
    "write, exact",
    [(market, 1e-15), (abaqus, 1e-15), (lambda K: abaqus(K, both=True), 1e-15), (calculix, 1e-15),
     (coordinate, 1e-15), (lambda K: coordinate(K, both=False), 1e-15),
     (output4, 1e-15), (lambda K: output4(K, sparse="dense"), 1e-15), (punched, 1e-8)],
    ids=["Matrix Market", "Abaqus", "Abaqus, both triangles", "CalculiX", "Abaqus, COORDINATE",
         "Abaqus, COORDINATE, one triangle", "OUTPUT4", "OUTPUT4, dense", "punch"],
)  # fmt: skip
def test_the_same_matrix_in_each_format(write, exact, stiffness, peer):
    peer("pyyeti")
    found = read_matrix(write(stiffness), NUMBERS, "k")
    np.testing.assert_allclose(found.toarray(), stiffness.toarray(), rtol=exact, atol=20.0 * exact)


def held(K):
    abaqus(K)
    lines = [line for line in Path("job_STIF1.mtx").read_text().splitlines() if "112,2" not in line]
    Path("job_STIF1.mtx").write_text("\n".join(lines))
    return "job_STIF1.mtx"


def turning(K):
    abaqus(K)
    with Path("job_STIF1.mtx").open("a") as file:
        file.write("25,5, 25,5, 3.0e2\n")
    return "job_STIF1.mtx"


def orphan(K):
    calculix(K)
    Path("job.dof").unlink()
    return "job.sti"


def others(K):
    calculix(K)
    Path("job.dof").write_text("3.1\n3.2\n3.3\n")
    return "job.sti"


def two(K):
    from pyyeti.nastran import op4

    op4.write("job.op4", {"kgg": all_six(K), "kff": np.eye(3)}, binary=False)
    return "job.op4"


def junk(K):
    Path("job.op4").write_text("neither bulk data nor a matrix\n")
    return "job.op4"


def constrained(K):
    """A COORDINATE file without the last row, which a support takes out."""
    coordinate(K)
    lines = [line for line in Path("job_STIF2.mtx").read_text().splitlines() if "15" not in line.split()[:2]]
    Path("job_STIF2.mtx").write_text("\n".join(lines))
    return "job_STIF2.mtx"


def halves(K):
    Path("job_STIF2.mtx").write_text("1 1 2.0\n1.5 2 3.0\n15 15 1.0\n")
    return "job_STIF2.mtx"


def grid_points(K):
    Path("job.pch").write_text("$TITLE   = A MESH\nGRID           1               0.0     0.0     0.0\n")
    return "job.pch"


@pytest.mark.parametrize("write, message", [
    (constrained, "job_STIF2.mtx has rows from 1 to 14, with 5 nodes"),
    (halves, "job_STIF2.mtx contains a row that is not a whole number"),
    (grid_points, "job.pch has no DMIG card. Have the matrices written by"),
    (held, "job_STIF1.mtx has no direction 2 of node 112"),
    (turning, "job_STIF1.mtx contains the rotation of node 25"),
    (orphan, "job.dof does not exist"),
    (others, "job.sti and job.dof do not fit together"),
    (two, "job.op4 contains KGG, KFF"),
    (junk, "job.op4"),
])  # fmt: skip
def test_what_is_refused(write, message, stiffness, peer):
    peer("pyyeti")
    with pytest.raises(Fault, match=re.escape(message)):
        read_matrix(write(stiffness), NUMBERS, "k")


@pytest.mark.parametrize("header, nodes, message", [
    ("array real general\n100000 100000", 50_000, "is read as a full matrix of 224 GiB; this machine has 16 GiB"),
    ("coordinate real symmetric\n100000 100000 1", 5, "has the shape (100000, 100000), with 5 nodes"),
    ("coordinate real symmetric\n1000000000000 1000000000000 1", 5, "(1000000000000, 1000000000000), with 5"),
])  # fmt: skip
def test_large_matrices_are_refused_by_their_first_line(monkeypatch, header, nodes, message):
    """Nothing of their size is stored."""
    monkeypatch.setattr("kaneflex.support.machine.installed", lambda: 16 * 2**30)
    monkeypatch.setattr("kaneflex.fem.imported.matrices._of_market", None)
    Path("k.mtx").write_text(f"%%MatrixMarket matrix {header}\n1 1 1.0\n")
    with pytest.raises(Fault, match=re.escape(message)):
        read_matrix("k.mtx", np.arange(1, nodes + 1), "k")


def test_large_punched_matrices_are_refused(monkeypatch):
    """pyYeti makes them full: 100,000 columns."""
    monkeypatch.setattr("kaneflex.support.machine.installed", lambda: 16 * 2**30)
    cards = (f"DMIG*   KAAX    {node:16d}{axis:16d}\n" for node in range(1, 33335) for axis in (1, 2, 3))
    Path("job.pch").write_text("".join(cards))
    with pytest.raises(Fault, match=r"job\.pch is read as a full matrix of 224 GiB; this machine has 16 GiB"):
        read_matrix("job.pch", NUMBERS, "k")


def test_a_node_that_is_not_listed(stiffness):
    with pytest.raises(Fault, match=r"job_STIF1\.mtx contains node 25"):
        read_matrix(abaqus(stiffness), NUMBERS[:-1], "k")


def test_nastran_without_its_reader(stiffness, monkeypatch):
    """The cure names the extra that brings it; what the reader itself lacks is another matter."""
    import builtins

    ordinary, lacking = builtins.__import__, "pyyeti"

    def without(name, *args, **kwargs):
        if name.partition(".")[0] == "pyyeti":
            raise ImportError(f"no {lacking}", name=lacking)
        return ordinary(name, *args, **kwargs)

    Path("job.op4").write_text("")
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(Fault, match="pyYeti") as caught:
        read_matrix("job.op4", NUMBERS, "k")
    assert "kaneflex[nastran]" in caught.value.cure
    lacking = "pandas"
    with pytest.raises(ImportError, match="no pandas"):
        read_matrix("job.op4", NUMBERS, "k")
