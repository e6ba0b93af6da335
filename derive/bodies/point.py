"""Kernels of points on the axis of a body in the plane: displacement and rotation of its section by the shapes.

Of the fields of a shape (:mod:`kaneflex.derive.bodies.kinds`) a point has x, y and the rotation of its section, and by
pairs of shapes the shortening along x.
"""

from __future__ import annotations

import sympy as sm

from kaneflex.derive.bodies.kinds import POINT, Kinds, tables
from kaneflex.derive.bodies.loops import Shape, code, ends, grow, loops, zeroed
from kaneflex.derive.printers import module_text

_PLACE = {"x": "xi", "y": "eta", "turn": "turn"}
"""Displacement of a section along and across the body, and its rotation."""
_DISPLACE = """\
Store the twists of a section for a unit of each shape, (shapes, 3), in the body's axes; return its displacement
and rotation."""
_GROWTH = "Return the acceleration of a section along the body at constant rates of its shapes."


def point_table() -> str:
    """Table of a point's numbers, by the kinds of its body's shapes."""
    singles, pairs = tables(POINT)
    return module_text.literal("POINT", singles | pairs, "numbers of a point by the kind of a shape, or of two")


def point_kernels(kinds: Kinds) -> list[str]:
    """Texts of the kernels of points of a body with these kinds of shapes; none in space."""
    return [] if kinds.in_space else [_displace(), _growth()]


def _displace() -> str:
    def of_shape(shape: Shape) -> list[str]:
        twist = [f"out[k + 3 * j{f' + {k}' if k else ''}] = {code(shape.grown(name))}" for k, name in enumerate(_PLACE)]
        moved = {place: (shape.single(name) + shape.grown(name)) / 2 for name, place in _PLACE.items()}
        return [*twist, *grow({place: sm.Symbol("q_j") * value for place, value in moved.items()})]

    return module_text.function("displace(p, o, count, q, i, out, k)", _DISPLACE, [
        *ends(POINT), *zeroed(_PLACE.values()), *loops(of_shape, kinds=POINT), f"return {', '.join(_PLACE.values())}",
    ], "**WITHIN")  # fmt: skip


def _growth() -> str:
    def of_shape(shape: Shape) -> list[str]:
        return grow({place: sm.Symbol("v_j") * shape.total(name, "v") for name, place in _PLACE.items()})

    return module_text.function("growth(p, o, count, v, i)", _GROWTH, [
        *ends(POINT), *zeroed(["xi"]), *loops(of_shape, kinds=POINT), "return xi",
    ], "**WITHIN")  # fmt: skip
