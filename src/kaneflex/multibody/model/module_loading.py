"""Find or derive the generated module of a scene's structure, and bind the scene's numbers to its kernels."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from kaneflex.mechanism.mechanism import NumericMechanism, mechanism_of
from kaneflex.scene import Scene
from kaneflex.scene.bodies import Body
from kaneflex.scene.options import acting, left_out, resolve_options
from kaneflex.scene.structure import laws_hash, number_at, pruned_hash, structure_hash
from kaneflex.support.contract import COURSES, LAWS_ATTRIBUTES, REQUIRED_ATTRIBUTES, beam_module
from kaneflex.support.errors import SceneError

Progress = Callable[[str], None]


def find_module(scene: Scene, progress: Progress) -> tuple[ModuleType, float]:
    """Module of the scene's structure: shipped, else from the user's cache, else derived.

    Returns the module and the seconds of derivation.
    """
    return _find(structure_hash(scene), lambda stage: generate_text(scene, stage), REQUIRED_ATTRIBUTES, progress)


def find_laws_module(scene: Scene, progress: Progress) -> tuple[ModuleType, float]:
    """Module of a scene's drives and loads, all that the engine needs of a structure; see :func:`find_module`."""
    return _find(laws_hash(scene), lambda stage: laws_text(scene, stage), LAWS_ATTRIBUTES, progress)


def laws_text(scene: Scene, progress: Progress = lambda stage: None) -> str:
    """Text of the module of a scene's drives and loads."""
    from kaneflex.derive.laws.drives_and_loads import generate_laws

    return generate_laws(scene, progress)


def element_of(bodies: Iterable[Body]) -> Any:
    """Leanest element that serves every elastic link among planar bodies, without scalars of a motion."""
    profiles = [body.profile for body in bodies if body.elastic]
    has = {of: any(getattr(profile, of) for profile in profiles) for of in ("rotary", "shear", "varying")}
    beam = beam_module(has["rotary"] or has["shear"], has["shear"], has["varying"])
    return SimpleNamespace(**vars(importlib.import_module(f"kaneflex.generated.{beam}")), SCALARS=())


def _find(
    structure: str, text: Callable[[Progress], str], required: Sequence[str], progress: Progress
) -> tuple[ModuleType, float]:
    """The module, and the seconds of its derivation."""
    from kaneflex.generated import STRUCTURES

    if structure in STRUCTURES:
        return importlib.import_module(f"kaneflex.generated.{STRUCTURES[structure]}"), 0.0
    if _module_name(structure) in sys.modules:
        return sys.modules[_module_name(structure)], 0.0
    from kaneflex.support.module_cache import cache_folder, keep, kept, sealed

    path = cache_folder() / f"{structure}.py"
    data, seconds = kept(path), 0.0
    if data is None:
        progress("deriving the equations, first time only" if not path.exists() else
                 "deriving the equations again: the cached file is damaged")  # fmt: skip
        started = time.perf_counter()
        data = sealed(text(lambda stage: progress(f"deriving the equations: {stage}")))
        keep(path, data)
        seconds = time.perf_counter() - started
    return _execute(data, path, structure, required), seconds


def generate_text(scene: Scene, progress: Progress = lambda stage: None) -> str:
    """Text of the module of a scene's structure.

    Raises
    ------
    SceneError
        If the drives and joints don't determine the motion; names undetermined motions and redundant constraints.
    """
    if scene.is_spatial:
        return laws_text(scene, progress)
    from kaneflex.derive.generate import generate

    with derivable(mechanism_of(scene)):
        return generate(scene, progress)


def pruned_text(scene: Scene, progress: Progress = lambda stage: None) -> str:
    """Text of a module of the scene without the terms that its options leave out.

    Under preset coupled, the module of its laws. Raises SceneError as :func:`generate_text`.
    """
    options = resolve_options(scene)
    if options.dynamics == "coupled":
        return laws_text(scene, progress)
    scene, without = acting(scene, options), left_out(options)
    if not without:
        return generate_text(scene, progress)
    from kaneflex.derive.generate import generate_pruned

    with derivable(mechanism_of(scene)):
        return generate_pruned(scene, without, pruned_hash(scene, without), progress)


def operation_count(text: str) -> int:
    """Operations of one call of each kernel of a module, from its OPERATIONS and those of its element."""
    wanted = [
        node
        for node in ast.parse(text).body
        if (isinstance(node, ast.Assign) and node.targets[0].id == "OPERATIONS")
        or (isinstance(node, ast.ImportFrom) and node.module == "kaneflex.generated")
    ]
    known: dict[str, dict[str, tuple[int, int]]] = {}
    exec(compile(ast.Module(wanted, type_ignores=[]), "OPERATIONS", "exec"), known)
    return sum(shared for _, shared in known["OPERATIONS"].values())


@contextmanager
def derivable(mechanism: NumericMechanism) -> Iterator[None]:
    """Check that joints and drives determine the motion, and turn other derivation errors into a SceneError."""
    from kaneflex.derive.equations.closure import UnsupportedLoop
    from kaneflex.derive.equations.linear import StructurallySingular
    from kaneflex.fem.mobility import check_determined

    check_determined(mechanism)
    try:
        yield
    except (StructurallySingular, UnsupportedLoop) as error:
        raise SceneError(
            "joints", None, str(error), "Give each body three constraints, drives included"
        ) from error


def _module_name(structure: str) -> str:
    """Module name, the key of numba's cache files."""
    return f"kaneflex_{structure}"


def import_file(path: Path, structure: str, required: Sequence[str] = REQUIRED_ATTRIBUTES) -> ModuleType:
    """Import a generated file under a name derived from its structure."""
    found = sys.modules.get(_module_name(structure))
    return found if found is not None else _execute(path.read_bytes(), path, structure, required)


def _execute(data: bytes, path: Path, structure: str, required: Sequence[str]) -> ModuleType:
    """Execute the text of a generated module, read from ``path``, as a module."""
    name = _module_name(structure)
    specification = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # before execution: numba looks up its functions' module
    try:
        exec(compile(data, str(path), "exec"), module.__dict__)
    except BaseException:
        del sys.modules[name]
        raise
    missing = [attribute for attribute in required if not hasattr(module, attribute)]
    if missing or module.STRUCTURE != structure:
        del sys.modules[name]
        raise SceneError(
            str(path),
            structure,
            "not a generated module of this structure",
            "Delete the file; it will be derived again",
        )
    return module


def bind_parameters(scene: Scene, module: ModuleType) -> np.ndarray:
    """Argument p of the kernels: every number of PARAMETERS in SI, then the tables' blocks."""
    values: list[float] = []
    blocks: list[np.ndarray] = []
    filled = len(module.PARAMETERS)
    for path, _ in module.PARAMETERS:
        table, owner, name = (*path.split(".", 2), "")[:3]
        if name == "table":
            reader = getattr(scene, table)[owner]
            block = reader.curve()
            values.append(float(filled))
            blocks.append(block)
            filled += len(block)
        elif name in (*COURSES, "side") or name.startswith("seed_"):
            values.append(0.0)  # filled after free joints are integrated and loops followed
        else:
            values.append(float(number_at(scene, path)))
    return np.concatenate([np.array(values), *blocks])
