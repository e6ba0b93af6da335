"""Mutated scenes: keys, values, units and tables of the shipped ones, and their text, changed at random.

A mutant is known by its seed. Whatever it is, reading it ends in a `Scene` or in the project's own error, in time.
`python tests/scene_fuzz.py COUNT FIRST` reads COUNT of them from seed FIRST on and names those that do not; with
`--runs` it runs a hundredth of shipped scenes whose numbers were changed, under one preset after the other.
"""

from __future__ import annotations

import copy
import json
import random
import signal
import sys
import tempfile
import time
import tomllib
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from kaneflex import Scene, Solution, UserError, load, read_scene, shipped_scenes, simulate, with_settings
from kaneflex.fem.links import make_link
from kaneflex.fem.spatial_joined import held_nodes
from kaneflex.mechanism.floating_frames import most_modes
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.position_analysis import place
from kaneflex.mechanism.rigid_bodies import check_elastic
from kaneflex.scene.options import acting, resolve_options
from kaneflex.scene.start import Start
from kaneflex.scene.structure import structure_hash
from kaneflex.solve.engine_loading import spatial_start

WORDS = (
    "", " ", "none", "true", "x", "t", "start", "end", "ground", "ground.origin", "rod.end", "crank", "a.b.c", "..",
    "/", "../../x", "~", "\x00", "\n", '"', "'", "\\", "é", "m²", "\u202e", "x" * 300, "x" * 5000, "rod." + "y" * 500,
    "engine", "gas.csv", "steel", "I", "+", "-", "global", "periodic", "coupled", "paper", "rigid", "adams", "all",
    "__import__('os')", "__class__", "{0}", "%s", "1", "0", "-1", "1e400", "nan", "inf", "1 m/0", "1 m**9**9**9**9",
    "1 m^1e9", "1 1/m", "1 m*" + "m*" * 50 + "m", "5 degC", "1 dB", "3 m s", "0 mm", "-3 kg", "1e60 m", "1e-60 m",
    "9" * 400 + " m", "1 \N{MICRO SIGN}m", "1 \N{GREEK SMALL LETTER MU}m", "1" + " " * 5000 + "m", "1 mm^2", "1 N m",
)  # fmt: skip
NUMBERS = (
    0, 1, -1, 2, 3, 0.5, -0.0, 1e-300, 1e-61, 1e-60, 1e-9, 1e9, 1e60, 1e61, 1e300, 10**29, 10**400, 2**63, -(2**63),
    float("inf"), float("-inf"), float("nan"), 720, 1e-3,
)  # fmt: skip
THINGS = (
    True, False, [], {}, [[]], [1], [1, 2], [0, 0], [1, 2, 3], ["1 m", "2 s"], {"x": 1}, [{}], ["rod.end", "crank"],
)  # fmt: skip
LAW_PARTS = (
    "t", "pi", "0", "1", "2", "1e3", "1e59", "1e400", "main", "main_speed", "hub", "x", "__class__", "(", ")", "+", "-",
    "*", "/", "**", "^", "%", "sin(", "exp(", "log(", "sqrt(", "tan(", "abs(", "max(", " if t else ", "[",
    "1j", "'", ".",
)  # fmt: skip
UNITS = (
    "mm", "m", "kg", "s", "deg", "rpm", "N", "kN m", "Hz", "%", "m/s", "parsec", "mmm", "RPM", "degC", "", "1/0", "^",
)  # fmt: skip


STRANGE = (b"\xff", b"\x00", b"[", b"=", b'"', b"\n", b"9" * 5000, b"\xef\xbb\xbf", b"." * 99)


def written_toml(table: dict[str, Any]) -> str:
    """A table as TOML, on inline tables alone beneath the top."""
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return _text(key)


def _text(text: str) -> str:
    return json.dumps(text).replace("\x7f", "\\u007f")


def _value(value: object) -> str:
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case dict():
            return "{" + ", ".join(f"{_key(key)} = {_value(inner)}" for key, inner in value.items()) + "}"
        case list():
            return "[" + ", ".join(map(_value, value)) + "]"
    return repr(value)


def paths(table: dict[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The paths of all keys, tables too."""
    for key, value in table.items():
        yield (*above, key)
        if isinstance(value, dict):
            yield from paths(value, (*above, key))


def _owner(table: dict[str, Any], path: tuple[str, ...]) -> dict[str, Any]:
    for key in path[:-1]:
        table = table[key]
    return table


def _anything(pick: random.Random) -> object:
    return copy.deepcopy(pick.choice(pick.choice((WORDS, NUMBERS, THINGS))))


def _drop(raw, path, pick, others):
    del _owner(raw, path)[path[-1]]


def _replace(raw, path, pick, others):
    _owner(raw, path)[path[-1]] = _anything(pick)


def _rename(raw, path, pick, others):
    """To another key of any scene, a misspelt one, or a word."""
    owner, other = _owner(raw, path), pick.choice(others)
    at = pick.randrange(len(path[-1]) + 1)
    misspelt = path[-1][:at] + pick.choice("_xé.0") + path[-1][at:]
    name = pick.choice((misspelt, pick.choice([*paths(other)])[-1], pick.choice(WORDS)))
    owner[name] = owner.pop(path[-1])


def _reunit(raw, path, pick, others):
    """Another unit, or another power of ten, for a number; a law's part for a law."""
    owner, key = _owner(raw, path), path[-1]
    value = owner[key]
    if isinstance(value, list) and value:
        value = list(value)
        value[pick.randrange(len(value))] = _anything(pick)
        owner[key] = value
    elif isinstance(value, str) and value[:1].isdigit():
        number, _, unit = value.partition(" ")
        scaled = f"{number}e{pick.randint(-70, 70)} {unit}"
        owner[key] = pick.choice((f"{number} {pick.choice(UNITS)}", scaled, f"-{value}"))
    elif isinstance(value, int | float):
        factor = 10.0 ** pick.randint(-70, 70)
        scaled = value if abs(value) > sys.float_info.max else value * factor  # whole numbers may be larger
        owner[key] = pick.choice((-value, scaled, f"{value} {pick.choice(UNITS)}"))
    else:
        owner[key] = _anything(pick)


def _law(raw, path, pick, others):
    """A law of random parts, for a drive or a load."""
    table = raw.get(pick.choice(["drives", "loads"]))
    entries = [entry for entry in table.values() if isinstance(entry, dict)] if isinstance(table, dict) else []
    if not entries:
        return
    entry = pick.choice(entries)
    for key in ("speed", "table", "value", "column", "unit", "against", "period", "offset", "cycle", "spin_up"):
        entry.pop(key, None)
    entry["law"] = "".join(pick.choice(LAW_PARTS) for _ in range(pick.choice((1, 3, 5, 8, 13, 400))))


def _swap(raw, path, pick, others):
    other = pick.choice([*paths(raw)])
    short = min(len(path), len(other))
    if path[:short] != other[:short]:
        one, two = _owner(raw, path), _owner(raw, other)
        one[path[-1]], two[other[-1]] = two[other[-1]], one[path[-1]]


def _graft(raw, path, pick, others):
    """A piece of another scene, where it stands there or anywhere."""
    other = pick.choice(others)
    source = pick.choice([*paths(other)])
    piece = copy.deepcopy(_owner(other, source)[source[-1]])
    owner = raw
    for key in source[:-1]:
        owner = owner.setdefault(key, {})
        if not isinstance(owner, dict):
            return
    if pick.random() < 0.7:
        owner[source[-1]] = piece
    else:
        _owner(raw, path)[path[-1]] = piece


def _double(raw, path, pick, others):
    """A second entry beside one, like it or the same."""
    owner = _owner(raw, path)
    twin = pick.choice(({"like": path[-1]}, copy.deepcopy(owner[path[-1]])))
    owner[pick.choice(("twin", "main_speed", *WORDS))] = twin


Number = tuple[Any, Any, Any]
"""The table or list that holds it, its key there, and itself, alone or with a unit."""


def _numbers(raw: dict[str, Any]) -> list[Number]:
    """All numbers of a scene, wherever they stand."""
    found: list[Number] = [(raw, key, value) for key, value in raw.items() if key != "schema"]
    numbers = []
    while found:
        owner, key, value = found.pop()
        if isinstance(value, dict):
            found += [(value, inner, each) for inner, each in value.items()]
        elif isinstance(value, list):
            found += [(value, k, each) for k, each in enumerate(value)]
        elif (isinstance(value, int | float) and value is not True) or (isinstance(value, str) and value[:1].isdigit()):
            numbers.append((owner, key, value))
    return numbers


def _huge(raw, path, pick, others):
    """Some number of the scene, far too large or too small."""
    if numbers := _numbers(raw):
        owner, key, value = pick.choice(numbers)
        unit = value.partition(" ")[2] if isinstance(value, str) else ""
        number = f"{pick.choice(('', '-'))}{pick.randint(1, 9)}e{pick.choice((-60, -59, -30, -9, 9, 30, 59, 60))}"
        owner[key] = f"{number} {unit}" if unit else float(number)


def _nest(raw, path, pick, others):
    """An entry within lists or tables, or a table or a list that has become another kind of thing."""
    owner, key = _owner(raw, path), path[-1]
    value = owner[key]
    shapes = [[value], [[value]], [value, [value]], {"x": value}, [{"x": value}], {key: value}]
    if isinstance(value, dict):
        shapes += [[*value], [*value.values()], [*value.items()], str(value)[:50]]
    if isinstance(value, list) and value:
        shapes += [value + value, value[:-1], value[0], {str(k): each for k, each in enumerate(value)}]
        shapes += [[*value[:-1], [value[-1]]], [*value[:-1], {"x": value[-1]}], [value, *value[1:]]]
    owner[key] = json.loads(json.dumps(pick.choice(shapes)))


_SCRIPTS = ("\uff10", "\u0660", "\u09e6", "\U0001d7ce")
"""Zeros of full-width, Arabic, Bengali and mathematical digits, which Python reads as digits."""


def _digits(raw, path, pick, others):
    """Digits of another script, underscores between them, or what float() reads beside decimals."""
    owner, key = _owner(raw, path), path[-1]
    text = str(owner[key])
    if not isinstance(owner[key], str | int | float):
        return
    zero = ord(pick.choice(_SCRIPTS))
    other = "".join(chr(zero + int(letter)) if letter in "0123456789" else letter for letter in text)
    unit = text.partition(" ")[2]
    owner[key] = f"{pick.choice((other, '1_0', '0x1f', 'nan', 'inf', '1e400', '1e'))} {unit}".strip()


def _same(raw, path, pick, others):
    """Two things of one name: a joint like a body, a load like a joint, a sensor like a load, of another case."""
    tables = [name for name, table in raw.items() if isinstance(table, dict) and table]
    if len(tables) < 2:
        return
    one, two = pick.sample(tables, 2)
    name = pick.choice([*raw[one]])
    entries = raw[two]
    entries[pick.choice((name, name.upper(), f"{name}_speed"))] = entries.pop(pick.choice([*entries]))


CHANGES: tuple[Callable, ...] = (
    _drop, _replace, _replace, _rename, _reunit, _reunit, _law, _swap, _graft, _double, _huge, _nest, _nest, _digits,
    _same,
)  # fmt: skip


def broken_text(text: str, pick: random.Random) -> bytes:
    """The text with characters lost, doubled or strange; sometimes no text at all."""
    data = bytearray(text.encode())
    for _ in range(pick.choice((1, 1, 2, 5))):
        if not data:
            break
        at = pick.randrange(len(data))
        match pick.randrange(4):
            case 0:
                del data[at : at + pick.choice((1, 1, 10, 200))]
            case 1:
                data[at:at] = data[at : at + pick.choice((1, 10, 200))] * pick.choice((1, 2, 50))
            case 2:
                data[at:at] = pick.choice(STRANGE)
            case 3:
                data[at] = pick.randrange(256)
    return bytes(data)


def _broken_table(text: str, pick: random.Random) -> bytes:
    """A CSV file with one cell, line or byte that is wrong, or that may be right."""
    if pick.random() < 0.3:
        return broken_text(text, pick)
    lines = text.splitlines()[: pick.choice((3, 6, 40, 999))]
    at = pick.randrange(len(lines))
    cells = lines[at].split(",")
    strange = (*NUMBERS, '"1\n2"', '"', "", "x", "0" * 200_000, "#", "1e308")
    cells[pick.randrange(len(cells))] = str(pick.choice(strange))
    lines[at] = ",".join(cells)
    return "\n".join(lines).encode()


class Mutants:
    """Scenes by seed, written into `folder` one over the other."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        files = shipped_scenes()
        self.texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()}
        self.raws = {name: tomllib.loads(text) for name, text in self.texts.items()}
        self.gas = (files["engine"].parent / "gas.csv").read_text(encoding="utf-8")

    def write(self, seed: int) -> Path:
        """The mutant of a seed, as a file."""
        pick = random.Random(seed)
        name = pick.choice([*self.raws])
        table = _broken_table(self.gas, pick) if pick.random() < 0.1 else self.gas.encode()
        (self.folder / "gas.csv").write_bytes(table)
        file = self.folder / "mutant.toml"
        if pick.random() < 0.15:
            file.write_bytes(broken_text(self.texts[name], pick))
            return file
        raw, others = copy.deepcopy(self.raws[name]), [*self.raws.values()]
        for _ in range(pick.choice((1, 1, 1, 2, 2, 4))):
            known = [*paths(raw)]
            if known:
                pick.choice(CHANGES)(raw, pick.choice(known), pick, others)
        file.write_text(written_toml(raw), encoding="utf-8", errors="surrogatepass")
        return file


RUN_PRESETS = ("rigid", "quasistatic", "linear", "stiffened", "coupled")


class Runs(Mutants):
    """Shipped scenes with other numbers by seed, each with a preset that it is to run under."""

    def write(self, seed: int) -> tuple[Path, str]:
        """A shipped scene with some numbers changed, mostly by a factor of up to a thousand, as a file."""
        pick = random.Random(seed)
        raw = copy.deepcopy(self.raws[pick.choice([*self.raws])])
        for _ in range(pick.choice((1, 1, 2, 3))):
            numbers = _numbers(raw)
            if not numbers:  # of a scene that is like another one
                break
            owner, key, value = pick.choice(numbers)
            number, _, unit = value.partition(" ") if isinstance(value, str) else (value, "", "")
            with suppress(ValueError):
                times = 10.0 ** pick.uniform(-3.0, 3.0) * pick.choice((1, 1, 1, -1, 0, 1e30, 1e-30))
                new = float(number) * times
                owner[key] = f"{new!r} {unit}" if unit else min(round(abs(new)), 30) if type(value) is int else new
        (self.folder / "gas.csv").write_text(self.gas)
        file = self.folder / "mutant.toml"
        file.write_text(written_toml(raw), encoding="utf-8")
        return file, RUN_PRESETS[seed % len(RUN_PRESETS)]


def examine(file: Path, placed: bool = False) -> Scene | UserError:
    """Everything that is found out about a scene before equations are derived, or the refusal.

    placed: whether the bodies are put in their places, too, which takes seconds where they don't meet.
    """
    try:
        with np.errstate(all="ignore"):
            scene = read_scene(file)
            options = resolve_options(scene)
            elastic = [name for name, body in scene.bodies.items() if body.elastic]
            if scene.is_spatial:
                links = [make_link(mechanism_of(scene), name, 1) for name in elastic]
                mechanism = mechanism_of(scene)
                assert all(held_nodes(mechanism, link) is not None for link in links)
            elif options.dynamics != "rigid" and elastic:
                check_elastic(scene)
            structure_hash(acting(scene, options))
            for name in () if scene.is_spatial else elastic:
                most_modes(mechanism_of(scene), name)
            if placed and scene.joints:
                spatial_start(scene) if scene.is_spatial else place(mechanism_of(scene))
    except UserError as error:
        assert all((problem.reason, problem.cure, str(problem)) for problem in error.problems)
        return error
    return scene


def run_shortly(given: tuple[Path, str]) -> Solution | UserError:
    """A hundredth of the run that a scene asks for, in 20 steps, or the refusal: no NaN where it completes.

    given: a file, and the preset
    """
    file, preset = given
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            scene = read_scene(file)
            short = [f"solve.duration={0.01 * scene.horizon!r}", "solve.steps=20", "solve.errors=none"]
            changes = [f"solve.preset={preset}", *(["solve.integrator=none"] * (scene.solve.integrator is not None))]
            changes += [] if isinstance(scene.solve.start, Start) else ["solve.start=zero"]
            solution = simulate(load(with_settings(scene, [*short, *changes])))
    except UserError as error:
        return error
    if solution.outcome.name == "COMPLETED":
        lost = [name for name, series in solution.series.items() if not np.isfinite(series.values).all()]
        assert not lost, f"{preset}: {lost} are no numbers"
    return solution


class Written(Protocol):
    """Mutants by seed, written into a folder one over the other."""

    def write(self, seed: int) -> Any: ...


def broken(
    mutants: Written, seeds: Iterable[int], limit: float, examine: Callable[[Any], object] = examine
) -> list[str]:
    """The seeds whose mutants ended neither in a result nor in a refusal within `limit` [s], and how."""
    found = []
    signal.signal(signal.SIGALRM, _too_long)
    for seed in seeds:
        given = mutants.write(seed)
        signal.setitimer(signal.ITIMER_REAL, limit)
        try:
            examine(given)
        except Exception as error:  # whatever it is, it is the finding
            found.append(f"{seed}: {type(error).__name__}: {str(error)[:300]}")
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    return found


def _too_long(number: int, frame: object) -> None:
    raise TimeoutError("it takes too long")


def main() -> None:
    """COUNT FIRST of mutated scenes; with --runs of short runs."""
    runs = "--runs" in sys.argv
    numbers = [word for word in sys.argv[1:] if word != "--runs"]
    count, first = (int(number) for number in (*numbers, "20000", "0")[:2])
    started, seeds = time.monotonic(), range(first, first + count)
    with tempfile.TemporaryDirectory() as folder:
        if runs:
            found = broken(Runs(Path(folder)), seeds, 600.0, run_shortly)  # the first ones compile
        else:
            found = broken(Mutants(Path(folder)), seeds, limit=60.0, examine=partial(examine, placed=True))
    what = "short runs" if runs else "mutated scenes"
    print(*found, f"{count} {what} in {time.monotonic() - started:.0f} s: {len(found)} broken", sep="\n")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
