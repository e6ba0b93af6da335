"""Kernels of a deforming body: proved against Kane's equations, and compiled ones against slices summed one by one."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from kaneflex import read_scene, scene_of
from kaneflex.derive.bodies.proof import NotKane, comparisons, prove
from kaneflex.generated import body
from kaneflex.multibody.model.body_parameters import Blocks, body_block, point_block
from kaneflex.multibody.model.system import build_system

PRINTED = "@njit" + Path(body.__file__).read_text(encoding="utf-8").partition("@njit")[2]
AXIAL, TRANSVERSE = 2, 3
SHAPES = AXIAL + TRANSVERSE
SIZE = 3 + SHAPES
HOME, AT, ROW = 4, 7, 2
"""Where the body's modal coordinates begin in q, its block in p and its rows in out, behind those of others."""


# ---- the printed text -------------------------------------------------------------------------------------------


def test_every_kernel_is_compared():
    names = {name for name, *_ in comparisons(PRINTED, 1, 1)}
    assert names - {"centre"} == {"displace", "growth", "inverse", "inertia", "energy"}


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize(("right", "wrong"), [
    ("2.0 * H_z_uv * omega_z", "H_z_uv * omega_z"),
    ("xi += v_j * x_vv", "xi -= v_j * x_vv"),
    ("H_z_uq += H_z_l * q[i + l]", "H_z_uq -= H_z_l * q[i + l]"),
    ("xi += 0.5 * q_j * x_vq", "xi += q_j * x_vq"),
    ("range(to_u, to_v)", "range(to_u)"),
    ("m_z += H_z_vq * b_j + H_z_vv * v_j", "pass"),
])  # fmt: skip
def test_a_wrong_kernel_is_not_proved(right, wrong):
    assert right in PRINTED
    with pytest.raises((NotKane, IndexError)):
        prove(PRINTED.replace(right, wrong))


# ---- compiled kernels against slices ------------------------------------------------------------------------------


class Slices:
    """A body of forty slices with shapes drawn by lot: its block, and its motion slice by slice.

    A state is a pair of q = (x, y, phi, b, a) and its rates.
    """

    def __init__(self, shortening: float = 1.0) -> None:
        rng = np.random.default_rng(1)
        self.mass, self.inertia = rng.uniform(0.1, 1.0, 40), rng.uniform(0.01, 0.1, 40)
        self.X = rng.uniform(0.0, 2.0, 40)
        self.s, self.w, self.psi = (rng.standard_normal((40, n)) for n in (AXIAL, TRANSVERSE, TRANSVERSE))
        root = rng.standard_normal((40, TRANSVERSE, TRANSVERSE))
        self.H = shortening * root @ root.transpose(0, 2, 1)
        self.K, root = rng.uniform(1.0, 2.0, SHAPES), rng.standard_normal((SHAPES, SHAPES))
        self.C = root @ root.T

    def p(self) -> np.ndarray:
        m, J, X, s, w, psi, H = self.mass, self.inertia, self.X, self.s, self.w, self.psi, self.H
        arrays = {
            "mass": m.sum(), "mass_X": m @ X, "mass_X_X": m @ X**2, "inertia": J.sum(),
            "mass_s": m @ s, "mass_w": m @ w, "mass_X_s": m * X @ s, "mass_X_w": m * X @ w, "inertia_psi": J @ psi,
            "mass_s_s": m * s.T @ s, "mass_s_w": m * s.T @ w, "mass_w_w": m * w.T @ w,
            "mass_H": np.tensordot(m, H, 1), "mass_X_H": np.tensordot(m * X, H, 1),
            "inertia_psi_psi": J * psi.T @ psi, "stiffness": self.K, "damping": self.C,
        }  # fmt: skip
        return np.concatenate([np.full(AT, np.nan), body_block(arrays, AXIAL, TRANSVERSE)])

    def points(self, slice_: int) -> np.ndarray:
        arrays = {name: getattr(self, name)[slice_] for name in ("X", "s", "w", "psi", "H")}
        return np.concatenate([np.full(AT, np.nan), point_block(arrays, AXIAL, TRANSVERSE)])

    def poses(self, q: np.ndarray) -> np.ndarray:
        """Global x, y and rotation of every section, (40, 3); q may be complex."""
        b, a = q[3 : 3 + AXIAL], q[3 + AXIAL :]
        xi, eta = self.X + self.s @ b - 0.5 * np.einsum("ijk,j,k->i", self.H, a, a), self.w @ a
        c, s = np.cos(q[2]), np.sin(q[2])
        return np.stack([q[0] + c * xi - s * eta, q[1] + s * xi + c * eta, q[2] + self.psi @ a], axis=1)

    def jacobians(self, q: np.ndarray) -> np.ndarray:
        """Their derivatives to q, (40, 3, SIZE), by complex steps."""
        columns = [self.poses(q + 1e-30j * unit).imag / 1e-30 for unit in np.eye(SIZE)]
        return np.stack(columns, axis=2)

    def weights(self) -> np.ndarray:
        return np.stack([self.mass, self.mass, self.inertia], axis=1)


def state(seed: int = 3, size: float = 0.3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(np.random.default_rng(seed).standard_normal((3, SIZE)) * size)


def modal(q: np.ndarray) -> np.ndarray:
    return np.concatenate([np.full(HOME, np.nan), q[3:]])


def inverse(p, q, v, a):
    out = np.zeros(ROW + SHAPES)
    c, s = np.cos(q[2]), np.sin(q[2])
    frame = body.inverse(p, AT, modal(q), modal(v), modal(a), HOME, c, s, v[2], *a[:3], out, ROW)
    assert not out[:ROW].any()
    return np.concatenate([frame, out[ROW:]])


def mass_matrix(p, q):
    return assembled(p, AT, modal(q), HOME, np.cos(q[2]), np.sin(q[2]), SHAPES)


def assembled(p, at, q, home, c, s, shapes):
    """Mass matrix by the speeds of frame and shapes from the kernel's parts."""
    out, coupling = np.full(ROW + (3 + shapes) ** 2, np.nan), ROW + 9
    body.inertia(p, at, q, home, c, s, out, ROW, coupling, coupling + 3 * shapes)
    E = out[coupling : coupling + 3 * shapes].reshape(shapes, 3)
    L = out[coupling + 3 * shapes : coupling + 3 * shapes + shapes**2].reshape(shapes, shapes)
    return np.block([[out[ROW:coupling].reshape(3, 3), E.T], [E, L]])


def energies(p, q, v):
    """Kinetic energy, strain energy, dissipated power, and mass times the centre's place from the start."""
    out = np.zeros(3)
    c, s = np.cos(q[2]), np.sin(q[2])
    centre = body.energy(p, AT, modal(q), modal(v), HOME, c, s, *v[:3], out)
    return *out, np.array(centre)


def elastic(body, q, v):
    return np.concatenate([np.zeros(3), body.K * q[3:] + body.C @ v[3:]])


def assert_equal(found, expected, tolerance=1e-12):
    assert np.abs(found - expected).max() <= tolerance * np.abs(expected).max()


def test_without_foreshortening_the_forces_are_newtons_for_every_slice():
    """Sum of mass times acceleration along each partial velocity; moments up to the second order are then all."""
    slices = Slices(shortening=0.0)
    q, v, a = state()
    step = 1e-5
    turning = (slices.jacobians(q + step * v) @ v - slices.jacobians(q - step * v) @ v) / (2 * step)
    acceleration = slices.jacobians(q) @ a + turning
    newton = np.einsum("ik,ik,ikn->n", slices.weights(), acceleration, slices.jacobians(q))
    assert_equal(inverse(slices.p(), q, v, a), newton + elastic(slices, q, v), 1e-8)


def test_kinetic_energy_is_that_of_the_slices_to_the_second_order():
    """What is left out is of the third order in the deformation and its rate."""
    slices, left = Slices(), []
    q, v, _ = state()
    for share in (1e-3, 5e-4):
        scale = np.array([1.0] * 3 + [share] * SHAPES)
        rates = slices.jacobians(q * scale) @ (v * scale)
        exact = 0.5 * (slices.weights() * rates**2).sum()
        left.append(abs(energies(slices.p(), q * scale, v * scale)[0] - exact))
    assert left[0] < 1e-8 and left[0] / left[1] == pytest.approx(8.0, rel=0.05)


def test_the_kernels_agree_with_each_other():
    """T = u'Mu/2; M is symmetric and what the accelerations add to the forces; strain energy and power of damping."""
    slices, (q, v, a) = Slices(), state()
    p, M = slices.p(), mass_matrix(slices.p(), q)
    assert_equal(M, M.T, 1e-15)
    assert_equal(inverse(p, q, v, a) - inverse(p, q, v, 0 * a), M @ a)
    kinetic, strain, lost, centre = energies(p, q, v)
    assert kinetic == pytest.approx(v @ M @ v / 2, rel=1e-13)
    assert strain == pytest.approx(slices.K @ q[3:] ** 2 / 2, rel=1e-13)
    assert lost == pytest.approx(v[3:] @ slices.C @ v[3:], rel=1e-13)
    assert_equal(centre, [M[1, 2], -M[0, 2]])


def test_power_is_the_rate_of_energy():
    """(M u' - f) u = d(T + V)/dt + dissipation along any path: nothing of f does work but stiffness and damping."""
    slices = Slices()
    p, path = slices.p(), np.random.default_rng(5).standard_normal((4, SIZE)) * [[0.3], [0.5], [0.4], [0.2]]

    def at(t, order):
        return sum(np.prod(range(k, k - order, -1)) * t ** max(k - order, 0) * path[k] for k in range(4))

    def total(t):
        kinetic, strain, *_ = energies(p, at(t, 0), at(t, 1))
        return kinetic + strain

    q, v, a = (at(0.4, order) for order in range(3))
    step = 1e-4
    rate = (8 * (total(0.4 + step) - total(0.4 - step)) - total(0.4 + 2 * step) + total(0.4 - 2 * step)) / (12 * step)
    assert inverse(p, q, v, a) @ v == pytest.approx(rate + energies(p, q, v)[2], rel=1e-9)


def test_a_point_moves_as_its_section():
    """displace and growth against the section's place: its derivatives by complex steps."""
    slices, (q, v, a) = Slices(), state()
    p, n, still = slices.points(11), 11, np.array([0, 0, 0, *[1] * SHAPES])
    q, v, a = q * still, v * still, a * still
    twists, J = np.full(ROW + 3 * SHAPES, np.nan), slices.jacobians(q)[n]
    moved = body.displace(p, AT, modal(q), HOME, twists, ROW)
    assert_equal(twists[ROW:].reshape(SHAPES, 3), J[:, 3:].T)
    assert_equal(np.array(moved), slices.poses(q)[n] - slices.poses(0 * q)[n])

    step = 1e-5
    turning = (slices.jacobians(q + step * v)[n] @ v - slices.jacobians(q - step * v)[n] @ v) / (2 * step)
    assert_equal(np.array([body.growth(p, AT, modal(v), HOME), 0.0, 0.0]), turning, 1e-9)


def test_a_rigid_body_beside_its_axis_is_newtons_and_eulers():
    """Centre at (0.3, -0.2) of a body of 2 kg and 0.5 kg m^2; forces and moment about its start (Shabana 2013, 3.4)."""
    m, J, centre = 2.0, 0.5, np.array([0.3, -0.2])
    p, none = np.array([m, *m * centre, J + m * centre @ centre, 0.0, 0.0]), np.zeros(0)
    phi, omega, epsilon, a_O = 0.7, 3.0, -4.0, np.array([1.5, -9.0])
    c, s = np.cos(phi), np.sin(phi)
    arm = np.array([c * centre[0] - s * centre[1], s * centre[0] + c * centre[1]])
    force = m * (a_O + epsilon * np.array([-arm[1], arm[0]]) - omega**2 * arm)
    found = body.inverse(p, 0, none, none, none, 0, c, s, omega, *a_O, epsilon, none, 0)
    assert_equal(np.array(found), np.array([*force, J * epsilon + arm[0] * force[1] - arm[1] * force[0]]))


# ---- blocks of a scene --------------------------------------------------------------------------------------------


LOADED = """
schema = 1
like = "slider-crank-150-coupled"
description = "Loads spread over its rod and its crank"
loads.on_rod = {spread_on = "rod", direction = [0, -1], value = "1 N/m"}
loads.on_crank = {spread_on = "crank", direction = [0, -1], value = "1 N/m"}
"""


@pytest.fixture(scope="module")
def blocks() -> Blocks:
    """Those of a slider-crank with an elastic rod, with loads spread over rod and crank."""
    system, _ = build_system(read_scene("slider-crank-150-coupled"), lambda stage: None)
    return Blocks(scene_of(LOADED), system.counts, system.shapes)


def test_the_weight_of_a_rod_is_a_load_spread_over_it(blocks):
    """rho A g along the rod, foreshortened as it is, against mass times gravity in the body's kernel."""
    counts = blocks.counts["rod"]
    q = np.random.default_rng(4).standard_normal(sum(counts)) * 1e-2
    gravity, none = np.array([3.0, -9.81]), np.zeros(len(q))
    c, s = np.cos(0.7), np.sin(0.7)
    p, weight = blocks.body("rod"), np.zeros(3 + len(q))
    force = blocks.scene.bodies["rod"].rho_A * blocks.scene.bodies["rod"].length / 2 * gravity
    for half in range(2):
        (x, _), numbers = blocks.point("rod", f"loads.on_rod.{half}")
        twists = np.zeros(3 * len(q))
        moved = body.displace(numbers, 0, q, 0, twists, 0)
        along, across = c * force[0] + s * force[1], c * force[1] - s * force[0]
        moment = across * (x + moved[0]) - along * moved[1]
        weight += [*force, moment, *(twists.reshape(-1, 3)[:, :2] @ [along, across])]
    shapes = np.zeros((2, len(q)))
    held = [*body.inverse(p, 0, q, none, none, 0, c, s, 0.0, *-gravity, 0.0, shapes[0], 0), *shapes[0]]
    stiffness = [*body.inverse(p, 0, q, none, none, 0, c, s, 0.0, 0.0, 0.0, 0.0, shapes[1], 0), *shapes[1]]
    terms = abs(np.array(held)) + abs(np.array(stiffness))
    assert (abs(weight + held - stiffness) <= 1e-12 * terms.max()).all()
    assert weight[:2] == pytest.approx(blocks.scene.bodies["rod"].mass * gravity, rel=1e-12)


def test_points_of_rigid_and_elastic_bodies(blocks):
    bodies = blocks.scene.bodies
    length = bodies["crank"].length
    for name, place in (("end", length), ("loads.on_crank.0", length / 3), ("loads.on_crank.1", 2 * length / 3)):
        at, numbers = blocks.point("crank", name)
        assert at == pytest.approx((place, 0.0), rel=1e-15) and numbers.tolist() == [0.0, 0.0]
    at, middle = blocks.point("rod", "mid")
    assert at == pytest.approx((bodies["rod"].length / 2, 0.0), rel=1e-15)
    axial, transverse = blocks.counts["rod"]
    assert middle[:2].tolist() == [axial, axial + transverse]
    assert len(middle) == 2 + axial + transverse * (2 + transverse)


# ---- compiling ----------------------------------------------------------------------------------------------------


def test_bodies_of_all_numbers_of_shapes_share_the_compiled_kernels(tmp_path):
    """One compilation serves them all, and a second process reads it."""
    code = """
import numpy as np
from kaneflex.generated import body
from kaneflex.multibody.model.body_parameters import point_block
ones = {"X": 0.0, "s": 1.0, "w": 1.0, "psi": 1.0, "H": 1.0}
for counts in ((1, 2), (2, 1)):
    out = np.zeros(9)
    body.displace(point_block(ones, *counts), 0, np.ones(3), 0, out, 0)
    print(sum(body.displace.stats.cache_misses.values()), *out)
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
