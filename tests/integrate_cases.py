"""Small systems for the tests of the integrators."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import csr_array

from kaneflex.integrate.system import AffineSystem


def affine(n, half_bandwidth, terms, force):
    """System from dense matrices: terms[name] = one (n, n) matrix a scalar, or None; force (n, n_scalars)."""
    width = 2 * half_bandwidth + 1
    stacks = {}
    for name in "MCK":
        stack = np.zeros((n * width, force.shape[1]))
        for k, matrix in enumerate(terms[name]):
            if matrix is None:
                continue
            for i, j in zip(*np.nonzero(matrix), strict=True):
                stack[i * width + j - i + half_bandwidth, k] = matrix[i, j]
        stacks[name] = csr_array(stack)
    return AffineSystem(n, half_bandwidth, **stacks, F=csr_array(force))


def constant(mass, damping, stiffness, force=None):
    """A system whose only scalar is 1, and its table."""
    n = len(mass)
    terms = {"M": [mass], "C": [damping], "K": [stiffness]}
    column = np.zeros((n, 1)) if force is None else np.reshape(force, (n, 1))
    return affine(n, n - 1, terms, column), lambda times: np.ones((times.size, 1))


def parametric(stiffness, modulation, rate=0.0, force=0.0):
    """z'' + rate z' + (stiffness + modulation cos t) z = force sin t, and its table; the period is 2 pi."""
    one = np.eye(1)
    terms = {"M": [one], "C": [rate * one], "K": [stiffness * one, modulation * one]}
    system = affine(1, 0, terms, np.array([[0.0, 0.0, force]]))
    return system, lambda times: np.stack((np.ones_like(times), np.cos(times), np.sin(times)), axis=1)


def solved_by_scipy(system, table, times, start, method="DOP853"):
    """Displacements (n_times, n) by SciPy with tight tolerances, an independent check of the compiled loops."""
    n = system.n

    def slope(t, x):
        mass, damping, stiffness, force = (system.dense(name, table(np.array([t]))[0]) for name in "MCKF")
        return np.concatenate((x[n:], np.linalg.solve(mass, force - damping @ x[n:] - stiffness @ x[:n])))

    span, first = (times[0], times[-1]), np.concatenate(start)
    return solve_ivp(slope, span, first, method, times, rtol=1e-11, atol=1e-16).y[:n].T
