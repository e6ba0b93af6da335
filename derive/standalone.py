"""The plain beam element of a module that stands alone: derived shape functions in the integrals that define it."""

from __future__ import annotations

import re
from collections.abc import Iterable

import sympy as sm

from kaneflex.derive.elements.beam import beam_element
from kaneflex.derive.elements.shapes import length, x
from kaneflex.support.contract import BEAMS

BEAM = "beam_euler_bernoulli"
"""The element whose integrals are short enough to be read: no rotary inertia, no shear, one section."""

_ELEMENT = """def element(rho_A, E_A, E_I, h, x_0):
    \"\"\"M, G, K_s<<doc>> and the loads f before omega^2, epsilon, a_x, a_y of an element of length h from x_0 on.

    q = (u1, v1, theta1, u2, v2, theta2); Gauss points are exact. Paper (43)-(55), (89)-(90), (96), (98).<<more>>\"\"\"
    M, G, K_s, f<<H>> = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 4))<<zeros>>
    for r, w in zip((1 + GAUSS[0]) / 2, h / 2 * GAUSS[1]):  # at x = r h from the first node
        N = np.array([[<<u>>],
                      [<<v>>]])  # u, v
<<slope>>        strain = np.array([<<strain>>])  # u'
        bending = np.array([<<bending>>])  # v''
        M += w * rho_A * N.T @ N
        G += w * rho_A * N.T @ [[0, -1], [1, 0]] @ N
        K_s += w * (E_A * np.outer(strain, strain) + E_I * np.outer(bending, bending))
        f -= w * rho_A * N.T @ [[-x_0 - r * h, 0, 1, 0], [0, x_0 + r * h, 0, 1]]
<<add>>    return M, G, K_s, f<<H>>
"""
_TENSIONED = {
    "doc": ", H", "H": ", H", "zeros": ", np.zeros((3, 6, 6))",
    "more": "\n    H_k = int (x/h)^k v'^T v' dx is what a tension adds to K, Kane, Ryan and Banerjee (1987).",
    "add": "        H += w * r ** np.arange(3)[:, None, None] * np.outer(slope, slope)\n",
}  # fmt: skip


def element_text(tensioned: bool) -> str:
    """The function ``element``; ``tensioned``: with what K_g asks for."""
    shape = beam_element(**BEAMS[BEAM], with_frame=False).shape
    u, v = shape.row(0), shape.row(1)
    rows = {"u": u, "v": v, "strain": u.diff(x), "bending": v.diff(x, 2)}
    found = {name: _row(entries) for name, entries in rows.items()}
    slope = f"        slope = np.array([{_row(v.diff(x))}])  # v'\n"
    found |= (_TENSIONED if tensioned else dict.fromkeys(_TENSIONED, "")) | {"slope": slope * tensioned}
    return re.sub("<<(\\w+)>>", lambda name: found[name[1]], _ELEMENT)


def _row(entries: Iterable[sm.Expr]) -> str:
    h, r = sm.symbols("h r")
    return ", ".join(sm.sstr(sm.factor_terms(entry.subs({length: h, x: r * h}).expand())) for entry in entries)
