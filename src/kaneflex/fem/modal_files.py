"""Reading of a link's modes from other programs: MBDyn's modal files, and universal files of modal tests.

- MBDyn's `.fem` (its input manual, "FEM File Format"): record groups of nodes, shapes, modal stiffness and the diagonal
  of a lumped mass;
- universal files (`.unv`, `.uff`), read by pyuff: nodes of data sets 15 and 2411, normal modes of 55 and 2414.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csc_array

from kaneflex.support.errors import Fault, installed
from kaneflex.support.files import check_file

LARGEST = 2**31
"""Largest size of a file [bytes]."""
_NODES, _X, _SHAPES, _STIFFNESS, _LUMPED = 2, 5, 8, 10, 11
"""Record groups of a file of MBDyn; y and z follow x."""
_NORMAL_MODE = 2
"""Kind of an analysis in a universal file."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a link in the units of their file.

    Attributes
    ----------
    numbers : ndarray of int (n_nodes,)
    nodes : ndarray (n_nodes, 3)
    shapes : ndarray (n_nodes, 3, n_modes)
        Translations.
    stiffness : ndarray (n_modes, n_modes) or None
        Modal; None where the file has ``omega`` instead.
    omega : ndarray (n_modes,) or None
        Circular frequencies of normal modes [rad/s].
    lumped : ndarray (n_nodes, 6) or None
        Diagonal of a lumped mass.
    """

    numbers: np.ndarray
    nodes: np.ndarray
    shapes: np.ndarray
    stiffness: np.ndarray | None = None
    omega: np.ndarray | None = None
    lumped: np.ndarray | None = None

    def translations(self, axes: int) -> np.ndarray:
        """Shapes of the first ``axes`` translations of each node, (n_nodes axes, n_modes)."""
        return self.shapes[:, :axes].reshape(-1, self.shapes.shape[2])

    def stiffness_by(self, M: csc_array) -> np.ndarray:
        """Modal stiffness; for normal modes omega^2 times the modal masses of M (n_nodes axes)^2."""
        if self.stiffness is not None:
            return self.stiffness
        assert self.omega is not None  # or the file has a stiffness
        own = self.translations(M.shape[0] // len(self.numbers))
        return np.diag(self.omega**2 * np.einsum("ij,ij->j", own, M @ own))


def has_modes(path: str) -> bool:
    """True if a file's ending is that of a file of modes."""
    return Path(path).suffix.lower() in _READERS


def read_modes(path: str) -> Modes:
    """Read the modes of a file. Raises Fault with the file and the problem."""
    try:
        check_file(Path(path), LARGEST)
        found = _READERS[Path(path).suffix.lower()](path)
    except OSError as error:
        raise Fault(f"{path} cannot be read: {error.strerror or error}", "Give a file of modes") from None
    parts = (found.nodes, found.shapes, found.stiffness, found.omega, found.lumped)
    if not all(np.isfinite(part).all() for part in parts if part is not None):
        raise Fault(f"{path} contains numbers that are not finite", "Export it again")
    if len(np.unique(found.numbers)) < len(found.numbers):
        raise Fault(f"{path} has two nodes with the same number", "Export it again")
    return found


def _mbdyn(path: str) -> Modes:
    groups: dict[int, list[str]] = {}
    group = 0
    for line in Path(path).read_text(encoding="utf-8", errors="replace").splitlines():
        head = line.partition(",")[0].split()
        if head[:3] == ["**", "RECORD", "GROUP"] and head[3:4] and head[3].isdecimal():
            group = int(head[3])
            groups[group] = []
        elif group and line.strip() and not line.lstrip().startswith("**"):
            groups[group].append(line)

    def numbers(group: int, name: str) -> np.ndarray:
        try:
            return np.array(" ".join(groups[group]).replace("D", "E").split(), float)
        except KeyError:
            raise Fault(f"{path} has no record group {group}, {name}", "Write the file with it") from None
        except ValueError as error:
            raise Fault(f"{path}, record group {group}: {error}", "Export it again") from None

    labels = numbers(_NODES, "nodes").astype(np.int64)
    count = len(labels)
    places = [numbers(_X + k, "coordinates of nodes") for k in range(3)]
    moved, resisting = numbers(_SHAPES, "mode shapes"), numbers(_STIFFNESS, "modal stiffness")
    masses = numbers(_LUMPED, "lumped mass") if _LUMPED in groups else None
    try:
        nodes, shapes = np.column_stack([part.reshape(count) for part in places]), moved.reshape(-1, count, 6)
        stiffness = resisting.reshape(len(shapes), len(shapes))
        lumped = None if masses is None else masses.reshape(count, 6)
    except ValueError:
        raise Fault(f"{path}: its record groups don't fit {count} nodes", "Export it again") from None
    return Modes(labels, nodes, shapes[:, :, :3].transpose(1, 2, 0), (stiffness + stiffness.T) / 2, lumped=lumped)


def _universal(path: str) -> Modes:
    sets = _sets(path)
    places = [each for each in sets if each["type"] in (15, 2411)]
    modes = [_mode(path, each) for each in sets if each["type"] in (55, 2414)]
    if not places or not modes:
        what = "nodes, data set 15 or 2411" if not places else "modes, data set 55 or 2414"
        raise Fault(f"{path} has no {what}", "Export nodes and normal modes into one file")
    labels = np.concatenate([np.asarray(each["node_nums"]) for each in places]).astype(np.int64)
    nodes = np.column_stack([np.concatenate([np.asarray(each[axis], float) for each in places]) for axis in "xyz"])
    shapes = np.zeros((len(labels), 3, len(modes)))
    for k, (at, values, _) in enumerate(modes):
        where = {int(node): row for row, node in enumerate(at)}
        absent = [node for node in labels.tolist() if node not in where]
        if absent:
            raise Fault(f"{path}: mode {k + 1} has no motion of node {absent[0]}", "Export it for all nodes")
        shapes[:, :, k] = values[[where[node] for node in labels.tolist()]]
    return Modes(labels, nodes, shapes, omega=2.0 * np.pi * np.array([frequency for *_, frequency in modes]))


def _sets(path: str) -> list[dict[str, Any]]:
    with installed("pyuff, which reads universal files,", "uff", "pyuff"):
        import pyuff
    try:
        found = pyuff.UFF(path).read_sets()
    except Exception as error:  # any error of its readers
        raise Fault(f"{path} can't be read by pyuff: {error}", "Export it again") from None
    return [found] if isinstance(found, dict) else list(found)


def _mode(path: str, given: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, float]:
    """Numbers of the nodes, their translations (n_nodes, 3), and the frequency [Hz] of a normal mode."""
    if given.get("analysis_type") != _NORMAL_MODE:
        kind = f"an analysis of kind {given.get('analysis_type')}"
        raise Fault(f"{path} has {kind} in data set {given['type']}", "Export normal modes, which are real (kind 2)")
    at = np.asarray(given["node_nums"])
    if given["type"] == 55:
        parts, frequency = [given.get(f"r{k}") for k in (1, 2, 3)], given["freq"]
        values = np.column_stack([np.zeros(len(at)) if part is None else part for part in parts])
    else:
        values, frequency = np.zeros((len(at), 3)), given["record12_field2"]
        for row, own in enumerate(given["data_at_node"]):
            values[row, : min(3, len(own))] = own[:3]
    if np.iscomplexobj(values) and abs(values.imag).max() > 0.0:
        raise Fault(f"{path} contains complex modes", "Export normal modes, which are real (kind 2)")
    return at, values.real.astype(float), float(frequency)


_READERS = {".fem": _mbdyn, ".unv": _universal, ".uff": _universal}
