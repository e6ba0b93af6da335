"""Data of a model in one file, and the functions that it takes from the generated modules."""

from __future__ import annotations

import ast
import re
import textwrap
from collections.abc import Iterable, Iterator
from inspect import getsource
from pprint import pformat

import numpy as np

from kaneflex.export import standalone_text as parts
from kaneflex.export.standalone_points import Points
from kaneflex.multibody.model.bound_model import Model
from kaneflex.support.errors import SceneError

LINE = 118
"""Largest line length, without a trailing comma."""
ELSE = "Use --language c or `kaneflex run`"
"""Advice for scenes that the file does not support."""


def filled(text: str, **values: object) -> str:
    """Text with the names in double brackets replaced."""
    return re.sub("<<(\\w+)>>", lambda found: str(values[found[1]]), text)


def broken(line: str, indent: int, end: str = "") -> str:
    """A line of code, broken at spaces within its outermost brackets; its end is not broken."""
    text = line + end.replace(" ", "\xa0")
    return textwrap.fill(text, LINE, subsequent_indent=" " * indent, break_on_hyphens=False, break_long_words=False,
                         replace_whitespace=False).replace("\xa0", " ")  # fmt: skip


class Code(str):
    """Expression that stands in data as it is."""

    __repr__ = str.__str__


def assigned(name: str, value: object, note: str = "") -> str:
    """Assignment of data after a comment on it."""
    text = pformat(value, width=LINE - len(name) - 3, compact=True, sort_dicts=False)
    first, *rest = f"{name} = {text}".split("\n")
    lines = "\n".join([first, *(" " * (len(name) + 3) + line for line in rest)])
    if rest or len(first) + len(note) + 4 > LINE:
        return f"# {note}\n{lines}"
    return f"{lines}  # {note}" if note else lines


def in_lines(rows: Iterable[tuple[str, str]], indent: int) -> str:
    """Dictionary of entries and their units; entries of one unit share lines."""
    lines: list[tuple[str, str]] = []
    for row, unit in rows:
        if lines and lines[-1][1] == unit and indent + len(lines[-1][0]) + len(row) + len(unit) < LINE:
            lines[-1] = f"{lines[-1][0]} {row},", unit
        else:
            lines.append((f"{row},", unit))
    wrapped = [broken(" " * indent + line, indent, f"  # {unit}") for line, unit in lines]
    text = "\n".join(wrapped).lstrip()
    last = text.rindex(",  # ")
    return f"{{{text[:last]}}}{text[last + 1 :]}"


# ---- data ----


def data(points: Points) -> str:
    """Definitions of the scene's data."""
    model, scene = points.model, points.scene
    alpha, beta = model.rayleigh
    links = {
        name: (_knots(link.nodes), *(float(link.parameters[key][0]) for key in ("rho_A", "E_A", "E_I")))
        for name, link in model.links.items()
    }
    lines = [
        _parameters(points),
        *[f"GRAVITY = np.array({tuple(scene.gravity)})  # m/s^2"] * any(scene.gravity),
        f"ALPHA, BETA = {float(alpha)!r}, {float(beta)!r}  # Rayleigh damping [1/s], [s]",
        f"STEPS, DURATION, N = {model.options.steps}, {float(model.options.duration)!r}, {len(model.coordinates)}"
        "  # steps and duration [s] of the run, elastic coordinates z",
        assigned("BODIES", ("ground", *scene.bodies)),
        assigned("LINKS", links, "elastic links: nodes [m], rho A [kg/m], E A [N], E I [N m^2]"),
        assigned("GUIDED", points.guided(), "rigid bodies on guides: axes and direction of the guide, element of z"),
        assigned("OWN", points.own(), "rows of q of a link that are elements of z"),
        assigned("JOINED", points.joined(), "nodes moved by a body, or by global elements of z"),
        assigned("MASSES", points.masses(), "body and node, numbers in P, position"),
        "INERTIA = {of: np.array([P.get(f'{of}.{key}', 0) for key in ('mass', 'mass', 'inertia')])"
        " for *_, of, _ in MASSES}",
        assigned("FORCES", points.forces(), "body and node, position, axes and direction"),
    ]
    return "\n".join(lines)


def _parameters(points: Points) -> str:
    """Numbers that ``motion`` reads, and masses, with their units."""
    model = points.model
    read, units = _of_motion(model)[0].values(), dict(model.module.PARAMETERS)
    values = dict(zip(units, model.motion.parameters.tolist(), strict=False))
    tables = {f"{path}.table": Code(table) for path, table in _tables(model).items()}
    rows = [(f"{path!r}: {tables.get(path, values[path])!r}", units[path]) for path in read]
    rows += [(f"{path!r}: {value!r}", unit) for path, value, unit in points.weights() if value and path not in read]
    return f"P = {in_lines(rows, 5)}"


def _knots(x: np.ndarray) -> Code:
    """Text of a row of numbers; evenly spaced ones by their ends."""
    if abs(np.linspace(x[0], x[-1], len(x)) - x).max() <= 1e-15 * abs(x).max():
        return Code(f"np.linspace({float(x[0])!r}, {float(x[-1])!r}, {len(x)})")
    return Code(f"np.array({tuple(x.tolist())!r})")


def _tables(model: Model) -> dict[str, str]:
    """Load -> name of its table in the file; equal tables are written once."""
    known: dict[tuple[bytes, bytes], str] = {}
    found = {}
    for path in model.module.TABLES:
        table = getattr(model.scene, path.split(".")[0])[path.split(".")[1]].read_table()
        found[path] = known.setdefault((table.x.tobytes(), table.y.tobytes()), f"TABLE_{len(known) + 1}")
    return found


def tables(model: Model) -> Iterator[str]:
    """Values of the tables that the motion reads, and the functions that read them."""
    written = set[str]()
    for path, name in _tables(model).items():
        reader = getattr(model.scene, path.split(".")[0])[path.split(".")[1]]
        if reader.period is None or reader.interpolation != "spline" or path.startswith("drives."):
            reason = "the file supports periodic tables of loads with splines only"
            raise SceneError(f"{path}.interpolation", reader.interpolation, reason, ELSE)
        table = reader.read_table()
        if abs(np.linspace(0.0, table.x[-1], len(table.x)) - table.x).max() > 1e-12 * table.x[-1]:
            raise SceneError(f"{path}.table", None, "its rows are not evenly spaced from zero", ELSE)
        if not written:
            yield parts.SPLINE
        if name not in written:
            yield _table(name, table.x, np.append((table.y[0] + table.y[-1]) / 2, table.y[1:-1]))
        written.add(name)


def _table(name: str, x: np.ndarray, y: np.ndarray) -> str:
    """A table by its values; decimal numbers as short differences of whole numbers."""
    scale = next((10**k for k in range(8) if (np.round(y * 10**k) / 10**k == y).all()), None)
    words, kind, of = " ".join(map(repr, y.tolist())), "float", ""
    if scale is not None:
        whole = np.round(y * scale).astype(int)
        texts = [" ".join(map(str, np.diff(whole, n=n, prepend=[0] * n).tolist())) for n in range(5)]
        n = min(range(5), key=lambda n: len(texts[n]))
        words, kind, of = texts[n], "int", f"{'.cumsum()' * n} / {float(scale)!r}"
    step = float(x[-1] / (len(x) - 1))
    return (f'\n\n{name} = spline(np.array("""\n{textwrap.fill(words, LINE, break_on_hyphens=False)}\n"""'
            f".split(), dtype={kind}){of}, {step!r}){'  # by differences' * bool(of)}\n")  # fmt: skip


# ---- functions of the generated modules ----


def functions(model: Model) -> Iterator[str]:
    """Text of ``scalars``, after the functions of laws that it calls."""
    from kaneflex.generated import laws

    names, body = _of_motion(model)
    assert not re.search(r"\bp\b", body), "motion reads p in an unknown way"
    waiting, known = [body], dict[str, str]()
    while waiting:
        for name in re.findall(r"(?<![.\w])(\w+)\(", waiting.pop()):
            law = getattr(getattr(laws, name, None), "py_func", None)
            if name not in known and law is not None:
                known[name] = getsource(law).partition("\n")[2]
                waiting.append(known[name])
    yield from (f"\n\n{text}" for text in reversed(known.values()))
    fixed = {"ground.c": 1.0} | {name: value for name, value in model.module.CONSTANTS.items() if value}
    rows = broken(f"    ({', '.join(names)},", 5, " *_) = p.values()")
    yield filled(parts.SCALARS, fixed=fixed, names=rows, body=body)


def _of_motion(model: Model) -> tuple[dict[str, str], str]:
    """Name of a number that ``motion`` reads -> its path, sorted by unit, and the statements that read them."""
    source = getsource(model.module.motion.py_func)
    statements = [each for each in ast.walk(ast.parse(source)) if isinstance(each, ast.Assign)]
    reads = [each for each in statements if ast.unparse(each.value).startswith(("p[", "(p["))]
    names = [name for read in reads for name in re.findall(r"\w+", ast.unparse(read.targets[0]))]
    places = [int(place) for read in reads for place in re.findall(r"\d+", ast.unparse(read.value))]
    body = _pruned(model, "\n".join(source.split("\n")[reads[-1].end_lineno :]))
    body = re.sub(r"\btable\((.*?), p, int\((\w+)\)\)", r"\2(\1)", body)
    numbers = [model.module.PARAMETERS[place] for place in places]
    read = sorted(zip(names, numbers, strict=True), key=lambda each: each[1][1])
    return {name: path for name, (path, _) in read if re.search(rf"\b{name}\b", body)}, body


def _pruned(model: Model, body: str) -> str:
    """Statements of the motion, scalars by their names, without the forces of rigid joints and what only they need."""
    joints = tuple(f"{name}." for name in model.scene.joints)
    scalars = [name for name, *_ in model.module.SCALARS]
    found: list[str] = []
    needed: set[str] = set()
    for line in reversed(body.rstrip("\n").split("\n")):
        statement = ast.parse(line.strip()).body[0]
        assert isinstance(statement, ast.Assign)
        names = [target.id for target in statement.targets if isinstance(target, ast.Name) and target.id in needed]
        slots = [each.slice for each in statement.targets if isinstance(each, ast.Subscript)]
        stored = [scalars[ast.literal_eval(slot)] for slot in slots]
        names += [f"s[{name!r}]" for name in stored if not name.startswith(joints)]
        if names:
            head, value = f"    {' = '.join(names)} = ", line.rpartition(" = ")[2]
            fits = len(head) + len(value) <= LINE
            found.append(head + value if fits else broken(f"{head}({value})", len(head) + 1))
            needed |= {node.id for node in ast.walk(statement.value) if isinstance(node, ast.Name)}
    return "\n".join(reversed(found))
