"""Fixed parts of the standalone file; ``<<name>>`` marks the scene's own parts."""

HEAD = '''"""<<title>>

Elastic displacements z about the rigid motion of the mechanism obey linear equations, paper (107), (117), whose
matrices depend on that motion (docs/theory.md of kaneflex, which wrote this file):
    M(t) z'' + (C_s + C_d) z' + (K_s + K_d<<plus>>) z = F(t),  C_s = alpha M + beta K_s,
    C_d = 2 omega G,  K_d = epsilon G - omega^2 M<<tension>>
SI units; angles in rad. `python FILE.py` prints the extremes of the sensors, `python FILE.py OUT.csv` writes their
series, too. Functions to call: scalars(t), equations(t), modes(t), trajectory(), sensors(t, z, v, a).
"""

import math
import sys
from functools import cache

import numpy as np

GAUSS = np.polynomial.legendre.leggauss(4)
ACROSS = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])  # before a displacement and rotation
'''

SPLINE = '''

def spline(y, h):
    """Periodic cubic spline through y at multiples of h: m_k-1 + 4 m_k + m_k+1 = 6 (y_k-1 - 2 y_k + y_k+1) / h^2."""
    wave = 2 * np.cos(2 * np.pi / len(y) * np.arange(len(y) // 2 + 1))
    m = np.fft.irfft(6 / h**2 * (wave - 2) / (wave + 4) * np.fft.rfft(y), len(y))

    def value(x):
        k, r = int(x // h), x / h - x // h
        i, j = k % len(y), (k + 1) % len(y)
        return (1 - r) * y[i] + r * y[j] + h * h / 6 * ((r**3 - r) * m[j] + ((1 - r) ** 3 - 1 + r) * m[i])
    return value
'''

SCALARS = '''

def scalars(t, p=P):
    """Scalars of the rigid motion at time t [s]: Kane's equations with the joint reactions as multipliers."""
    s = <<fixed>>  # scalars that are not here are zero
<<names>>
<<body>>
    return s
'''

KINEMATICS = '''

def product(a, b):
    """Matrix product with its first and second rate, stacked along the first axis (Leibniz)."""
    return np.array([a[0] @ b[0], a[1] @ b[0] + a[0] @ b[1], a[2] @ b[0] + 2 * a[1] @ b[1] + a[0] @ b[2]])


def frame(s, body, at=(0, 0)):
    """Global position of a point of a rigid body, and the rotation R of the body's axes, with rates."""
    if (body, "frame") not in s:
        names = "c s omega epsilon x y v_x v_y a_x a_y"
        c, sine, omega, epsilon, *start = (s.get(f"{body}.{name}", 0.0) for name in names.split())
        R, S = np.array([[c, -sine], [sine, c]]), np.array([[0.0, -1.0], [1.0, 0.0]])
        R = np.array([R, omega * S @ R, (epsilon * S - omega**2 * np.eye(2)) @ R])
        s[body, "frame"] = np.reshape(start, (3, 2)), R
    start, R = s[body, "frame"]
    return start + R @ at, R


def maps(s):
    """Maps L of q = L z, paper (66), in axes of bodies: joints share global displacements. A rigid body is a node."""
    L = {body: np.zeros((3, 3 * len(LINKS[body][0]) if body in LINKS else 3, N)) for body in BODIES}
    for body, (axes, direction, column) in GUIDED.items():
        along = frame(s, axes)[1] @ np.reshape(direction, (2, 1))
        L[body][:, :2, [column]] = product(frame(s, body)[1].transpose(0, 2, 1), along)
    for link, (rows, columns) in OWN.items():
        L[link][0, rows, columns] = 1.0
    for (link, k), by in JOINED.items():
        R_T = frame(s, link)[1].transpose(0, 2, 1)
        L[link][:, 3 * k:3 * k + 2] = product(R_T, turned(s, L, by, 0)[:, :2]) if by in BODIES else R_T @ np.eye(N)[by]
    return L


def turned(s, L, body, k):
    """L of the global displacement and rotation of a node."""
    shift = product(frame(s, body)[1], L[body][:, 3 * k:3 * k + 2])
    return np.concatenate([shift, L[body][:, 3 * k + 2:3 * k + 3]], axis=1)


def about(s, body, of, at, push):
    """A force at a point of a rigid body with its moment about the body's start; a force on a node as it is."""
    x, y = (frame(s, of, at)[0][0] - frame(s, body)[0][0]) * (body not in LINKS)
    return push + np.array([0.0, 0.0, x * push[1] - y * push[0]])


def pushes(s, L, z):
    """Global forces and moments on nodes: inertia m (g - a), -J epsilon, and loads; paper (43), (89)."""
    for body, node, of, at in MASSES:
        moved, spin = product(turned(s, L, body, node), z), s.get(f"{body}.omega", 0.0) * ACROSS
        a = np.append(frame(s, body, at)[0][2]<<less>>, s.get(f"{body}.epsilon", 0.0)) + moved[2]
        yield body, node, about(s, body, body, at, -INERTIA[of] * (a + ALPHA * (moved[1] - spin @ moved[0])))
    for name, (body, node, at, axes, direction) in FORCES.items():
        yield body, node, about(s, body, body, at, s[name] * np.append(frame(s, axes)[1][0] @ direction, 0.0))
'''

EQUATIONS = '''

ELEMENTS = {  # M, G, K_s, f, H of all elements
    link: [np.array(each) for each in zip(*(element(*section, h, x_0) for h, x_0 in zip(np.diff(nodes), nodes)))]
    for link, (nodes, *section) in LINKS.items()
}


def beam(s, link):
    """Matrices M, C, K, F, K_s of every element of a link, paper (107)."""
    (nodes, rho_A, *_), (M, G, K_s, f, H) = LINKS[link], ELEMENTS[link]
    names = "omega epsilon link.a_x link.a_y link.P_0"
    omega, epsilon, a_x, a_y, P_0 = (s.get(f"{link}.{name}", 0.0) for name in names.split())
    K = K_s + epsilon * G - omega**2 * M
<<K_g>>    return M, ALPHA * M + BETA * K_s + 2 * omega * G, K, f @ (omega**2, epsilon, a_x, a_y), K_s


def equations(t):
    """M, C, K, F, K_s at time t: sums of L^T M L, L^T (C L + 2 M L'), L^T (K L + C L' + M L''), L^T F, L^T K_s L."""
    s, zero = scalars(t), np.zeros((3, 3))
    L, parts = maps(s), []
    for link in LINKS:
        parts += [(L[link][:, 3 * e:3 * e + 6], *matrices) for e, matrices in enumerate(zip(*beam(s, link)))]
    for body, node, of, _ in MASSES:
        M, spin = np.diag(INERTIA[of]), s.get(f"{body}.omega", 0.0) * ACROSS
        parts.append((turned(s, L, body, node), M, ALPHA * M, -ALPHA * M @ spin, np.zeros(3), zero))
    for body, node, push in pushes(s, L, np.zeros((3, N))):
        parts.append((turned(s, L, body, node), zero, zero, zero, push, zero))
    M, C, K, F, K_s = np.zeros((N, N)), np.zeros((N, N)), np.zeros((N, N)), np.zeros(N), np.zeros((N, N))
    for (L, rate, accel), m, c, k, f, k_s in parts:
        M, C, F = M + L.T @ m @ L, C + L.T @ (c @ L + 2 * m @ rate), F + L.T @ f
        K, K_s = K + L.T @ (k @ L + c @ rate + m @ accel), K_s + L.T @ k_s @ L
    return M, C, K, F, K_s


def modes(t):
    """Natural frequencies [rad/s] and shapes, Phi^T M Phi = 1, of K_s phi = omega^2 M phi; paper (135), (140)."""
    M, *_, K_s = equations(t)
    inverse = np.linalg.inv(np.linalg.cholesky(M))
    squares, shapes = np.linalg.eigh(inverse @ (K_s + K_s.T) @ inverse.T / 2)
    return np.sqrt(np.maximum(squares, 0.0)), inverse.T @ shapes
'''

K_G = '''\
    x_0, h = nodes[:-1], np.diff(nodes)  # K_g = sum P_k H_k, P_0 + P_1 x/h + P_2 (x/h)^2 the rigid link's tension
    P_0, P_1 = P_0 + rho_A * x_0 * (a_x - omega**2 * x_0 / 2), rho_A * h * (a_x - omega**2 * x_0)
    K = K + np.einsum("ke,ekij->eij", (P_0, P_1, -rho_A * h**2 * omega**2 / 2), H)
'''

RADAU = '''

NODES = np.array([0.4 - math.sqrt(6.0) / 10.0, 0.4 + math.sqrt(6.0) / 10.0, 1.0])
INVERSE = np.linalg.inv(NODES[:, None] ** np.arange(3))
A, B = NODES[:, None] ** np.arange(1, 4) / np.arange(1, 4) @ INVERSE, 1.0 / np.arange(1, 4) @ INVERSE


def steps(z, v, loaded=1.0):
    """Yield z, v, a after steps from states in columns: Radau IIA, order 5 (Hairer and Wanner 1996, section IV.5).

    Unknowns are the accelerations x_s of three stages: M_s x_s + C_s v_s + K_s z_s = loaded F_s with
    v_s = v + h sum a_sr x_r,  z_s = z + c_s h v + h^2 sum (a a)_sr x_r
    """
    h, (n, m) = DURATION / STEPS, z.shape
    for k in range(STEPS):
        left, right = np.zeros((3, n, 3, n)), np.zeros((3, n, m))
        for s, node in enumerate(NODES):
            M, C, K, F, _ = equations(h * (k + node))
            for r in range(3):
                left[s, :, r] = (r == s) * M + h * A[s, r] * C + h**2 * (A @ A)[s, r] * K
            right[s] = np.outer(F, loaded * np.ones(m)) - C @ v - K @ (z + node * h * v)
        x = np.linalg.solve(left.reshape(3 * n, 3 * n), right.reshape(3 * n, m)).reshape(3, n, m)
        z, v = z + h * v + h**2 * np.tensordot(B @ A, x, 1), v + h * np.tensordot(B, x, 1)
        yield z, v, x[2]
'''

FROM_STATE = '''

def trajectory():
    """States z, z', z'' at all instants, (3, STEPS + 1, N), from the initial state with the numbers above."""
    z, v = (np.array(each).reshape(N, 1) for each in <<start>>)
    M, C, K, F, _ = equations(0.0)
    first = z, v, np.linalg.solve(M, F[:, None] - C @ v - K @ z)
    return np.array([first, *steps(z, v)])[..., 0].transpose(1, 0, 2)
'''

REPEATED = '''

def trajectory():
    """States z, z', z'' of the periodic motion, (3, STEPS + 1, N).

    A cycle maps x = (z, h v) to A x + b; columns of A come from unit states without load, b from rest.
    """
    h, unit = DURATION / STEPS, np.eye(2 * N, 2 * N + 1)
    for z, v, _ in steps(unit[:N], unit[N:] / h, np.eye(1, 2 * N + 1, 2 * N)[0]):
        after = np.concatenate([z, h * v])
    x = np.linalg.solve(np.eye(2 * N) - after[:, :-1], after[:, -1:])
    found = [*steps(x[:N], x[N:] / h)]
    return np.array([found[-1], *found])[..., 0].transpose(1, 0, 2)
'''

SPECTRAL = '''

GRIDS = <<grids>>  # instants of the cycle, and corrections on them


def harmonics(z, count, order=0):
    """Derivative of the trigonometric polynomials through z, (instants, n), at ``count`` instants of the cycle."""
    half, k = len(z) // 2, np.arange(len(z) // 2 + 1)
    waves = np.exp(2j * np.pi * (np.outer(np.arange(count), k) % count) / count) * np.where(k % half == 0, 1, 2)
    return (waves * (2j * np.pi * k / DURATION) ** order @ np.fft.rfft(z, axis=0)).real / len(z)


def trajectory():
    """States z, z', z'' of the periodic motion, (3, STEPS + 1, N), by Fourier collocation on finer and finer grids.

    GMRES (Saad and Schultz 1986) in y, z = L^-T y, K = L L^T; preconditioned by the mean equations."""
    z = None
    for count, corrections in GRIDS:
        M, C, K, F, _ = map(np.array, zip(*(equations(DURATION * k / count) for k in range(count))))
        L_1 = np.linalg.inv(np.linalg.cholesky((K + K.transpose(0, 2, 1)) / 2))
        if z is None:  # modes of the mean equations
            z, mean = np.zeros((count, N)), lambda X, n=1: (L_1 @ X @ L_1.transpose(0, 2, 1))[::n].mean(axis=0)
            basis = np.linalg.qr(np.random.default_rng(0).standard_normal((N, min(N, <<vectors>>))))[0]
            for _ in range(4 * (N > <<modes>>)):  # subspace iteration (Bathe 2013)
                basis = np.linalg.qr(mean(M, count // 16) @ basis)[0]
            shapes = basis @ np.linalg.eigh(basis.T @ (mean(M) + mean(M).T) @ basis)[1][:, ::-1][:, :<<modes>>]
            m, c, k = (np.diag(shapes.T @ mean(X) @ shapes) for X in (M, C, K))
        order = 2 * np.pi / DURATION * np.arange(count // 2 + 1)[:, None]
        of_y = lambda y: (L_1.transpose(0, 2, 1) @ y.reshape(count, N, 1))[..., 0]
        gains = 1 / (k - m * order**2 + 1j * c * order * (order < order[-1]))

        def answer(z, loads=0.0):
            z = loads - sum((X @ harmonics(z, count, r)[..., None])[..., 0] for r, X in enumerate((K, C, M)))
            y = (L_1 @ z[..., None])[..., 0]
            share = y @ shapes
            return (y + (np.fft.irfft(gains * np.fft.rfft(share, axis=0), count, axis=0) - share) @ shapes.T).ravel()

        z = harmonics(z, count)
        rest, images = answer(z, F), []
        for _ in range(corrections):
            vectors = np.linalg.qr(np.transpose([rest, *images]))[0].T
            images.append(-answer(of_y(vectors[-1])))
        z = z + of_y(np.linalg.lstsq(np.transpose(images), rest, rcond=None)[0] @ vectors)
    return np.array([harmonics(z, STEPS, order) for order in range(3)])[:, np.arange(STEPS + 1) % STEPS]
'''

FORESHORTENING = '''

<<held>>


@cache
def statics(link):
    """Static shapes of unit displacements of a link at its joints, and its stiffness against these."""
    K_s, held = np.zeros((3 * len(LINKS[link][0]),) * 2), HELD[link]
    for e, each in enumerate(ELEMENTS[link][2]):
        K_s[3 * e:3 * e + 6, 3 * e:3 * e + 6] += each
    shapes, free = np.eye(len(K_s))[:, held], np.setdiff1d(np.arange(len(K_s)), held)
    shapes[free] = -np.linalg.lstsq(K_s[np.ix_(free, free)], K_s[np.ix_(free, held)], rcond=None)[0]
    return shapes, shapes.T @ K_s @ shapes


def shortened(L, q, z):
    """Displacements (u, v, theta) of all nodes with the shortening s(x) = 1/2 int v'^2 of bent axes.

    Joints stay closed with the least strain energy of the links: sum (L^T K L) z = -sum L^T K s over joints."""
    S, g, short = np.zeros((3, N, N)), np.zeros((3, N)), {}
    for link, held in HELD.items():
        count, H = len(LINKS[link][0]), ELEMENTS[link][4][:, 0]
        x = q[link][:, 3 * np.arange(count - 1)[:, None] + np.arange(6)]
        squares = np.einsum("aei,eij,bej->abe", x, H, x)
        short[link] = np.zeros((3, 3 * count))
        short[link][:, 3::3] = np.cumsum([squares[0, 0] / 2, squares[0, 1], squares[1, 1] + squares[0, 2]], axis=1)
        push = L[link][:, held].transpose(0, 2, 1) @ statics(link)[1]
        S, g = S + product(push, L[link][:, held]), g - product(push, short[link][:, held])
    S, own = S * (1.0 + 1e-11 * np.eye(N)), np.zeros((3, N))  # undetermined displacements stay small
    S[0] += np.diag(np.diag(S[0]) == 0.0)
    own[0] = np.linalg.solve(S[0], g[0])
    own[1] = np.linalg.solve(S[0], g[1] - S[1] @ own[0])
    own[2] = np.linalg.solve(S[0], g[2] - 2 * S[1] @ own[1] - S[2] @ own[0])
    d = {body: product(L[body], z + own) for body in BODIES}
    return d | {link: q[link] - short[link] + (product(L[link][:, held], own) + short[link][:, held])
                @ statics(link)[0].T for link, held in HELD.items()}
'''

REACTIONS = '''

<<joints>>


def reactions(s, z, L, g):
    """Global force and moment of every joint on its second side, by equilibrium of nodes and rigid bodies."""
    sites = [*dict.fromkeys(site for joint in JOINTS.values() for _, site, *_ in joint[3:])]
    A, names, units = [], [], []
    for body, node, push in pushes(s, L, z):
        g[body][node] -= push
    for name, (axes, (x, y), kinds, *sides) in JOINTS.items():
        for kind in kinds:
            direction = frame(s, axes)[1][0] @ {"along": (x, y), "across": (-y, x), "moment": (0, 0)}[kind]
            names, units = [*names, name], [*units, np.append(direction, kind == "moment")]
            A.append(np.zeros((len(sites), 3)))
            for sign, site, of, at in sides:
                A[-1][sites.index(site)] = sign * about(s, site[0], of, at, units[-1])
    A, b = (np.array(each) / (1, 1, <<length>>) for each in (A, [g[body][node] for body, node in sites]))
    r = np.linalg.lstsq(A.reshape(len(A), -1).T, b.ravel(), rcond=None)[0]
    return {name: r * np.equal(names, name) @ units for name in JOINTS}
'''

SENSORS = '''

def sensors(t, z, v, a):
    """Readings of all sensors at time t with the elastic coordinates z, z', z''."""
    s, z = scalars(t), np.array([z, v, a])
    L, R, f, g = maps(s), {body: frame(s, body)[1] for body in BODIES}, {}, {body: np.zeros((1, 3)) for body in BODIES}
    q = {body: product(L[body], z) for body in BODIES}
    d = {body: each.reshape(3, -1, 3) for body, each in <<displaced>>.items()}
    for link in LINKS:  # M q'' + C q' + K q - F of every element: forces and moments at its two ends
        M, C, K, F, _ = beam(s, link)
        x = q[link][:, 3 * np.arange(len(F))[:, None] + np.arange(6), None]
        f[link] = ((M @ x[2] + C @ x[1] + K @ x[0])[..., 0] - F).reshape(-1, 2, 3)
<<exerted>><<helpers>>    return <<sensors>>
'''

EXERTED = '''\
        ends = np.concatenate([f[link][..., :2] @ R[link][0].T, f[link][..., 2:]], axis=2)  # in global axes
        g[link] = np.pad(ends[:, 0], ((0, 1), (0, 0))) + np.pad(ends[:, 1], ((1, 0), (0, 0)))
    exerted = reactions(s, z, L, g)
'''

OF_POINTS = {
    "place": '''\
    def place(body, node, at):  # global position with rates
        return frame(s, body, at)[0] + product(R[body], d[body][:, node, :2])
''',
    "turn": '''\
    def turn(body, node):  # angle with rates
        angle = math.atan2(R[body][0][1, 0], R[body][0][0, 0])
        return (angle, s.get(f"{body}.omega", 0.0), s.get(f"{body}.epsilon", 0.0)) + d[body][:, node, 2]
''',
}

TENSION = ",  K_g by the axial force of the rigid mechanism"

MAIN = '''

def main():
    times = DURATION / STEPS * np.arange(STEPS + 1)
    rows = [sensors(t, *state) for t, state in zip(times, trajectory().transpose(1, 0, 2))]
    series = {"time": times} | {name: np.array([row[name] for row in rows]) for name in rows[0]}
<<angles>>    print("natural frequencies [Hz]:", *(f"{omega / 2 / np.pi:.6g}" for omega in modes(<<reference>>)[0][:6]))
    for name, values in series.items():
        print(f"{name:30} {values.min():16.9g} {values.max():16.9g}")
    if len(sys.argv) > 1:
        np.savetxt(sys.argv[1], np.transpose([*series.values()]), "%.17g", ",", header=",".join(series), comments="")


if __name__ == "__main__":
    main()
'''
ANGLES = '''    for name in <<names>>:  # full turns
        series[name] = np.unwrap(series[name])
'''
