"""From a scene to a model: find or derive its module, bind the numbers, assemble, reduce."""

from __future__ import annotations

import importlib
import importlib.util
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
from scipy.sparse import csr_array

from kaneflex.affine import Affine
from kaneflex.assembly import Equations, assemble, guided_part, with_loads
from kaneflex.contract import ELEMENT_PARAMETERS, FORMAT, REQUIRED_ATTRIBUTES
from kaneflex.errors import SceneError
from kaneflex.frame import Frame, Interfaces, build_frame, find_interfaces, guided_bodies, prescribed_bodies
from kaneflex.links import Link, Part, build_link, craig_bampton, with_rayleigh
from kaneflex.model import Model, Motion, RigidMotion, keep_terms
from kaneflex.modes import lowest_modes
from kaneflex.options import Options, resolve_options
from kaneflex.scene import Scene
from kaneflex.writing import write_text

Progress = Callable[[str], None]
_SWEEP = 720
"""Samples of a cycle at which the linkage must close before anything is computed."""


def load(scene: Scene, progress: Progress = lambda stage: None) -> Model:
    """Bind a scene to its generated module.

    Parameters
    ----------
    scene : Scene
    progress : callable
        Called with the name of each stage that can take longer than a moment.

    Returns
    -------
    Model

    Raises
    ------
    SceneError
        If the linkage can't close over the drives' range, or the scene asks for what is not available.
    """
    started = time.perf_counter()
    options = resolve_options(scene)
    guided_bodies(scene, prescribed_bodies(scene))
    module, derived = find_module(scene, progress)
    bound = time.perf_counter()
    motion = Motion(module, bind_parameters(scene, module))
    progress("compiling, first time only")
    _compile(motion)
    compiled = time.perf_counter()
    check_closure(scene, motion, options)
    model = build_model(scene, options, motion)
    seconds = {
        "derive": derived,
        "compile": compiled - bound,
        "set_up": time.perf_counter() - started - derived - (compiled - bound),
    }
    return replace(model, seconds=seconds)


def _compile(motion: Motion) -> None:
    """Call the kernels that every load needs once, so that compiling is seen and timed apart from computing."""
    motion.table(np.zeros(1))
    if motion.module.LINKS:
        motion.module.terms(0, np.ones(len(ELEMENT_PARAMETERS)), np.zeros((6, 6)))


def find_module(scene: Scene, progress: Progress) -> tuple[ModuleType, float]:
    """The module of the scene's structure: shipped, else from the user's cache, else derived now.

    Returns the module and the seconds spent on deriving it.
    """
    structure = scene.structure_hash()
    from kaneflex.generated import STRUCTURES

    if structure in STRUCTURES:
        return importlib.import_module(f"kaneflex.generated.{STRUCTURES[structure]}"), 0.0
    path = cache_folder() / f"{structure}.py"
    seconds = 0.0
    if not path.exists():
        progress("deriving the equations, first time only")
        started = time.perf_counter()
        write_text(path, generate_text(scene))
        seconds = time.perf_counter() - started
    return import_file(path, structure), seconds


def generate_text(scene: Scene, progress: Progress = lambda stage: None) -> str:
    """Text of the module of a scene's structure.

    Raises
    ------
    SceneError
        If the drives and joints don't determine the motion; it names what is open and what is redundant.
    """
    from kaneflex.derive import StructurallySingular, UnsupportedLoop, generate

    try:
        return generate(scene, progress)
    except StructurallySingular as error:
        cure = "Every body needs three constraints, drives counted: add or remove joints or drives"
        raise SceneError("joints", None, str(error), cure) from error
    except UnsupportedLoop as error:
        raise SceneError("joints", None, str(error), "Drive these bodies, or close them by a rod and a guide") from error


def cache_folder() -> Path:
    """Where modules that kaneflex derived for the user are kept: each version of the generator has its own."""
    from importlib.metadata import version

    import platformdirs

    return Path(platformdirs.user_cache_dir("kaneflex", appauthor=False)) / f"{version('kaneflex')}-{FORMAT}"


def import_file(path: Path, structure: str) -> ModuleType:
    """Import a generated file under a name made of its structure, which numba's cache files are keyed by."""
    name = f"kaneflex_{structure}"
    if name in sys.modules:
        return sys.modules[name]
    specification = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(specification)
    sys.modules[name] = module  # before it is executed: numba looks its functions' module up
    try:
        specification.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    missing = [attribute for attribute in REQUIRED_ATTRIBUTES if not hasattr(module, attribute)]
    if missing or module.STRUCTURE != structure:
        del sys.modules[name]
        raise SceneError(str(path), structure, "not a generated module of this structure", "Delete the file; it is derived anew")
    return module


def bind_parameters(scene: Scene, module: ModuleType) -> np.ndarray:
    """The kernels' argument p: every number of PARAMETERS in SI, then the tables' blocks."""
    values: list[float] = []
    blocks: list[np.ndarray] = []
    filled = len(module.PARAMETERS)
    for path, _ in module.PARAMETERS:
        owner, _, name = path.partition(".")
        if name == "table":
            load_table = scene.loads[owner]
            block = load_table.read_table().coefficients(load_table.period)
            values.append(float(filled))
            blocks.append(block)
            filled += len(block)
        else:
            values.append(float(_number(scene, owner, name)))
    return np.concatenate([np.array(values), *blocks])


def _number(scene: Scene, owner: str, name: str) -> float:
    """The scene's number at a dotted path of PARAMETERS."""
    if owner.startswith("gravity_"):
        return scene.gravity["xy".index(owner[-1])]
    if owner in scene.bodies:
        return _body_number(scene, owner, name)
    if owner == "ground":
        point, _, axis = name.partition(".")
        return scene.ground[point]["xy".index(axis)]
    if owner in scene.drives and name in ("speed", "angle"):
        return getattr(scene.drives[owner], name)
    if owner in scene.joints and name == "branch":
        return 1.0 if scene.joints[owner].branch == "+" else -1.0
    table = scene.joints if owner in scene.joints else scene.loads
    if name.startswith("direction_"):
        return table[owner].direction["xy".index(name[-1])]
    return getattr(scene.loads[owner], name)


def _body_number(scene: Scene, owner: str, name: str) -> float:
    body = scene.bodies[owner]
    if name.startswith("element."):
        field = name.removeprefix("element.")
        return {"length": body.length / body.beam.elements, "x_0": 0.0}.get(field, getattr(body, field, 0.0))
    if name.startswith("centre_"):
        return body.centre["xy".index(name[-1])]
    if "." in name:
        point, axis = name.split(".")
        return body.points_all[point]["xy".index(axis)]
    return getattr(body, name)


def check_closure(scene: Scene, motion: Motion, options: Options) -> None:
    """Sweep the drives' range: every loop must close with a margin, or the error names loop, angle and value."""
    margins = [name for name in motion.column if name.endswith(".closure")]
    if not margins:
        return
    horizon = scene.period if options.cycles else options.duration
    rigid = motion.at(np.linspace(0.0, horizon, _SWEEP + 1))
    for name in margins:
        joint = name.removesuffix(".closure")
        margin = rigid[name]
        if (margin > 0.0).all():
            continue
        index = int(np.argmax(~(margin > 0.0)))
        drive = next(iter(scene.drives))
        angle = math.degrees(float(rigid[f"{drive}.angle"][index]))
        raise SceneError(
            f"joints.{joint}", scene.joints[joint].branch,
            f"the loop can't close: at {drive} = {angle:.6g} deg the rod does not reach the guide",
            "Lengthen the rod or shorten the crank, or limit the drive's range",
        )  # fmt: skip


def build_model(scene: Scene, options: Options, motion: Motion) -> Model:
    """Mesh the links, assemble, reduce."""
    reference = _reference_time(scene, options)
    if options.dynamics == "rigid":
        empty = {key: Affine.zero(0, 1 if key == "F" else 0) for key in ("M", "C_s", "C_d", "K_s", "K_d", "K_c", "K_g", "F")}
        none = Equations((), **empty)
        return Model(scene, options, motion, {}, {}, {}, None, None, none, none, None, reference)
    links = {
        name: build_link(scene, name, motion.module, options.elements or body.beam.elements)
        for name, body in scene.bodies.items()
        if body.elastic
    }
    interfaces = find_interfaces(scene, links, options.weld_pins, options.free_drives)
    parts, bases = _parts(scene, options, links, interfaces)
    frame = build_frame(scene, parts, interfaces)
    equations = assemble(parts, frame, options.convective)
    model = Model(scene, options, motion, links, parts, bases, interfaces, frame, equations, equations, None, reference)
    if scene.damping is not None and scene.damping.kind == "modal":
        equations = _with_modal_damping(model)
        model = replace(model, equations=equations, reduced=equations)
    if options.reduction == "modal":
        omega, basis = reference_modes(model, options.modes)
        names = tuple(f"mode_{k + 1}" for k in range(len(omega)))
        reduced = equations.in_basis(basis, names)
        if options.dynamics == "frozen":
            reduced = _frozen(model, reduced, omega)
        model = replace(model, reduced=reduced, modal_basis=basis)
    return model


def _frozen(model: Model, reduced: Equations, omega: np.ndarray) -> Equations:
    """a'' + 2 zeta omega a' + omega^2 a = Phi^T F(t), paper (143), with the matrices of the reference angle."""
    size = len(omega)
    zero = Affine.zero(size, size)
    rigid = model.motion.at(model.reference_time)
    damping = np.diag(np.diag(_at(reduced.C_s, rigid).toarray())) if model.options.damping else np.zeros((size, size))
    constant = {key: zero for key in ("C_d", "K_d", "K_c", "K_g")}
    constant |= {"M": np.eye(size), "C_s": damping, "K_s": np.diag(omega**2)}
    frozen = {key: value if isinstance(value, Affine) else Affine.constant(value) for key, value in constant.items()}
    return Equations(reduced.coordinates, F=reduced.F, **frozen)


def _at(affine: Affine, rigid: RigidMotion) -> csr_array:
    """An affine matrix at the first time of a rigid motion."""
    return affine.at({name: float(rigid[name][0]) for monomial in affine.terms for name in monomial})


def _reference_time(scene: Scene, options: Options) -> float:
    drive = next(iter(scene.drives.values()), None)
    if drive is None or drive.speed == 0:
        return 0.0
    return (options.mode_angle - drive.angle) / drive.speed


def _parts(
    scene: Scene, options: Options, links: dict[str, Link], interfaces: Interfaces
) -> tuple[dict[str, Part], dict[str, np.ndarray]]:
    parts: dict[str, Part] = {}
    bases: dict[str, np.ndarray] = {}
    for name, link in links.items():
        parts[name] = with_loads(scene, link.part, link)
        if options.reduction == "craig-bampton":
            held = interfaces.held_rows(parts[name])
            limit = parts[name].size - len(held)
            count = limit if options.modes == "all" else options.modes
            if count > limit:
                raise SceneError(
                    "solve.modes", options.modes, f"{name} has {limit} fixed-interface modes",
                    "Ask for fewer modes, or give the link more elements",
                )  # fmt: skip
            parts[name], bases[name] = craig_bampton(parts[name], held, count)
    for name in guided_bodies(scene, prescribed_bodies(scene)):
        parts[name] = with_loads(scene, guided_part(scene, name), None)
    if scene.damping is not None and scene.damping.kind == "rayleigh":
        alpha, beta = rayleigh_coefficients(scene.damping.rayleigh.ratio, *scene.damping.rayleigh.at)
        parts = {name: with_rayleigh(part, alpha, beta) for name, part in parts.items()}
    return parts, bases


def rayleigh_coefficients(ratio: float, f_1: float, f_2: float) -> tuple[float, float]:
    """alpha [1/s] and beta [s] of C = alpha M + beta K with one damping ratio at two frequencies [Hz]."""
    w_1, w_2 = 2 * math.pi * f_1, 2 * math.pi * f_2
    return 2 * ratio * w_1 * w_2 / (w_1 + w_2), 2 * ratio / (w_1 + w_2)


def reference_modes(model: Model, modes: int | str) -> tuple[np.ndarray, np.ndarray]:
    """Undamped modes at the reference configuration: angular frequencies [rad/s] and shapes, one a column.

    K_s alone, but for the frozen model of the paper, whose K is K_s + K_d, eq. (99).
    """
    rigid = model.motion.at(model.reference_time)
    frozen = model.options.dynamics == "frozen"
    stiffness = keep_terms(model.equations, model.options)["K"] if frozen else model.equations.K_s
    size = model.equations.size
    count = size if modes == "all" else modes
    if count > size:
        raise SceneError(
            "solve.modes", modes, f"the mechanism has {size} degrees of freedom",
            "Ask for fewer modes, or give the links more elements",
        )  # fmt: skip
    square = _at(stiffness, rigid)
    return lowest_modes((square + square.T) * 0.5, _at(model.equations.M, rigid), count)


def _with_modal_damping(model: Model) -> Equations:
    """C = M Phi diag(2 zeta omega) Phi^T M at the reference configuration."""
    ratios = model.scene.damping.modal.ratio
    omega, shapes = reference_modes(model, "all")
    zeta = np.array([ratios[min(k, len(ratios) - 1)] for k in range(len(omega))])
    weighted = _at(model.equations.M, model.motion.at(model.reference_time)) @ shapes
    damping = Affine.constant(weighted * (2.0 * zeta * omega) @ weighted.T)
    return replace(model.equations, C_s=model.equations.C_s + damping)
