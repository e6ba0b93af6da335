"""Modules of beam elements in space: the kernels of one element, printed once for each theory and for every scene.

Each entry (i, j) of a slice's matrices (``elements.slice``) stands for int f N_i^T N_j dx with the shape functions of
its two coordinates: with the entry (j, i) before its transpose, it becomes a call of ``fill_both`` with the factors
before the powers of x/length in f, which is a polynomial by the section's growth and the link's X. Strain energy and
axial tension bring such integrals, too. The x-z plane is the x-y plane with w' for v', where theta_y = -w'.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations_with_replacement, zip_longest
from math import prod

from sympy import Expr, Poly, Rational, S, factor_terms

from kaneflex.derive.elements.parameters import SPATIAL_BEAMS, SPATIAL_ELEMENT_TERMS, spatial_element_parameters
from kaneflex.derive.elements.plane import element_module, shared_tables
from kaneflex.derive.elements.shape_integrals import POWERS, s, shape_integrals_text
from kaneflex.derive.elements.shapes import length, rho_A, x_0
from kaneflex.derive.elements.shapes import x as along
from kaneflex.derive.elements.slice import P_0, PARAMETERS, SCALARS, X, link_tension, rho_I_y, rho_I_z, slice_equations
from kaneflex.derive.ir.program import Program, share
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.derive.printers.rows import element_table
from kaneflex.support.contract import ELEMENT_KERNELS, SPATIAL_LINK_SCALARS, SPATIAL_NODE

_DOCS = {
    "M": "Mass matrix of one element, 12 x 12 [SI].",
    "K_s": "Elastic stiffness, 12 x 12 [SI]: axial, torsion, bending about z and y.",
    "K_d": "Dynamic stiffness, before omega_i omega_j and epsilon_i, 12 x 12 [SI].",
    "K_g": "Geometric stiffness of int P/2 (v'^2 + w'^2 + I_p/A theta_x'^2) dx, 12 x 12 [SI].",
    "C": "Gyroscopic matrix, before omega_i; the runtime adds material damping, 12 x 12 [SI].",
    "F": "Inertia and weight of an element that moves with its frame, 12 [SI].",
}
_CORRECTED = "\n\nIt holds the correction M_c for the element's answer to its own inertia; K_d and C are without it."

_FUNCTIONS = {
    "u": ("LINEAR", "U", 1), "v": ("DEFLECTION", "V", 1), "w": ("DEFLECTION", "W", 1),
    "theta_x": ("LINEAR", "T", 1), "theta_y": ("ROTATION", "W", -1), "theta_z": ("ROTATION", "V", 1),
}  # fmt: skip
"""Coordinate of a slice -> its shape functions, the nodes' coordinates that they belong to, its sign there."""
_PLANES = {"V": ("E_I_z", "phi_y"), "W": ("E_I_y", "phi_z")}
"""Nodes' coordinates of a plane of bending -> its stiffness, its flexibility in shear."""
_BENT = ("theta_y", "theta_z")
"""Turns of a section by bending."""
_SIZE = {"U": 2, "T": 2, "V": 4, "W": 4}
_PER_INTEGRAL, _PER_LOAD, _PER_SUM, _PER_TURN = 12, 5, 2, 2
"""Operations of the loops in ``shape_integrals``."""


@dataclass(frozen=True)
class _Section:
    """An element's numbers along s = x/length.

    general: properties of the section grow linearly about their means in the middle; it shears and has rotary inertia.
    """

    general: bool

    @property
    def parameters(self) -> tuple[tuple[str, str, str], ...]:
        return spatial_element_parameters(self.general)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Coordinates of a slice with inertia: without rotary inertia these are not the section's turns by bending."""
        return SPATIAL_NODE if self.general else SPATIAL_NODE[:4]

    def along(self, name: str) -> Expr:
        return PARAMETERS[name] + (PARAMETERS[f"{name}_rise"] * (s - Rational(1, 2)) if self.general else 0)

    def here(self, expression: Expr) -> Expr:
        """A slice's number by s."""
        densities = {symbol: self.along(symbol.name) for symbol in (rho_A, rho_I_y, rho_I_z)}
        return expression.xreplace(densities | {X: x_0 + length * s})

    def tension(self) -> Expr:
        """Axial force by s."""
        before = (PARAMETERS["m_0"], PARAMETERS["S_0"]) if self.general else (rho_A * x_0, rho_A * x_0**2 / 2)
        density = self.along("rho_A").subs(s, along / length)
        return P_0 + link_tension(before, density).subs(along, length * s)

    def bubble(self, functions: str, rows: str) -> str:
        """Name in a kernel of (beta - 1, alpha, turn) of these functions."""
        if functions in ("LINEAR", "GRADIENT"):
            return "STRAIGHT"
        return f"{'shear' if functions == 'SHEAR' else 'bend'}_{rows.lower()}"

    def bubbles(self, rows: str) -> tuple[list[tuple[str, Expr]], tuple[str, ...]]:
        """The numbers of a plane's bubbles, and the statements that make triples of them."""
        stiffness, flexibility = _PLANES[rows]
        plane, turn = rows.lower(), "length" if rows == "V" else "-length"
        if not self.general:
            return [], (f"bend_{plane} = (0.0, 0.0, {turn})",)
        beta = 1 / (1 + PARAMETERS[flexibility])
        growth = PARAMETERS[f"{stiffness}_rise"] / PARAMETERS[stiffness]
        numbers = {"beta": beta, "alpha": (1 - beta) * growth / 6, "growth": growth}
        bending = f"bend_{plane} = (beta_{plane} - 1.0, alpha_{plane}, {turn})"
        shear = f"shear_{plane} = (1.0, -growth_{plane}/6.0, {turn})"
        return [(f"{name}_{plane}", number) for name, number in numbers.items()], (bending, shear)


@dataclass
class _Sum:
    """The statements of a kernel: integrals that it adds, and the numbers before them with their names."""

    section: _Section
    calls: list[str] = field(default_factory=list)
    filled: set[frozenset[str]] = field(default_factory=set)
    numbers: dict[Expr, str] = field(default_factory=dict)
    operations: int = 0

    def add(self, left: tuple[str, str], right: tuple[str, str], f: Expr, g: Expr) -> None:
        """f(s) times the integral of two functions' products and g(s) times its transpose, each with its rows."""
        if (left[0], right[0]) not in POWERS:
            left, right, f, g = right, left, g, f
        operations = _PER_INTEGRAL + _PER_TURN + 2 * _PER_SUM
        self._call("fill_both", f"{left[0]}_{right[0]}", (left, right), (f, g), operations)

    def add_load(self, functions: str, rows: str, f: Expr) -> None:
        """f(s) times the integral of functions alone."""
        self._call("fill_load", functions, ((functions, rows),), (f,), _PER_LOAD + _PER_SUM)

    def square(self, functions: str, rows: str, f: Expr) -> None:
        """The matrix whose quadratic form is the integral of f(s) times the functions' square."""
        operations = _SIZE[rows] * (_PER_INTEGRAL + _PER_SUM)
        self._call("fill_square", f"{functions}_{functions}", ((functions, rows),), (f,), operations)

    def _call(
        self, loop: str, table: str, of: Sequence[tuple[str, str]], factors: Sequence[Expr], operations: int
    ) -> None:
        """A call of one of the loops, with so many operations a row and a power of s.

        The first call for some rows and columns stores, the others add.
        """
        powers = list(zip_longest(*map(_coefficients, factors), fillvalue=S.Zero))
        if not powers:
            return
        places = [rows for _, rows in of]
        names = [", ".join(map(self._name, each)) for each in zip(*powers, strict=True)]
        arguments = [*places, *(self.section.bubble(*each) for each in of)]
        arguments += [f"({name}{',' * (len(powers) == 1)})" for name in names]
        self.calls.append(f"{loop}(out, {frozenset(places) not in self.filled}, {table}, {', '.join(arguments)})")
        self.filled.add(frozenset(places))
        self.operations += len(powers) * prod(_SIZE[rows] for rows in places) * operations

    def _name(self, number: Expr) -> str:
        if number == 0:
            return "0.0"
        if (opposite := factor_terms(-number)) in self.numbers:
            return f"-{self.numbers[opposite]}"
        return self.numbers.setdefault(number, f"f_{len(self.numbers)}")


def _coefficients(f: Expr) -> list[Expr]:
    """Coefficients of the powers of s, from the zeroth."""
    f = f.expand()
    return [factor_terms(f.coeff(s, k)) for k in range(Poly(f, s).degree() + 1)] if f != 0 else []


def _fill(total: _Sum, kernel: str) -> None:
    """Integrals of a kernel: of slices, and of strains.

    M has the correction rho_A phi l^4 / (144 E I) K of ``mass_correction`` in each plane.
    """
    section = total.section
    if kernel in ("M", "C", "K_d"):
        _sum_of_slices(total, kernel[0])
    if kernel == "K_s":
        for functions, rows, rigidity in _strains(section):
            total.square(functions, rows, rigidity)
    if kernel == "M" and section.general:
        for functions, rows, rigidity in list(_strains(section))[2:]:
            stiffness, flexibility = (PARAMETERS[name] for name in _PLANES[rows])
            total.square(functions, rows, rho_A * flexibility * length**4 / (144 * stiffness) * rigidity)
    if kernel == "K_g":
        P = section.tension() / length
        for rows in _PLANES:
            total.square("SLOPE", rows, P)
        total.square("GRADIENT", "T", P * PARAMETERS["I_p_A"])
    if kernel == "F":
        for name in section.coordinates:
            functions, rows, sign = _FUNCTIONS[name]
            unit = sign * (1 if functions == "ROTATION" else length)
            total.add_load(functions, rows, _entry(section, "F", name) * unit)


def _sum_of_slices(total: _Sum, target: str) -> None:
    """M, C or K of the slices: int f N_i^T N_j dx + int g N_j^T N_i dx for each pair of a slice's coordinates."""
    for i, j in combinations_with_replacement(total.section.coordinates, 2):
        (left, rows, sign), (right, columns, other) = _FUNCTIONS[i], _FUNCTIONS[j]
        unit = sign * other * length / length ** [left, right].count("ROTATION")
        f, g = (_entry(total.section, target, *at) * unit for at in ((i, j), (j, i)))
        if i == j:
            total.square(left, rows, f)
        else:
            total.add((left, rows), (right, columns), f, g)


def _entry(section: _Section, target: str, i: str, j: str = "") -> Expr:
    """An entry of a slice's matrix, or of its F, by s and the motion."""
    at = SPATIAL_NODE.index(i), SPATIAL_NODE.index(j) if j else 0
    found = (scalar * matrix[at] for (of, scalar), matrix in slice_equations().items() if of == target)
    return section.here(sum(found, S.Zero)) * (PARAMETERS["rotary"] if {i, j} & set(_BENT) else 1)


def _strains(section: _Section) -> Iterator[tuple[str, str, Expr]]:
    """Functions, rows, rigidity by s of each generalised strain, in the scale of the functions: stretch, twist, then in
    each plane bending and shear.

    Of shear it is kappa G A gamma^2 l = 12 E I beta (1 - beta) / l ((P - growth/6 Q) / (2 l))^2, by ``beam_shape``.
    """
    yield "GRADIENT", "U", PARAMETERS["E_A"] / length
    yield "GRADIENT", "T", PARAMETERS["G_J"] / length
    for rows, (stiffness, flexibility) in _PLANES.items():
        yield "CURVATURE", rows, section.along(stiffness) / length**3
        if section.general:
            beta = 1 / (1 + PARAMETERS[flexibility])
            yield "SHEAR", rows, 3 * PARAMETERS[stiffness] * PARAMETERS[flexibility] * beta**2 / length**3


def spatial_element_texts() -> dict[str, str]:
    """Module -> its text, of all SPATIAL_BEAMS and of the integrals that they add up."""
    texts, integrals = {}, shape_integrals_text()
    scalars = {"LINK_SCALARS": module_text.literal("LINK_SCALARS", SPATIAL_LINK_SCALARS, "s: name, unit, meaning")}
    for module, general in SPATIAL_BEAMS.items():
        section = _Section(general)
        built = [_kernel(name, section) for name in ELEMENT_KERNELS]
        words = sorted({word for kernel, *_ in built for call in kernel.calls for word in re.findall(r"\w+", call)})
        called = [word for word in words if f"\n{word} = " in integrals or f"\ndef {word}(" in integrals]
        counts = emit.operations([pair[:2] for pair in built])
        counts = {name: tuple(count + built[k][2] for count in counts[name]) for k, name in enumerate(counts)}
        texts[module] = element_module(
            "Matrices of one element of an elastic link in space", _about(section),
            element_table("SPATIAL", section.parameters), counts, [kernel for kernel, *_ in built],
            shared_tables(SPATIAL_ELEMENT_TERMS, next(iter(SPATIAL_BEAMS)), texts, scalars),
            [module_text.import_called("shape_integrals", called, integrals)],
        )  # fmt: skip
    return {"shape_integrals": integrals, **texts}


def _kernel(name: str, section: _Section) -> tuple[emit.Kernel, Program, int]:
    """A kernel, the raw program of the numbers before its integrals, the operations of its loops."""
    total = _Sum(section)
    _fill(total, name)
    numbers = [(called, number) for number, called in total.numbers.items()]
    _demand_terms(name, numbers)
    outputs, pairs = [], []
    text = " ".join(total.calls)
    for rows in _PLANES:
        of_plane, made = section.bubbles(rows)
        used = [statement for statement in made if f"{statement.partition(' ')[0]}," in text]
        pairs += used
        outputs += [(called, number) for called, number in of_plane if called in " ".join(used)]
    inputs = emit.places((PARAMETERS[key] for key, *_ in section.parameters), "p") + emit.places(SCALARS, "s")
    raw = Program(name, tuple(symbol for symbol, _ in inputs), (), (*outputs, *numbers))
    motion = set(SCALARS) & set().union(*(number.free_symbols for _, number in numbers))
    doc = _DOCS[name] + _CORRECTED * (name == "M" and section.general)
    doc += "\n\np: ELEMENT_PARAMETERS of one element." + " s: LINK_SCALARS." * bool(motion) + " out: zeros."
    kernel = emit.Kernel(
        share(raw), ("p", "s", "out") if motion else ("p", "out"), inputs, doc,
        calls=(*pairs, *total.calls), inline=True,
    )  # fmt: skip
    return kernel, raw, total.operations


def _demand_terms(name: str, numbers: list[tuple[str, Expr]]) -> None:
    """The monomials of the motion in a kernel are those that the contract names."""
    found = {
        tuple(factor for symbol, power in zip(SCALARS, powers, strict=True) for factor in [symbol.name] * power)
        for _, number in numbers
        for powers, _ in Poly(number, *SCALARS).terms()
    }
    named = {factors for _, _, kernel, factors in SPATIAL_ELEMENT_TERMS if kernel == name}
    assert found == named, f"the terms of {name} are not those of the contract: {sorted(found ^ named)}"


def _about(section: _Section) -> list[str]:
    turning = "with rotary = 1 theirs against bending, too" if section.general else "theirs against torsion alone"
    return [
        "In link axes, with scalars of the motion before constant matrices (TERMS):",
        "    M q'' + (C_s + C) q' + (K_s + K_d + K_g) q = F",
        "    q = (u, v, w, theta_x, theta_y, theta_z) of both nodes",
        "    K_g by P = P_0 + int_0^X rho A (a_x - (omega_y^2 + omega_z^2) X) dX",
        f"Sections have the rotary inertia rho I_y, rho I_z and their sum about x: {turning}.",
    ]
