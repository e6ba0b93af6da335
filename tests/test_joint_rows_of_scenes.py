"""The kernels of joints against the written-out constraints of the shipped coupled scenes, at states of no motion."""

import numpy as np
import pytest

from kaneflex.generated import joints
from kaneflex.generated.body import kernels
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.multibody.system import build_system
from kaneflex.scene import read_scene, shipped_scenes

SCENES = [name for name in sorted(shipped_scenes()) if read_scene(name).solve.preset == "coupled"]


class Sections:
    """Sections of bodies by the body kernels, with the numbers of a bound coupled module."""

    def __init__(self, system, q, v, a):
        self.system, self.q, self.v, self.a = system, q, v, a
        self.number = dict(zip((path for path, _ in system.module.PARAMETERS), system.parameters, strict=False))

    def block(self, point):
        """The body kernels' numbers of a point."""
        axial, transverse = self.system.module.BODIES[point.body]
        path = f"bodies.{point.body}.points.{point.name}"
        start = self.number.get(f"{path}.X", point.at[0])
        block = [1.0, start, point.at[1], *(self.number.get(f"{path}.s_{k}", 0.0) for k in range(axial))]
        for shape in ("w", "psi"):
            block += [self.number.get(f"{path}.{shape}_{k}", 0.0) for k in range(transverse)]
        pairs = [(min(j, k), max(j, k)) for j in range(transverse) for k in range(transverse)]
        return np.array([*block, *(self.number.get(f"{path}.H_{j}_{k}", 0.0) for j, k in pairs)])

    def state(self, point):
        """The nine numbers of a section, and its twist by all speeds, (3, n)."""
        W = np.zeros((3, len(self.q)))
        if point.body == "ground":
            return np.array([*point.at, *[0.0] * 7]), W
        at, (axial, transverse) = self.system.start[point.body], self.system.module.BODIES[point.body]
        body, block, i, n = kernels(axial, transverse), self.block(point), at + 3, 3 + axial + transverse
        (x, y, phi), V, A = (each[at : at + 3] for each in (self.q, self.v, self.a))
        c, s = np.cos(phi), np.sin(phi)
        inside, own = np.zeros(9), np.zeros(3 * n)
        body.deform.py_func(block, 0, self.q, self.v, self.a, i, inside, 0)
        body.jacobian.py_func(block, 0, self.q, i, c, s, own, 0)
        W[:, at : at + n] = own.reshape(3, n)
        (r, turn), (r_1, turn_1), (r_2, turn_2) = ((inside[k : k + 2], inside[k + 2]) for k in (0, 3, 6))
        R, S, omega = np.array([[c, -s], [s, c]]), np.array([[0.0, -1.0], [1.0, 0.0]]), V[2]
        place = [x, y] + R @ r
        velocity = V[:2] + R @ (omega * S @ r + r_1)
        acceleration = A[:2] + R @ (A[2] * S @ r - omega**2 * r + 2 * omega * S @ r_1 + r_2)
        return np.array([*place, phi + turn, *velocity, omega + turn_1, *acceleration, A[2] + turn_2]), W


@pytest.mark.parametrize("name", SCENES)
def test_rows_are_the_written_out_constraints(name):
    """g, G, and G q'' + gamma, of joints and prescribed drives, in their order."""
    scene = read_scene(name)
    system, _ = build_system(scene, lambda stage: None)
    n, m, rng, t = system.size, len(system.constraints), np.random.default_rng(8), 0.013
    q, v, a = rng.normal(size=n), rng.normal(size=n), rng.normal(size=n)
    for body, (axial, transverse) in system.module.BODIES.items():  # deformations of some share of the bodies' size
        q[system.modal(body)] *= 1e-2 if axial + transverse else 1.0
    g, g_t, G, gamma = np.zeros(m), np.zeros(m), np.zeros((m, n)), np.zeros(m)
    system.module.constraints.py_func(t, q, v, system.parameters, g, g_t, G, gamma)
    mechanism, found = mechanism_of(scene), []
    sections = Sections(system, q, v, a)
    prescribed = [mechanism.joints[name] for name, drive in mechanism.drives.items() if not drive.free]
    held = [(joint, joint.kind) for joint in mechanism.joints.values()]
    held += [(joint, "slide" if joint.slides else "turn") for joint in prescribed]
    for joint, kind in held:
        (first, W_1), (second, W_2) = (sections.state(side) for side in joint.sides)
        out = np.zeros(9 * joints.ROWS[kind])
        numbers = (float(number) for number in (*joint.direction, joint.angle))
        getattr(joints, kind)(np.concatenate([first, second]), 0, 1, *numbers, out, 0)
        found += [(row[0], row[1], row[2], row[3:6] @ W_1 + row[6:] @ W_2) for row in out.reshape(-1, 9)]
    residual, rate, second_rate, jacobian = (np.array(entries) for entries in zip(*found, strict=True))
    joined = m - len(prescribed)
    assert residual[:joined] == pytest.approx(g[:joined], abs=1e-13)  # less their courses those of the drives, too
    assert jacobian == pytest.approx(G, abs=1e-13)
    assert rate == pytest.approx(G @ v, abs=1e-12)
    assert second_rate == pytest.approx(G @ a + gamma, abs=1e-12)
