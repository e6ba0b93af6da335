"""Laws: a user's expressions in the time and the drives' angles and speeds.

Python's `ast` parses them, see :mod:`kaneflex.scene.law_parser`. They are never evaluated as Python code. `Law.to`
walks the checked tree and builds the expression from any kind of number: SymPy's, NumPy's or plain floats.
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from kaneflex.support.errors import Fault

FUNCTIONS: dict[str, tuple[int, ...]] = {
    "abs": (1,), "acos": (1,), "asin": (1,), "atan": (1,), "atan2": (2,), "cos": (1,), "exp": (1,), "log": (1,),
    "max": (2,), "min": (2,), "sign": (1,), "sin": (1,), "sqrt": (1,), "step": (1, 5), "tan": (1,), "tanh": (1,),
}  # fmt: skip
"""Function that a law can call -> number of arguments."""
_KINKED = {"abs": 1, "max": 2, "min": 2}
_JUMPING = {"atan2": 2, "sign": 1, "step": 1}
"""Functions whose slopes (and whose values) jump -> number of arguments with which they do."""

BINARY = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
UNARY = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_SAMPLES = 720
"""Number of intervals of a run at whose ends a law must be finite before anything is derived."""


@dataclass(frozen=True)
class Law:
    """Checked law: its canonical text (independent of spacing) and its syntax tree."""

    text: str
    tree: ast.expr

    @classmethod
    def of(cls, name: str) -> Law:
        """Law that is a single name."""
        return cls(name, ast.Name(name))

    def to(self, functions: Mapping[str, Callable], names: Mapping[str, Any], number: Callable[[float], Any]) -> Any:
        """Build the law from other objects.

        `functions`: one for each of FUNCTIONS that it calls; `names`: the object for each name, including `pi`;
        `number`: converts a literal's value, e.g. `sympy.Float` or `float`.
        """

        def build(node: ast.expr) -> Any:
            match node:
                case ast.Constant():
                    return number(node.value)
                case ast.Name():
                    return names[node.id]
                case ast.UnaryOp():
                    return UNARY[type(node.op)](build(node.operand))
                case ast.BinOp():
                    return BINARY[type(node.op)](build(node.left), build(node.right))
                case ast.Call():
                    return functions[node.func.id](*map(build, node.args))
            raise AssertionError(f"parse_law let through {ast.dump(node)}")

        return build(self.tree)

    def on_arrays(self, names: Mapping[str, Any]) -> np.ndarray:
        """Values of the law for floats or ndarrays (n,) of its names; not finite where it is undefined."""
        with np.errstate(all="ignore"):
            values = self.to(ON_ARRAYS, {**names, "pi": np.pi}, np.float64)
        return values + np.zeros(np.shape(names["t"]))

    def check_values(self, names: Mapping[str, Any]) -> None:
        """Raise Fault unless the law is finite and real at all the times `names["t"]` (n,) [s]; as `on_arrays`."""
        lost = ~np.isfinite(self.on_arrays(names))
        if lost.any():
            reason = f"it has no finite value at t = {names['t'][int(lost.argmax())]:.6g} s"
            raise Fault(reason, "Give a law that is finite and real over the run, or another duration")

    def uses(self, name: str) -> bool:
        """True if the law contains the name."""
        return name in self._names

    @cached_property
    def _names(self) -> frozenset[str]:
        return frozenset(node.id for node in ast.walk(self.tree) if isinstance(node, ast.Name))

    def uses_any(self, joints: Collection[str]) -> bool:
        """True if the law contains a joint's coordinate or speed."""
        return any(self.uses(name) or self.uses(f"{name}_speed") for name in joints)

    def kinks(self, smooth: Collection[str] = ()) -> str | None:
        """Text of the first part whose value or slope jumps as its arguments vary, like `abs(t)`; None if smooth.

        `smooth`: functions known not to jump.
        """
        return self._first({name: count for name, count in (_KINKED | _JUMPING).items() if name not in smooth})

    def jumps(self, smooth: Collection[str] = ()) -> str | None:
        """Text of the first part whose value jumps, like `sign(t)`; None if continuous."""
        return self._first({name: count for name, count in _JUMPING.items() if name not in smooth})

    def calls(self, *functions: str) -> list[tuple[str, Law, list[Law]]]:
        """Name, whole call and arguments of every non-constant call of one of these functions."""
        found = []
        for node in ast.walk(self.tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in functions:
                inner = {each.id for part in node.args for each in ast.walk(part) if isinstance(each, ast.Name)}
                if inner - {*FUNCTIONS, "pi"}:
                    arguments = [Law(ast.unparse(argument), argument) for argument in node.args]
                    found.append((node.func.id, Law(ast.unparse(node), node), arguments))
        return found

    def _first(self, functions: Mapping[str, int]) -> str | None:
        found = self.calls(*functions)
        return next((call.text for name, call, arguments in found if functions[name] == len(arguments)), None)


def step(x: Any, *course: Any) -> Any:
    """Step: 0 below zero, 1 above, 1/2 at it; or from h_0 at x_0 to h_1 at x_1 with course = (x_0, h_0, x_1, h_1)."""
    if not course:
        return np.heaviside(x, 0.5)
    x_0, h_0, x_1, h_1 = course
    return h_0 + (h_1 - h_0) * smooth(np.clip((x - x_0) / (x_1 - x_0), 0.0, 1.0))


def smooth(s: Any) -> Any:
    """Smooth step from 0 to 1, without slope and curvature at either end: 10 s^3 - 15 s^4 + 6 s^5."""
    return s**3 * (10 - 15 * s + 6 * s**2)


ON_ARRAYS = {name: getattr(np, name) for name in FUNCTIONS if hasattr(np, name)}
ON_ARRAYS |= {"acos": np.arccos, "asin": np.arcsin, "atan": np.arctan, "atan2": np.arctan2}
ON_ARRAYS |= {"max": np.maximum, "min": np.minimum, "step": step}
"""Functions of floats and ndarrays."""


def sample_times(horizon: float) -> np.ndarray:
    """Times (n,) [s] of a run of `horizon` [s] at which laws are checked."""
    return np.linspace(0.0, horizon, _SAMPLES + 1)
