"""Construction of a model: mesh the links, choose coordinates, assemble, reduce."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from kaneflex.fem.assembly import (
    ElasticEquations,
    assemble,
    parts_of_links,
    place_rigid,
    place_springs,
    place_torques,
)
from kaneflex.fem.coordinate_map import Frame, Placed, Sites, find_interfaces
from kaneflex.fem.links import Link, make_link, with_rayleigh
from kaneflex.fem.modes import damping_ratios, lowest_modes, rayleigh_coefficients
from kaneflex.mechanism.affine import Affine, Matrix, entries, from_entries, sparse
from kaneflex.mechanism.mechanism import mechanism_of, same_mechanism
from kaneflex.mechanism.rigid_motion import RigidKinematics
from kaneflex.multibody.model.bound_model import REACHED, Model, keep_terms
from kaneflex.scene import Scene
from kaneflex.scene.options import Options
from kaneflex.support.errors import SceneError, counted

if TYPE_CHECKING:
    from kaneflex.mechanism.energy import Energy

_SAMPLES = 4001
"""Instants of a run among which the first drive's position is searched."""
_NARROW = 12
"""Half-bandwidth up to which reordering does not pay off."""


def build_model(
    scene: Scene, options: Options, motion: RigidKinematics, frozen: Model | None = None, like: Model | None = None,
    without_linear: bool = False,
) -> Model:
    """Mesh the links, assemble, reduce.

    ``frozen`` provides the order of coordinates, the bases and the damping modes; ``like`` the equations, if equal.
    ``without_linear``: the coupled equations have no linear ones, since no elastic stage can follow the rigid motion.
    """
    model = Model(scene, options, motion)
    reference, warnings = reference_instant(model)
    model = replace(model, reference_time=reference)
    if like is not None and _same_equations(model, like):
        model = replace(like, scene=scene, options=options, motion=motion, reference_time=reference, energy=None,
                        seconds={})  # fmt: skip
        return replace(model, warnings=(*warnings, *(_without_modes(model) if model.equations.size else ())))
    if without_linear:
        links = _links(model)
        return replace(model, links=links, parts={name: link.part for name, link in links.items()})
    if options.dynamics == "rigid" or not scene.is_elastic:
        return model
    bases = {} if frozen is None else frozen.bases
    if scene.is_spatial:  # a local import lets planar scenes start faster
        from kaneflex.multibody.model.spatial_elastic import with_elastic_parts

        model = with_elastic_parts(model, bases)
    else:
        model = _with_elastic_parts(model, bases)
    placed, of_parts = list(model.placed), model.warnings
    if scene.damping is not None and scene.damping.kind == "rayleigh":
        alpha, beta = rayleigh_coefficients(scene.damping.rayleigh.ratio, *scene.damping.rayleigh.at)
        placed = [each._replace(part=with_rayleigh(each.part, alpha, beta)) for each in placed]
    frame, placed = model.frame, [*placed, *model.sprung.values()]  # springs have dampers of their own
    assert frame is not None
    frame, placed = _narrow_band(frame, placed) if frozen is None else _ordered(frame, placed, frozen.coordinates)
    moving = (each for each in placed if each.L.terms)
    equations = assemble(moving, frame.coordinates, options.convective, options.dynamics == "quasistatic")
    sprung = dict(zip(model.sprung, placed[len(model.placed) :], strict=True))
    model = replace(model, frame=frame, equations=equations, reduced=equations, sprung=sprung, warnings=(),
                    placed=tuple(each for each in placed if each.at))  # fmt: skip
    warnings = (*warnings, *_without_modes(model), *of_parts)
    if scene.damping is not None and scene.damping.kind == "modal":
        equations = _with_modal_damping(model, model if frozen is None else frozen)
        model = replace(model, equations=equations, reduced=equations)
    if options.reduction == "modal":
        omega, basis = reference_modes(model if frozen is None else frozen, options.modes)
        names = tuple(f"mode_{k + 1}" for k in range(len(omega)))
        reduced = equations.in_basis(basis, names)
        if options.dynamics == "frozen":
            reduced = _frozen(model, reduced, omega)
        model = replace(model, reduced=reduced, modal_basis=basis)
    return replace(model, warnings=warnings)


def moving(model: Model, motion: RigidKinematics, energy: Energy) -> Model:
    """Model of the same scene along an integrated motion; ``model`` has only the start of the motion."""
    found = build_model(model.scene, model.options, motion, like=model)
    warnings = (*found.warnings, *model.warnings)
    found = replace(found, energy=energy, warnings=warnings, seconds=model.seconds, given=model.given)
    return found.sharing(model)


def _links(model: Model) -> Mapping[str, Link]:
    """Elastic links of a planar mechanism; under preset coupled those of its equations."""
    mechanism = mechanism_of(model.scene)
    return getattr(model.motion, "links", None) or {
        name: make_link(mechanism, name, model.options.elements or body.beam.elements, model.module)
        for name, body in mechanism.deforming.items()
        if body.elastic
    }


def _with_elastic_parts(model: Model, frozen: Mapping[str, np.ndarray]) -> Model:
    """Model with the meshed links and coordinates of a planar mechanism; ``frozen``: bases of reductions."""
    mechanism, links = mechanism_of(model.scene), _links(model)
    interfaces = find_interfaces(mechanism, links, model.options.weld_pins, model.options.free_drives)
    parts, bases = parts_of_links(model.options, links, interfaces, frozen)
    sites = Sites(mechanism, links, parts, interfaces)
    placed = [Placed(part, sites.frame.maps[name]) for name, part in parts.items()]
    placed += [*place_rigid(sites), *place_torques(sites)]
    return replace(model, links=links, parts=parts, bases=bases, interfaces=interfaces, frame=sites.frame,
                   placed=tuple(placed), sprung={each.part.name: each for each in place_springs(sites)})  # fmt: skip


def _same_equations(model: Model, like: Model) -> bool:
    """True if another model's equations apply to a scene, which then differs in drives' speeds only.

    A speed enters the scalars of the motion only, unless the equations are those of one instant.
    """
    as_before = model.options._replace(duration=like.options.duration, steps=like.options.steps)
    if model.module is not like.module or as_before != like.options or of_an_instant(model):
        return False
    return model.options.dynamics != "coupled" and same_mechanism(model.scene, like.scene)


def of_an_instant(model: Model) -> bool:
    """True if the equations use modes of the reference configuration, by reduction, freezing or damping.

    Under preset coupled, modal damping uses each link's own modes.
    """
    damping, options = model.scene.damping, model.options
    damped = damping is not None and damping.kind == "modal" and options.damping
    return options.reduction == "modal" or (damped and options.dynamics != "coupled")


def _narrow_band(frame: Frame, placed: list[Placed]) -> tuple[Frame, list[Placed]]:
    """Reorder the coordinates for a small bandwidth, if that helps.

    A chain of links is narrow in its given order; loops and branches are not.
    """
    size = len(frame.coordinates)
    touched = Affine.zero(size, size).pattern()
    for part, L, _ in placed:
        within, motion = sum(part.matrices[key].pattern() for key in ("M", "C_d", "K_s", "K_g")), L.pattern()
        if not isinstance(touched, np.ndarray):  # few rows may be a dense array, their product is sparse
            within, motion = sparse(within), sparse(motion)
        touched = touched + motion.T @ within @ motion
    rows, columns, _ = entries(touched)
    before = abs(rows - columns).max(initial=0)
    if before <= _NARROW:  # narrow ones keep their order
        return frame, placed
    order = _reverse_cuthill_mckee(touched)
    place = np.argsort(order)
    if abs(place[rows] - place[columns]).max() >= before:
        return frame, placed
    return _ordered(frame, placed, [frame.coordinates[k] for k in order])


def _reverse_cuthill_mckee(pattern: Matrix) -> list[int]:
    """Order of small bandwidth (Cuthill & McKee 1969, reversed by George 1971).

    The same as scipy's, whose import takes longer than loading a small scene.
    """
    rows, columns, _ = entries(pattern)
    near = np.split(columns, np.searchsorted(rows, np.arange(1, pattern.shape[0])))
    degree = np.array([len(each) + (k in each) for k, each in enumerate(near)])
    order, met = list[int](), np.zeros(len(near), dtype=bool)
    for seed in np.argsort(degree).tolist():
        wave = [] if met[seed] else [seed]
        met[seed] = True
        for k in wave:  # it grows
            new = [j for j in near[k].tolist() if not met[j]]
            met[new] = True
            wave += sorted(new, key=degree.__getitem__)
        order += wave
    return order[::-1]


def _ordered(frame: Frame, placed: list[Placed], coordinates: Sequence[str]) -> tuple[Frame, list[Placed]]:
    """The same with reordered coordinates; unchanged if they are different ones."""
    size = len(frame.coordinates)
    if set(coordinates) != set(frame.coordinates):
        return frame, placed
    order = [frame.coordinates.index(name) for name in coordinates]
    swap = Affine.constant(from_entries((size, size), order, np.arange(size), np.ones(size)))
    moved = Frame(
        tuple(coordinates),
        {name: L @ swap for name, L in frame.maps.items()},
        {name: L @ swap for name, L in frame.bodies.items()},
    )
    return moved, [each._replace(L=each.L @ swap) for each in placed]


def _frozen(model: Model, reduced: ElasticEquations, omega: np.ndarray) -> ElasticEquations:
    """Modal equations a'' + 2 zeta omega a' + omega^2 a = Phi^T F(t), paper (143), with the matrices of the reference
    angle.

    A mode of zero frequency may have lost its stiffness to the spin: omega^2 is then negative, and it diverges.
    """
    size = len(omega)
    zero = Affine.zero(size, size)
    rigid = model.motion.at(model.reference_time)
    damping = np.diag(rigid.first(reduced.C_s).diagonal()) if model.options.damping else np.zeros((size, size))
    absent = {key: zero for key in ("C_d", "K_d", "K_c", "K_g")}
    squares = np.where(omega > 0.0, omega**2, rigid.first(keep_terms(reduced, model.options)["K"]).diagonal())
    modal = {"M": np.eye(size), "C_s": damping, "K_s": np.diag(squares)}
    constant = {key: Affine.constant(matrix) for key, matrix in modal.items()}
    return ElasticEquations(reduced.coordinates, F=reduced.F, **constant, **absent)


def reference_instant(model: Model) -> tuple[float, tuple[str, ...]]:
    """Instant [s] of the reference configuration, from :func:`instant_of` or the first one; and warnings about it.

    Raises SceneError if the first drive never reaches the requested position.
    """
    scene, options, motion = model.scene, model.options, model.motion
    instant = instant_of(model, options.mode_angle)
    if instant is not None or options.dynamics == "rigid" or motion.is_start:
        return instant or 0.0, ()
    name, drive = next(iter(scene.drives.items()))
    angles = motion.at(np.linspace(0.0, scene.horizon, _SAMPLES))[f"{name}.angle"]
    ends, mechanism = (options.mode_angle, angles[0], min(angles), max(angles)), mechanism_of(scene)
    wanted, start, lowest, highest = (mechanism.written_coordinate(name, x) for x in ends)
    if "mode_angle" not in scene.solve.model_fields_set and options.mode_angle == scene.solve.mode_angle:
        warning = f"{name} never reaches solve.mode_angle = {wanted}: modes are those of {start}"
        return 0.0, (warning,) if of_an_instant(model) else ()
    reason = f"{name} never reaches it; its range is {lowest} to {highest}"
    if drive.kind == "free" and options.dynamics == "coupled":
        reason = f"before the run only the start of {name}, {start}, is known"
    elif lowest == highest:
        reason = f"{name} stays at {start}"
    place = f"{name}.{'position' if scene.slides(name) else 'angle'}"
    cure = "Choose a position within its range"
    if drive.kind in ("constant speed", "free"):
        cure += f", or set {place} = {wanted}"
    raise SceneError("solve.mode_angle", wanted, reason, cure)


def instant_of(model: Model, coordinate: float) -> float | None:
    """First instant [s] at which the first drive is at a coordinate [rad or m]; None if it never is.

    Positions count modulo the cycle, or modulo a full turn for a rotating drive without cycle. A drive with constant
    speed is followed beyond the run.
    """
    scene, motion = model.scene, model.motion
    name, drive = next(iter(scene.drives.items()), (None, None))
    if drive is None:
        return 0.0
    turn = math.inf if scene.slides(name) else drive.cycle or 2.0 * math.pi
    if drive.kind == "constant speed" and drive.speed and not scene.slides(name):
        instant = (coordinate - drive.start) / drive.speed
        return instant if 0.0 <= instant <= scene.horizon else instant % (turn / abs(drive.speed))
    times = np.zeros(1) if motion.is_start else np.linspace(0.0, scene.horizon, _SAMPLES)
    ahead = motion.at(times)[f"{name}.angle"] - coordinate
    around = ahead if math.isinf(turn) else ahead - turn * np.round(ahead / turn)
    reached = REACHED["m" if math.isinf(turn) else "rad"]
    for gap in (ahead, around):
        if abs(gap[0]) < reached:
            return 0.0
        # a jump from half a turn ahead to half a turn behind is not a crossing
        passed = (gap[:-1] * gap[1:] <= 0.0) & (abs(np.diff(gap)) < turn / 2)
        if passed.any():
            k = int(passed.argmax())
            level = float(coordinate + ahead[k] - gap[k])
            return _passing(motion, name, level, times[k], times[k + 1])
    return None


def _passing(motion: RigidKinematics, drive: str, coordinate: float, start: float, end: float) -> float:
    """Instant [s] between two others at which a drive passes a coordinate, by refined samples and linear
    interpolation."""
    for _ in range(3):
        times = np.linspace(start, end, 101)
        gap = motion.at(times)[f"{drive}.angle"] - coordinate
        k = int((gap[:-1] * gap[1:] <= 0.0).argmax())
        start, end, before, rise = times[k], times[k + 1], gap[k], gap[k + 1] - gap[k]
    return float(start - (end - start) * before / rise) if rise else float(start)


def has_modes(model: Model) -> bool:
    """True if there are equations and the reference configuration is not a dead centre."""
    if not model.equations.size:
        return False
    rigid = model.motion.at(model.reference_time)
    return all(np.isfinite(entries(rigid.first(part))[2]).all() for part in (model.equations.M, model.equations.K_s))


def _at_reference(model: Model) -> tuple[str, str, str]:
    """Position of the reference configuration, why it has no modes, and a fix."""
    cure = "Choose another position by solve.mode_angle"
    for name, at in model.reference_coordinates.items():
        reason = f"a dead centre or change point, where {name} does not determine the motion"
        return mechanism_of(model.scene).written_coordinate(name, at), reason, cure
    return "0", "a position where the mechanism locks", cure


def _without_modes(model: Model) -> tuple[str, ...]:
    """Warning about a reference configuration without modes, if nothing needs them."""
    if model.scene.damping is not None or model.options.reduction == "modal" or has_modes(model):
        return ()
    place, reason, cure = _at_reference(model)
    return (f"no modes at solve.mode_angle = {place}, {reason}: {cure[:1].lower()}{cure[1:]}",)


def no_modes(model: Model) -> SceneError:
    """Error for a reference configuration without modes."""
    place, reason, cure = _at_reference(model)
    return SceneError("solve.mode_angle", place, f"there are no modes at {reason}", cure)


def reference_modes(model: Model, modes: int | str) -> tuple[np.ndarray, np.ndarray]:
    """Undamped modes at the reference configuration: angular frequencies [rad/s] and shapes in columns.

    From K_s only, except for the paper's frozen model, whose K is K_s + K_d, eq. (99).
    """
    rigid = model.motion.at(model.reference_time)
    frozen = model.options.dynamics == "frozen"
    stiffness = keep_terms(model.equations, model.options)["K"] if frozen else model.equations.K_s
    size = model.equations.size
    count = size if modes == "all" else modes
    if count > size:
        raise SceneError(
            "solve.modes", modes, f"the mechanism has {counted(size, 'degree of freedom')}",
            "Use fewer modes, or more elements",
        )  # fmt: skip
    if size and not has_modes(model):
        raise no_modes(model)
    square = rigid.first(stiffness)
    return lowest_modes((square + square.T) * 0.5, rigid.first(model.equations.M), count)


def _with_modal_damping(model: Model, of: Model) -> ElasticEquations:
    """Equations with C = M Phi diag(2 zeta omega) Phi^T M at the reference configuration; Phi and omega from ``of``."""
    omega, shapes = reference_modes(of, "all")
    zeta = damping_ratios(model.scene.damping.modal.ratio, omega)
    weighted = model.motion.at(model.reference_time).first(model.equations.M) @ shapes
    damping = Affine.constant(weighted * (2.0 * zeta * omega) @ weighted.T)
    return replace(model.equations, C_s=model.equations.C_s + damping)
