"""Statements for products of bending with the shortening scale xi of a pinned beam, in the kernels of a body in space.

The shortening displaces the axis along itself like one more shape, whose coordinate scale is quadratic in the others
(:mod:`kaneflex.derive.bodies.kinds`). What Kane's equations ask of this one, R, each shape is asked times ``by``, the
derivative of scale by its coordinate. All that is known behind the loops over the shapes only, so a second loop adds
it, for which Q and ``by`` are kept. T, W and g are sums of xi times the displacement across the axis, its rate and its
acceleration.
"""

from __future__ import annotations

import sympy as sm

from kaneflex.derive.bodies.kane import EPSILON, OMEGA
from kaneflex.derive.bodies.kinds import SHORTENING
from kaneflex.derive.bodies.loops import INDENT, Shape, bounds, code, grow

_ACROSS = {"v": "y", "w": "z"}
"""Axis along which the shapes of a kind displace the beam's."""
_SCALE, _RATE, _CHANGE = sm.symbols("scale scale_1 scale_2")
_Q, _BY = "room[z + 2 * j]", "room[z + 2 * j + 1]"
T, W, g = (sm.symbols(f"{letter}_y {letter}_z") for letter in "TWg")
Sums = dict[str, sm.Expr]


def increments(shape: Shape, rates: bool) -> Sums:
    """Increments of scale and T by the j-th shape, and, where they are wanted, of their rates."""
    q, v, b = sm.symbols("q_j v_j b_j")
    found = Sums()
    if shape.kind in _ACROSS:
        orders = [("T", q), *[("W", v), ("g", b)] * rates]
        found |= {f"{letter}_{_ACROSS[shape.kind]}": shape.single("Q") * x for letter, x in orders}
    if shape.kind in SHORTENING:
        by = shape.total("scale", "q")
        found["scale"] = q * by / 2
        found |= {"scale_1": v * by, "scale_2": b * by + v * shape.total("scale", "v")} if rates else {}
    return found


def kept(shape: Shape) -> list[str]:
    """Statements that keep Q of the j-th shape and the derivative of scale by q_j, where these are not zero."""
    values = {_Q: shape.single("Q"), _BY: shape.total("scale", "q")}
    return [f"{place} = {code(value)}" for place, value in values.items() if value != 0]


def _loops(rows: dict[str, str], shortening: list[str]) -> list[str]:
    """Second loops over shapes by their kinds, with Q, then over all of SHORTENING, with ``by``."""
    lines = [line for kind, row in rows.items() for line in (f"for j in range({bounds(kind)}):", INDENT + row)]
    first, last = (bounds(kind).split(", ") for kind in (SHORTENING[0], SHORTENING[-1]))
    return [*lines, f"for j in range({first[0]}, {last[1]}):", *(INDENT + line for line in shortening)]


def _of_inertia() -> Sums:
    """Additions to I."""
    return {"I_xy": -_SCALE * T[0], "I_zx": -_SCALE * T[1]}


def of_demand() -> list[str]:
    """Statements of shaped_demand between its loops and the force and the moment."""
    (_, w_y, w_z), (_, e_y, e_z), (xy, zx) = OMEGA, EPSILON, sm.symbols("s_xy s_zx")
    asked = (e_y - zx / 2) * T[1] - (e_z + xy / 2) * T[0] + 2 * (w_y * W[1] - w_z * W[0])
    factors = {"v": _SCALE * (e_z - xy / 2) + 2 * w_z * _RATE, "w": -_SCALE * (e_y + zx / 2) - 2 * w_y * _RATE}
    lines = [f"R = {code(asked)}", *(f"of_{kind} = {code(factor)}" for kind, factor in factors.items())]
    grown = [_RATE * T[k] + _SCALE * W[k] for k in range(2)]
    total = {
        "D_xy": -grown[0] / 2, "D_zx": -grown[1] / 2,
        "h_y": _RATE * T[1] - _SCALE * W[1], "h_z": _SCALE * W[0] - _RATE * T[0],
        "m_y": _CHANGE * T[1] - _SCALE * g[1], "m_z": _SCALE * g[0] - _CHANGE * T[0],
    }  # fmt: skip
    rows = {kind: f"h[i + j] += {_Q} * of_{kind}" for kind in factors}
    return [*lines, *_loops(rows, [f"h[i + j] += {_BY} * R"]), *grow(total | _of_inertia())]


def of_inertia() -> list[str]:
    """Statements of shaped_inertia behind its loops."""
    y, z = "out[coupling + 6 * j + 4]", "out[coupling + 6 * j + 5]"
    rows = {"v": f"{z} += scale * {_Q}", "w": f"{y} -= scale * {_Q}"}
    return _loops(rows, [f"{y} += {_BY} * T_z", f"{z} -= {_BY} * T_y"]) + grow(_of_inertia())
