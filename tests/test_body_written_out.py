"""Kernels of bodies as loops against the coupled modules whose equations are written out: the same M and f."""

import numpy as np
import pytest

from kaneflex.generated.body import kernels
from kaneflex.multibody.blocks import body_block
from kaneflex.multibody.inertia_integrals import body_data, body_moments
from kaneflex.multibody.system import build_system
from kaneflex.scene import read_scene, shipped_scenes

SCENES = sorted(name for name in shipped_scenes() if read_scene(name).solve.preset == "coupled")


@pytest.mark.parametrize("name", SCENES)
def test_mass_and_forces_of_every_body_are_those_of_the_module(name):
    """M's diagonal blocks and M a - f; what f has beside them is the loads, by their power, on no modal coordinate."""
    scene = read_scene(name)
    system, _ = build_system(scene, lambda stage: None)
    module, size = system.module, system.size
    modal = [k for body in module.BODIES for k in range(size)[system.modal(body)]]
    q, v, a = np.random.default_rng(2).standard_normal((3, size))
    q[modal] *= 1e-2
    M, f, energy = np.zeros((size, size)), np.zeros(size), np.zeros(3 + len(module.LOADS))
    module.equations(0.0, q, v, system.parameters, M, f)
    module.energy(0.0, q, v, system.parameters, energy)

    blocks, forces, energies = np.zeros((size, size)), np.zeros(size), np.zeros(3)
    potential = 0.0
    for body, (axial, transverse) in module.BODIES.items():
        first, n = system.start[body], 3 + axial + transverse
        moments = body_moments(scene, body, body_data(scene, body, system.links, system.shapes))
        found, p = kernels(axial, transverse), body_block(moments, axial, transverse)
        c, s = np.cos(q[first + 2]), np.sin(q[first + 2])
        block, rigid = np.full(n * n, np.nan), slice(first, first + 3)
        found.inertia(p, 0, q, first + 3, c, s, block, 0)
        blocks[first : first + n, first : first + n] = block.reshape(n, n)
        x, y, epsilon = a[rigid] - [*scene.gravity, 0.0]
        found.inverse(p, 0, q, v, a, first + 3, c, s, v[first + 2], x, y, epsilon, forces, first)
        centre = found.energy(p, 0, q, v, first + 3, c, s, *v[rigid], energies)
        potential -= np.dot(scene.gravity, np.array(centre) + p[0] * q[first : first + 2])

    assert (abs(blocks - M) <= 1e-13 * np.sqrt(np.outer(np.diag(M), np.diag(M)))).all()
    loads = forces - (M @ a - f)
    terms = abs(M) @ abs(a) + abs(f)
    assert (abs(loads) <= 1e-13 * terms)[modal].all()
    assert loads @ v == pytest.approx(energy[3:].sum(), rel=1e-12, abs=1e-13 * terms @ abs(v))
    assert energies[0] == pytest.approx(v @ M @ v / 2, rel=1e-13)
    assert [potential, *energies[1:]] == pytest.approx(energy[:3], rel=1e-13, abs=1e-13)
