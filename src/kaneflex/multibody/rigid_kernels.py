"""Compiled kernels of a structure whose bodies are all rigid and whose drives stand where they are told to.

They have the parameters of those that a structure's module has, as the engine calls them.
"""

from numba import njit

from kaneflex.generated.body import kernels

OPTIONS = {"cache": True, "error_model": "numpy"}
_rigid = kernels(0, 0)
deform_0, push_0, jacobian_0 = _rigid.deform, _rigid.push, _rigid.jacobian
inverse_0, inertia_0, energy_0 = _rigid.inverse, _rigid.inertia, _rigid.energy
KINDS = ((0, 0),)


@njit(**OPTIONS)
def courses(t, p, out, k):
    """Coordinate, speed and acceleration of every drive: p has how many numbers these are, then the numbers."""
    for i in range(int(p[0])):
        out[k + i] = p[1 + i]


@njit(**OPTIONS)
def magnitudes(t, x, i, p, out, k):
    """Nothing pushes what is only placed."""


@njit(**OPTIONS)
def deform(kind, p, o, q, v, a, i, out, k):
    return deform_0(p, o, q, v, a, i, out, k)


@njit(**OPTIONS)
def push(kind, p, o, q, i, c, s, x, y, turn, out, k):
    return push_0(p, o, q, i, c, s, x, y, turn, out, k)


@njit(**OPTIONS)
def jacobian(kind, p, o, q, i, c, s, out, k):
    return jacobian_0(p, o, q, i, c, s, out, k)


@njit(**OPTIONS)
def inverse(kind, p, o, q, v, a, i, c, s, omega, x, y, epsilon, out, k):
    return inverse_0(p, o, q, v, a, i, c, s, omega, x, y, epsilon, out, k)


@njit(**OPTIONS)
def inertia(kind, p, o, q, i, c, s, out, k):
    return inertia_0(p, o, q, i, c, s, out, k)


@njit(**OPTIONS)
def energy(kind, p, o, q, v, i, c, s, v_x, v_y, omega, out):
    return energy_0(p, o, q, v, i, c, s, v_x, v_y, omega, out)
