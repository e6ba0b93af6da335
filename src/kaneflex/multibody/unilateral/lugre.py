"""LuGre friction in the compiled integration, for one friction at a time.

The deflection z of the bristles is a state of first order: z' = v - sigma_0 |v| z / g, with the force sigma_0 z +
sigma_1 z' + sigma_2 v. It is not a massless coordinate of the tree, since sigma_0 |v| / g reaches 1e7/s, v is not its
rate during sliding, and every body's recursion would carry it. Instead it is condensed within the step: for given stage
speeds, z is the solution of three linear equations of the same collocation method, for any stiffness. The force is an
additional unknown of the stages, like a sticking force. Its row of the factors has the linearised law

dF = ((sigma_1 + h sigma_0) / (1 + h sigma_0 |v| / g)) dz' + sigma_2 dv

with h the step times an eigenvalue of the method. No event is needed: slipping and sticking are one law. Where the slip
turns, only the rate's slope changes.
"""

from __future__ import annotations

from numba import njit

from kaneflex.generated import friction as laws
from kaneflex.multibody.compile.types import OPTIONS, basis, larger, no_inline
from kaneflex.multibody.model.layout import BY_PRESS, BY_SPEED, DECAY, FIRMEST, MEMORY, NODES, NORMAL, SLIP, VISCOUS

VISCOUS_AT, STIFFNESS_AT, DAMPING_AT = 7, 12, 13
"""Places among the law's numbers: viscous part, stiffness and damping of the bristles."""
_LEAST = 1e-100
"""Least sliding resistance [N or N m]: without normal force, bristles relax at once."""
_UNKNOWN = 1e-3
"""Share of the bristles' force below which the sliding resistance can't have caused it: the normal force is not known
yet."""


@njit(**OPTIONS)
def sliding_resistance(w, j, N, v):
    """Sliding resistance g at a speed [N or N m]."""
    return larger(laws.dry(w, j, N, v), _LEAST)


@njit(**OPTIONS)
def force_now(w, k, j):
    """Force [N or N m] of bristles on the second side in the current state."""
    v, z = w[k + SLIP], w[k + MEMORY]
    g = sliding_resistance(w, j, w[k + NORMAL], v)
    if g < _UNKNOWN * w[j + STIFFNESS_AT] * abs(z) or g == _LEAST:
        return -w[j + STIFFNESS_AT] * z - w[j + VISCOUS_AT] * v
    return -laws.bristle_force(w, j, g, v, z)


@njit(**OPTIONS)
def linearise(w, k, j, N, v, z, h):
    """Linearise a friction's bristles with deflection z before h; h = 0: at an instant."""
    g = sliding_resistance(w, j, N, v)
    slope = laws.dry_slope(w, j, N, v) if v != 0.0 else 0.0
    decay = laws.bristle_decay(w, j, g, v)
    z = (z + h * v) / (1.0 + h * decay)
    way = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)
    w[k + VISCOUS] = w[k + BY_SPEED] = w[k + DECAY] = w[k + BY_PRESS] = 0.0
    if h > 0.0:
        w[k + VISCOUS], w[k + DECAY] = w[j + VISCOUS_AT], decay
        w[k + BY_SPEED] = larger(laws.bristle_by_speed(w, j, g, slope, v, way, z), 0.0)
    if g > _LEAST and (h > 0.0 or g >= _UNKNOWN * w[j + STIFFNESS_AT] * abs(z)):
        w[k + BY_PRESS] = laws.bristle_by_dry(w, j, g, v, z) * (laws.dry(w, j, 1.0, v) - laws.dry(w, j, 0.0, v))


@njit(**OPTIONS)
def step_damping(w, k, j, h):
    """Derivative of the force with respect to the bristles' rate over a step h."""
    return (w[j + DAMPING_AT] + h * w[j + STIFFNESS_AT]) / (1.0 + h * w[k + DECAY])


@njit(**OPTIONS)
def deflect(table, h, w, k, j, z):
    """Deflection and force of bristles in the stages, from the speeds and g at the nodes; z: before the step h."""
    no_inline()
    one, two, three = k + NODES + 4, k + NODES + 8, k + NODES + 12
    d_0 = laws.bristle_decay(w, j, w[one + 1], w[one])
    d_1 = laws.bristle_decay(w, j, w[two + 1], w[two])
    d_2 = laws.bristle_decay(w, j, w[three + 1], w[three])
    s_0, s_1, s_2 = 1.0 / (1.0 + h * d_0), 1.0 / (1.0 + h * d_1), 1.0 / (1.0 + h * d_2)
    a, c_0, c_1, c_2 = table.a_1, h * d_0 * s_0, h * d_1 * s_1, h * d_2 * s_2
    # with unknowns (1 + h decay) z all coefficients are about one, for any stiffness
    m_00, m_01, m_02 = s_0 + a[0] * c_0, a[1] * c_1, a[2] * c_2
    m_10, m_11, m_12 = a[3] * c_0, s_1 + a[4] * c_1, a[5] * c_2
    m_20, m_21, m_22 = a[6] * c_0, a[7] * c_1, s_2 + a[8] * c_2
    r_0 = z + h * (a[0] * w[one] + a[1] * w[two] + a[2] * w[three])
    r_1 = z + h * (a[3] * w[one] + a[4] * w[two] + a[5] * w[three])
    r_2 = z + h * (a[6] * w[one] + a[7] * w[two] + a[8] * w[three])
    e_0, e_1, e_2 = m_11 * m_22 - m_12 * m_21, m_12 * m_20 - m_10 * m_22, m_10 * m_21 - m_11 * m_20
    scale = 1.0 / (m_00 * e_0 + m_01 * e_1 + m_02 * e_2)
    x_0 = r_0 * e_0 + r_1 * (m_02 * m_21 - m_01 * m_22) + r_2 * (m_01 * m_12 - m_02 * m_11)
    x_1 = r_0 * e_1 + r_1 * (m_00 * m_22 - m_02 * m_20) + r_2 * (m_02 * m_10 - m_00 * m_12)
    x_2 = r_0 * e_2 + r_1 * (m_01 * m_20 - m_00 * m_21) + r_2 * (m_00 * m_11 - m_01 * m_10)
    w[one + 2], w[two + 2], w[three + 2] = x_0 * scale * s_0, x_1 * scale * s_1, x_2 * scale * s_2
    for n in range(3):
        i = one + 4 * n
        w[i + 3] = -laws.bristle_force(w, j, w[i + 1], w[i], w[i + 2])


@njit(**OPTIONS)
def deflection_at_end(table, h, w, k, j, z):
    """Deflection of the bristles at the end of the step."""
    if table.ends[0] != 0.0:
        return w[k + NODES + 14]
    for n in range(3):
        i = k + NODES + 4 + 4 * n
        z += h * table.b_1[n] * laws.bristle_rate(w, j, w[i + 1], w[i], w[i + 2])
    return z


@njit(**OPTIONS)
def sensitivity(w, k, j, step):
    """Deflection of a friction's bristles per 1 m or rad of slip in a step, as a share of their largest one.

    For a contact, the largest since it closed: at separation the normal force vanishes.
    """
    most = 0.0
    for n in range(3):
        i = k + NODES + 4 + 4 * n
        v, g, z = w[i], w[i + 1], w[i + 2]
        way = 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0)
        bends = abs(laws.bristle_by_speed(w, j, g, 0.0, v, way, z)) / (1.0 + step * laws.bristle_decay(w, j, g, v))
        most = larger(most, bends * w[j + STIFFNESS_AT] / larger(g, w[k + FIRMEST]))
    return most


@njit(**OPTIONS)
def turn_error(table, h, step, w, k, j, before):
    """Error of the deflection at the end of a step in which the slip turns, as a share of the largest; otherwise 0.

    The rate then has a kink: its error is the defect of the rate at the start, or, where the slip turns after the last
    node, what is missed from there on. ``before``: deflection at the start.
    """
    one, last, c = k + NODES, k + NODES + 12, table.nodes
    v, g = w[last], w[last + 1]
    least = larger(g, w[k + FIRMEST]) / w[j + STIFFNESS_AT]
    end = basis(c, 1.0, 0) * w[one + 4] + basis(c, 1.0, 1) * w[one + 8] + basis(c, 1.0, 2) * v
    if end * v < 0.0:
        since = h * (1.0 - c[2]) * end / (end - v)
        return since * laws.bristle_decay(w, j, g, end) * abs(w[last + 2]) / least
    if w[one] * v >= 0.0:
        return 0.0
    defect = -laws.bristle_rate(w, j, w[one + 1], w[one], before)
    for n in range(3):
        i = one + 4 + 4 * n
        defect += basis(c, 0.0, n) * laws.bristle_rate(w, j, w[i + 1], w[i], w[i + 2])
    return h * abs(defect) / (1.0 + step * laws.bristle_decay(w, j, g, v)) / least
