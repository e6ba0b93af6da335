"""Export of a scene as one readable Python module: rigid motion, elements, joints, modes, integration and sensors."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from kaneflex.export import standalone_text as parts
from kaneflex.export.standalone_numbers import (
    ELSE,
    LINE,
    data,
    filled,
    functions,
    narrowed,
    parameters,
    short,
    tables,
    wrapped,
)
from kaneflex.export.standalone_sensors import Texts, pair, sensor_text
from kaneflex.integrate.outcome import Trajectory
from kaneflex.mechanism.affine import as_array
from kaneflex.mechanism.rigid_bodies import carried_bodies
from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene import Scene
from kaneflex.scene.options import resolve_options
from kaneflex.solve.loading import load
from kaneflex.solve.simulation import solve
from kaneflex.support.errors import SceneError
from kaneflex.support.escaping import visible

MOST_LINES = 400
"""Largest number of lines of a readable file."""
_FEW = 3
"""Largest number of coordinate ranges that are listed one by one."""


def standalone(scene: Scene, progress: Callable[[str], None] = lambda stage: None) -> str:
    """Text of one module that solves a scene with numpy and numba only.

    Raises
    ------
    SceneError
        For features that the file does not support; names the entry.
    """
    _check_scene(scene)
    model = load(scene, progress)
    _check_model(model)
    progress("solving")
    begun = solve(model).trajectory
    assert isinstance(begun, Trajectory)  # one-way preset
    from kaneflex.derive.standalone import element_text

    geometric = model.options.geometric
    progress("element matrices")
    scene_texts = Texts(model)
    sensing = sensor_text(scene_texts)
    texts = [
        filled(parts.HEAD, title=_title(scene), parameters=parameters(model), data=data(model),
               plus=" + K_g" * geometric, tension=parts.TENSION * geometric),
        *tables(model),
        *functions(model),
        f"\n\n{element_text(geometric)}",
        filled(parts.KINEMATICS, maps=_maps(scene_texts), less=scene_texts.less_gravity),
        parts.NODE_MAP * ("node_map" in scene_texts.lumps() + sensing),
        filled(parts.EQUATIONS, lumps=scene_texts.lumps(), H_=", H" * geometric, K_g=parts.K_G * geometric,
               unpacked=parts.UNPACKED if geometric else "M, G, K_s, f = ELEMENTS[link]"),
        *_integration(model, begun),
        _foreshortening(scene_texts) if model.options.foreshortening else "",
        sensing,
    ]  # fmt: skip
    text = narrowed(re.sub("\n\n\n\n+", "\n\n\n", "".join(texts)))
    lines = text.count("\n")
    if lines > MOST_LINES:
        reason = f"the file would have {lines} lines, the limit is {MOST_LINES}"
        raise SceneError("--standalone", visible(scene.name), reason, ELSE)
    return text


def _check_scene(scene: Scene) -> None:
    """Raise SceneError for features that the file does not support, before anything is computed."""
    options = resolve_options(scene)
    if scene.is_spatial:
        raise SceneError("--standalone", "a mechanism in space", "only planar mechanisms are supported", ELSE)
    if options.dynamics != "dynamic":
        what = "no body is elastic" if options.dynamics == "rigid" else f"its equations are {options.dynamics}"
        raise SceneError("solve.preset", options.preset, f"{what}: the file needs linear, integrated equations",
                         f"Use --preset stiffened or linear with an elastic body. {ELSE}")  # fmt: skip
    left_out = [name for name in ("spin", "gyroscopic", "euler", "convective") if not getattr(options, name)]
    kinds = {"revolute", "prismatic", "weld"}
    damping = None if scene.damping is None else scene.damping.kind
    refused: list[tuple[object, str, object, str]] = [
        (options.reduction != "none", "solve.reduction", options.reduction, "the file does not support reductions"),
        (options.integrator not in ("radau", "spectral"), "solve.integrator", options.integrator,
         "the file supports radau and spectral only"),
        (left_out, "solve.terms", ", ".join(left_out), "the file needs all terms"),
        ((options.rotary and _has(scene, "rotary")) or _has(scene, "shear"), "beam.theory", "not euler-bernoulli",
         "the file supports Euler-Bernoulli beams only"),
        (damping not in (None, "rayleigh"), f"damping.{damping}", None, "the file supports Rayleigh damping only"),
        (damping and not options.damping, "solve.terms.damping", False, "the file needs the scene's damping"),
        (scene.springs, f"springs.{next(iter(scene.springs), '')}", None, "the file does not support springs"),
        (scene.torques, f"loads.{next(iter(scene.torques), '')}.torque_at", None, "the file does not support torques"),
        (scene.spreads, f"loads.{next(iter(scene.spreads), '')}.spread_on", None, "the file has no distributed loads"),
        (scene.contacts, f"contacts.{next(iter(scene.contacts), '')}", None, "the file does not support contacts"),
        (scene.events, f"events.{next(iter(scene.events), '')}", None, "the file does not support events"),
    ]  # fmt: skip
    refused += [(joint.kind not in kinds or joint.friction is not None, f"joints.{name}", joint.kind,
                 "the file has pins, guides and welds without friction only") for name, joint in scene.joints.items()]
    refused += [(drive.kind == "free", f"drives.{name}", "free", "the file does not support free drives")
                for name, drive in scene.drives.items()]
    refused += [(body.beam and body.beam.axially_rigid, f"bodies.{name}.beam.axially_rigid", True,
                 "the file does not support axially rigid links") for name, body in scene.bodies.items()]
    for wrong, key, value, reason in refused:
        if wrong:
            raise SceneError(key, value, reason, ELSE)


def _has(scene: Scene, term: str) -> bool:
    return any(getattr(body.beam, term) for body in scene.bodies.values() if body.elastic)


def _check_model(model: Model) -> None:
    """Raise SceneError for unsupported features of the assembled model."""
    from kaneflex.derive.standalone import BEAM

    beam = getattr(model.module, "beam", None)
    if beam is None or not beam.__name__.endswith(f".{BEAM}"):
        raise SceneError("bodies", None, "the file does not support tapered beams", ELSE)
    if getattr(model.module, "LOOPS", ()):
        raise SceneError("joints", None, "the file does not support loops closed by Newton's method", ELSE)
    known = {monomial for affine in model.kept.values() for each in affine.terms for monomial in each}
    jumps = sorted(name for name in known if ".link.jump_" in name)
    if jumps:
        raise SceneError("loads", jumps[0], "the file does not support axial forces between a link's ends", ELSE)
    for body, how in carried_bodies(model.scene).items():
        if how.kind != "guided":
            raise SceneError(f"bodies.{body}", None, "the file has no rigid bodies carried without guide", ELSE)


def _title(scene: Scene) -> str:
    """Name and description as text within triple quotes, with quotes and backslashes replaced."""
    lines = textwrap.wrap(f"{visible(scene.name)}: {visible(scene.description)}", LINE - 6)
    return "\n".join(lines).replace("\\", "/").replace('"', "'")


# ---- coordinates ----


def _maps(texts: Texts) -> str:
    """Statements that compute L of every link and every guided body."""
    sizes = dict.fromkeys(texts.guided, 3) | {name: 3 * len(link.nodes) for name, link in texts.links.items()}
    shapes = (f"{name!r}: np.zeros((3, {size}, N))" for name, size in sizes.items())
    lines = [wrapped("L = ", shapes, "{}", indent=4)]
    lines.append("    R_T = {link: frame(s, link)[1].transpose(0, 2, 1) for link in LINKS}")
    for body, how in carried_bodies(texts.scene).items():
        guide = texts.scene.joints[str(how.joint)]
        carrier, direction = guide.addresses[0].body, short(pair(guide.direction))
        column = int(np.flatnonzero(as_array(texts.frame.bodies[body].pattern()).sum(axis=0))[0])
        fixed = carrier == "ground"
        along = direction if fixed else f"frame(s, {carrier!r})[1] @ {direction}"
        lines.append(f"    L[{body!r}][{0 if fixed else ':'}, :2, {column}] = {along}")
    for name in texts.links:
        lines += _map_of_link(texts, name)
    return "\n".join([*lines, "    return L"])


def _map_of_link(texts: Texts, name: str) -> Iterator[str]:
    L, interfaces, place = texts.frame.maps[name], texts.interfaces, texts.model.parts[name].place
    nodes = [node for link, node in interfaces.displaced if link == name]
    displaced = {row for node in nodes for row in place[node][:2]}
    constant = as_array(L.terms.get((), np.zeros(L.shape)))
    own = [(int(i), int(j)) for i, j in zip(*np.nonzero(constant), strict=True) if i not in displaced]
    runs = list(_runs(own))
    if len(runs) > _FEW:
        rows, columns = [i for i, _ in own], [j for _, j in own]
        yield f"    L[{name!r}][0, {rows}, {columns}] = 1.0"
    else:
        yield from (f"    L[{name!r}][0, {at}, {of}] = 1.0" for at, of in runs)
    for node in nodes:
        group, rows_of = interfaces.displaced[name, node], f"{3 * node}:{3 * node + 2}"
        if group in interfaces.carrier:
            body = interfaces.carrier[group].body
            yield f"    L[{name!r}][:, {rows_of}] = product(R_T[{name!r}], L[{body!r}][:, :2])"
        elif group not in interfaces.fixed:
            cosines = as_array(L.terms[(f"{name}.c",)])
            columns = [int(np.flatnonzero(cosines[row])[0]) for row in place[node][:2]]
            yield f"    L[{name!r}][:, {rows_of}, {columns}] = R_T[{name!r}]"


def _runs(pairs: Sequence[tuple[int, int]]) -> Iterator[tuple[str, str]]:
    """Ranges of pairs that both increase by one from pair to pair."""
    groups: list[list[tuple[int, int]]] = []
    for row, column in pairs:
        if groups and groups[-1][-1] == (row - 1, column - 1):
            groups[-1].append((row, column))
        else:
            groups.append([(row, column)])
    for group in groups:
        ends = [(first, last + 1) for first, last in zip(group[0], group[-1], strict=True)]
        at, of = (str(i) if j == i + 1 else f"range({i}, {j})".replace("(0, ", "(") for i, j in ends)
        yield at, of


def _foreshortening(texts: Texts) -> str:
    """Rows of each link at joints, and the functions that keep joints closed when bent links shorten."""
    model = texts.model
    held = {name: sorted(texts.interfaces.held_rows(link.part)) for name, link in model.links.items()}
    used: set[int] = set()
    for name, rows in held.items():
        pattern = as_array(texts.frame.maps[name].pattern())[rows]
        used |= set(np.flatnonzero(pattern.sum(axis=0)).tolist())
    used_text = f"USED = {sorted(used)!r}  # elements of z that move them"
    if len(used) == len(model.coordinates):
        used_text = "USED = list(range(N))  # elements of z that move them"
    loose = any(len(rows) < 3 for rows in held.values())
    functions = filled(parts.FORESHORTENING, undetermined=parts.UNDETERMINED * loose)
    texts_held = wrapped("HELD = ", (f"{name!r}: {rows!r}" for name, rows in held.items()), "{}",
                         "  # rows of each link at joints")  # fmt: skip
    return f"\n\n{texts_held}\n{used_text}\n{functions}"


# ---- integration ----


def _integration(model: Model, begun: Trajectory) -> Iterator[str]:
    """Text of the time steps or harmonics of the run."""
    if begun.solver.startswith("spectral"):
        from kaneflex.integrate.spectral import MODES, SPARE, periodic_orbit

        options = model.options
        orbit = periodic_orbit(model.system, model.scalars, 0.0, options.duration, options.tolerance)
        n, subspace = model.system.n, parts.ALL_MODES
        if n > MODES:
            subspace = filled(parts.SUBSPACE, vectors=min(n, MODES + SPARE), modes=MODES)
        yield filled(parts.SPECTRAL, grids=repr(orbit.grids), subspace=subspace)
        return
    yield parts.RADAU
    if model.options.start == "periodic":
        yield parts.REPEATED
        return
    z, v = (tuple(map(float, part[0])) for part in (begun.z, begun.v))
    start = "np.zeros((2, N))" if not any((*z, *v)) else None
    yield filled(parts.FROM_STATE, start=start or repr((z, v)))
