"""Export of a scene's linear equations as a Functional Mock-up Unit (FMI 2.0.5), compiled and packed.

States are z and z', outputs the sensors. Between its steps in co-simulation it interpolates by the quintic through z,
z', z'' at both ends.
"""

from __future__ import annotations

import hashlib
import io
import platform
import uuid
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from kaneflex.export.c_model import CModel, c_model, unread
from kaneflex.export.c_text import Arrays, shared_texts, structure_in_c
from kaneflex.multibody.model.bound_model import Model
from kaneflex.scene.options import resolve_options
from kaneflex.scene.read import SceneLike, scene_from
from kaneflex.solve.repeated_motion import one_way_cure
from kaneflex.support.arguments import takes
from kaneflex.support.c_compiler import CompilerError, c_compiler, shared_library
from kaneflex.support.errors import SceneError
from kaneflex.support.escaping import visible
from kaneflex.support.files import write_bytes
from kaneflex.support.terminal import silent

_FLAGS = ("-O2", "-fvisibility=hidden")
_SYSTEMS = {"Linux": ("linux64", "so"), "Darwin": ("darwin64", "dylib"), "Windows": ("win64", "dll")}
"""Folder and ending of the library by system; FMI 2.0 names no folder for other processors than x86_64."""
_BASE = {"m": {"m": 1}, "s": {"s": 1}, "kg": {"kg": 1}, "rad": {"rad": 1}, "N": {"kg": 1, "m": 1, "s": -2}, "1": {}}
_AT_ANY_TIME, _BEFORE = ("value",), ("speed", "angle", "spin_up", "offset")
"""Numbers of loads that may change during a run, and of drives and loads that may change before it."""


@dataclass(frozen=True)
class Variable:
    """A real variable of the FMU; those with an initial value have a `start`."""

    name: str
    unit: str
    causality: str = "local"
    start: float | None = None
    derivative_of: int | None = None
    meaning: str = ""


@dataclass(frozen=True, eq=False)
class Fmu:
    """Content of the file, its platform (None: sources only), names of sensors, of unread ones, of inputs, and of
    numbers that would be parameters with a start from zero."""

    content: bytes
    compiled_for: str | None
    outputs: tuple[str, ...]
    unread: tuple[str, ...]
    inputs: tuple[str, ...]
    fixed: tuple[str, ...]

    def __repr__(self) -> str:
        return f"Fmu({len(self.outputs)} outputs, {len(self.inputs)} inputs, {len(self.content)} bytes)"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sensors and parameters that are left out, and a missing library."""
        left_out = {
            "left out (angles of bodies that rotate continuously)": self.unread,
            "no parameters, as the initial state depends on them (--set solve.start=zero offers them)": self.fixed,
        }
        missing = "not compiled (no C compiler found); the FMU contains the sources"
        found = [f"{text}: {', '.join(names)}" for text, names in left_out.items() if names]
        return (*found, *(missing,) * (self.compiled_for is None))

    def save(self, path: Path | str) -> None:
        """Write the file, whole or not at all. Raises OutputError."""
        write_bytes(Path(path), self.content)


@takes(scene="scene", progress="function")
def export_fmu(scene: SceneLike, progress: Callable[[str], None] | None = None) -> Fmu:
    """A scene as an FMU for model exchange and co-simulation, with its sources.

    Parameters
    ----------
    scene : Scene, Model, Solution or path
        With a one-way preset that integrates; in space with a periodic motion.

    Returns
    -------
    Fmu
        Inputs are the values of constant loads [N or N m], parameters the drives' speeds and angles and the offsets of
        tables, outputs the sensors. It starts from the initial state of the scene's run; parameters on which this state
        depends (start periodic or quasistatic) are left out.

    Raises
    ------
    SceneError
        For scenes without C code, see :func:`kaneflex.export.c_model.c_model`, and for presets without integration.
    """
    scene, progress = scene_from(scene), progress or silent
    options = resolve_options(scene)
    if options.dynamics == "coupled" or options.integrator == "none":
        reason = "it has nothing to integrate, and an FMU needs that"
        if options.dynamics == "coupled":
            reason = "an FMU needs linear equations, and these are nonlinear"
        cure = one_way_cure(scene, "export", integrated=True)
        raise SceneError("solve.preset", scene.solve.preset, reason, cure)
    made = c_model(scene, progress, "export")
    if made.readings is None:
        reason = "they have no elastic coordinates to integrate"
        raise SceneError("bodies", ", ".join(made.model.links), reason, "Give them more elements")
    name, variables = made.name, _variables(made)
    shared = ("kaneflex_fmi2.c", "kaneflex_fmu.c", "kaneflex_fmu.h")
    texts = {key: text for key, text in made.texts.items() if key.endswith((".c", ".h")) and key != f"{name}_run.c"}
    texts |= shared_texts(shared)
    digest = hashlib.sha256("".join(text for _, text in sorted(texts.items())).encode())
    token = f"{{{uuid.UUID(bytes=digest.digest()[:16])}}}"
    texts[f"{name}_fmu.c"] = _described(made, token)
    sources = sorted(key for key in texts if key.endswith(".c"))
    files = {f"sources/{key}": text.encode() for key, text in texts.items()}
    files["modelDescription.xml"] = _xml(_description(made, token, variables, sources))
    progress("compiling")
    compiled = _compiled(texts, name)
    if compiled is not None:
        files[compiled[0]] = compiled[1]
    inputs = tuple(each.name for each in variables if each.causality in ("input", "parameter"))
    place = None if compiled is None else compiled[0].split("/")[1]
    fixed = tuple(each.name for _, each in _settable(made.model, any_start=True) if each.name not in inputs)
    return Fmu(_packed(files), place, (*made.readings.sensors,), (*unread(made.readings, made.model),), inputs, fixed)


def _settable(model: Model, any_start: bool = False) -> Iterator[tuple[int, Variable]]:
    """Places in p of the variables that can be set, parameters last.

    Excluded are numbers on which precomputed data depend: integrated or tabulated motions, frozen matrices, modes, the
    initial state (unless ``any_start``); in space drives and tables, on which the motion's Fourier series depend.
    """
    parameters = model.module.PARAMETERS
    if model.module.FREE:
        return
    modal = model.scene.damping is not None and model.scene.damping.modal is not None
    plain = model.options.dynamics == "dynamic" and model.modal_basis is None and not modal
    plain = plain and model.in_space is None and (any_start or model.options.start in ("zero", "given"))
    for causality, names in (("input", _AT_ANY_TIME), ("parameter", _BEFORE if plain else ())):
        for place, (path, unit) in enumerate(parameters):
            table, _, name = path.split(".", 2) if path.count(".") >= 2 else (path, "", "")
            if table in ("drives", "loads") and name in names:
                yield place, Variable(path, unit, causality, float(model.motion.parameters[place]))


def _variables(made: CModel) -> list[Variable]:
    """All variables in the order of their value references, as in kaneflex_fmu.h."""
    model, readings, names = made.model, made.readings, made.model.reduced.coordinates
    assert readings is not None
    found = [Variable("time", "s", "independent")] + [each for _, each in _settable(model)]
    first, n = len(found), len(names)
    units = ["rad" if name.endswith(("theta", "phi")) else "m" for name in names]
    for prefix, by, begun in (("", "", made.start[0]), ("rate of ", "/s", made.start[1])):
        found += [
            Variable(f"{prefix}{name}", f"{unit}{by}", start=start)
            for name, unit, start in zip(names, units, begun, strict=True)
        ]
    for power, order in (("", 0), ("^2", 1)):
        for k, (name, unit) in enumerate(zip(names, units, strict=True), start=first + order * n):
            of = f"rate of {name}" if order else name
            found.append(Variable(f"der({of})", f"{unit}/s{power}", derivative_of=k))
    sensors = model.scene.sensors
    return found + [
        Variable(name, sensors[name].unit, "output", meaning=model.scene.meaning_of(sensors[name]))
        for name in readings.sensors
    ]


def _described(made: CModel, token: str) -> str:
    """C source that connects the model with the shared functions."""
    name, settable = made.name, list(_settable(made.model))
    inputs = sum(variable.causality == "input" for _, variable in settable)
    first = (f'&{name}_linear, &{name}_readings, "{token}", {name.upper()}_MEMORY, '
             f"{len(made.model.motion.parameters)}, {len(settable)}, {inputs}")  # fmt: skip
    places: Arrays = {"places": ("size_t", [place for place, _ in settable])}
    texts = structure_in_c("kaneflex_fmu_model", "kaneflex_fmu", name, first, places)
    return "\n".join([f'#include "{name}_data.h"\n#include "kaneflex_fmu.h"\n', *texts])


def _node(tag: str, /, *children: ElementTree.Element, **given: object) -> ElementTree.Element:
    """XML element; attributes that are None are left out."""
    node = ElementTree.Element(tag, {key: visible(str(value)) for key, value in given.items() if value is not None})
    node.extend(children)
    return node


def _description(made: CModel, token: str, variables: list[Variable], sources: list[str]) -> ElementTree.Element:
    from kaneflex import __version__

    model, scene = made.model, made.model.scene
    state = {"canGetAndSetFMUstate": "true", "modelIdentifier": made.name}
    files = _node("SourceFiles", *(_node("File", name=source) for source in sources))
    experiment = {"startTime": 0.0, "stopTime": float(model.options.duration), "stepSize": float(model.step)}
    children = [
        _node("ModelExchange", files, **state),
        _node("CoSimulation", files, **state, canHandleVariableCommunicationStepSize="true"),
        _units(variables),
        _node("DefaultExperiment", **experiment),
        _node("ModelVariables", *map(_variable, range(len(variables)), variables)),
        _node("ModelStructure", *_structure(variables)),
    ]
    return _node(
        "fmiModelDescription", *children, fmiVersion="2.0", guid=token, numberOfEventIndicators="0",
        modelName=scene.name, generationTool=f"kaneflex {__version__}", variableNamingConvention="flat",
        description=scene.description or None,
    )  # fmt: skip


def _structure(variables: list[Variable]) -> Iterator[ElementTree.Element]:
    """Outputs and derivatives of states, by their indices from one."""
    outputs = [k for k, each in enumerate(variables) if each.causality == "output"]
    derivatives = [k for k, each in enumerate(variables) if each.derivative_of is not None]
    groups = {"Outputs": outputs, "Derivatives": derivatives, "InitialUnknowns": outputs + derivatives}
    for tag, numbers in groups.items():
        if numbers:
            yield _node(tag, *(_node("Unknown", index=k + 1) for k in sorted(numbers)))


def _variable(reference: int, variable: Variable) -> ElementTree.Element:
    after = None if variable.derivative_of is None else variable.derivative_of + 1
    initial = "calculated" if variable.start is None else "exact"
    return _node(
        "ScalarVariable", _node("Real", unit=variable.unit, start=variable.start, derivative=after),
        name=variable.name, causality=variable.causality,
        variability="fixed" if variable.causality == "parameter" else "continuous",
        description=variable.meaning or None,
        initial=None if variable.causality in ("input", "independent") else initial, valueReference=reference,
    )  # fmt: skip


def _units(variables: list[Variable]) -> ElementTree.Element:
    """Units by powers of the base units."""
    units = []
    for unit in dict.fromkeys(variable.unit for variable in variables):
        powers = Counter[str]()
        above, _, below = unit.partition("/")
        for sign, part in ((1, above), (-1, below)):
            for base, _, power in (word.partition("^") for word in part.split()):
                for name, by in _BASE[base].items():
                    powers[name] += sign * by * int(power or 1)
        given = {name: power for name, power in powers.items() if power}
        units.append(_node("Unit", _node("BaseUnit", **given), name=unit))
    return _node("UnitDefinitions", *units)


def _xml(root: ElementTree.Element) -> bytes:
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _compiled(texts: Mapping[str, str], name: str) -> tuple[str, bytes] | None:
    """Path in the archive and content of the compiled library; None without a compiler or for an unknown platform.

    Raises
    ------
    SceneError
        If the compiler fails.
    """
    command = c_compiler()
    folder, suffix = _SYSTEMS.get(platform.system(), ("", ""))
    if not command or not folder or platform.machine().lower() not in ("x86_64", "amd64"):
        return None
    try:
        return f"binaries/{folder}/{name}.{suffix}", shared_library(command, texts, _FLAGS)
    except CompilerError as error:
        problem = f"the C does not compile: {error}"
        raise SceneError("CC", command[0], problem, "Set CC to another C11 compiler") from error


def _packed(files: Mapping[str, bytes]) -> bytes:
    """Zip archive with reproducible bytes."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            archive.writestr(zipfile.ZipInfo(name), files[name], zipfile.ZIP_DEFLATED)
    return content.getvalue()
