"""The plain beam element of a module that stands alone: derived shape functions in the integrals that define it."""

from __future__ import annotations

import re
from collections.abc import Iterable

import sympy as sm

from kaneflex.derive.elements.beam import beam_element
from kaneflex.derive.elements.parameters import BEAMS
from kaneflex.derive.elements.shapes import length, x

BEAM = "beam_euler_bernoulli"
"""The element whose integrals are short enough to be read: no rotary inertia, no shear, one section."""

_ELEMENT = """def element(rho_A, E_A, E_I, h, x_0):
    \"\"\"M, G, K_s, H and the loads f before omega^2, epsilon, a_x, a_y of an element of length h from x_0 on.

    q = (u1, v1, theta1, u2, v2, theta2); Gauss points are exact. Paper (43)-(55), (89)-(90), (96), (98).
    H_k = int (x/h)^k v'^T v' dx is what a tension adds to K, Kane, Ryan and Banerjee (1987).\"\"\"
    M, G, K_s, f, H = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros((6, 4)), np.zeros((3, 6, 6))
    for r, w in zip((1 + GAUSS[0]) / 2, h / 2 * GAUSS[1]):  # at x = r h from the first node
        N = np.array([[<<u>>],
                      [<<v>>]])  # u, v
        slope = np.array([<<slope>>])  # v'
        strain = np.array([<<strain>>])  # u'
        bending = np.array([<<bending>>])  # v''
        M += w * rho_A * N.T @ N
        G += w * rho_A * N.T @ [[0, -1], [1, 0]] @ N
        K_s += w * (E_A * np.outer(strain, strain) + E_I * np.outer(bending, bending))
        f -= w * rho_A * N.T @ [[-x_0 - r * h, 0, 1, 0], [0, x_0 + r * h, 0, 1]]
        H += w * r ** np.arange(3)[:, None, None] * np.outer(slope, slope)
    return M, G, K_s, f, H
"""


def element_text() -> str:
    """The function ``element``."""
    shape = beam_element(**BEAMS[BEAM]).shape
    u, v = shape.row(0), shape.row(1)
    rows = {"u": u, "v": v, "slope": v.diff(x), "strain": u.diff(x), "bending": v.diff(x, 2)}
    return re.sub("<<(\\w+)>>", lambda name: _row(rows[name[1]]), _ELEMENT)


def _row(entries: Iterable[sm.Expr]) -> str:
    h, r = sm.symbols("h r")
    return ", ".join(sm.sstr(sm.factor_terms(entry.subs({length: h, x: r * h}).expand())) for entry in entries)
