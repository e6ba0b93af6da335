"""The module of bodies, joints and springs in space, printed once for every scene.

A section of a body is fifteen numbers of ``sec`` at 15 i: place, velocity, acceleration of its point, angular velocity
and acceleration of its body, each x, y, z and global. Axes are three numbers of ``axes`` at 3 k, unit vectors that turn
with their body, global, too.
"""

from __future__ import annotations

import sympy as sm

from kaneflex.derive.bodies.kane import ACCEL, BODY, EPSILON, MOTION, XYZ, body_equations
from kaneflex.derive.laws.joints import EITHER, change, pull, sections_at
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit

SECTION = tuple(f"{letter}_{axis}" for letter in ("r", "v", "a", "omega", "epsilon") for axis in XYZ)

_ABOUT = """
A body: mass [kg], its centre [m] and its moments and products of inertia about it [kg m^2], J_xy = -int x y dm, in
the body's own axes, which begin at its origin; ten numbers of p from p[o]. Its equations are Kane's, of its origin's
velocity and its angular velocity in its own axes, by SymPy's KanesMethod. A row of a joint is fifteen numbers: the
residual g that is to vanish, g', g'', then J_1 and J_2 of g' = J_1 V_1 + J_2 V_2, where V = (v, omega) are the twists
of the two sections, on which a multiplier lambda acts with the forces and moments J_1^T lambda and J_2^T lambda. Every
joint in space is some of three elementary constraints (Nikravesh 1988, Computer-Aided Analysis of Mechanical Systems,
sec. 7.3).
"""
_ROWS = {
    "coincide": "The points of two sections are one: three rows at out[n], out[n + 15] and out[n + 30].",
    "perpendicular": "Axis k of the first section and axis l of the second are at right angles: a row at out[n].",
    "on_plane": "The second point is in the plane across the axis k through the first: a row at out[n].",
}


def spatial_text() -> str:
    """Text of ``generated/spatial.py``."""
    gap, gap_rate = (tuple(sm.Matrix(_symbols(of, 2)) - sm.Matrix(_symbols(of, 1))) for of in "rv")
    pulls = [pull(directed, _READS, gap, gap_rate, ()) for directed in (True, False)]
    kernels = [_demand(), _inertia(), *(_row(kind) for kind in _ROWS), *pulls]
    tables = [
        module_text.literal("SECTION", SECTION, "sec: the numbers of section i begin at 15 i"),
        module_text.literal("BODY", BODY, "p: the numbers of a body begin at o"),
    ]
    return emit.kernels_module("Bodies, joints and springs in space", _ABOUT, tables, kernels, EITHER)


_OF_BODY = emit.places(sm.symbols(BODY), "p", "o")


def _demand() -> emit.Printed:
    """Kernel of a body's inertia force and moment."""
    reads = (*_OF_BODY, *emit.places(MOTION, "w", "k"))
    doc = (
        "Store the force and the moment about its origin that a body's motion takes, in its axes: Kane's -fr*.\n\n"
        "w[k]: omega, acceleration of the origin less gravity, epsilon, in the body's axes."
    )
    return emit.kernel("demand", ("p", "o", "w", "k", "out", "n"), reads, body_equations(), doc, out="n")


def _inertia() -> emit.Printed:
    """Mass matrix."""
    matrix = body_equations().jacobian([*ACCEL, *EPSILON])
    doc = "Store the mass matrix of a body (6, 6) row by row, in its axes: of its origin's velocity and of omega."
    return emit.kernel("inertia", ("p", "o", "out", "n"), _OF_BODY, matrix, doc, out="n")


def _symbols(letter: str, side: int) -> tuple[sm.Symbol, ...]:
    return sm.symbols(" ".join(f"{letter}_{axis}_{side}" for axis in XYZ))


_READS = sections_at("sec", "15 * i", "15 * j", SECTION)
_AXES = (*emit.places(_symbols("n", 1), "axes", "3 * k"), *emit.places(_symbols("n", 2), "axes", "3 * l"))


def _rates() -> dict[sm.Symbol, sm.Expr]:
    """Symbol -> its rate; an axis n turns with its section, n' = omega x n."""
    found: dict[sm.Symbol, sm.Expr] = {}
    for side in (1, 2):
        place, velocity, accel, omega, epsilon, axis = (
            _symbols(letter, side) for letter in ("r", "v", "a", "omega", "epsilon", "n")
        )
        found |= dict(zip(place, velocity, strict=True)) | dict(zip(velocity, accel, strict=True))
        found |= dict(zip(omega, epsilon, strict=True))
        found |= dict(zip(axis, sm.Matrix(omega).cross(sm.Matrix(axis)), strict=True))
    return found


_RATE = _rates()


def _residuals(kind: str) -> list[sm.Expr]:
    """Residuals of an elementary constraint."""
    gap = sm.Matrix(_symbols("r", 2)) - sm.Matrix(_symbols("r", 1))
    first, second = sm.Matrix(_symbols("n", 1)), sm.Matrix(_symbols("n", 2))
    return {"coincide": list(gap), "perpendicular": [first.dot(second)], "on_plane": [first.dot(gap)]}[kind]


def _row(kind: str) -> emit.Printed:
    """Rows of an elementary constraint."""
    twists = [symbol for side in (1, 2) for letter in ("v", "omega") for symbol in _symbols(letter, side)]
    entries: list[sm.Expr] = []
    for residual in _residuals(kind):
        rate = change(residual, _RATE)
        entries += [residual, rate, change(rate, _RATE), *(rate.diff(twist) for twist in twists)]
    axes = {"coincide": (), "perpendicular": ("axes", "k", "l"), "on_plane": ("axes", "k")}[kind]
    return emit.kernel(kind, ("sec", "i", "j", *axes, "out", "n"), (*_READS, *_AXES), entries, _ROWS[kind], out="n")
