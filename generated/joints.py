import math
from numba import njit
OPTIONS = {"cache": True, "error_model": "numpy", "fastmath": {"nsz", "arcp", "contract", "afn", "reassoc"}}

@njit(**OPTIONS)
def _point(sec, i, j, out, k, axis):
    a, b = 9 * i + axis, 9 * j + axis
    out[k], out[k + 1], out[k + 2] = sec[b] - sec[a], sec[b + 3] - sec[a + 3], sec[b + 6] - sec[a + 6]
    for n in range(3):
        out[k + 3 + n] = -1.0 if n == axis else 0.0
        out[k + 6 + n] = 1.0 if n == axis else 0.0

@njit(**OPTIONS)
def turn(sec, i, j, d_x, d_y, angle, out, k):
    _point(sec, i, j, out, k, 2)
    out[k] -= angle

@njit(**OPTIONS)
def revolute(sec, i, j, d_x, d_y, angle, out, k):
    _point(sec, i, j, out, k, 0)
    _point(sec, i, j, out, k + 9, 1)

@njit(**OPTIONS)
def weld(sec, i, j, d_x, d_y, angle, out, k):
    revolute(sec, i, j, d_x, d_y, angle, out, k)
    turn(sec, i, j, d_x, d_y, angle, out, k + 18)

@njit(**OPTIONS)
def _along(sec, i, j, d_x, d_y, out, k):
    a, b = 9 * i, 9 * j
    c, s = math.cos(sec[a + 2]), math.sin(sec[a + 2])
    x, y = c * d_x - s * d_y, s * d_x + c * d_y
    w, e = sec[a + 5], sec[a + 8]
    gx, gy = sec[b] - sec[a], sec[b + 1] - sec[a + 1]
    vx, vy = sec[b + 3] - sec[a + 3], sec[b + 4] - sec[a + 4]
    ax, ay = sec[b + 6] - sec[a + 6], sec[b + 7] - sec[a + 7]
    ug, ng = x * gx + y * gy, x * gy - y * gx
    uv, nv = x * vx + y * vy, x * vy - y * vx
    ua, na = x * ax + y * ay, x * ay - y * ax
    out[k], out[k + 1], out[k + 2] = ug, uv + w * ng, ua + 2 * w * nv + e * ng - w * w * ug
    out[k + 3], out[k + 4], out[k + 5], out[k + 6], out[k + 7], out[k + 8] = -x, -y, ng, x, y, 0.0

@njit(**OPTIONS)
def slide(sec, i, j, d_x, d_y, angle, out, k):
    _along(sec, i, j, d_x, d_y, out, k)

@njit(**OPTIONS)
def prismatic(sec, i, j, d_x, d_y, angle, out, k):
    _along(sec, i, j, -d_y, d_x, out, k)
    turn(sec, i, j, d_x, d_y, angle, out, k + 9)

@njit(**OPTIONS)
def pull(sec, i, j, stiffness, damping, free, out, m):
    a, b = 9 * i, 9 * j
    gx, gy = sec[b] - sec[a], sec[b + 1] - sec[a + 1]
    vx, vy = sec[b + 3] - sec[a + 3], sec[b + 4] - sec[a + 4]
    length = math.sqrt(gx * gx + gy * gy)
    out[m] = length
    if damping == 0.0 and free == 0.0:
        out[m + 1], out[m + 2], out[m + 3] = stiffness * length, -stiffness * gx, -stiffness * gy
        out[m + 4], out[m + 5] = 0.5 * stiffness * length * length, 0.0
        return
    rate = (gx * vx + gy * vy) / length
    tension = stiffness * (length - free) + damping * rate
    out[m + 1], out[m + 2], out[m + 3] = tension, -tension * gx / length, -tension * gy / length
    out[m + 4], out[m + 5] = 0.5 * stiffness * (length - free) ** 2, damping * rate * rate

@njit(**OPTIONS)
def twist(sec, i, j, stiffness, damping, free, out, m):
    angle, rate = sec[9 * j + 2] - sec[9 * i + 2], sec[9 * j + 5] - sec[9 * i + 5]
    out[m], out[m + 1], out[m + 2], out[m + 3] = angle, stiffness * (angle - free) + damping * rate, 0.0, 0.0
    out[m + 4], out[m + 5] = 0.5 * stiffness * (angle - free) ** 2, damping * rate * rate
