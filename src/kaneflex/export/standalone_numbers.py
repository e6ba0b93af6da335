"""Numbers of a model in one file, and the functions that it takes from the generated modules."""

from __future__ import annotations

import ast
import io
import re
import textwrap
import tokenize
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from kaneflex.export import standalone_text as parts
from kaneflex.generated.rows import BODY_SCALARS
from kaneflex.multibody.model.bound_model import Model
from kaneflex.support.errors import SceneError
from kaneflex.support.escaping import visible

LINE = 118
"""Largest line length, without a trailing comma."""
ELSE = "Use --language c or `kaneflex run`"
"""Advice for scenes that the file does not support."""


def filled(text: str, **values: object) -> str:
    """Text with the names in double brackets replaced."""
    return re.sub("<<(\\w+)>>", lambda found: str(values[found[1]]), text)


def _source(name: str, module: ModuleType) -> tuple[ast.FunctionDef, str]:
    """A function of a module's file and its text, including the decorator."""
    text = Path(str(module.__file__)).read_text(encoding="utf-8")
    node = next(each for each in ast.parse(text).body if isinstance(each, ast.FunctionDef) and each.name == name)
    first = min([node.lineno, *(each.lineno for each in node.decorator_list)])
    return node, "\n".join(text.split("\n")[first - 1 : node.end_lineno])


_UNPACKED = re.compile(r"    \(?([^()\"]*?)\)? = unpacked\(p, \d+\)\n")
"""Statement that unpacks the numbers of ``motion``."""


def names_of_parameters(model: Model) -> dict[str, str]:
    """Path of a number that ``motion`` reads -> its name there, in the order of p."""
    found = _UNPACKED.search(_source("motion", model.module)[1])
    assert found is not None
    names = [name.strip() for name in found[1].split(",") if name.strip()]
    called: dict[str, str] = {}
    for (path, _), name in zip(model.module.PARAMETERS, names, strict=False):
        plain = re.sub(r"\W+", "_", path.split(".", 1)[1], flags=re.ASCII)
        while name == "_" or name in called.values():
            name, plain = plain, f"{plain}_"
            name = "_" if name in names else name
        called[path] = name
    return called


def parameters(model: Model) -> str:
    """Fields with the numbers that ``motion`` reads, except places of tables."""
    units = dict(model.module.PARAMETERS)
    lines = []
    for k, (path, name) in enumerate(names_of_parameters(model).items()):
        unit = "" if units[path] == "1" else f" [{units[path]}]"
        if not path.endswith(".table"):
            lines.append(f"    {name}: float = {float(model.motion.parameters[k])!r}  # {visible(path)}{unit}")
    return "\n".join(lines)


def number(model: Model, path: str, value: float) -> str:
    """A number of the scene, by its name in P if it has one."""
    names = names_of_parameters(model)
    return f"P.{names[path]}" if path in names else short(value)


def short(value: float | Sequence[float]) -> str:
    """A number or a tuple of numbers; whole numbers without decimals."""
    if isinstance(value, Sequence):
        return f"({', '.join(map(short, value))})"
    return str(int(value)) if float(value).is_integer() and abs(value) < 1e6 else repr(float(value))


def wrapped(name: str, entries: Iterable[object], brackets: str = "()", note: str = "", indent: int = 0) -> str:
    """Statement with a list of entries, broken into aligned lines."""
    texts = [f"{each}," for each in entries]
    if not texts:
        return f"{' ' * indent}{name}{brackets}{note}"
    head = f"{' ' * indent}{name}{brackets[0]}"
    lines = [head]
    for text in texts:
        if len(lines[-1]) + len(text) >= LINE and lines[-1].strip() != head.strip():
            lines.append(" " * len(head))
        lines[-1] += text if lines[-1].endswith(brackets[0]) or not lines[-1].strip() else f" {text}"
    last = lines[-1][:-1] if len(texts) > 1 or brackets != "()" else lines[-1]
    whole = [*(line.rstrip() for line in lines[:-1]), f"{last}{brackets[1]}"]
    if note and len(whole[0]) + len(note) > LINE + 2:
        whole.insert(0, note.strip())
    else:
        whole[0] += note
    return "\n".join(whole)


def narrowed(text: str) -> str:
    """Text with long lines broken after commas within brackets, aligned with the bracket's content."""
    while (found := _last_comma(text)) is not None:
        row, column, below = found
        lines = text.split("\n")
        line = lines[row]
        lines[row : row + 1] = [line[: column + 1], " " * below + line[column + 1 :].lstrip()]
        text = "\n".join(lines)
    return text


def _last_comma(text: str) -> tuple[int, int, int] | None:
    """First line that is too long: its number, and the columns of the last possible break and of the alignment."""
    lines, opened, found, depth = text.split("\n"), list[int](), None, 0
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        row, column = token.start[0] - 1, token.start[1]
        if found is not None and row > found[0]:
            break
        if token.type != tokenize.OP:
            continue
        if token.string in "([{":
            opened.append(column + 1)
        elif token.string in ")]}":
            opened.pop()
        elif token.string == "," and opened and len(lines[row]) > LINE + 2 and opened[-1] < column < LINE:
            if found is None or len(opened) <= depth:
                found, depth = (row, column, opened[-1]), len(opened)
    return found


def kept_scalars(model: Model) -> dict[int, int]:
    """Indices of the scalars that the file reads -> indices in the file; forces of rigid joints are dropped."""
    joints = tuple(f"{name}." for name in model.scene.joints)
    kept = [k for k, (name, *_) in enumerate(model.module.SCALARS) if not name.startswith(joints)]
    return {k: place for place, k in enumerate(kept)}


def data(model: Model) -> str:
    scene, options, module = model.scene, model.options, model.module
    alpha, beta = model.rayleigh
    lines = [
        *[f"GRAVITY = np.array({short(tuple(scene.gravity))})  # m/s^2"] * any(scene.gravity),
        f"ALPHA, BETA = {float(alpha)!r}, {float(beta)!r}  # Rayleigh damping [1/s], [s]",
        "ACROSS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # before a displacement and rotation",
        f"STEPS, DURATION, N = {options.steps}, {float(options.duration)!r}, {len(model.coordinates)}"
        "  # steps and duration [s] of the run, elastic coordinates z",
    ]
    beams = []
    for name, link in model.links.items():
        values = (repr(float(link.parameters[key][0])) for key in ("rho_A", "E_A", "E_I"))
        beams.append(f"{name!r}: ({_knots(link.nodes)}, {', '.join(values)})")
    lines.append("# elastic links: nodes [m], rho A [kg/m], E A [N], E I [N m^2]")
    lines.append(wrapped("LINKS = ", beams, "{}"))
    lines.append(wrapped("SCALARS = ", (repr(module.SCALARS[k][0]) for k in kept_scalars(model))))
    fixed = [f"{name!r}: {value!r}" for name, value in module.CONSTANTS.items() if value]
    known = {name for name, *_ in module.SCALARS} | set(module.CONSTANTS)
    frames = (f"{body}.{name}" for body in scene.bodies for name in BODY_SCALARS)
    fixed += [f"{name!r}: math.nan" for name in frames if name not in known]  # never read
    lines.append(wrapped("CONSTANTS = ", fixed, "{}", "  # scalars in neither are zero"))
    return "\n".join(lines)


def tables(model: Model) -> Iterator[str]:
    """Values of the tables that the motion reads, and the functions that read them."""
    known: dict[tuple[bytes, bytes], str] = {}
    for path in model.module.TABLES:
        reader = getattr(model.scene, path.split(".")[0])[path.split(".")[1]]
        if reader.period is None or reader.interpolation != "spline" or path.startswith("drives."):
            reason = "the file supports periodic tables of loads with splines only"
            raise SceneError(f"{path}.interpolation", reader.interpolation, reason, ELSE)
        table = reader.read_table()
        if abs(np.linspace(0.0, table.x[-1], len(table.x)) - table.x).max() > 1e-12 * table.x[-1]:
            raise SceneError(f"{path}.table", None, "its rows are not evenly spaced from zero", ELSE)
        if not known:
            yield parts.SPLINE
        name = f"TABLE_{len(known) + 1}"
        same = known.setdefault((table.x.tobytes(), table.y.tobytes()), name)
        if same == name:
            yield _table(name, table.x, np.append((table.y[0] + table.y[-1]) / 2, table.y[1:-1]))


def _knots(x: np.ndarray) -> str:
    """Text of a row of numbers; evenly spaced ones by their ends."""
    if abs(np.linspace(x[0], x[-1], len(x)) - x).max() <= 1e-15 * abs(x).max():
        return f"np.linspace({float(x[0])!r}, {float(x[-1])!r}, {len(x)})"
    return f"np.array({tuple(x.tolist())!r})"


def _table(name: str, x: np.ndarray, y: np.ndarray) -> str:
    """A table by its values; decimal numbers as short differences of whole numbers."""
    scale = next((10**k for k in range(8) if (np.round(y * 10**k) / 10**k == y).all()), None)
    words, kind, of = [repr(each) for each in y.tolist()], "float", ""
    if scale is not None:
        whole = np.round(y * scale).astype(int)
        texts = [" ".join(map(str, np.diff(whole, n=n, prepend=[0] * n).tolist())) for n in range(5)]
        n = min(range(5), key=lambda n: len(texts[n]))
        words, kind, of = texts[n].split(), "int", f"{'.cumsum()' * n} / {float(scale)!r}"
    rows = [textwrap.fill(part.strip(), LINE, break_on_hyphens=False)
            for part in re.split(r"(?<!\S)((?:0 ){100,})", " ".join(words))]  # fmt: skip
    rows[1::2] = [f'""" + {row.split().count("0")} * "0 " + """' for row in rows[1::2]]
    text, step = "\n".join(rows), float(x[-1] / (len(x) - 1))
    return (f'\n\n{name} = spline(np.array(("""\n{text}\n""").split(), dtype={kind}){of}, {step!r})'
            f"{'  # by differences' * bool(of)}\n")  # fmt: skip


# ---- functions of the generated modules ----


def functions(model: Model) -> list[str]:
    """Text of ``motion``, after the functions of laws that it calls."""
    from kaneflex.generated import laws

    node, text = _source("motion", model.module)
    head, body = text[: text.rindex('"""') + 4], _UNPACKED.split(text)[-1]
    body = _pruned(body, kept_scalars(model))
    places = _places(model)
    body = re.sub(r", p, int\((\w+)\)\)", lambda found: f", *{places[found[1]]})", body)
    assert not re.search(r"\bp\b", body), "motion reads p in an unknown way"
    names = [name for path, name in names_of_parameters(model).items() if not path.endswith(".table")]
    waiting, known = [node], dict[str, str]()
    while waiting:
        for each in ast.walk(waiting.pop()):
            name = each.func.id if isinstance(each, ast.Call) and isinstance(each.func, ast.Name) else ""
            if name not in known and hasattr(getattr(laws, name, None), "py_func"):
                called, known[name] = _source(name, laws)
                waiting.append(called)
    return [_function(each) for each in (*reversed(known.values()), head + _unpacking(names, body) + body)]


def _pruned(body: str, kept: dict[int, int]) -> str:
    """Statements without those that only dropped scalars need, with the other scalars renumbered."""
    found: list[str] = []
    needed: set[str] = set()
    for line in reversed(body.rstrip("\n").split("\n")):
        statement = ast.parse(line.strip()).body[0]
        assert isinstance(statement, ast.Assign)
        names = [target.id for target in statement.targets if isinstance(target, ast.Name)]
        stored = [target.slice for target in statement.targets if isinstance(target, ast.Subscript)]
        slots = [kept[slot] for slot in map(ast.literal_eval, stored) if slot in kept]
        names = [name for name in names if name in needed]
        if names or slots:
            value = line.rpartition(" = ")[2]
            found.append("    " + " = ".join([*names, *(f"s[{slot}]" for slot in slots), value]))
            needed |= {node.id for node in ast.walk(statement.value) if isinstance(node, ast.Name)}
    return "\n".join(reversed(found)) + "\n"


def _unpacking(names: Sequence[str], text: str) -> str:
    used = [name if re.search(rf"\b{name}\b", text) else "_" for name in names]
    line = f"    {', '.join(used)}{',' * (len(used) == 1)} = p"
    return f"{line if len(line) <= LINE else wrapped('', used, indent=4) + ' = p'}\n"


def _places(model: Model) -> dict[str, str]:
    """Name of a table's place in the text of ``motion`` -> the table."""
    names, known, found = names_of_parameters(model), dict[tuple[bytes, bytes], str](), {}
    for path in model.module.TABLES:
        table = getattr(model.scene, path.split(".")[0])[path.split(".")[1]].read_table()
        found[names[f"{path}.table"]] = known.setdefault(
            (table.x.tobytes(), table.y.tobytes()), f"TABLE_{len(known) + 1}"
        )
    return found


def _function(text: str) -> str:
    """Text of a function with the first line of its docstring; long lines are broken."""
    text = re.sub(r'(?s)"""(.*?)\n.*?"""', r'"""\1"""', text, count=1)
    return "\n\n" + "\n".join(_broken(line) for line in text.split("\n")).rstrip() + "\n"


def _broken(line: str) -> str:
    if len(line) <= LINE + 2 or " = " not in line:
        return line
    head, _, value = line.rpartition(" = ")
    begin = f"{head} = ("
    body = textwrap.fill(value, LINE, initial_indent=begin, subsequent_indent=" " * len(begin), break_on_hyphens=False,
                         break_long_words=False)  # fmt: skip
    return f"{body})"
