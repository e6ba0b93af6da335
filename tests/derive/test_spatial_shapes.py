"""Shapes of a body in space: energy has an integral, sections turn as their angles say, pinned rods bent far."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import sympy as sm
from interpreted import interpreted
from scipy.spatial.transform import Rotation

from kaneflex.derive.bodies.kane import ACCEL, EPSILON, OMEGA, coordinates, shaped_equations
from kaneflex.fem.links import make_link
from kaneflex.generated import spatial, spatial_shapes
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.model.shape_bases import spatial_shapes as built_shapes
from kaneflex.scene import scene_of

spatial, spatial_shapes = interpreted(spatial), interpreted(spatial_shapes)


def test_what_forces_do_is_the_change_of_kinetic_energy():
    """u.(-fr*) = d/dt (u.M u / 2) along any motion: what the truncation keeps is a mechanical system."""
    equations = shaped_equations(2)
    q, rates, accelerations = zip(*map(coordinates, range(2)), strict=True)
    v = sm.symbols("v_x v_y v_z")
    M, u = equations.jacobian([*ACCEL, *EPSILON, *accelerations]), sm.Matrix([*v, *OMEGA, *rates])
    energy = (u.T * M * u)[0] / 2
    of_v = sm.Matrix(ACCEL) - sm.Matrix(OMEGA).cross(sm.Matrix(v))
    motion = zip([*v, *OMEGA, *rates, *q], [*of_v, *EPSILON, *accelerations, *rates], strict=True)
    change = sum(energy.diff(x) * rate for x, rate in motion)
    assert sm.expand((u.T * equations)[0] - change) == 0
    assert (M - M.T).expand() == sm.zeros(8, 8)


def test_a_section_turns_as_its_axes_say():
    """R is a rotation, R' R^T the cross product with T theta', and T' theta' its rate but for T theta''."""
    theta, rate, h = np.array([0.3, -0.7, 0.5]), np.array([0.9, 0.4, -1.1]), 1e-6
    found = np.zeros((3, 21))
    for k, at in enumerate((theta - h * rate, theta, theta + h * rate)):
        spatial_shapes.section(np.concatenate([at, rate]), 0, found[k], 0)
    R, T, gamma = found[1, :9].reshape(3, 3), found[:, 9:18].reshape(3, 3, 3), found[1, 18:]
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-15) and np.linalg.det(R) > 0.0
    spin = (found[2, :9] - found[0, :9]).reshape(3, 3) / (2 * h) @ R.T
    omega = T[1] @ rate
    assert np.allclose([spin[2, 1], spin[0, 2], spin[1, 0]], omega, atol=1e-8)
    assert np.allclose((T[2] - T[0]) @ rate / (2 * h), gamma, atol=1e-8)
    slope = R[:, 0]  # bending turns the axis by the shortest way, whatever the twist
    spatial_shapes.section(np.concatenate([[0.0], theta[1:], rate]), 0, found[0], 0)
    assert np.allclose(found[0, [0, 3, 6]], slope, atol=1e-15)


@pytest.mark.parametrize("far", [0.0, 0.01, 1.0, 2.0])
def test_a_section_rotates_by_its_angles_as_in_the_plane(far):
    """By the rotation vector (0, theta_y, theta_z), then by theta_x: SciPy's rotations."""
    theta, found = far * np.array([0.5, 0.6, -0.8]), np.zeros(21)
    spatial_shapes.section(np.concatenate([theta, np.zeros(3)]), 0, found, 0)
    expected = Rotation.from_rotvec([0.0, *theta[1:]]) * Rotation.from_rotvec([theta[0], 0.0, 0.0])
    assert np.allclose(found[:9].reshape(3, 3), expected.as_matrix(), atol=1e-13)


# ---- the fibres of a section that turns ---------------------------------------------------------------------------

SHAFT = """
schema = 1
gravity = [0, 0, 0]
bodies.disc = {mass = "1 kg", inertia = [0.01, 0.01, 0.01]}
bodies.shaft.length = "0.6 m"
bodies.shaft.beam = {material = "steel", section = {rectangle = ["60 mm", "90 mm"]}, theory = "rayleigh", elements = 3}
joints.foot = {weld = ["ground", "shaft.start"]}
joints.tip = {weld = ["shaft.end", "disc"]}
solve = {preset = "coupled", duration = "1 ms"}
"""


def test_the_largest_displacement_of_a_shape_is_one():
    """Of twist the rotation is; positive, so that the sign of a shape does not depend on the solver of the modes."""
    scene = scene_of(SHAFT)
    found = built_shapes(make_link(mechanism_of(scene), "shaft", 3), 2, (0.0, 0.0, 0.0))
    moved = found.basis.reshape(-1, 6, found.count)[:, :4]
    assert moved.max(axis=(0, 1)) == pytest.approx(np.ones(found.count), abs=1e-12)
    assert abs(moved).max() == pytest.approx(1.0, abs=1e-12)


def test_fibres_of_a_thick_section_go_where_its_rotation_takes_them():
    """Integral of y G and z G dm: the second derivatives of the rotation R(theta), by differences, over y^2 and z^2."""
    scene = scene_of(SHAFT)
    link = make_link(mechanism_of(scene), "shaft", 3)
    found = built_shapes(link, 1, (0.0, 0.0, 0.0))
    h, R = 1e-3, {}
    for theta in itertools.product((-1, 0, 1), repeat=3):
        out = np.zeros(21)
        spatial_shapes.section(np.concatenate([h * np.array(theta), np.zeros(3)]), 0, out, 0)
        R[theta] = out[:9].reshape(3, 3)
    one = np.eye(3, dtype=int)
    at = [[sum(s * t * R[tuple(np.clip(s * a + t * b, -1, 1))] for s in (1, -1) for t in (1, -1)) / (4 * h**2)
           for b in one] for a in one]  # fmt: skip
    for a in range(3):
        at[a][a] = (R[tuple(one[a])] - 2 * R[0, 0, 0] + R[tuple(-one[a])]) / h**2
    second = np.array(at)
    places, weights = np.polynomial.legendre.leggauss(4)
    expected = np.zeros((2, 3, found.count, found.count))
    for begin, end in itertools.pairwise(link.nodes):
        for place, weight in zip(places, weights, strict=True):
            rows, _ = found.at(((begin + end) / 2 + (end - begin) / 2 * place, 0.0, 0.0))
            dm = 7850 * (end - begin) / 2 * weight
            for k, I in enumerate((0.09 * 0.06**3 / 12, 0.06 * 0.09**3 / 12)):  # of y^2 dA and z^2 dA [m^4]
                expected[k] += dm * I * np.einsum("abi,aj,bl->ijl", second[..., k + 1], rows[3:], rows[3:])
    assert abs(expected).max(axis=(2, 3)).min() > 1e-7
    assert found.moments.r_G[1:] == pytest.approx(expected, rel=1e-5, abs=1e-6 * abs(expected).max())


@pytest.mark.parametrize(("theory", "freed"), [("rayleigh", ""), ("euler-bernoulli", "xyz")])
def test_kinds_of_a_beam_are_what_any_shapes_are(theory, freed):
    """Kernels of a thick link by its kinds, and by the same shapes as those of any body, without the products of third
    order of a pinned link."""
    scene = scene_of(SHAFT.replace("rayleigh", theory))
    link = make_link(mechanism_of(scene), "shaft", 3)
    found, values = built_shapes(link, 2, (0.0, 0.0, 0.0), freed), []
    assert len(found.counts) == 4 and min(found.counts) > 0
    count, random = found.count, np.random.default_rng(5)
    q, v, b, w = random.normal(size=count), random.normal(size=count), random.normal(size=count), random.normal(size=9)
    damping = random.normal(size=(count, count))
    kinds = np.repeat(np.arange(4), found.counts)
    damping *= np.equal.outer(kinds, kinds)
    moments, room = replace(found.moments, line=None), np.zeros(2 * count)
    for counts in (found.counts, (0, 0, 0, 0)):
        p = moments.numbers(counts, found.stiffness, damping, found.cubic)
        demand, matrix = np.zeros(6 + count), np.zeros((6 + count) ** 2)
        spatial_shapes.shaped_demand(p, 0, count, w, 0, q, v, b, 0, demand, 0, demand[6:], room, 0)
        spatial_shapes.shaped_inertia(p, 0, count, q, 0, matrix, 0, room, 0)
        values.append((demand, spatial_shapes.shaped_strain(p, 0, count, q, 0), matrix))
    for own, other in zip(*values, strict=True):
        np.testing.assert_allclose(own, other, rtol=1e-12, atol=1e-13 * np.abs(other).max())


# ---- a pinned rod that is bent far ---------------------------------------------------------------------------------

ROD = SHAFT.replace('["60 mm", "90 mm"]', '["3 mm", "5 mm"]').replace("elements = 3", "elements = 8")
"""Radii of gyration of its section: 0.87 and 1.4 mm."""


def pinned_rod(theory, place):
    """Shapes of a thin rod with a pin about z at a place, four modes in either plane."""
    name, sides = ("tip", '"shaft.end", "disc"') if place else ("foot", '"ground", "shaft.start"')
    pinned = f"{name} = {{revolute = [{sides}], axis = [0, 0, 1]}}"
    text = ROD.replace(f"{name} = {{weld = [{sides}]}}", pinned) + f"drives.{name}.free = true\n"
    scene = scene_of(text.replace("rayleigh", theory))
    return built_shapes(make_link(mechanism_of(scene), "shaft", 8), 4, (place, 0.0, 0.0), "z")


def mass_matrix(shapes, q):
    """Mass matrix of a rod at q by the kernels, (6 + count, 6 + count)."""
    count, mass = shapes.count, 7850 * 0.6 * 0.003 * 0.005
    of_section = np.array([0.003**2 + 0.005**2, 0.005**2, 0.003**2]) * mass / 12
    J = of_section + mass * 0.6**2 / 12 * np.array([0, 1, 1])
    p = np.concatenate([[mass, 0.3, 0.0, 0.0, *J, 0.0, 0.0, 0.0], shapes.numbers()])
    matrix, room = np.zeros(36 + 6 * count + count**2), np.zeros(2 * count)
    spatial.inertia(p, 0, matrix, 0)
    spatial_shapes.shaped_inertia(p, 10, count, q, 0, matrix, 0, room, 0)
    E = matrix[36 : 36 + 6 * count].reshape(count, 6).T
    return np.block([[matrix[:36].reshape(6, 6), E], [E.T, matrix[36 + 6 * count :].reshape(count, count)]])


def least(shapes, q):
    """Smallest eigenvalue of the mass matrix, all of its diagonal entries being one."""
    M = mass_matrix(shapes, q)
    scale = 1.0 / np.sqrt(np.diag(M))
    return np.linalg.eigvalsh(scale[:, None] * M * scale)[0]


@pytest.mark.parametrize("theory", ["euler-bernoulli", "rayleigh"])
@pytest.mark.parametrize("place", [0.0, 0.6])
def test_the_mass_matrix_of_a_pinned_rod_bent_far_is_positive_definite(theory, place):
    """At ten radii of gyration; to the second order it is not, as a rotation of the axes that bending undoes moves
    hardly any mass."""
    shapes = pinned_rod(theory, place)
    straight, bent = np.zeros(shapes.count), np.eye(shapes.count)[shapes.counts[0]] * 0.01
    assert least(shapes, bent) > 0.5 * least(shapes, straight) > 0.0
