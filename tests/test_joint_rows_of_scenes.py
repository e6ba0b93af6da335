"""The kernels of joints and loads against the written-out equations of the shipped coupled scenes, at any states."""

import numpy as np
import pytest

from kaneflex.derive.multibody_module import generate_multibody
from kaneflex.generated import joints
from kaneflex.generated.body import kernels
from kaneflex.mechanism.floating_frames import shape_counts
from kaneflex.mechanism.joints import drive_reaction, reactions
from kaneflex.mechanism.mechanism import mechanism_of
from kaneflex.mechanism.planar import Pose
from kaneflex.multibody.binding import bind_parameters, import_file
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


def row(sections, joint, kind):
    """The rows of a joint, and their derivatives by all speeds."""
    (first, W_1), (second, W_2) = (sections.state(side) for side in joint.sides)
    out = np.zeros(9 * joints.ROWS[kind])
    numbers = (float(number) for number in (*joint.direction, joint.angle))
    getattr(joints, kind)(np.concatenate([first, second]), 0, 1, *numbers, out, 0)
    return [(*row[:3], row[3:6] @ W_1 + row[6:] @ W_2) for row in out.reshape(-1, 9)]


def state(name):
    scene = read_scene(name)
    system, _ = build_system(scene, lambda stage: None)
    q, v, a = np.random.default_rng(8).normal(size=(3, system.size))
    for body in system.module.BODIES:  # deformations of some share of the bodies' size
        q[system.modal(body)] *= 1e-2
    return scene, Sections(system, q, v, a)


@pytest.mark.parametrize("name", SCENES)
def test_rows_are_the_written_out_constraints(name):
    """g, G, and G q'' + gamma, of joints and prescribed drives, in their order."""
    scene, sections = state(name)
    system, q, v, a = sections.system, sections.q, sections.v, sections.a
    n, m = system.size, len(system.constraints)
    g, g_t, G, gamma = np.zeros(m), np.zeros(m), np.zeros((m, n)), np.zeros(m)
    system.module.constraints.py_func(0.013, q, v, system.parameters, g, g_t, G, gamma)
    mechanism = mechanism_of(scene)
    prescribed = [mechanism.joints[name] for name, drive in mechanism.drives.items() if not drive.free]
    held = [(joint, joint.kind) for joint in mechanism.joints.values()]
    held += [(joint, "slide" if joint.slides else "turn") for joint in prescribed]
    found = [entries for joint, kind in held for entries in row(sections, joint, kind)]
    residual, rate, second_rate, jacobian = (np.array(entries) for entries in zip(*found, strict=True))
    named = [named for joint in mechanism.joints.values() for named in reactions(joint)]
    assert (*named, *map(drive_reaction, prescribed)) == system.module.CONSTRAINTS
    joined = m - len(prescribed)
    assert residual[:joined] == pytest.approx(g[:joined], abs=1e-13)  # less their courses those of the drives, too
    assert jacobian == pytest.approx(G, abs=1e-13)
    assert rate == pytest.approx(G @ v, abs=1e-12)
    assert second_rate == pytest.approx(G @ a + gamma, abs=1e-12)


@pytest.mark.parametrize("name", ["engine-torque-elastic", "four-bar-motor", "spin-up-torque"])
def test_loads_work_as_the_written_out_ones(name, tmp_path):
    """Powers: the sizes by the structure's own module, the rates by the sections' states."""
    scene, sections = state(name)
    system, mechanism, t = sections.system, mechanism_of(scene), 0.013
    energies = np.zeros(3 + len(system.module.LOADS))
    system.module.energy.py_func(t, sections.q, sections.v, system.parameters, energies)
    structure = f"{SCENES.index(name):016x}"
    file = tmp_path / f"{structure}.py"
    file.write_text(generate_multibody(scene, shape_counts(scene), structure))
    module = import_file(file, structure, ("magnitudes",))
    coordinate = {
        name: row(sections, joint, "slide" if joint.slides else "turn")[0] for name, joint in mechanism.joints.items()
    }
    x = np.concatenate([coordinate[drive][:2] for drive in module.DRIVES])
    sizes = np.zeros(len(module.LOADS))
    module.magnitudes(t, x, bind_parameters(scene, module), sizes)
    rates = []
    for load in mechanism.loads.values():
        if load.joint is not None:
            rates.append(coordinate[load.joint][1])
        else:
            nine, _ = sections.state(load.point)
            turned = Pose(0.0, 0.0, np.cos(nine[2]), np.sin(nine[2])).turn(load.direction)
            rates.append(np.dot(load.direction if load.axes == "global" else turned, nine[3:5]))
    assert module.LOADS == system.module.LOADS
    assert sizes * rates == pytest.approx(energies[3:], rel=1e-11)
