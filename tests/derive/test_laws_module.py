"""Modules of drives and loads, which are all that the engine needs of a structure."""

import tomllib

import numpy as np
import pytest
from runs import STENCIL, model, shipped

import kaneflex
from kaneflex.derive.laws.drives_and_loads import generate_laws
from kaneflex.multibody.model.module_loading import bind_parameters, find_laws_module
from kaneflex.scene import read_scene, scene_of, with_settings

SHIPPED = [name for name, scene in shipped().items() if scene.solve.preset == "coupled"]
MOVING = ("engine", "mathieu", "quick-return", "spin-up", "two-link-arm")
"""Constant speeds, spin-ups, laws; constant loads, tables and laws against the time, drives and their speeds."""


def module(name):
    scene = with_settings(read_scene(name), ["solve.preset=coupled"])
    return scene, find_laws_module(scene, lambda stage: None)[0]


@pytest.mark.parametrize("name", SHIPPED)
def test_a_module_is_short_and_the_same_for_all_numbers_of_modes(name):
    few, many = (with_settings(read_scene(name), [f"solve.modes={modes}"]) for modes in (1, 9))
    assert generate_laws(few) == generate_laws(many) and len(generate_laws(few).splitlines()) <= 200
    assert find_laws_module(few, lambda stage: None)[0] is find_laws_module(many, pytest.fail)[0]


def chain(bars):
    """Bars in a row on pins with torsional springs."""
    names = [f"bar_{k}" for k in range(bars)]
    held = zip(["ground", *(f"{name}.end" for name in names)], names, strict=False)
    return "\n".join([
        'schema = 1\ndescription = "Bars on torsional springs"\n[bodies]',
        *(f'{name} = {{length = "25 mm", mass = "10 g", inertia = "1e-6 kg m^2"}}' for name in names),
        "[joints]", *(f'at_{name} = {{revolute = ["{before}", "{name}.start"]}}' for before, name in held),
        "[drives]", *(f"at_{name} = {{free = true}}" for name in names),
        "[springs]", *(f'of_{name} = {{torsional_at = "at_{name}", stiffness = "1 N m/rad"}}' for name in names),
        '[solve]\npreset = "coupled"\nduration = "1 s"\n',
    ])  # fmt: skip


def test_no_kernel_grows_with_the_bodies():
    found = [generate_laws(scene_of(tomllib.loads(chain(bars)))) for bars in (4, 40)]
    few, many = (text[text.index("OPERATIONS = ") :] for text in found)
    assert few == many and "magnitudes" in few


@pytest.mark.parametrize("name", MOVING)
def test_courses_and_magnitudes_are_those_of_the_rigid_motion(name):
    """Coordinates and loads against the rigid module's scalars, speeds and accelerations by differences in time."""
    scene, found = module(name)
    p, motion = bind_parameters(scene, found), model(name).motion
    drives = list(found.DRIVES)
    assert drives == list(scene.drives) and list(found.LOADS) == list(scene.loads)
    h = 1e-3
    for t in (0.0123, 1.7, 14.99):
        course = np.full((9, 3 * len(drives)), 3.5)
        for row, instant in zip(course, t + h * np.arange(-4, 5), strict=True):
            found.courses.py_func(instant, p, row, 0)
        rigid, x = motion.at(t), np.zeros(2 * len(drives))
        for k, (coordinate, speed, acceleration) in enumerate(course[4].reshape(-1, 3)):
            assert coordinate == pytest.approx(rigid[f"{drives[k]}.angle"][0], rel=1e-14)
            assert speed == pytest.approx(STENCIL @ course[:, 3 * k] / h, rel=1e-7, abs=1e-9)
            assert acceleration == pytest.approx(STENCIL @ course[:, 3 * k + 1] / h, rel=1e-7, abs=1e-8)
            x[2 * k : 2 * k + 2] = coordinate, speed
        sizes = np.full(2 + len(found.LOADS), 3.5)
        found.magnitudes.py_func(t, np.append([7.0], x), 1, p, sizes, 1)
        assert sizes[[0, -1]].tolist() == [3.5, 3.5]
        assert sizes[1:-1] == pytest.approx([rigid[load][0] for load in found.LOADS], rel=1e-12)


def test_loads_follow_the_speeds_of_free_drives():
    """The motor's law 170 (1 - omega / 628.3) [N m], and the gas of each cylinder by the crank's angle."""
    scene, found = module("engine-torque")
    p, sizes = bind_parameters(scene, found), np.zeros(len(found.LOADS))
    gas = scene.loads["gas_2"]
    found.magnitudes.py_func(0.0, np.array([gas.offset + gas.curve()[2], 250.0]), 0, p, sizes, 0)
    assert found.DRIVES == {"main": "free"}
    by_name = dict(zip(found.LOADS, sizes, strict=True))
    assert by_name["motor"] == pytest.approx(170.0 * (1.0 - 250.0 / 628.3), rel=1e-14)
    intervals = int(gas.curve()[0])
    assert by_name["gas_2"] == pytest.approx(gas.curve()[2 + intervals + 1], rel=1e-12)  # the first of its values


def test_without_drives_and_loads_nothing_is_stored():
    """By kernels that such structures have in common."""
    _, found = module("elastic-double-pendulum")
    _, other = module("elastic-pendulum")
    assert (found.courses, found.magnitudes) == (other.courses, other.magnitudes)
    p, x, out = np.full(9, 2.5), np.full(9, 2.5), np.full(9, 3.5)
    found.courses(0.1, p, out, 1)
    found.magnitudes(0.1, x, 0, p, out, 1)
    assert (out == 3.5).all()


def test_what_courses_and_magnitudes_would_read_beyond_its_end_is_refused():
    scene, found = module("engine")
    safe, p = kaneflex.checked(found), bind_parameters(scene, found)
    safe.courses(0.0, p, np.zeros(3), 0)
    safe.courses(0.0, p, np.zeros(8), 5)
    with pytest.raises(ValueError, match=r"courses: out has shape \(2,\), at least \(3,\) is required"):
        safe.courses(0.0, p, np.zeros(2), 0)
    with pytest.raises(ValueError, match=r"courses: out has shape \(7,\), at least \(8,\) is required"):
        safe.courses(0.0, p, np.zeros(7), 5)
    with pytest.raises(ValueError, match=r"magnitudes: x has shape \(1,\), at least \(2,\) is required"):
        safe.magnitudes(0.0, np.zeros(1), 0, p, np.zeros(1), 0)
    with pytest.raises(ValueError, match=r"does not hold the whole table of loads.gas.table"):
        safe.magnitudes(0.0, np.zeros(2), 0, p[:-1], np.zeros(1), 0)
