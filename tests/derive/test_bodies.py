"""Bodies of one and of several shapes, in the plane and in space, against momenta by hand; products of different ones.

Shapes are polynomials over a bar and over a cube, integrated by Gauss's quadrature. Momenta are exact to the second
order in the coordinates (Shabana 2013, Dynamics of Multibody Systems, chapter 5); force, moment and generalised forces
are their rates in turning axes, the last less the derivative of the kinetic energy.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from interpreted import interpreted
from machines import machine

from kaneflex import read_scene, scene_of
from kaneflex.derive.bodies import kinds
from kaneflex.derive.bodies.proof import NotKane, comparisons, prove
from kaneflex.generated import joints, shapes, spatial, spatial_shapes
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.spatial import Side
from kaneflex.multibody.model.assembly import build_system
from kaneflex.multibody.model.body_parameters import Blocks, point_numbers, shaped_numbers
from kaneflex.multibody.model.shapes import ShapeMoments, Shapes
from kaneflex.multibody.model.topology import build_tables

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)
S, WEIGHTS = (_POINTS + 1) / 2, _WEIGHTS / 2
MU, J_LINE, LENGTH = 1.7, 0.04, 1.3
"""Mass and rotary inertia per length, length."""
MOTIONS = np.random.default_rng(24)


def assert_equal(found, expected):
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13 * abs(np.asarray(expected)).max())


def elasticity(count):
    """Stiffness of each shape and a full damping matrix."""
    root = MOTIONS.uniform(-1, 1, (count, count))
    return MOTIONS.uniform(20.0, 60.0, count), root @ root.T


def behind(count, numbers):
    """The same numbers behind so many that nothing reads."""
    return np.concatenate([np.full(count, np.nan), numbers])


# ---- the printed text ------------------------------------------------------------------------------------------


def printed(module):
    return "@njit" + Path(module.__file__).read_text(encoding="utf-8").partition("@njit")[2]


PLANE, SPACE = printed(shapes), printed(spatial_shapes).rpartition("\n\n@njit")[0]
# Numba takes nine seconds to compile them for arrays of these types.
joints, shapes, spatial, spatial_shapes = map(interpreted, (joints, shapes, spatial, spatial_shapes))
PROOFS = {"plane": (PLANE, kinds.PLANE), "space": (SPACE, kinds.SPACE)}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("dimension", PROOFS)
def test_every_kernel_is_compared(dimension):
    text, of = PROOFS[dimension]
    names = {name for name, *_ in comparisons(text, of, ("u", "v"))}
    assert names == set(re.findall(r"def (\w+)", text))


@pytest.mark.exhaustive(share=8)
@pytest.mark.parametrize(("dimension", "right", "wrong"), [
    ("plane", "2.0 * H_z_uv * omega_z", "H_z_uv * omega_z"),
    ("plane", "xi += v_j * x_vv", "xi -= v_j * x_vv"),
    ("plane", "H_z_uq += H_z_l * q[i + l]", "H_z_uq -= H_z_l * q[i + l]"),
    ("plane", "xi += 0.5 * q_j * x_vq", "xi += q_j * x_vq"),
    ("plane", "range(to_u, to_v)", "range(to_u)"),
    ("plane", "m_z += H_z_vq * b_j + H_z_vv * v_j", "pass"),
    ("space", "2.0 * H_z_vv * omega_z", "H_z_vv * omega_z"),
    ("space", "room[z + 2 * j] * of_w", "room[z + 2 * j] * of_v"),
    ("space", "scale_2 += b_j * scale_tq", "scale_2 += v_j * scale_tq"),
    ("space", "X_x_wv += p[o + 1]", "X_x_wv += p[o + 2]"),
    ("space", "J_yy_vq += p[o + 2]", "J_yy_vq += p[o + 1]"),
    ("space", "s_yz = -2.0 * omega_y", "s_yz = 2.0 * omega_y"),
    ("space", "strain += 0.5 * K_0", "strain += K_0"),
    ("space", "int(p[o + 3]), p[o + 4]", "int(p[o + 2]), p[o + 4]"),
])  # fmt: skip
def test_a_wrong_kernel_is_not_proved(dimension, right, wrong):
    text, of = PROOFS[dimension]
    assert right in text
    with pytest.raises((NotKane, IndexError)):
        prove(text.replace(right, wrong), of)


# ---- the plane ----------------------------------------------------------------------------------------------------


def bar(axial, transverse):
    """s = x - x^k/3 and w = x^k for k from 2 over x = X/L, psi = w' and H = int_0^X w' w'^T dX, at S."""
    x, k = S[:, None], np.arange(2, transverse + 2)
    along = x - x ** np.arange(2, axial + 2) / 3
    across, turn = x**k, k * x ** (k - 1) / LENGTH
    power = k[:, None] + k - 1
    bow = k[:, None] * k * S[:, None, None] ** power / (power * LENGTH)
    return along, across, turn, bow


def bar_by_hand(axial, transverse, q, v, a, elastic, motion):
    """Arrays of the bar, what its motion takes and its mass matrix, rows along, across, turn and shapes.

    P = (m v_x + e_x' - omega e_y, m v_y + e_y' + omega e_x), L = I omega + g.q' - v_x e_y + v_y e_x and
    p = m_qq q' + g omega + e_x,q v_x + e_y,q v_y with the first moments e, the second moment I and g(q).
    """
    (a_x, a_y, omega, epsilon), (stiffness, damping) = motion, elastic
    s, w, psi, H = bar(axial, transverse)
    dm, dJ, X = WEIGHTS * MU * LENGTH, WEIGHTS * J_LINE * LENGTH, LENGTH * S
    arrays = {
        "mass": dm.sum(), "mass_X": dm @ X, "mass_X_X": dm @ X**2, "inertia": dJ.sum(), "mass_s": dm @ s,
        "mass_w": dm @ w, "mass_X_s": (dm * X) @ s, "mass_X_w": (dm * X) @ w, "inertia_psi": dJ @ psi,
        "mass_s_s": dm * s.T @ s, "mass_s_w": dm * s.T @ w, "mass_w_w": dm * w.T @ w,
        "mass_H": np.tensordot(dm, H, 1), "mass_X_H": np.tensordot(dm * X, H, 1),
        "inertia_psi_psi": dJ * psi.T @ psi, "stiffness": stiffness, "damping": damping,
    }  # fmt: skip
    n, b, c = axial + transverse, slice(0, axial), slice(axial, None)
    h, hq = np.zeros((n, n)), np.zeros((n, n))
    h[c, c], hq[c, c] = arrays["mass_H"], arrays["mass_X_H"]
    first_x, first_y, cross = np.zeros(n), np.zeros(n), np.zeros((n, n))
    first_x[b], first_y[c] = arrays["mass_s"], arrays["mass_w"]
    cross[b, c] = arrays["mass_s_w"]
    own, second = np.zeros((n, n)), np.zeros((n, n))
    own[b, b] = second[b, b] = arrays["mass_s_s"]
    own[c, c], second[c, c] = arrays["mass_w_w"] + arrays["inertia_psi_psi"], arrays["mass_w_w"] - arrays["mass_X_H"]
    lever, swept = np.zeros(n), np.zeros(n)
    lever[b], swept[c] = arrays["mass_X_s"], arrays["mass_X_w"] + arrays["inertia_psi"]
    m = arrays["mass"]
    e_x, e_y = arrays["mass_X"] + first_x @ q - q @ h @ q / 2, first_y @ q
    by_x, turned = first_x - h @ q, swept + (cross.T - cross) @ q
    inertia, by_q = arrays["mass_X_X"] + arrays["inertia"] + 2 * lever @ q + q @ second @ q, 2 * lever + 2 * second @ q
    force_x = m * a_x + by_x @ a - v @ h @ v - epsilon * e_y - 2 * omega * first_y @ v - omega**2 * e_x
    force_y = m * a_y + first_y @ a + epsilon * e_x + 2 * omega * by_x @ v - omega**2 * e_y
    moment = inertia * epsilon + omega * by_q @ v + turned @ a - a_x * e_y + a_y * e_x
    shapes = own @ a + turned * epsilon + by_x * a_x + first_y * a_y - omega**2 * by_q / 2
    shapes += 2 * omega * (cross.T - cross) @ v + stiffness * q + damping @ v
    mass = np.block([
        [np.array([[m, 0, -e_y], [0, m, e_x], [-e_y, e_x, inertia]]), np.stack([by_x, first_y, turned])],
        [np.stack([by_x, first_y, turned], axis=1), own],
    ])  # fmt: skip
    return arrays, np.array([force_x, force_y, moment, *shapes]), mass


@pytest.mark.parametrize(("axial", "transverse"), [(1, 0), (0, 1), (1, 1), (0, 2), (2, 1), (1, 3)])
def test_a_bar_of_shapes(axial, transverse):
    """Forces of any motion, mass matrix and strain energy: axial with transverse shapes, and two or three of a kind;
    numbers begin behind those of others."""
    count, own = axial + transverse, len(joints.BODY)
    elastic = elasticity(count)
    for _ in range(3):
        q, v, a = MOTIONS.uniform(-1, 1, (3, count))
        a_x, a_y, omega, epsilon = motion = MOTIONS.uniform(-1, 1, 4)
        arrays, forces, mass = bar_by_hand(axial, transverse, q, v, a, elastic, motion)
        p = behind(7, shaped_numbers(arrays))
        w, out, parts = np.array([np.nan, omega, a_x, a_y, epsilon]), np.zeros(5), np.zeros(11 + count * (3 + count))
        q_4, v_4, a_4, rows = (behind(4, each) for each in (q, v, a, np.zeros(count)))
        joints.demand(p, 7, w, 1, out, 2)
        shapes.shaped_demand(p, 7 + own, count, w, 1, q_4, v_4, a_4, 4, out, 2, rows)
        joints.inertia(p, 7, parts, 2)
        shapes.shaped_inertia(p, 7 + own, count, q_4, 4, parts, 2)
        I, E, L = np.split(parts[2:], [9, 9 + 3 * count])
        E = E.reshape(count, 3).T
        assert_equal(np.array([*out[2:], *rows[4:]]), forces)
        assert_equal(np.block([[I.reshape(3, 3), E], [E.T, L.reshape(count, count)]]), mass)
        assert_equal(shapes.shaped_strain(p, 7 + own, count, q_4, 4), elastic[0] @ q**2 / 2)


def test_a_section_of_a_bar():
    """Displacement of the section and its derivatives; its acceleration at constant rates."""
    s, w, psi, H = (each[3] for each in bar(2, 3))
    q, v = MOTIONS.uniform(-1, 1, (2, 5))
    rows, shortening = np.zeros((3, 5)), np.zeros((5, 5))
    rows[0, :2], rows[1, 2:], rows[2, 2:], shortening[2:, 2:] = s, w, psi, -H
    p = behind(7, point_numbers(2, rows, shortening))
    twists, (b, a) = np.full(2 + 15, np.nan), (q[:2], q[2:])
    moved = shapes.displace(p, 7, 5, behind(4, q), 4, twists, 2)
    assert_equal(moved, [s @ b - a @ H @ a / 2, w @ a, psi @ a])
    none = np.zeros(2)
    assert_equal(twists[2:].reshape(5, 3).T, [[*s, *-H @ a], [*none, *w], [*none, *psi]])
    assert_equal(shapes.growth(p, 7, 5, behind(4, v), 4), -v[2:] @ H @ v[2:])


def test_a_rigid_body_beside_its_axis_is_newtons_and_eulers():
    """Centre at (0.3, -0.2) of a body of 2 kg and 0.5 kg m^2; forces and moment about its start (Shabana 2013, 3.4)."""
    m, J, centre = 2.0, 0.5, np.array([0.3, -0.2])
    omega, epsilon, a_O, found = 3.0, -4.0, np.array([1.5, -9.0]), np.zeros(3)
    force = m * (a_O + epsilon * np.array([-centre[1], centre[0]]) - omega**2 * centre)
    joints.demand(np.array([m, *centre, J]), 0, [omega, *a_O, epsilon], 0, found, 0)
    assert_equal(found, np.array([*force, J * epsilon + centre[0] * force[1] - centre[1] * force[0]]))


# ---- space --------------------------------------------------------------------------------------------------------

CUBE = np.array(np.meshgrid(S, S, S)).reshape(3, -1).T
CUBE_WEIGHTS = np.einsum("i,j,k->ijk", WEIGHTS, WEIGHTS, WEIGHTS).ravel()


def cube(count):
    """N (points, count, 3) and G (points, count, count, 3), symmetric, of a unit cube from the origin."""
    x, y, z = CUBE.T
    N = np.stack([np.stack(of, axis=1) for of in (
        (-2 * x * y, x**2 - x * z, x * y), (x * z, y**2 / 2, -(x**2) * z), (z**2 - y, x * y * z, x**3 / 2),
    )], axis=1)[:, :count]  # fmt: skip
    G = np.einsum("pjx,pkx->pjk", N, N)[..., None] * np.stack([-x / 2, y * z, -z], axis=1)[:, None, None]
    return N, G


def cube_by_hand(dm, N, G, q, v, b, motion):
    """What a motion takes of that cube without elasticity, and its mass matrix.

    P = m V + omega x S + S', L = S x V + I omega + g.q', p = n q' + S,q V + g omega; S = int (r + N q + G q q/2) dm,
    I to the second order and g_j = int (r x N_j + q_k (r x G_jk + N_k x N_j)) dm to the first order.
    """
    (omega, a, epsilon), unit, cross, r = motion, np.eye(3), np.cross, CUBE
    m, moved, bent = dm.sum(), np.einsum("pjx,j->px", N, q), np.einsum("pjkx,j,k->px", G, q, q) / 2
    S_0 = dm @ (r + moved + bent)
    by_q = np.einsum("p,pjx->jx", dm, N) + np.einsum("p,pjkx,k->jx", dm, G, q)
    own = np.einsum("p,pjx,pkx->jk", dm, N, N)

    def product(left, right):
        """int (left . right 1 - (left right^T + right left^T)/2) dm."""
        outer = np.einsum("p,px,py->xy", dm, left, right)
        return np.trace(outer) * unit - (outer + outer.T) / 2

    shapes = range(len(q))
    grown = np.einsum("pjkx,k->pjx", G, q)
    inertia = product(r, r) + 2 * product(r, moved + bent) + product(moved, moved)
    by_shape = [2 * product(r, N[:, j] + grown[:, j]) + 2 * product(moved, N[:, j]) for j in shapes]
    turned = np.array([dm @ (cross(r, N[:, j] + grown[:, j]) + cross(moved, N[:, j])) for j in shapes])
    turned_by = np.array([[dm @ (cross(r, G[:, j, k]) + cross(N[:, k], N[:, j])) for k in shapes] for j in shapes])
    rate, changed = v @ by_q, v @ turned
    force = m * a + cross(epsilon, S_0) + 2 * cross(omega, rate) + cross(omega, cross(omega, S_0)) + b @ by_q
    force += np.einsum("p,pjkx,j,k->x", dm, G, v, v)
    moment = cross(S_0, a) + inertia @ epsilon + sum(v[j] * by_shape[j] for j in shapes) @ omega + b @ turned
    moment += np.einsum("jkx,j,k->x", turned_by, v, v) + cross(omega, inertia @ omega + changed)
    rows = by_q @ a + turned @ epsilon + own @ b
    rows += np.array([-omega @ by_shape[j] @ omega / 2 for j in shapes])
    # d/dt of g_j(q) omega less the derivative of omega g_k(q) q_k' by q_j
    rows += np.array([sum((turned_by[j, k] - turned_by[k, j]) @ omega * v[k] for k in shapes) for j in shapes])
    arm = np.array([[0, -S_0[2], S_0[1]], [S_0[2], 0, -S_0[0]], [-S_0[1], S_0[0], 0]])
    mass = np.block([[m * unit, -arm, by_q.T], [arm, inertia, turned.T], [by_q, turned, own]])
    return np.array([*force, *moment, *rows]), mass


def sums(dm, N, G, stiffness, damping, cubic):
    """Numbers of the body behind those of the rigid one."""
    moments = ShapeMoments(
        np.einsum("p,pja->aj", dm, N), np.einsum("p,pa,pjb->abj", dm, CUBE, N),
        np.einsum("p,pja,pkb->abjk", dm, N, N), np.einsum("p,pjka->ajk", dm, G),
        np.einsum("p,pa,pjkb->abjk", dm, CUBE, G),
    )  # fmt: skip
    return moments.numbers((0, 0, 0, 0), np.diag(stiffness), damping, cubic)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_cube_of_shapes(count):
    """Forces of any motion, mass matrix and strain energy, with all products of different shapes and a cubic energy."""
    dm, (N, G) = 1.7 * CUBE_WEIGHTS, cube(count)
    stiffness, damping = elasticity(count)
    cubic = MOTIONS.uniform(-1, 1, (count, count, count))
    cubic = sum(cubic.transpose(order) for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)))
    m = dm.sum()
    rigid = [m, 0.5, 0.5, 0.5, m / 6, m / 6, m / 6, 0.0, 0.0, 0.0]
    p = np.array([*rigid, *sums(dm, N, G, stiffness, damping, cubic)])
    for _ in range(3):
        q, v, b = MOTIONS.uniform(-1, 1, (3, count))
        w = MOTIONS.uniform(-1, 1, 9)
        found, size, room = np.zeros(6 + count), 36 + 6 * count, np.zeros(2 * count)
        spatial.demand(p, 0, w, 0, found, 0)
        spatial_shapes.shaped_demand(p, 10, count, w, 0, q, v, b, 0, found, 0, found[6:], room, 0)
        matrix = np.zeros(size + count**2)
        spatial.inertia(p, 0, matrix, 0)
        spatial_shapes.shaped_inertia(p, 10, count, q, 0, matrix, 0, room, 0)
        couples = matrix[36:size].reshape(count, 6).T
        whole = np.block([[matrix[:36].reshape(6, 6), couples], [couples.T, matrix[size:].reshape(count, count)]])
        forces, mass = cube_by_hand(dm, N, G, q, v, b, w.reshape(3, 3))
        forces[6:] += stiffness * q + damping @ v + np.einsum("jkl,k,l->j", cubic, q, q)
        assert_equal(found, forces)
        assert_equal(whole, mass)
        strain = stiffness @ q**2 / 2 + np.einsum("jkl,j,k,l", cubic, q, q, q) / 3
        assert_equal(spatial_shapes.shaped_strain(p, 10, count, q, 0), strain)


# ---- blocks of a scene --------------------------------------------------------------------------------------------


LOADED = machine(
    like="slider-crank-150-coupled", description="Loads spread over its rod and its crank",
    loads=dict(on_rod='spread_on = "rod", direction = [0, -1], value = "1 N/m"',
               on_crank='spread_on = "crank", direction = [0, -1], value = "1 N/m"'),
)


@pytest.fixture(scope="module")
def rod() -> Shapes:
    """Shapes of the elastic rod of a slider-crank."""
    system, _ = build_system(read_scene("slider-crank-150-coupled"), lambda stage: None, 3)
    return system.shapes["rod"]


def test_the_weight_of_a_rod_is_a_load_spread_over_it(rod):
    """rho A g along the rod, foreshortened as it is, against mass times gravity in the body's kernel."""
    blocks, own = Blocks(rod.link.mechanism, {}), rod.link.body
    q = np.random.default_rng(4).standard_normal(rod.count) * 1e-2
    gravity, none = np.array([3.0, -9.81]), np.zeros(len(q))
    c, s = np.cos(0.7), np.sin(0.7)
    p, weight = blocks.body("rod", rod), np.zeros(3 + len(q))
    force = own.rho_A * own.length / 2 * gravity
    for weights in ((1.0, 0.0), (0.0, 1.0)):
        share, x, rows, G = rod.spread(*weights)
        x, numbers = x / share, blocks.station(rod, rows / share, G / share)
        twists = np.zeros(3 * len(q))
        moved = shapes.displace(numbers, 0, len(q), q, 0, twists, 0)
        along, across = c * force[0] + s * force[1], c * force[1] - s * force[0]
        moment = across * (x + moved[0]) - along * moved[1]
        weight += [*force, moment, *(twists.reshape(-1, 3)[:, :2] @ [along, across])]
    held, stiffness = np.zeros((2, 3 + len(q)))
    g = c * gravity[0] + s * gravity[1], c * gravity[1] - s * gravity[0]
    for motion, out in (((0.0, -g[0], -g[1], 0.0), held), (np.zeros(4), stiffness)):
        joints.demand(p, 0, motion, 0, out, 0)
        shapes.shaped_demand(p, len(joints.BODY), len(q), motion, 0, q, none, none, 0, out, 0, out[3:])
        out[:2] = c * out[0] - s * out[1], s * out[0] + c * out[1]
    terms = abs(held) + abs(stiffness)
    assert (abs(weight + held - stiffness) <= 1e-12 * terms.max()).all()
    assert weight[:2] == pytest.approx(own.mass * gravity, rel=1e-12)


def test_sections_of_loads_spread_over_rigid_and_elastic_bodies(rod):
    scene = scene_of(LOADED)
    length, blocks = scene.bodies["crank"].length, Blocks(mechanism_of(scene), {"rod": lambda held, freed: rod})
    sections = build_tables(blocks).sections
    assert {Side("crank", (k * length / 3, 0.0, 0.0)) for k in (1, 2)} <= {*sections}
    middle = blocks.station(rod, *rod.at((scene.bodies["rod"].length / 2, 0.0, 0.0)))
    axial, transverse = rod.counts
    assert middle[0] == axial
    assert len(middle) == 1 + axial + transverse * (2 + transverse)


# ---- compiling ----------------------------------------------------------------------------------------------------


def test_bodies_of_all_numbers_of_shapes_share_the_compiled_kernels(tmp_path):
    """One compilation serves them all, and a second process reads it."""
    code = """
import numpy as np
from kaneflex.generated import shapes
from kaneflex.multibody.model.body_parameters import point_numbers
for counts in ((1, 2), (2, 1)):
    out, rows, shortening = np.zeros(9), np.zeros((3, 3)), -np.ones((3, 3))
    rows[0, : counts[0]] = rows[1:, counts[0] :] = 1.0
    shapes.displace(point_numbers(counts[0], rows, shortening), 0, 3, np.ones(3), 0, out, 0)
    print(sum(shapes.displace.stats.cache_misses.values()), *out)
"""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True).stdout
        for _ in range(2)
    ]
    first, second = ([line.split(maxsplit=1) for line in text.splitlines()] for text in said)
    assert [compiled for compiled, _ in first] == ["1", "1"]
    assert [compiled for compiled, _ in second] == ["0", "0"]
    bent, straight = "-2.0 1.0 1.0", "1.0 0.0 0.0"
    expected = [f"{straight} {bent} {bent}", f"{straight} {straight} -1.0 1.0 1.0"]
    assert [out for _, out in first] == [out for _, out in second] == expected
