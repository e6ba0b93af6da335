"""Kernels of one body that moves freely in the plane and deforms by shapes of its own."""

import math
from functools import cache
from types import SimpleNamespace

from numba import njit

OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"}}


@cache
def kernels(axial, transverse):
    """Kernels of a body with so many axial and transverse shapes, compiled for them when they are first called."""
    shapes = axial + transverse
    S, W = 4, 4 + axial
    XS, XW = W + transverse, W + transverse + axial
    SS = XW + transverse
    SW, N = SS + axial * axial, SS + axial * axial + axial * transverse
    H, A = N + transverse * transverse, N + 2 * transverse * transverse
    K = A + transverse * transverse
    C = K + shapes
    size = C + shapes * shapes
    PS, PW = 3, 3 + axial
    PSI, PH = PW + transverse, PW + 2 * transverse
    point = PH + transverse * transverse

    @njit(**OPTIONS)
    def deform(p, o, q, v, a, i, out, k):
        """A point in the body's axes: xi, eta, theta, their rates and accelerations."""
        x, x1, x2 = p[o + 1], 0.0, 0.0
        y, y1, y2 = p[o + 2], 0.0, 0.0
        turn, turn1, turn2 = 0.0, 0.0, 0.0
        for j in range(axial):
            s = p[o + PS + j]
            x += s * q[i + j]
            x1 += s * v[i + j]
            x2 += s * a[i + j]
        for j in range(transverse):
            b = i + axial + j
            w, psi = p[o + PW + j], p[o + PSI + j]
            y += w * q[b]
            y1 += w * v[b]
            y2 += w * a[b]
            turn += psi * q[b]
            turn1 += psi * v[b]
            turn2 += psi * a[b]
            h, h1 = 0.0, 0.0
            for l in range(transverse):
                h += p[o + PH + transverse * j + l] * q[i + axial + l]
                h1 += p[o + PH + transverse * j + l] * v[i + axial + l]
            x -= 0.5 * h * q[b]
            x1 -= h * v[b]
            x2 -= h1 * v[b] + h * a[b]
        out[k], out[k + 1], out[k + 2] = x, y, turn
        out[k + 3], out[k + 4], out[k + 5] = x1, y1, turn1
        out[k + 6], out[k + 7], out[k + 8] = x2, y2, turn2

    @njit(**OPTIONS)
    def push(p, o, q, i, c, s, x, y, turn, out, k):
        """Add the generalised forces of a force (x, y, global) and a moment at a point: W^T F."""
        share = p[o]
        along, across = c * x + s * y, c * y - s * x
        xi, eta = p[o + 1], p[o + 2]
        for j in range(axial):
            xi += p[o + PS + j] * q[i + j]
            out[k + 3 + j] += p[o + PS + j] * along
        for j in range(transverse):
            b = i + axial + j
            h = 0.0
            for l in range(transverse):
                h += p[o + PH + transverse * j + l] * q[i + axial + l]
            xi -= 0.5 * h * q[b]
            eta += p[o + PW + j] * q[b]
            out[k + 3 + axial + j] += p[o + PW + j] * across - h * along + p[o + PSI + j] * turn
        out[k] += share * x
        out[k + 1] += share * y
        out[k + 2] += xi * across - eta * along + turn

    @njit(**OPTIONS)
    def jacobian(p, o, q, i, c, s, out, k):
        """W (3, 3 + shapes) row by row: the twist of a section at a point, of the speeds of frame and shapes."""
        n = 3 + shapes
        xi, eta = p[o + 1], p[o + 2]
        for j in range(axial):
            shape = p[o + PS + j]
            xi += shape * q[i + j]
            out[k + 3 + j] = c * shape
            out[k + n + 3 + j] = s * shape
            out[k + 2 * n + 3 + j] = 0.0
        for j in range(transverse):
            b = 3 + axial + j
            h, w = 0.0, p[o + PW + j]
            for l in range(transverse):
                h += p[o + PH + transverse * j + l] * q[i + axial + l]
            xi -= 0.5 * h * q[i + axial + j]
            eta += w * q[i + axial + j]
            out[k + b] = -c * h - s * w
            out[k + n + b] = c * w - s * h
            out[k + 2 * n + b] = p[o + PSI + j]
        out[k], out[k + 1], out[k + 2] = p[o], 0.0, -(s * xi + c * eta)
        out[k + n], out[k + n + 1], out[k + n + 2] = 0.0, p[o], c * xi - s * eta
        out[k + 2 * n], out[k + 2 * n + 1], out[k + 2 * n + 2] = 0.0, 0.0, 1.0

    @njit(**OPTIONS)
    def inverse(p, o, q, v, a, i, c, s, omega, x, y, epsilon, out, k):
        """Add M u' - f: the generalised forces that a motion takes; x, y: acceleration of the frame less gravity."""
        mass, first_x, first_y, second = p[o], p[o + 1], p[o + 2], p[o + 3]
        along, across = c * x + s * y, c * y - s * x
        square = omega * omega
        e_x, e_x1, e_x2 = first_x, 0.0, 0.0
        e_y, e_y1, e_y2 = first_y, 0.0, 0.0
        turn, rate = epsilon * second, 0.0
        for j in range(axial):
            b, b1, b2 = q[i + j], v[i + j], a[i + j]
            e_x += p[o + S + j] * b
            e_x1 += p[o + S + j] * b1
            e_x2 += p[o + S + j] * b2
            ss, ss2, sw, sw1 = p[o + XS + j], 0.0, 0.0, 0.0
            both = p[o + XS + j]
            for l in range(axial):
                m = p[o + SS + axial * j + l]
                ss += m * q[i + l]
                ss2 += m * a[i + l]
            for l in range(transverse):
                m = p[o + SW + transverse * j + l]
                sw += m * q[i + axial + l]
                sw1 += m * v[i + axial + l]
            f = p[o + S + j] * along + ss2 - epsilon * sw - 2.0 * omega * sw1 - square * ss
            f += p[o + K + j] * b
            for l in range(shapes):
                f += p[o + C + shapes * j + l] * v[i + l]
            out[k + 3 + j] += f
            second += (ss + both) * b
            turn += epsilon * (ss + both) * b - sw * b2
            rate += 2.0 * ss * b1
        for j in range(transverse):
            r = i + axial + j
            w = p[o + W + j]
            w0, w1, w2 = q[r], v[r], a[r]
            e_y += w * w0
            e_y1 += w * w1
            e_y2 += w * w2
            n, h, h1, m2, sw, sw1 = 0.0, 0.0, 0.0, 0.0, p[o + XW + j], 0.0
            for l in range(transverse):
                n += p[o + N + transverse * j + l] * q[i + axial + l]
                h += p[o + H + transverse * j + l] * q[i + axial + l]
                h1 += p[o + H + transverse * j + l] * v[i + axial + l]
                m2 += p[o + A + transverse * j + l] * a[i + axial + l]
            for l in range(axial):
                sw += p[o + SW + transverse * l + j] * q[i + l]
                sw1 += p[o + SW + transverse * l + j] * v[i + l]
            e_x -= 0.5 * h * w0
            e_x1 -= h * w1
            e_x2 -= h1 * w1 + h * w2
            f = w * across - h * along + m2 + epsilon * sw + 2.0 * omega * sw1 - square * n
            f += p[o + K + axial + j] * w0
            for l in range(shapes):
                f += p[o + C + shapes * (axial + j) + l] * v[i + l]
            out[k + 3 + axial + j] += f
            turn += epsilon * n * w0 + sw * w2
            rate += 2.0 * n * w1
        # R (e + 2 omega S e' ...) in the body's axes, then turned
        f_x = mass * along - epsilon * e_y - square * e_x - 2.0 * omega * e_y1 + e_x2
        f_y = mass * across + epsilon * e_x - square * e_y + 2.0 * omega * e_x1 + e_y2
        out[k] += c * f_x - s * f_y
        out[k + 1] += s * f_x + c * f_y
        out[k + 2] += e_x * across - e_y * along + turn + omega * rate

    @njit(**OPTIONS)
    def inertia(p, o, q, i, c, s, out, k):
        """Mass matrix (3 + shapes, 3 + shapes), row by row."""
        n = 3 + shapes
        e_x, e_y, second = p[o + 1], p[o + 2], p[o + 3]
        for j in range(axial):
            b = k + 3 + j
            shape = p[o + S + j]
            e_x += shape * q[i + j]
            ss, sw = p[o + XS + j], 0.0
            for l in range(axial):
                m = p[o + SS + axial * j + l]
                ss += m * q[i + l]
                out[b + n * (3 + l)] = m
            for l in range(transverse):
                sw += p[o + SW + transverse * j + l] * q[i + axial + l]
                out[b + n * (3 + axial + l)] = 0.0
                out[k + n * (3 + j) + 3 + axial + l] = 0.0
            second += (ss + p[o + XS + j]) * q[i + j]
            out[b] = out[k + n * (3 + j)] = c * shape
            out[b + n] = out[k + n * (3 + j) + 1] = s * shape
            out[b + 2 * n] = out[k + n * (3 + j) + 2] = -sw
        for j in range(transverse):
            b = k + 3 + axial + j
            w, z = p[o + W + j], q[i + axial + j]
            e_y += w * z
            h, m_n, sw = 0.0, 0.0, p[o + XW + j]
            for l in range(transverse):
                h += p[o + H + transverse * j + l] * q[i + axial + l]
                m_n += p[o + N + transverse * j + l] * q[i + axial + l]
                out[b + n * (3 + axial + l)] = p[o + A + transverse * j + l]
            for l in range(axial):
                sw += p[o + SW + transverse * l + j] * q[i + l]
            e_x -= 0.5 * h * z
            second += m_n * z
            row = k + n * (3 + axial + j)
            out[b] = out[row] = -c * h - s * w
            out[b + n] = out[row + 1] = c * w - s * h
            out[b + 2 * n] = out[row + 2] = sw
        out[k] = out[k + n + 1] = p[o]
        out[k + 1] = out[k + n] = 0.0
        out[k + 2] = out[k + 2 * n] = -(s * e_x + c * e_y)
        out[k + n + 2] = out[k + 2 * n + 1] = c * e_x - s * e_y
        out[k + 2 * n + 2] = second

    @njit(**OPTIONS)
    def energy(p, o, q, v, i, c, s, v_x, v_y, omega, out):
        """Add kinetic energy and strain energy [J], dissipated power [W], and mass times the place of its centre."""
        along, across = c * v_x + s * v_y, c * v_y - s * v_x
        e_x, e_x1, e_y, e_y1 = p[o + 1], 0.0, p[o + 2], 0.0
        second, turn, twice, strain, lost = p[o + 3], 0.0, 0.0, 0.0, 0.0
        for j in range(shapes):
            strain += 0.5 * p[o + K + j] * q[i + j] * q[i + j]
            for l in range(shapes):
                lost += p[o + C + shapes * j + l] * v[i + j] * v[i + l]
        for j in range(axial):
            b, b1 = q[i + j], v[i + j]
            e_x += p[o + S + j] * b
            e_x1 += p[o + S + j] * b1
            ss = p[o + XS + j]
            for l in range(axial):
                ss += p[o + SS + axial * j + l] * q[i + l]
                twice += p[o + SS + axial * j + l] * b1 * v[i + l]
            for l in range(transverse):
                turn -= p[o + SW + transverse * j + l] * (q[i + axial + l] * b1 - v[i + axial + l] * b)
            second += (ss + p[o + XS + j]) * b
        for j in range(transverse):
            w0, w1 = q[i + axial + j], v[i + axial + j]
            e_y += p[o + W + j] * w0
            e_y1 += p[o + W + j] * w1
            turn += p[o + XW + j] * w1
            for l in range(transverse):
                h = p[o + H + transverse * j + l] * w0
                e_x -= 0.5 * h * q[i + axial + l]
                e_x1 -= h * v[i + axial + l]
                second += p[o + N + transverse * j + l] * w0 * q[i + axial + l]
                twice += p[o + A + transverse * j + l] * w1 * v[i + axial + l]
        kinetic = 0.5 * p[o] * (along * along + across * across) + 0.5 * omega * omega * second + omega * turn
        kinetic += along * e_x1 + across * e_y1 + omega * (across * e_x - along * e_y) + 0.5 * twice
        out[0] += kinetic
        out[1] += strain
        out[2] += lost
        return c * e_x - s * e_y, s * e_x + c * e_y

    return SimpleNamespace(
        deform=deform, push=push, jacobian=jacobian, inverse=inverse, inertia=inertia, energy=energy, size=size,
        point=point,
    )
