"""The module of bodies, joints and springs in space, printed once for every scene.

A section of a body is fifteen numbers of ``sec`` at 15 i: place, velocity, acceleration of its point, angular velocity
and acceleration of its body, each x, y, z and global. Axes are three numbers of ``axes`` at 3 k, unit vectors that turn
with their body, global, too.
"""

from __future__ import annotations

from functools import cache

import sympy as sm

from kaneflex.derive import module_text
from kaneflex.derive.joints import EITHER, change, pull, sections_at
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.derive.spatial_shapes import ACCEL, EPSILON, MASS, MOTION, PLACE, particle_equations, summed

_XYZ = "xyz"
SECTION = tuple(f"{letter}_{axis}" for letter in ("r", "v", "a", "omega", "epsilon") for axis in _XYZ)
BODY = ("mass", *(f"centre_{axis}" for axis in _XYZ), "J_x", "J_y", "J_z", "J_xy", "J_yz", "J_zx")
_MASS, _CENTRE, _J = sm.Symbol(BODY[0]), sm.symbols(BODY[1:4]), sm.symbols(BODY[4:])

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


@cache
def body_equations() -> sm.Matrix:
    """-fr* of a free rigid body (6 x 1) in its own axes: three forces at its origin, three moments about it.

    The sum of Kane's equations of its particles (:func:`particle_equations`), by J about the centre of mass.
    """
    J_x, J_y, J_z, J_xy, J_yz, J_zx = _J
    second = {"xx": (J_y + J_z - J_x) / 2, "yy": (J_z + J_x - J_y) / 2, "zz": (J_x + J_y - J_z) / 2, "xy": -J_xy,
              "yz": -J_yz, "xz": -J_zx}  # fmt: skip
    place, centre = (dict(zip(_XYZ, of, strict=True)) for of in (PLACE, _CENTRE))
    sums = {(MASS,): _MASS} | {(MASS, place[a]): _MASS * centre[a] for a in _XYZ}
    sums |= {(MASS, place[a], place[b]): J + _MASS * centre[a] * centre[b] for (a, b), J in second.items()}
    return sm.Matrix([summed(row, sums) for row in particle_equations(0)]).expand()


_OF_BODY = emit.places((_MASS, *_CENTRE, *_J), "p", "o")


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
    return sm.symbols(" ".join(f"{letter}_{axis}_{side}" for axis in _XYZ))


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
