"""Reading of finite-element matrices from other programs' files, in the order of a link's nodes.

The first lines or the ending of a file give its format:

- Matrix Market, the translations of the nodes one after the other in the order of the nodes;
- Abaqus ``*MATRIX OUTPUT``: with ``FORMAT=MATRIX INPUT`` lines of node, direction, node, direction, value; with
  ``FORMAT=COORDINATE`` lines of row, column, value, the motions of one node after the other by their numbers;
- CalculiX ``*FREQUENCY, SOLVER=MATRIXSTORAGE``: lines of row, column, value in job.sti and job.mas, and in job.dof the
  node and the direction of each row;
- MBDyn's ``.fem``: the diagonal of its lumped mass;
- Nastran's OUTPUT4 (``.op4``), six motions of each grid point in the order of their numbers, and DMIG cards of a punch
  file (``.pch``), both by pyYeti.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection
from pathlib import Path

import numpy as np
from scipy.io import mminfo
from scipy.sparse import coo_array, csc_array, diags_array

from kaneflex.support import machine
from kaneflex.support.errors import Fault, counted, installed
from kaneflex.support.files import check_file

LARGEST = 2**31
"""Largest size of a file of matrices [bytes]."""
SAME = 1e-6
"""Tolerance for the symmetry of a matrix, as a share of the largest entry."""
_DIRECTIONS = 6
"""Motions of a node that programs number: translations, then rotations."""
_EACH = (2, 3, _DIRECTIONS)
"""Possible numbers of motions per node in a matrix."""
_COPIES = 3
"""Number of arrays in memory while a full matrix is read: the reader's, the result, and the comparison of both
triangles."""

Labels = tuple[np.ndarray, np.ndarray]
"""Number of the node and direction, from 1, of each row."""

_FREE = "Give two or three translations, or six degrees of freedom, of every node, including constrained ones"


def read_matrix(path: str, numbers: np.ndarray, first: str, turning: bool = False) -> csc_array:
    """A square, symmetric matrix of two or three translations of each node, or of three and its rotations.

    Parameters
    ----------
    path : str
        The file.
    numbers : ndarray of int (n_nodes,)
        Of the nodes, in their order.
    first : {"m", "k"}
        First letter of the matrix's name in a file of several, as in MGG and KGG.
    turning : bool
        True if nodes may have rotations.

    Returns
    -------
    csc_array (n_nodes d, n_nodes d)
        Matrix in the units of the file, d motions per node; rotations without stiffness are zero.

    Raises
    ------
    Fault
        It names the file and what is wrong with it.
    """
    try:
        check_file(Path(path), LARGEST)
        found, labels = _reader(path)(path, numbers, first)
    except OSError as error:
        raise Fault(f"{path} cannot be read: {error.strerror or error}", "Give a file of a matrix") from None
    if found.dtype.kind not in "fiu" or not np.isfinite(found.data).all():
        raise Fault(f"{path} contains numbers that are not finite", "Export it again")
    found = _in_order(path, csc_array(found), labels, numbers, turning)
    if abs(found - found.T).max() > SAME * abs(found).max():
        raise Fault(f"{path} is not symmetric", "Export the whole matrix, or one marked as symmetric")
    return found.astype(float)


def read_lines(path: str) -> list[str]:
    """Lines of a text file. Raises Fault."""
    try:
        check_file(Path(path), LARGEST)
        return Path(path).read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except Fault as fault:
        raise Fault(f"{path} {fault.reason}", fault.cure) from None
    except OSError as error:
        raise Fault(f"{path} cannot be read: {error.strerror}", "Give a text file of numbers") from None


def read_table(path: str) -> np.ndarray:
    """Numbers of a text file, one row per line, separated by commas or spaces. Raises Fault."""
    lines = read_lines(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a file without numbers, which is an error below
            found = np.loadtxt((line.replace(",", " ") for line in lines), ndmin=2)
    except ValueError as error:
        reason = str(error).partition(";")[0].rstrip(".")  # what else numpy says is for who calls it
        raise Fault(f"{path} is not a table of numbers: {reason}", "Give lines of numbers, # before words") from None
    if not found.size or not np.isfinite(found).all():
        raise Fault(f"{path} contains no finite numbers", "Give lines of numbers")
    return found


def _reader(path: str) -> Callable[[str, np.ndarray, str], tuple[csc_array, Labels]]:
    by_ending = {".op4": _output4, ".pch": _punched, ".sti": _calculix, ".mas": _calculix}
    if (ending := Path(path).suffix.lower()) in by_ending:
        return by_ending[ending]
    with Path(path).open("rb") as file:
        return _matrix_market if file.read(2) == b"%%" else _abaqus


def read_market(path: str, shapes: Collection[tuple[int, int]] = (), wanted: str = "") -> csc_array:
    """The matrix of a Matrix Market file, by its first line of one of these shapes. Raises Fault, or OSError."""
    check_file(Path(path), LARGEST)
    try:
        rows, columns, entries, layout, field, symmetry = mminfo(path)
        if shapes and (rows, columns) not in shapes:
            raise Fault(f"{path} has the shape {(rows, columns)}, {wanted}", _FREE)
        if field == "complex":
            raise Fault(f"{path} contains complex numbers", "Export real numbers")
        if layout == "array":
            _check_full(path, rows * columns)
        with Path(path).open(encoding="utf-8", errors="replace") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a file without entries
            numbers = (line for line in file if line.strip() and line[0] != "%")
            next(numbers)  # the size
            body = np.loadtxt(numbers, ndmin=2)
        return _of_market(body, (rows, columns), None if layout == "array" else entries, field == "pattern", symmetry)
    except (ValueError, TypeError, OverflowError) as error:
        if isinstance(error, Fault):
            raise
        raise Fault(f"{path} is not a Matrix Market file: {error}", "Export it again") from None


def _of_market(
    body: np.ndarray, shape: tuple[int, int], entries: int | None, pattern: bool, symmetry: str
) -> csc_array:
    """The matrix of the numbers below the head of a Matrix Market file; ``entries`` is None for a full one.

    SciPy's own reader reads beyond the end of a file whose lines are torn, and ends the process.
    """
    lower = symmetry != "general"
    if entries is None:
        each = np.ones(shape[::-1])  # column after column
        columns, rows = np.nonzero(np.triu(each, symmetry == "skew-symmetric") if lower else each)
        values, entries = body.ravel(), len(rows)
    else:
        body = body if body.size else np.zeros((0, 2 if pattern else 3))
        if body.shape[1] != (2 if pattern else 3):
            raise ValueError(f"lines of {body.shape[1]} numbers")
        at = body[:, :2]
        if (at != at.round()).any() or at.min(initial=1) < 1 or (at > shape).any():
            raise ValueError("a row or column is outside the matrix")
        rows, columns = at.T.astype(np.int64) - 1
        values = np.ones(len(at)) if pattern else body[:, 2]
    if len(values) != entries:
        raise ValueError(f"{len(values)} entries, not {entries}")
    found = csc_array(coo_array((values, (rows, columns)), shape))
    if not lower:
        return found
    mirrored = found.T - diags_array(found.diagonal())
    return csc_array(found - mirrored if symmetry == "skew-symmetric" else found + mirrored)


def _check_full(path: str, count: int) -> None:
    """Raise Fault if reading a full matrix of so many entries takes more than the machine's memory."""
    needed, there = _COPIES * 8 * count, machine.installed()
    if there is not None and needed > there:
        reason = f"{path} is read as a full matrix of {machine.gib(needed)}; this machine has {machine.gib(there)}"
        raise Fault(reason, "Export it as a sparse one: Matrix Market 'coordinate', OUTPUT4 or lines of entries")


def _matrix_market(path: str, numbers: np.ndarray, first: str) -> tuple[csc_array, Labels]:
    count = len(numbers)
    found = read_market(path, [(each * count,) * 2 for each in _EACH], f"with {count} nodes")
    return found, _one_after_the_other(numbers, found.shape[0] // count)


def _abaqus(path: str, numbers: np.ndarray, first: str) -> tuple[csc_array, Labels]:
    table = read_table(path)
    if table.shape[1] not in (3, 5):
        raise Fault(
            f"{path} has {counted(table.shape[1], 'column')}",
            "Give a Matrix Market file, or one of Abaqus: lines of node, direction, node, direction, value, or of "
            "row, column, value",
        )
    with np.errstate(invalid="ignore"):  # too large a number is not equal to its integer
        ends = table[:, :-1].astype(np.int64)
    if (ends != table[:, :-1]).any():
        raise Fault(f"{path} contains a row that is not a whole number", "Give a file of *MATRIX OUTPUT of Abaqus")
    if table.shape[1] == 3:
        count, largest = len(numbers), int(ends.max())
        if ends.min() < 1 or largest not in [each * count for each in _EACH]:
            raise Fault(f"{path} has rows from {ends.min()} to {largest}, with {count} nodes", _FREE)
        return _halved(*(ends - 1).T, table[:, 2], largest), _one_after_the_other(np.sort(numbers), largest // count)
    each, place = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
    at = place.reshape(-1, 2)
    return _halved(at[:, 0], at[:, 1], table[:, 4], len(each)), (each[:, 0], each[:, 1])


def _calculix(path: str, numbers: np.ndarray, first: str) -> tuple[csc_array, Labels]:
    table, names = read_table(path), Path(path).with_suffix(".dof")
    try:
        words = [line.split(".") for line in names.read_text(encoding="utf-8").split()]
        rows = np.array(words, dtype=np.int64)
    except FileNotFoundError:
        raise Fault(f"{names} does not exist", f"Put it next to {path}: CalculiX writes both") from None
    except ValueError:
        raise Fault(f"{names} is not a list of node.direction", "Give the one that CalculiX wrote") from None
    if table.shape[1] != 3 or table[:, :2].min() < 1 or table[:, :2].max() > len(rows):
        raise Fault(f"{path} and {names} do not fit together", "Give the files of one run of CalculiX")
    at = table[:, :2].astype(np.int64) - 1
    return _halved(at[:, 0], at[:, 1], table[:, 2], len(rows)), (rows[:, 0], rows[:, 1])


def _output4(path: str, numbers: np.ndarray, first: str) -> tuple[csc_array, Labels]:
    found = csc_array(_nastran(path, first, lambda nastran: nastran.op4.read(path, sparse=True)))
    if found.shape != (_DIRECTIONS * len(numbers),) * 2:
        raise Fault(
            f"{path} has the shape {found.shape}, with {len(numbers)} nodes",
            "Give the matrix of all grid points (KGG, MGG), six degrees of freedom each",
        )
    return found, _one_after_the_other(np.sort(numbers), _DIRECTIONS)


def _punched(path: str, numbers: np.ndarray, first: str) -> tuple[csc_array, Labels]:
    with Path(path).open(encoding="utf-8", errors="replace") as file:
        columns = sum(line.upper().startswith("DMIG") for line in file)  # a card of each, after one for the matrix
    if not columns:
        raise Fault(f"{path} has no DMIG card", "Have the matrices written by PARAM,EXTOUT,DMIGPCH")
    _check_full(path, columns**2)
    frame = _nastran(path, first, lambda nastran: nastran.rddmig(path, square=True, follow_includes=False))
    if frame.shape[0] != frame.shape[1]:
        raise Fault(f"{path} contains a matrix of the shape {frame.shape}", "Give a square matrix of all grid points")
    labels = (frame.index.get_level_values(level).to_numpy(np.int64) for level in ("id", "dof"))
    return csc_array(frame.to_numpy()), tuple(labels)


def _nastran(path: str, first: str, read: Callable):
    """Only matrix that pyYeti reads from a file, or only one whose name begins with the given letter."""
    instead = "give a Matrix Market file"
    with installed("pyYeti, which reads Nastran's files,", "nastran", "pyyeti", instead=instead):
        from pyyeti import nastran
    try:
        found = read(nastran)
    except Exception as error:  # any error of its readers
        raise Fault(f"{path} can't be read by pyYeti: {error}", "Export it again") from None
    wanted = [name for name in found if len(found) == 1 or name.lower().startswith(first)]
    if len(wanted) != 1:
        there = ", ".join(name.upper() for name in found) or "no matrix"
        raise Fault(f"{path} contains {there}", f"Give a file with one matrix whose name begins with {first.upper()}")
    return found[wanted[0]]


def _one_after_the_other(numbers: np.ndarray, each: int) -> Labels:
    return np.repeat(numbers, each), np.tile(np.arange(1, each + 1), len(numbers))


def _halved(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, count: int) -> csc_array:
    """Matrix from its entries; a single triangle is mirrored at the diagonal."""
    found = csc_array(coo_array((values, (rows, columns)), shape=(count, count)))
    off = rows != columns
    there = csc_array(coo_array((np.ones(off.sum()), (rows[off], columns[off])), shape=(count, count)))
    if there.multiply(there.T).nnz:
        return found
    return csc_array(found + found.T - diags_array(found.diagonal()))


def _in_order(path: str, found: csc_array, labels: Labels, numbers: np.ndarray, turning: bool) -> csc_array:
    """Matrix with the nodes in the order of ``numbers``, without rotations if these are zero. Raises Fault."""
    nodes, directions = labels
    moving = np.asarray(abs(found).sum(axis=0)).ravel() > 0.0
    in_space = "Use --space, or mesh the link by solid elements, whose nodes have no rotations"
    beyond = (directions < 1) | (moving & (directions > _DIRECTIONS))
    for wrong, what, cure in (
        (beyond, "a direction outside 1 to 6 of", "Export displacements and rotations of the nodes only"),
        (moving & (directions > 3) & (not turning), "the rotation of", in_space),
        (moving & ~np.isin(nodes, numbers), "", "List it with its coordinates in the file of nodes"),
    ):
        if wrong.any():
            raise Fault(f"{path} contains {what} node {nodes[wrong][0]}".replace("  ", " "), cure)
    axes = int(directions[moving].max(initial=2))
    axes = axes if axes <= 3 else _DIRECTIONS
    order = np.argsort(numbers)
    kept = np.flatnonzero((directions <= axes) & np.isin(nodes, numbers))
    place = order[np.searchsorted(numbers[order], nodes[kept])] * axes + directions[kept] - 1
    rows = np.full(axes * len(numbers), -1)
    rows[place] = kept
    lacking = (rows < 0) & (np.arange(len(rows)) % axes < 3)
    if lacking.any():
        absent = int(np.flatnonzero(lacking)[0])
        raise Fault(
            f"{path} has no direction {absent % axes + 1} of node {numbers[absent // axes]}",
            "Export the link free, without supports, with all of its nodes",
        )
    present, kept = np.flatnonzero(rows >= 0), rows[rows >= 0]
    of = coo_array(found[:, kept][kept])
    return csc_array(coo_array((of.data, (present[of.row], present[of.col])), (len(rows),) * 2))
