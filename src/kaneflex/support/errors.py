"""Errors that a user can cause, each with the entry, its value, the reason and what to do.

`Fault` is raised where only reason and `cure` (what to do) are known; the caller that knows the key turns it
into a `Problem`, and all problems of one file are raised together as one `SceneError`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import NamedTuple

_LONGEST_VALUE = 200  # characters of a value that a message repeats
LONGEST_NAME = 100
"""Largest length of a name; no nearest name is searched for a longer one."""


class Fault(ValueError):
    """Error in a value whose key is not known here: `reason` and `cure` (what to do), without full stops.

    `below` is an optional path of the faulty entry, relative to the key that the caller knows.
    """

    def __init__(self, reason: str, cure: str, below: str = "") -> None:
        super().__init__(f"{reason}. {cure}.")
        self.reason = reason
        self.cure = cure
        self.below = below


@contextmanager
def within(key: str) -> Iterator[None]:
    """Prefix the paths of Faults with a key."""
    try:
        yield
    except Fault as fault:
        raise Fault(fault.reason, fault.cure, below=f"{key}.{fault.below}".rstrip(".")) from None


@contextmanager
def naming(key: str, value: object) -> Iterator[None]:
    """Turn Faults of a value into a SceneError with its key."""
    try:
        yield
    except Fault as fault:
        raise SceneError(key, value, fault.reason, fault.cure) from None


@contextmanager
def installed(package: str, extra: str, *modules: str, instead: str = "") -> Iterator[None]:
    """Raise a Fault if the import of an optional package fails.

    Parameters
    ----------
    package : str
        Name of the package in the message.
    extra : str
    *modules : str
        Imported modules; an ImportError of any other module is raised unchanged.
    instead : str
        Alternative for the user.
    """
    try:
        yield
    except ImportError as error:
        if error.name not in modules:
            raise
        other = f", or {instead}" if instead else ""
        raise Fault(f"{package} is not installed", f'Run: pip install "kaneflex[{extra}]"{other}') from None


class Problem(NamedTuple):
    """Error in one entry: its path (`key`), its `value`, the `reason` and what to do (`cure`)."""

    key: str
    value: object
    reason: str
    cure: str

    def __str__(self) -> str:
        thing = self.key if self.value is None else f"{self.key} = {_shortened(self.value)}"
        return f"{thing}: {self.reason}. {self.cure}."


def unknown(key: str, name: str, kind: str, known: Iterable[str]) -> Problem:
    """Problem of an entry that names something of a kind that does not exist."""
    return Problem(key, name, f"no {kind} of that name", nearest(name, known))


def taken(key: str, reason: str) -> Problem:
    """Problem of an entry whose name is not available."""
    return Problem(key, None, reason, "Choose another name")


def failed(name: str, message: str) -> Problem:
    """Problem of a model by the message that it failed with."""
    reason, _, cure = message.rstrip(".").rpartition(". ")
    return Problem(name, None, reason, cure)


class UserError(ValueError):
    """Base of the errors that a user can cause; its attributes are those of the first of its `problems`."""

    def __init__(self, key: str, value: object, reason: str, cure: str) -> None:
        self._set((Problem(key, value, reason, cure),))

    @classmethod
    def gather(cls, problems: Iterable[Problem]) -> UserError:
        """One error for several problems (at least one), one line each."""
        error = cls.__new__(cls)
        error._set(tuple(problems))
        return error

    def _set(self, problems: tuple[Problem, ...]) -> None:
        super().__init__("\n".join(map(str, problems)))
        self.problems = problems
        first = problems[0]
        self.key, self.value, self.reason, self.cure = first.key, first.value, first.reason, first.cure


class SceneError(UserError):
    """A scene, a table it names or a setting cannot be used."""


def refuse(*rules: tuple[object, str, object, str, str]) -> None:
    """Raise SceneError for the first rule whose condition holds; rules are (condition, key, value, reason, advice)."""
    for broken, key, value, reason, cure in rules:
        if broken:
            raise SceneError(key, value, reason, cure)


class StoppedEarly(SceneError):
    """Run that stopped early, where a complete run is needed."""


class OutputError(UserError):
    """A folder or file cannot be written."""


class ValidityWarning(UserWarning):
    """Warning about the validity of a run's results."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Advice for an unknown `name`: the nearest of the `known` ones, or their list."""
    known = sorted(known)
    close = difflib.get_close_matches(name[:LONGEST_NAME], known, n=1, cutoff=0.6)
    if close:
        return f"The nearest known one is {close[0]!r}"
    return "Known: " + ", ".join(known) if known else "There is none: add one first"


def counted(count: object, noun: str) -> str:
    """Number with its noun, like "1 step" and "2 degrees of freedom"."""
    many = noun.replace(" of ", "s of ") if " of " in noun else f"{noun}s"
    return f"{count} {noun if count == 1 else many}"


def _shortened(value: object) -> str:
    try:
        text = repr(value)
    except ValueError:  # Python prints no whole number of more than 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= _LONGEST_VALUE else text[: _LONGEST_VALUE - 3] + "..."
