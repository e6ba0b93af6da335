"""Modules of beam elements: the kernels of one element, printed once for each theory and for every scene.

A structure's module imports what it offers of them. Assembly takes the affine form apart with the very kernels that a
user imports: each is linear in the monomials of the motion's scalars, so that with one scalar at 1 and the others at 0
it gives the constant matrix before that scalar's monomial.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from itertools import product
from types import MappingProxyType

import sympy as sm

from kaneflex.derive.elements.beam import Element, beam_element
from kaneflex.derive.elements.parameters import BEAMS, ELEMENT_TERMS
from kaneflex.derive.elements.shapes import x_0
from kaneflex.derive.ir.names import Names
from kaneflex.derive.ir.program import Program, named, share
from kaneflex.derive.printers import module_text
from kaneflex.derive.printers import numba_printer as emit
from kaneflex.derive.printers.rows import element_table, rows_text
from kaneflex.support.contract import ELEMENT_KERNELS

TermRow = tuple[str, str, str, tuple[str, ...]]
"""A row of TERMS: name, group, kernel, factors of the scalar."""
_KERNELS = {
    "M": ("Mass matrix M = int rho A N^T N dx of one element, 6 x 6 [SI].", "M", ("inertia",)),
    "K_s": ("Elastic stiffness: E A / l and E I / l^3 blocks, 6 x 6 [SI].", "K", ("elastic",)),
    "K_d": (
        "Dynamic stiffness K_d = -omega^2 M + epsilon G, M of translation alone, 6 x 6 [SI].", "K", ("spin", "euler")
    ),
    "K_g": ("Geometric stiffness K_g = int P(X) H'^T H' dx, 6 x 6 [SI].", "K", ("geometric",)),
    "C": ("Gyroscopic matrix C_d = 2 omega G; the runtime adds material damping, 6 x 6 [SI].", "C", ("gyroscopic",)),
    "F": ("Inertia and weight F_d = -int rho A N^T (a - g + epsilon S r - omega^2 r) dx [SI].", "F", ("load",)),
}  # fmt: skip
"""Kernel -> what it is, and which of the element's terms it sums."""

_ROTARY = {
    "M": "\n\nM holds the rotary inertia int rho I theta^T theta dx, too.",
    "F": "\n\nIt holds the rotary inertia -epsilon int rho I theta^T dx, too.",
}


def element_texts() -> dict[str, str]:
    """Module -> its text, of all BEAMS and of the rows of their tables."""
    texts = {"rows": rows_text()}
    scalars = module_text.import_called("rows", ["LINK_SCALARS"], texts["rows"])
    for module, options in BEAMS.items():
        element = beam_element(**options)
        assert {(term.group, monomial(term.scalar)) for term in element.terms} == {
            (group, factors) for _, group, _, factors in ELEMENT_TERMS
        }, f"the terms of {module} are not those of the contract"
        kernels = [element_kernel(name, element) for name in ELEMENT_KERNELS]
        table = element_table("PLANAR", (row[:1] + row[2:] for row in element.parameters))
        texts[module] = element_module(
            "Matrices of one element of an elastic link", _about(element), table, emit.operations(kernels),
            [kernel for kernel, _ in kernels], shared_tables(ELEMENT_TERMS, next(iter(BEAMS)), texts), [scalars],
        )  # fmt: skip
    return texts


def element_module(
    title: str, about: Iterable[str], parameters: str, counts: Mapping[str, tuple[int, int]],
    kernels: Iterable[emit.Kernel], shared: tuple[list[str], list[str]], imports: Iterable[str],
) -> str:  # fmt: skip
    """Text of the module of one element, from its table of parameters, the operations of its kernels and these, and
    what it shares with others of its kind: tables and imports."""
    tables, imported = shared
    tables = [parameters, *tables, module_text.operations_table(counts)]
    printed = emit.print_kernels(kernels, Names({}))
    return module_text.module(title, [*about, "", module_text.CHECKED], tables, printed, [*imports, *imported])


def shared_tables(
    terms: Iterable[TermRow], first: str, texts: Mapping[str, str], more: Mapping[str, str] = MappingProxyType({})
) -> tuple[list[str], list[str]]:
    """TERMS and ``more`` tables of a kind's elements: their texts in the first module, imports in others."""
    comment = "name, group, kernel that has it, factors of the scalar"
    data = {**more, "TERMS": module_text.literal("TERMS", terms, comment)}
    return ([], [module_text.import_called(first, data, texts[first])]) if first in texts else ([*data.values()], [])


def monomial(scalar: sm.Expr) -> tuple[str, ...]:
    """Factors of a term's scalar, repeated for powers: omega**2 -> ("omega", "omega")."""
    powers = sorted(scalar.as_powers_dict().items(), key=str)
    return tuple(str(base) for base, power in powers if base != 1 for _ in range(int(power)))


def element_kernel(name: str, element: Element) -> emit.Printed:
    """The sum of an element's terms that a kernel computes, and its raw program."""
    doc, target, groups = _KERNELS[name]
    if element.has("rho_I"):
        doc += _ROTARY.get(name, "")
    if element.has("phi_s") and name == "M":
        doc += "\nSo is the correction M_c for the element's answer to its own inertia; K_d and C are without it."
    chosen = [term for term in element.terms if term.target == target and term.group in groups]
    total = sum((term.scalar * term.matrix for term in chosen), sm.zeros(*chosen[0].matrix.shape))
    inputs = emit.places((symbol for _, symbol, *_ in element.parameters), "p")
    inputs += emit.places((symbol for _, symbol, *_ in element.scalars), "s")
    symbols = tuple(symbol for symbol, _ in inputs)
    raw, steps, stored = Program(name, symbols, (), _stores(total)), (), total
    if name == "K_g":  # by the few numbers of the tension, in Horner's form, instead of by all of their products
        steps = tuple((symbol, sm.horner(expression, x_0)) for symbol, expression, _ in element.tension)
        stored = sum((symbol * matrix for symbol, _, matrix in element.tension), sm.zeros(*total.shape))
    arguments = ("p", "s", "out") if any(term.scalar != 1 for term in chosen) else ("p", "out")
    doc += "\n\np: ELEMENT_PARAMETERS of one element." + (" s: LINK_SCALARS." if "s" in arguments else "")
    doc += " out: zeros; structural zeros are not stored."
    program = share(Program(name, symbols, steps, _stores(stored)))
    matrix = stored.cols > 1
    return emit.Kernel(named(program) if matrix else program, arguments, inputs, doc, by_rows=matrix), raw


def _stores(matrix: sm.Matrix) -> tuple[tuple[str, sm.Expr], ...]:
    """Entries that are not zero, with their places."""
    places = product(range(matrix.rows), range(matrix.cols))
    return tuple((f"out[{i}{f', {j}' * (matrix.cols > 1)}]", matrix[i, j]) for i, j in places if matrix[i, j] != 0)


def in_letters(without: Collection[str] = ()) -> str:
    """The equations of an elastic link, perhaps without some groups of terms."""
    damping = {"damping": " + C_s", "gyroscopic": " + 2 omega G"}
    stiffness = {"elastic": "K_s", "spin": " - omega^2 M", "euler": " + epsilon G", "geometric": " + K_g"}
    C, K = ("".join(term for group, term in of.items() if group not in without) for of in (damping, stiffness))
    return "M q''" + (f" + ({C.removeprefix(' + ')}) q'" if C else "") + f" + ({K}) q = F"


def _about(element: Element) -> list[str]:
    return [
        "In link axes, with one scalar of the motion before each constant matrix:",
        f"    {in_letters()}",
        "    q = (u1, v1, theta1, u2, v2, theta2); K_g = P_0 K_g0 + a_x K_g1 + omega^2 K_g2",
        *module_text.ROTARY * element.has("rho_I"),
    ]
