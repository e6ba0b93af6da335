"""Random linkages of a handful of structures: they close, balance, and don't care in which order they were written."""

import re

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from newton_euler import imbalance, place, turned
from scipy.linalg import eigvalsh

from kaneflex import Model, Scene, load, scene_of
from kaneflex.mechanism.rigid_motion import RigidKinematics, RigidMotion
from kaneflex.multibody.model.module_loading import bind_parameters, find_module

# Without shrinking: a first failure already names its numbers, and to shrink would mean to solve hundreds more.
some = settings(
    max_examples=8, deadline=None, derandomize=True, phases=[Phase.generate], suppress_health_check=list(HealthCheck)
)

FOUR_BAR = {
    "bodies": ["crank", "coupler", "rocker"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]',
        "pin": 'revolute = ["crank.end", "coupler.start"]',
        "knee": 'revolute = ["coupler.end", "rocker.end"]',
        "foot": 'revolute = ["ground.pivot", "rocker.start"], branch = "{branch}"',
    },
}
SLIDER_CRANK = {
    "bodies": ["crank", "rod", "piston"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]',
        "pin": 'revolute = ["crank.end", "rod.start"]',
        "wrist": 'revolute = ["rod.end", "piston"]',
        "bore": 'prismatic = ["ground.pivot", "piston"], direction = [{c!r}, {s!r}], branch = "{branch}"',
    },
}
LEVER = {
    "bodies": ["crank", "block", "lever"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]',
        "pin": 'revolute = ["crank.end", "block"]',
        "foot": 'revolute = ["ground.pivot", "lever.start"]',
        "slide": 'prismatic = ["lever.start", "block"], direction = [{c!r}, {s!r}], branch = "{branch}"',
    },
}
CHAIN = {
    "bodies": ["crank", "arm", "hand"],
    "joints": {
        "main": 'revolute = ["ground", "crank.start"]', "elbow": 'revolute = ["crank.end", "arm.start"]',
        "wrist": 'revolute = ["arm.end", "hand.start"]',
    },
}


def number(low: float, high: float):
    """Never zero: numbers that are exactly zero make a structure of their own, which would be derived anew."""
    return st.floats(low, high, allow_subnormal=False).filter(lambda x: abs(x) > 1e-9)


@st.composite
def linkage(draw, kind: dict) -> dict:
    """Numbers of a linkage that turns through: lengths by Grashof's rule, or long enough."""
    r = draw(number(0.02, 0.08))
    numbers = {"lengths": {}, "pivot": (0.0, 0.0), "branch": draw(st.sampled_from("+-"))}
    angle = draw(number(-1.0, 1.0))
    numbers |= {"c": float(np.cos(angle)), "s": float(np.sin(angle))}
    if kind is FOUR_BAR:  # shortest + longest < the other two
        l, q = draw(number(2.0, 3.0)) * r, draw(number(2.0, 3.0)) * r
        d = draw(number(abs(l - q) / r + 1.2, (l + q) / r - 1.2)) * r
        numbers |= {"lengths": {"crank": r, "coupler": l, "rocker": q}, "pivot": (0.8 * d, 0.6 * d)}
    elif kind is SLIDER_CRANK:
        offset = draw(number(-0.5, 0.5)) * r
        numbers["lengths"] = {"crank": r, "rod": draw(number(1.8, 5.0)) * r}
        numbers["pivot"] = (-numbers["s"] * offset, numbers["c"] * offset)
    elif kind is LEVER:
        d = draw(number(1.3, 4.0)) * r
        numbers |= {"lengths": {"crank": r, "lever": 2 * r}, "pivot": (0.6 * d, -0.8 * d)}
    else:
        numbers["lengths"] = {name: r * draw(number(0.5, 3.0)) for name in kind["bodies"]}
        numbers["relative"] = {name: draw(number(-30.0, 30.0)) for name in ("elbow", "wrist")}
    numbers["bodies"] = {
        name: {
            "mass": draw(number(0.1, 3.0)), "inertia": draw(number(1e-6, 1e-3)),
            "centre": (draw(number(-0.05, 0.1)), draw(number(-0.03, 0.03))),
        }
        for name in kind["bodies"]
    }
    numbers["speed"] = draw(number(1.0, 60.0)) * draw(st.sampled_from([-1, 1]))
    numbers["gravity"] = (draw(number(-10.0, 10.0)), draw(number(-10.0, 10.0)))
    numbers["force"] = draw(number(-500.0, 500.0))
    return numbers


def written(kind: dict, numbers: dict, backwards: bool = False) -> str:
    """The scene; `backwards` lists bodies in the opposite order, and joints as far as the loop stays the same one."""
    names = kind["bodies"][::-1] if backwards else kind["bodies"]
    gravity, (x, y) = list(numbers["gravity"]), numbers["pivot"]
    lines = ["schema = 1", f"gravity = {gravity}", f"ground = {{pivot = [{x!r}, {y!r}]}}"]
    for name in names:
        body = numbers["bodies"][name]
        lines += [f"[bodies.{name}]", f"mass = {body['mass']!r}", f"inertia = {body['inertia']!r}"]
        lines += [f"centre = [{body['centre'][0]!r}, {body['centre'][1]!r}]"]
        if name in numbers["lengths"]:
            lines += [f"length = {numbers['lengths'][name]!r}"]
    joints = {name: text.format(**numbers) for name, text in kind["joints"].items()}
    order = [*list(joints)[:-1][::-1], list(joints)[-1]] if backwards else list(joints)
    lines += ["[joints]", *(f"{name} = {{{joints[name]}}}" for name in order)]
    lines += ["[drives]", f"main = {{speed = {numbers['speed']!r}}}"]
    lines += [f"{name} = {{speed = {speed!r}}}" for name, speed in numbers.get("relative", {}).items()]
    last, force = kind["bodies"][-1], numbers["force"]
    lines += ["[loads]", f'push = {{force_on = "{last}", direction = [0.6, 0.8], value = {force!r}}}']
    lines += ["[solve]", 'preset = "rigid"', 'duration = "1 s"']
    return "\n".join(lines) + "\n"


def turning(text: str) -> tuple[Scene, RigidMotion]:
    """A turn of the first drive in steps of 3 degrees."""
    scene = scene_of(text)
    module, _ = find_module(scene, lambda stage: None)
    times = np.radians(np.arange(0, 360, 3)) / abs(next(iter(scene.drives.values())).speed)
    return scene, RigidKinematics(module, bind_parameters(scene, module)).at(times)


KINDS = {"four-bar": FOUR_BAR, "slider-crank": SLIDER_CRANK, "lever": LEVER, "chain": CHAIN}


def check_closed(scene: Scene, rigid: RigidMotion) -> None:
    size = max(np.abs(rigid[f"{body}.{axis}"]).max() for body in scene.bodies for axis in "xy")
    size = max(size, *(body.length or 0.0 for body in scene.bodies.values()))
    for name, joint in scene.joints.items():
        first, second = joint.addresses
        apart = place(scene, rigid, second) - place(scene, rigid, first)
        if joint.kind == "revolute":
            assert np.abs(apart).max() < 1e-12 * size, name
        else:
            t = turned(rigid, first.body, joint.direction)
            assert np.abs(t[0] * apart[1] - t[1] * apart[0]).max() < 1e-12 * size, name


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_random_linkages_close_and_balance(kind):
    @some
    @given(linkage(kind))
    def check(numbers: dict) -> None:
        scene, rigid = turning(written(kind, numbers))
        assert np.isfinite(rigid.values).all()
        check_closed(scene, rigid)
        assert imbalance(scene, rigid) < 1e-10

    check()


def renamed(kind: dict, text: str) -> str:
    """The same linkage under names that sort the other way round."""
    names = {}
    for group in (kind["bodies"], list(kind["joints"])):
        names |= {name: f"{'zyxw'[k]}_{name}" for k, name in enumerate(group)}
    return re.sub(rf"\b({'|'.join(names)})\b", lambda found: names[found[0]], text)


def agree(one: RigidMotion, other: RigidMotion, names: dict[str, str]) -> None:
    """Every scalar of one motion is that of the other under its new name, to a share of the largest of its kind."""
    unit = {name: unit for name, unit, _ in one.motion.module.SCALARS}
    assert len(unit) == len(other.motion.module.SCALARS)
    for name in unit:
        owner, dot, rest = name.partition(".")
        same = names.get(owner, owner) + dot + rest
        largest = max(np.abs(one[like]).max() for like in unit if unit[like] == unit[name])
        worst = np.abs(one[name] - other[same]).max()
        assert worst <= 1e-10 * largest, name


@pytest.mark.exhaustive(share=2)
@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_names_change_no_bit_and_the_order_of_bodies_and_joints_no_number(kind):
    """The equations are derived in the file's order: another one rounds otherwise, other names do not."""

    @some
    @given(linkage(kind))
    def check(numbers: dict) -> None:
        text = written(kind, numbers)
        _, one = turning(text)
        _, listed = turning(written(kind, numbers, backwards=True))
        agree(one, listed, {})
        _, other = turning(renamed(kind, text))
        assert other.motion.module.STRUCTURE != one.motion.module.STRUCTURE
        assert np.array_equal(other.values, one.values)

    check()


# ---- elastic links -----------------------------------------------------------------------------------------------


@st.composite
def sections(draw) -> tuple[float, float, float, int]:
    """Length [m], A [m^2], I [m^4] and number of elements of a steel link."""
    length, height = draw(number(0.1, 2.0)), draw(number(0.005, 0.05))
    width = draw(number(0.005, 0.05))
    return length, width * height, width * height**3 / 12, draw(st.integers(1, 8))


def arm(section: tuple[float, float, float, int], speed: float) -> Model:
    """A turning steel link with a load at its end; another one hangs from it."""
    length, A, I, elements = section
    beam = f'length = {length!r}, beam = {{material = "steel", A = {A!r}, I = {I!r}, elements = {elements}}}'
    return load(scene_of(f"""
schema = 1
bodies = {{upper = {{{beam}}}, lower = {{like = 'upper'}}}}
joints = {{main = {{revolute = ['ground', 'upper.start']}}, elbow = {{revolute = ['upper.end', 'lower.start']}}}}
drives = {{main = {{speed = {speed!r}}}, elbow = {{law = '0.5 * sin(3 * t)'}}}}
masses.load = {{at = 'lower.end', mass = 0.3}}
solve.duration = 1
"""))


@some
@given(section=sections(), speed=number(-50.0, 50.0), t=number(0.0, 10.0))
def test_matrices_of_random_elastic_arms(section, speed, t):
    """M and K_s positive definite; in a link's own axes C_d is skew, and a rigid displacement costs nothing."""
    found = arm(section, speed)
    M, K = found.M(t), found.K_s(t)
    assert np.abs(M - M.T).max() <= 1e-13 * np.abs(M).max() and np.abs(K - K.T).max() <= 1e-13 * np.abs(K).max()
    scale = 1 / np.sqrt(np.diag(M))
    assert eigvalsh(M * scale[:, None] * scale).min() > 1e-9
    assert eigvalsh(K, M)[0] > 0
    scalars = {name: found.motion.at(t)[name][0] for name in found.motion.column}
    for link in found.links.values():
        matrices = {key: link.part.matrices[key].value(scalars) for key in ("C_d", "K_s", "M")}
        C = matrices["C_d"]
        assert np.abs(C).max() > 0 or scalars[f"{link.name}.omega"] == 0
        assert np.abs(C + C.T).max() <= 1e-13 * np.abs(C).max()
        assert eigvalsh(matrices["M"])[0] > 0
        shift = np.zeros((link.part.size, 3))
        for k, x in enumerate(link.nodes):
            shift[3 * k : 3 * k + 3] = [[1, 0, 0], [0, 1, x], [0, 0, 1]]
        K_s = matrices["K_s"]
        size = np.abs(K_s) @ np.abs(shift)
        assert (np.abs(K_s @ shift) <= 1e-12 * size.max(axis=0)).all()
